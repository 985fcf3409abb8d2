"""Footage: videos and image sequences, decoded once, reduced, rectified and streamed."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..cameras.camera import field_of_frame
from ..cameras.lens_turns import undone_zoom
from ..errors import FootageError
from ..numerics.arrays import Array
from .footage_files.image_sequences import image_files, read_image
from .footage_files.stored_frames import (
    StoredFrame,
    codec_of,
    opened_video,
    quarter_turns,
    sequence_image,
    stored_frames,
    undecodable,
)
from .footage_files.video_edits import shown_share
from .frame_numbers import FIRST_PARITY, footage_index, frames_per_file_frame
from .interlacing import FieldWatch
from .shot import View

Image = NDArray[Any]

_LINE_BLUR = np.array([1, 2, 1]) / 4
_ROTATIONS = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}
_WITHOUT_COVER = "leave the cover out, as with: ffmpeg -i FOOTAGE -map 0:v:1 -c copy CONVERTED.mkv"


@dataclass(frozen=True)
class Footage:
    """What is known of footage before it is decoded.

    Attributes
    ----------
    path : Path
        The video, or the pattern of an image sequence.
    size : tuple of int
        Width and height after the rotation that the metadata asks for, pixels.
    count : int
        Number of frames (not fields), for a video as its container states, without those that an edit list cuts.
    fps : float
        Frames per second, 0 for an image sequence.
    """

    path: Path
    size: tuple[int, int]
    count: int
    fps: float


_SURELY_DECODED = ("AVC1", "H264")
"""Codecs that nearly every build of FFmpeg decodes: where one does not, it is reported when frames are read."""


def probe(path: Path | str) -> Footage:
    """Find out about footage, decoding no more than its first frame, and none where its codec is surely known.

    Raises
    ------
    FootageError
        The footage is missing or cannot be read; names the file, and what to do.
    """
    path = Path(path)
    images = image_files(path)
    if images is not None:
        height, width = read_image(images[min(images)]).shape[:2]
        return Footage(path, (width, height), max(images) + 1, 0.0)
    with opened_video(path) as video:
        size = int(video.get(cv2.CAP_PROP_FRAME_WIDTH)), int(video.get(cv2.CAP_PROP_FRAME_HEIGHT))
        if quarter_turns(video) in (90, 270):
            size = size[::-1]
        codec, stored = codec_of(video), int(video.get(cv2.CAP_PROP_FRAME_COUNT))
        if codec not in _SURELY_DECODED and not video.read()[0]:
            raise undecodable(path, codec)
        if stored > 1 and codec == "MJPG" and not video.grab():
            what = "only its first picture can be read: it is a cover before the video proper, or the file is damaged"
            raise FootageError(what, where=str(path), todo=_WITHOUT_COVER)
        return Footage(path, size, round(stored * shown_share(path)), video.get(cv2.CAP_PROP_FPS))


def container_rate(view: View) -> float:
    """Return the rate of a view's frames, or fields, per second, as its file states; 0 if it states none."""
    if image_files(view.footage) is not None:
        return 0.0
    try:
        with opened_video(view.footage) as video:
            return round(video.get(cv2.CAP_PROP_FPS) * frames_per_file_frame(view), 3)
    except FootageError:
        return 0.0


def frames_at(
    view: View,
    frames: Sequence[int],
    factor: float,
    *,
    grey: bool = True,
    album: Album | None = None,
    threads: int = 0,
    turns: Sequence[Array] | Array | None = None,
) -> Iterator[Image]:
    """Stream frames of a view that was checked: decoded once, in order, reduced and rectified.

    A field comes as a whole picture, in the same place whatever its parity: see `_whole`.

    Parameters
    ----------
    frames : sequence of int
        Frames in increasing order, in the same numbering as the shot's first and last frame.
    factor : float
        Factor of reduction: the images have the size of `view.camera.reduced(factor)`.
    grey : bool
        Grey levels rather than colour.
    album : Album, optional
        Collects pictures on the way.
    threads : int
        Number of decoding threads; 0 for one per core.
    turns : sequence of ndarray, shape (3, 3), optional
        For each frame, the turn of the camera's axes to those of the picture (`Camera.turns_to`); pictures of the album
        are not turned, but zooms are undone.

    Yields
    ------
    ndarray of uint8, shape (h, w) or (h, w, 3)
        Grey levels, or blue, green and red.

    Raises
    ------
    FootageError
        The footage ends or breaks early; names the file and the frame.
    """
    camera = view.camera.reduced(factor)
    maps = camera.rectify_maps() if turns is None else None
    near = None if album is None else view.camera.reduced(album.factor)
    near_maps = None if near is None or near.zooms is not None else near.rectify_maps()
    indices = [footage_index(view, f) for f in frames]
    for k, (frame, decoded) in enumerate(zip(frames, _decoded(view, indices, threads), strict=True)):
        if album is not None and near is not None and frame in album.frames:
            own_maps = near_maps if near.zooms is None or turns is None else near.rectify_maps(undone_zoom(turns[k]))
            album.pictures[frame] = _prepared(decoded, near.size, own_maps, grey=False)
            if decoded.parity is None:
                album.fields.add(decoded.image, frame)
        yield _prepared(decoded, camera.size, maps if turns is None else camera.rectify_maps(turns[k]), grey)


@dataclass(eq=False)
class Album:
    """Collects colour pictures of some frames while footage is streamed.

    Attributes
    ----------
    frames : frozenset of int
        The frames to collect, in the same numbering as the shot's first and last frame.
    factor : float
        Factor by which the pictures are reduced.
    pictures : dict of int to ndarray of uint8, shape (h, w, 3)
        The pictures collected so far, rectified; blue, green, red.
    fields : FieldWatch
        Has seen them as they are stored, if the footage is said to be progressive.
    """

    frames: frozenset[int]
    factor: float
    pictures: dict[int, Image] = field(default_factory=dict)
    fields: FieldWatch = field(default_factory=FieldWatch)


def _prepared(
    decoded: StoredFrame, size: tuple[int, int], maps: tuple[NDArray[Any], NDArray[Any]] | None, grey: bool
) -> Image:
    """Return a decoded frame or field, reduced to a size, rotated and rectified."""
    image, turn = decoded.image, decoded.turn
    if grey:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    stored = size[::-1] if turn in (90, 270) else size
    if decoded.parity is not None:
        image = _whole(image, decoded.parity, stored[0])
    if image.shape[1::-1] != stored:
        image = _reduced(image, stored)
    if turn:
        image = cv2.rotate(image, _ROTATIONS[turn])
    if maps is None:
        return image.copy() if image is decoded.image else image
    # A black border would be an edge that moves with nothing in the scene.
    return cv2.remap(image, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _reduced(image: Image, size: tuple[int, int]) -> Image:
    """Return an image reduced to a size; repeated halving gives the same result as one mean, many times faster."""
    while all(have % 2 == 0 and have >= 4 * want for have, want in zip(image.shape[1::-1], size, strict=True)):
        image = cv2.resize(image, (image.shape[1] // 2, image.shape[0] // 2), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def _whole(frame: Image, parity: int, width: int) -> Image:
    """Return a whole picture, reduced to a width, from the lines of one parity, each at its place in the frame.

    The lines are interpolated by a quadratic B-spline (linear, then 1 2 1), which blurs all lines by the same variance.
    Linear interpolation alone would leave a field's own lines sharp, and static edges would flicker between fields.
    """
    lines = frame[parity::2]
    lines = cv2.resize(lines, (width, len(lines)), interpolation=cv2.INTER_AREA)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = width, len(frame)
    spread = cv2.warpAffine(lines, field_of_frame(parity)[:2], size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(cv2.sepFilter2D(spread, -1, np.ones(1), _LINE_BLUR))


def decodable(path: Path, limit: int) -> int:
    """Return how many frames, up to `limit`, can actually be decoded."""
    with opened_video(path) as video:
        count = 0
        while count < limit and video.grab():
            count += 1
    return count


def _decoded(view: View, indices: Sequence[int], threads: int) -> Iterator[StoredFrame]:
    """Generate the footage's frames, or fields, at increasing indices; each frame of the file is decoded once."""
    each, first = frames_per_file_frame(view), FIRST_PARITY.get(view.fields)
    shared = [(number, list(same)) for number, same in groupby(indices, lambda index: index // each)]
    stored = stored_frames(view.footage, [number for number, _ in shared], view.camera.size, threads)
    for decoded, (_, same) in zip(stored, shared, strict=True):
        for index in same:
            yield decoded if first is None else replace(decoded, parity=(index + first) % 2)


def pictures(path: Path | str) -> Iterator[Image]:
    """Stream all frames of a video or an image sequence in colour, rotated as the metadata asks, until it ends.

    Yields
    ------
    ndarray of uint8, shape (h, w, 3)
        Blue, green and red.

    Raises
    ------
    FootageError
        The footage is missing or cannot be read; names the file.
    """
    path = Path(path)
    images = image_files(path)
    if images is not None:
        size = probe(path).size
        for number in sorted(images):
            yield sequence_image(path, images, number, size)
        return
    with opened_video(path) as video:
        turn = quarter_turns(video)
        while True:
            read, frame = video.read()
            if not read or frame is None:
                return
            yield cv2.rotate(frame, _ROTATIONS[turn]) if turn else frame


def picture(path: Path | str, number: int) -> Image:
    """Return one frame of a video or an image sequence in colour, rotated as the metadata asks; the last frame if it
    has fewer.

    Raises
    ------
    FootageError
        The footage is missing or cannot be read, or has no frame at all; names the file.
    """
    # A deque of one keeps the last.
    last = deque(islice(pictures(path), number + 1), maxlen=1)
    if not last:
        raise FootageError("the footage has no frames", where=str(path))
    return last[0]


MAX_PICTURE_SIDE = 960
"""Approximate limit of the longer side of pictures that are kept to be shown to people, pixels."""


def working_factor(view: View, working_size: int) -> float:
    """Return the factor by which a view's frames are reduced for tracking."""
    return max(1.0, max(view.camera.size) / working_size)
