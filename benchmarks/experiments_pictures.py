"""Pictures as the papers have them: the model's outlines in white over parts of frames, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.body import part_poses
from ..core.body.motion import Motion
from ..core.cameras.camera import Camera
from ..core.errors import OutputError
from ..core.evidence.rendering.part_geometry import Geometry
from ..core.formats import Landmarks
from ..core.review.overlay import draw_outlines
from ..core.runtime.output_files.files import replacing
from ..core.shot.footage import frames_at
from ..core.shot.shot import Shot, View

Image = NDArray[Any]
Panel = tuple[int, Motion | None, str]
"""A shot frame, the motion whose outlines are drawn, if any, and the words in the corner."""

MARGIN = 1.2
"""Size of a part, relative to the performer's."""
GAP = 4
"""Space between parts, pixels."""
QUALITY = 82
"""Of the JPEG file, up to 100."""
_BACKGROUND = 24
"""Grey level between and beside the parts."""


@dataclass(frozen=True, eq=False)
class Panels:
    """Parts of one view's frames around the shot's only performer, who is where the truth says; all of one size.

    The view is the camera's; without a name it is the first.
    """

    shot: Shot
    truth: Landmarks
    camera: str | None = None

    @property
    def view(self) -> View:
        """The view of the camera; the first one where none is named."""
        named = {view.camera.name: view for view in self.shot.views}
        return named[self.camera] if self.camera is not None else self.shot.views[0]

    @property
    def boxes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Centres (F, 2) of the performer, and the size (2,) of a box that holds him everywhere, pixels."""
        uv = self.view.camera.rectified().project(self.truth.points_world)
        low, high = np.nanmin(uv, axis=1), np.nanmax(uv, axis=1)
        return (low + high) / 2, (high - low).max(axis=0) * MARGIN

    def row(self, panels: Sequence[Panel], height: int, whole: bool = False) -> Image:
        """Panels of some height in pixels, side by side; of the `whole` picture where the performer is not enough."""
        frames = sorted({frame for frame, _, _ in panels})
        images = frames_at(self.view, [self.shot.frames[0] + f for f in frames], 1.0, grey=False)
        pictures = dict(zip(frames, images, strict=True))
        cells = [self._panel(pictures[f], f, motion, words, height=height, whole=whole) for f, motion, words in panels]
        gap = np.full((height, GAP, 3), _BACKGROUND, np.uint8)
        return np.hstack([part for cell in cells for part in (cell, gap)][:-1])

    def _box(self, frame: int, whole: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Corner and size of the part that is shown, pixels."""
        if whole:
            return np.zeros(2), np.array(self.view.camera.size, float)
        centres, size = self.boxes
        return centres[frame] - size / 2, size

    def _panel(self, image: Image, frame: int, motion: Motion | None, words: str, *, height: int, whole: bool) -> Image:
        corner, size = self._box(frame, whole)
        camera = part_of(self.view.camera.rectified(), corner, size, height / size[1])
        shift = camera.matrix @ np.linalg.inv(self.view.camera.matrix)
        cell = cv2.warpAffine(image, shift[:2], camera.size, flags=cv2.INTER_LINEAR, borderValue=(_BACKGROUND,) * 3)
        if motion is not None:
            body = self.shot.performers[0].body
            R, T = (pose[0] for pose in part_poses(body, motion[[frame]]))
            draw_outlines(cell, Geometry.of([body]), camera, frame=frame, R=R, T=T)
        for colour, thickness in (((0, 0, 0), 3), ((255, 255, 255), 1)):
            cv2.putText(cell, words, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.42, colour, thickness, cv2.LINE_AA)
        return cell


def part_of(camera: Camera, corner: NDArray[np.float64], size: NDArray[np.float64], scale: float) -> Camera:
    """Return the camera of a part of a picture, enlarged; its upper left corner and its size in pixels of the whole."""
    K = camera.matrix.copy()
    K[:2, 2] -= corner
    K[:2] *= scale
    width, height = (round(float(n * scale)) for n in size)
    return replace(camera, size=(width, height), matrix=K)


def stacked_rows(rows: Sequence[Image]) -> Image:
    """Rows of pictures one under the other, filled up where one is shorter."""
    width = max(row.shape[1] for row in rows)
    filled = [
        cv2.copyMakeBorder(r, 0, GAP, 0, width - r.shape[1], cv2.BORDER_CONSTANT, value=(_BACKGROUND,) * 3)
        for r in rows
    ]
    return np.vstack(filled)[:-GAP]


def write_jpeg(path: Path, image: Image) -> None:
    """Write a picture, small.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    encoded, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not encoded:
        raise OutputError("the picture cannot be encoded", where=str(path))
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())
