"""The contact sheet: the model's outlines in white over the footage, to see at a glance whether it fits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses, scene_poses
from ..body.motion import Motion
from ..body.time_shift import poses_after
from ..body.unknown_parts import without_hidden_solids
from ..cameras.camera import Camera
from ..errors import OutputError
from ..evidence.rendering.label_images import render_labels
from ..evidence.rendering.part_geometry import Geometry
from ..numerics.arrays import Array, evenly_spaced
from ..numerics.frame_ranges import runs
from ..runtime.output_files.files import replacing
from ..runtime.progress import Progress, report_progress
from ..runtime.threads import worker_count
from ..shot.footage import frames_at
from ..shot.frame_numbers import shown_delay
from ..shot.shot import Shot, View

Image = NDArray[Any]

SHEET_WIDTH = 2400
"""Width of the contact sheet, pixels."""
COLUMNS = 7
"""Number of pictures side by side."""
_MAX_CELL_HEIGHT, _CELL_SPACING = 460, 4  # pixels
_MARGIN = 1.2  # size of a crop, relative to the performers'
_MAX_ZOOM = 1.5
_WHITE, _HIDDEN, _KEY = (255, 255, 255), (150, 150, 150), (0, 215, 255)
_BACKGROUND = 24  # grey level
_SUBPIXEL_BITS = 4
_POINT_SPACING = 1.5  # pixels


def sheet_frames(shot: Shot) -> list[int]:
    """Return up to `COLUMNS` of the key frames and the frames midway between them, counted from the shot's first."""
    frames = keys_and_middles((int(f) for p in shot.performers for f in p.key_poses.frames), shot.length)
    return [frames[i] for i in evenly_spaced(len(frames), COLUMNS)]


def keys_and_middles(keys: Iterable[int], length: int) -> list[int]:
    """Return the first frame, the last one and the key frames, with the frames midway between them."""
    ends = sorted({0, *keys, length - 1})
    return sorted({*ends, *((a + b) // 2 for a, b in pairwise(ends))})


def contact_sheet(
    shot: Shot,
    motions: Sequence[Motion],
    frames: Sequence[int] | None = None,
    progress: Progress | None = None,
    pictures: Sequence[Mapping[int, Image]] | None = None,
    *,
    labelled: bool = True,
) -> Image:
    """Draw some frames of every view, a row each, cropped around the performers.

    Parameters
    ----------
    shot : Shot
    motions : sequence of Motion
        One per performer, a pose for every frame.
    frames : sequence of int, optional
        Counted from the shot's first frame; by default `sheet_frames`.
    progress : callable, optional
    pictures : sequence of mappings, optional
        Per view: the rectified picture of each of these frames (`TrackResult.pictures`); by default the footage is
        read.
    labelled : bool
        Whether each picture shows its camera and frame in the corner, and a border if it is a key frame.

    Returns
    -------
    ndarray of uint8, shape (h, w, 3)
        Blue, green, red; at most `SHEET_WIDTH` wide.

    Raises
    ------
    FootageError
        The footage cannot be read.
    """
    chosen = sheet_frames(shot) if frames is None else sorted(frames)
    bodies = [without_hidden_solids(performer.body, performer.unknown) for performer in shot.performers]
    sheet = _Sheet(shot, chosen, Geometry.of(bodies), labelled)
    poses = [scene_poses(bodies, poses_after(motions, shown_delay(view, shot.settings), chosen)) for view in shot.views]
    rows = []

    def row_of(v: int) -> Image:
        return sheet.row(shot.views[v], poses[v], pictures[v] if pictures else None)

    with ThreadPoolExecutor(worker_count(shot.settings.threads)) as pool:
        for row in pool.map(row_of, range(len(shot.views))):
            rows.append(row)
            report_progress(progress, "overlay", len(rows) / len(shot.views))
    return _stacked(rows)


def picture_cells(
    shot: Shot, motions: Sequence[Motion], frames: Sequence[int], progress: Progress | None = None
) -> list[Image]:
    """Draw frames of a shot's first view one by one, each cropped around the performers, without labels.

    Parameters are those of `contact_sheet`; frames are increasing.
    """
    sheet = contact_sheet(replace(shot, views=shot.views[:1]), motions, frames, progress, labelled=False)
    step = (SHEET_WIDTH + _CELL_SPACING) // max(len(frames), 3)
    return [sheet[:, k * step : (k + 1) * step - _CELL_SPACING] for k in range(len(frames))]


def write_contact_sheet(path: Path, sheet: Image) -> None:
    """Write a contact sheet as a picture.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    encoded, data = cv2.imencode(path.suffix, sheet)
    if not encoded:
        raise OutputError("the picture cannot be encoded", where=str(path))
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())


@dataclass(frozen=True, eq=False)
class _Sheet:
    """What the rows of a contact sheet have in common; frames are counted from the shot's first."""

    shot: Shot
    frames: list[int]
    geometry: Geometry
    labelled: bool

    @property
    def cell_width(self) -> int:
        return (SHEET_WIDTH + _CELL_SPACING) // max(len(self.frames), 3) - _CELL_SPACING

    def row(self, view: View, poses: Poses, pictures: Mapping[int, Image] | None) -> Image:
        """Draw the frames of one view side by side, each cropped to the performers.

        The pictures are read from the footage if they are not given.
        """
        (R, T), shot, frames, width = poses, self.shot, self.frames, self.cell_width
        camera = view.camera.rectified()
        boxes = [_framing(camera, f, self.geometry, R[k], T[k]) for k, f in enumerate(frames)]
        height = round(np.clip(np.max([e[1] / e[0] for _, e in boxes]) * width, 0.7 * width, _MAX_CELL_HEIGHT))
        factors = [max(e[0] / width, e[1] / height, 1 / _MAX_ZOOM) for _, e in boxes]
        images: Iterable[Image]
        if pictures is None:
            numbers, turns = [shot.frames[0] + f for f in frames], view.camera.unzooming(frames)
            images = frames_at(view, numbers, max(min(factors), 1.0), grey=False, turns=turns)
        else:
            images = [pictures[frame] for frame in frames]
        keys = {int(f) for performer in shot.performers for f in performer.key_poses.frames}
        cells = []
        for k, (frame, image) in enumerate(zip(frames, images, strict=True)):
            near = camera.reduced(factors[k])
            shrinks = near.size[0] < image.shape[1]
            enlarged = cv2.resize(image, near.size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC)
            draw_outlines(enlarged, self.geometry, near, frame=frame, R=R[k], T=T[k])
            cell = _cropped(enlarged, boxes[k][0] / factors[k], (width, height))
            if self.labelled:
                _label(cell, view.camera.name, shot.frames[0] + frame, frame in keys)
            cells.append(cell)
        gap = np.full((height, _CELL_SPACING, 3), _BACKGROUND, np.uint8)
        return np.hstack([part for cell in cells for part in (cell, gap)][:-1])


def _framing(camera: Camera, frame: int, geometry: Geometry, R: Array, T: Array) -> tuple[Array, Array]:
    """Return centre and size, pixels, of the part of a picture that contains the performers; all of it if none."""
    size = np.array(camera.size, float)
    owner = geometry.owner
    points = np.einsum("vab,vb->va", R[owner], geometry.vertices) + T[owner]
    pixels = camera.project(points, frame)
    pixels = pixels[np.isfinite(pixels).all(axis=1)]
    inside = pixels[(pixels > -0.2 * size).all(axis=1) & (pixels < 1.2 * size).all(axis=1)]
    if not len(inside):
        return size / 2, size
    box = inside.min(axis=0), inside.max(axis=0)
    return (box[0] + box[1]) / 2, np.maximum((box[1] - box[0]) * _MARGIN, 8.0)


def draw_outlines(image: Image, geometry: Geometry, camera: Camera, *, frame: int, R: Array, T: Array) -> None:
    """Draw the outline of every part into an image: white where it is visible, grey where it is hidden.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w, 3)
        The camera's picture without lens distortion; it is changed.
    R, T : ndarray, shape (P, 3, 3) and (P, 3)
        World poses of the parts on that frame.
    """
    labels = render_labels(geometry, camera, frame, R[None], T[None])
    outlines = []
    for i, (a, b) in enumerate(pairwise(labels.outlines.ends.tolist())):
        if a < b:
            outline = _resampled(labels.outlines.uv[a:b])
            outlines.append((outline, _seen(outline, labels.part[0], i)))
    for outline, seen in outlines:
        _draw_runs(image, outline, ~seen, _HIDDEN)
    for outline, seen in outlines:
        _draw_runs(image, outline, seen, _WHITE)


def _resampled(corners: NDArray[Any]) -> Array:
    """Return points along a closed polygon, `_POINT_SPACING` pixels apart, shape (N, 2)."""
    closed = np.vstack([corners, corners[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0, length[-1], max(8, int(length[-1] / _POINT_SPACING)))
    return np.stack([np.interp(at, length, closed[:, c]) for c in range(2)], axis=1)


def _seen(outline: Array, label: NDArray[np.int16], part: int) -> NDArray[np.bool_]:
    """Return whether the part is the one visible just inside each point of its outline."""
    inward = outline.mean(axis=0) - outline
    inward /= np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-9)
    seen = np.zeros(len(outline), dtype=bool)
    for depth in (0.7, 1.5):
        u, v = np.round(outline + depth * inward).astype(int).T
        within = (u >= 0) & (v >= 0) & (u < label.shape[1]) & (v < label.shape[0])
        seen[within] |= label[v[within], u[within]] == part
    return seen


def _draw_runs(image: Image, outline: Array, mask: NDArray[np.bool_], colour: tuple[int, int, int]) -> None:
    """Draw the pieces of an outline where the mask is True."""
    points = np.round(outline * (1 << _SUBPIXEL_BITS)).astype(np.int32)
    for first, last in runs(mask):
        line = points[first : last + 2]
        cv2.polylines(image, [line], False, colour, 1, cv2.LINE_AA, _SUBPIXEL_BITS)


def _cropped(image: Image, centre: Array, size: tuple[int, int]) -> Image:
    """Return the crop of a size around a centre, shifted to lie in the image; padded with grey if that is smaller."""
    whole = image.shape[1], image.shape[0]
    left, top = (
        round(min(max(c - s / 2, 0), w - s)) if w > s else round((w - s) / 2)
        for c, s, w in zip(centre, size, whole, strict=True)
    )
    shift = np.array([[1.0, 0.0, -left], [0.0, 1.0, -top]])
    dark = (_BACKGROUND,) * 3
    return np.asarray(cv2.warpAffine(image, shift, size, flags=cv2.INTER_NEAREST, borderValue=dark))


def _label(cell: Image, camera: str, frame: int, key: bool) -> None:
    """Write the camera and frame number in the corner, and draw a border around key frames."""
    if key:
        cv2.rectangle(cell, (0, 0), (cell.shape[1] - 1, cell.shape[0] - 1), _KEY, 2)
    text = f"{camera}  {frame}" + ("  key" if key else "")
    for colour, thickness in (((0, 0, 0), 3), (_KEY if key else _WHITE, 1)):
        cv2.putText(cell, text, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, thickness, cv2.LINE_AA)


def _stacked(rows: list[Image]) -> Image:
    gap = np.full((_CELL_SPACING, rows[0].shape[1], 3), _BACKGROUND, np.uint8)
    return np.vstack([part for row in rows for part in (row, gap)][:-1])
