"""Reading 2D keypoints: a folder with a JSON file for every picture, or one JSON file for all."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import KeypointError, located
from ..shot.detections import Detections
from ..shot.frame_numbers import is_interlaced
from ..shot.shot import Shot, View
from .keypoint_documents import DetectedPerson, people, picture_number
from .keypoint_layouts import HAND_NAMES, LAYOUTS, WHOLE_BODY, keypoint_layout
from .picture_frames import first_number, frames_by_name, stem_of
from .reading import NUMBER_LIMIT, read_bytes, reading

_MAX_NUMBER = 10**15  # number of a frame or track: some programs number pictures by the time
KNOWN_FORMATS = "OpenPose, COCO, AlphaPose, MMPose, MediaPipe or YOLO"

_TABLES = "write DeepLabCut's and other tables as COCO's JSON: a list of image_id and keypoints"
_LANDMARKS = "these are 3D landmarks: name the file as landmarks of a [[performer]]"
_OTHERS = {".csv": _TABLES, ".h5": _TABLES, ".trc": _LANDMARKS, ".c3d": "pose the body from it in Blender"}
"""What to do with files of other kinds, by the endings of their names."""


def read_keypoints(
    path: Path | str,
    size: tuple[int, int] | None = None,
    *,
    footage: Path | None = None,
    skip_broken: bool = False,
    hands: bool = False,
) -> Detections:
    """Read what a detector found in the footage of one view; the format is recognised by its content.

    Parameters
    ----------
    path : path
        A JSON file, or a folder with one for every picture, whose frame is the last number in the file's name, or that
        of the footage's image with this name.
    size : tuple of int, optional
        Width and height of the footage, pixels; needed if coordinates are fractions of them (MediaPipe).
    footage : Path, optional
        The footage, if its frames are not fields. Pictures may then also be called by the names of its images, or
        numbered from 1, see `core.formats.picture_frames`.
    skip_broken : bool
        Whether to leave out files of a folder that cannot be read, and list them in the result, instead of raising an
        error.
    hands : bool
        Whether to read the 42 points of both hands (`core.formats.keypoint_layouts.HAND_NAMES`) instead of the body's;
        people without hands in the file are left out.

    Raises
    ------
    KeypointError
        A file cannot be read or is not a keypoint file; names it.
    """
    path = Path(path)
    images = {} if footage is None else frames_by_name(footage)
    skipped: list[str] = []
    if path.is_file():
        if (todo := _OTHERS.get(path.suffix.lower())) is not None:
            raise KeypointError("is no keypoint file that can be read", where=str(path), todo=todo)
        found = [_named(person, images) for person in _read(path)]
        numbers = {person.frame for person in found if person.frame is not None}
    else:
        found, numbers = _read_folder(path, images, skipped if skip_broken else None)
    if footage is not None and (start := first_number(numbers, footage)):
        found = [replace(person, frame=(person.frame or 0) - start) for person in found]
    return _gathered(_of_hands(found, path) if hands else found, skipped, path, size)


def _read_folder(
    path: Path, images: Mapping[str, int], skipped: list[str] | None
) -> tuple[list[DetectedPerson], set[int]]:
    """Read the files of a folder, one for every picture.

    Parameters
    ----------
    path : Path
    images : mapping of str to int
        See `core.formats.picture_frames.frames_by_name`.
    skipped : list of str, optional
        Takes messages about files that cannot be read; if it is None, they are errors.

    Returns
    -------
    list of DetectedPerson
    set of int
        The numbers of all pictures, also of those that show nobody.
    """
    files = sorted((f for f in _listed(path) if f.suffix.lower() == ".json"), key=lambda f: f.name)
    if not files:
        raise KeypointError("there is no .json file in the folder", where=str(path))
    found: list[DetectedPerson] = []
    numbers: set[int] = set()
    for file in files:
        try:
            number = images.get(stem_of(file.name), _number(file))
            seen = [_named(person, images) for person in _numbered(_read(file), file, number)]
        except KeypointError as error:
            if skipped is None:
                raise
            skipped.append(f"{file}: {error.what}")
            continue
        found += seen
        numbers |= {person.frame for person in seen if person.frame is not None}
        numbers |= {number} if number is not None and not seen else set()
    if skipped is not None and len(skipped) == len(files):
        raise KeypointError(f"none of the {len(files)} files can be read; the first: {skipped[0]}", where=str(path))
    return found, numbers


def read_shot_keypoints(shot: Shot, *, hands: bool = False) -> list[Detections]:
    """Read the keypoints of bodies, or of hands, of every view of a shot; empty for views without keypoint files.

    Raises
    ------
    KeypointError
        A file cannot be read; names the camera and the file.
    """
    skip_broken = shot.settings.broken_keypoints == "skip"
    return [_read_view(view, skip_broken=skip_broken, hands=hands) for view in shot.views]


def _read_view(view: View, *, skip_broken: bool, hands: bool) -> Detections:
    if view.keypoints is None:
        nobody = np.zeros(0, np.int64)
        return Detections((), nobody, np.zeros((0, 0, 2)), np.zeros((0, 0)), nobody)
    with located(f"keypoints of camera '{view.camera.name}'"):
        footage = None if is_interlaced(view) else view.footage
        return read_keypoints(view.keypoints, view.camera.size, footage=footage, skip_broken=skip_broken, hands=hands)


def _listed(path: Path) -> list[Path]:
    try:
        return list(path.iterdir())
    except OSError as error:
        raise KeypointError(f"keypoints cannot be read: {error.strerror}", where=str(path)) from error


def _read(file: Path) -> list[DetectedPerson]:
    data = read_bytes(file, "keypoints", KeypointError)
    with reading(file, "a JSON file", KeypointError, _SKIP):
        document: Any = json.loads(data)
    with reading(file, "a list of people", KeypointError, _SKIP):
        found = people(document)
        if found is None:
            raise KeypointError("holds no keypoints", where=str(file), todo=f"known are files of {KNOWN_FORMATS}")
        for person in found:
            _check(person, file)
    return found


_SKIP = 'write it again, or leave such files out with broken_keypoints = "skip" in [track]'


def _check(person: DetectedPerson, file: Path) -> None:
    count, rest = divmod(len(person.values), 3)
    if rest or (person.names is None and count not in LAYOUTS):
        known = ", ".join(map(str, LAYOUTS))
        what = f"a person has {len(person.values)} numbers"
        raise KeypointError(what, where=str(file), todo=f"known are x, y, confidence of {known} keypoints")
    if person.names is not None and count != len(person.names):
        raise KeypointError(f"a person has {count} keypoints, {len(person.names)} are named", where=str(file))
    if not all(type(v) is float or type(v) is int for v in person.values):
        raise KeypointError("a coordinate is not a number", where=str(file), todo=_SKIP)
    if any(abs(v) > NUMBER_LIMIT for v in person.values):
        raise KeypointError("a coordinate is beyond all pictures", where=str(file), todo=_SKIP)
    for what, number in (("frame", person.frame or 0), ("number of a person", person.track)):
        if abs(number) > _MAX_NUMBER:
            raise KeypointError(f"a {what} has {len(str(abs(number)))} digits", where=str(file), todo=_SKIP)


def _number(file: Path) -> int | None:
    """Return the last number in a file's name, None if it has none."""
    try:
        number = picture_number(file.name.replace("_keypoints", ""))
    except ValueError:
        return None
    return number if number <= _MAX_NUMBER else None


def _numbered(found: list[DetectedPerson], file: Path, number: int | None) -> list[DetectedPerson]:
    """Return the people of a file in a folder; those without a frame get the file's number."""
    if all(person.frame is not None for person in found):
        return found
    if number is None:
        todo = "name the files by the frames, as cam01_000012.json"
        raise KeypointError("its name has no number", where=str(file), todo=todo)
    return [replace(person, frame=number) for person in found]


def _named(person: DetectedPerson, images: Mapping[str, int]) -> DetectedPerson:
    """Return a person, on the frame of the footage's image that its picture is named after, if there is one."""
    frame = None if person.picture is None else images.get(stem_of(person.picture))
    return person if frame is None else replace(person, frame=frame)


def _of_hands(found: list[DetectedPerson], file: Path) -> list[DetectedPerson]:
    """Return the hands of those people who have some."""
    hands = []
    for person in found:
        count = 3 * len(HAND_NAMES)
        values = person.values[-count:] if len(person.values) // 3 in WHOLE_BODY else person.hands
        if len(values):
            hands.append(replace(person, values=values, names=HAND_NAMES))
            _check(hands[-1], file)
    return hands


def _gathered(
    found: list[DetectedPerson], skipped: Sequence[str], path: Path, size: tuple[int, int] | None
) -> Detections:
    """Return all people as arrays, sorted by frame."""
    found = sorted(found, key=lambda person: person.frame or 0)
    names, table = _table(found)
    if (shares := np.array([person.normalised for person in found], bool)).any():
        if size is None:
            raise KeypointError("its coordinates are fractions of a picture of unknown size", where=str(path))
        table[shares, :, :2] = table[shares, :, :2] * size - 0.5  # integers at pixel centres
    # Detectors write (0, 0) or a confidence of 0 for keypoints that they did not find.
    missing = ~np.isfinite(table).all(axis=-1) | (table[..., 2] <= 0) | (table[..., :2] == 0).all(axis=-1)
    table[missing] = [np.nan, np.nan, 0.0]
    return Detections(
        names,
        np.array([person.frame or 0 for person in found], np.int64),
        table[..., :2],
        np.clip(table[..., 2], 0.0, 1.0),
        np.array([person.track for person in found], np.int64),
        tuple(skipped),
    )


def _table(found: Sequence[DetectedPerson]) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    """Return the names of all keypoints, and their x, y, confidence, shape (n, k, 3); NaN if a person's list lacks
    one.
    """
    alike: dict[tuple[int, tuple[str, ...] | None], list[int]] = {}
    for i, person in enumerate(found):
        alike.setdefault((len(person.values), person.names), []).append(i)
    groups = []
    for (_, named), rows in alike.items():
        values = np.array([found[i].values for i in rows], float).reshape(len(rows), -1, 3)
        groups.append((rows, named or keypoint_layout(values), values))
    names = tuple(dict.fromkeys(name for _, layout, _ in groups for name in layout if name))
    table = np.full((len(found), len(names), 3), np.nan)
    for rows, layout, values in groups:
        used = [k for k, name in enumerate(layout) if name]
        table[np.ix_(rows, [names.index(layout[k]) for k in used])] = values[:, used]
    return names, table
