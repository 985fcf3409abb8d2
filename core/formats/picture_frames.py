"""Which frame of the footage a picture is, that a detector calls by a name or a number.

Frames are counted from 0. A detector that was given the images of a sequence names its pictures like them, and these
are often numbered from 1; some programs number the pictures of a video from 1 as well.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path, PureWindowsPath

from ..errors import FootageError
from ..shot.footage import probe
from ..shot.footage_files.image_sequences import image_files


def frames_by_name(footage: Path) -> dict[str, int]:
    """Return the frames of an image sequence by the names of their images without ending; none of a video or of footage
    that is not there.
    """
    try:
        images = image_files(footage) or {}
    except FootageError:
        return {}
    return {image.stem: frame for frame, image in images.items()}


def stem_of(picture: str) -> str:
    """Return a picture's name without folders, ending, and what OpenPose adds to it."""
    return PureWindowsPath(picture).stem.removesuffix("_keypoints")


def first_number(numbers: Collection[int], footage: Path) -> int:
    """Return which of the numbers of pictures is that of the footage's first frame: 1 if they run from 1 to the number
    of frames that the footage has, of which none could have the last number otherwise; else 0.
    """
    if not numbers or min(numbers) != 1 or len(numbers) != max(numbers):
        return 0
    try:
        return int(probe(footage).count == len(numbers))
    except FootageError:
        return 0
