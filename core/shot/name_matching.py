"""Matching footage to cameras by their names."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable, Sequence
from pathlib import Path

from .footage_files.image_sequences import IMAGE_SUFFIXES

_GENERIC_NAMES = {"frame", "frames", "im", "image", "images", "img", "imgs", "out", "output", "pic", "picture", "still"}
"""Names of images that say nothing of the camera, so that their folder names it."""
_DUPLICATE = re.compile(r"\.\d{3}$")  # what Blender adds to a name that is taken


def paired(footage: Sequence[str], cameras: Sequence[str]) -> dict[str, str]:
    """Match cameras to footage by their names.

    Matched first are names that differ only in case and punctuation; then those of which one is contained in the words
    of the other ("walk_cam01" and "cam01"); then those that end in the same number ("GoPro 2" and "camera_02"); finally
    the only remaining footage and camera. Ambiguous matches are left out.

    Parameters
    ----------
    footage, cameras : sequence of str
        Names, each list without repetition.

    Returns
    -------
    dict of str to str
        From names of footage to names of cameras; no camera appears twice.
    """
    found: dict[str, str] = {}
    for key in (_joined, _number):
        _pair_same(found, footage, cameras, key)
        if key is _joined:
            _pair_contained(found, footage, cameras)
    if not found and len(footage) == len(cameras) == 1:
        found[footage[0]] = cameras[0]
    return {name: found[name] for name in footage if name in found}


def _pair_same(
    found: dict[str, str], footage: Sequence[str], cameras: Sequence[str], key: Callable[[str], Hashable | None]
) -> None:
    for name in _left(footage, found):
        fitting = [c for c in _left(cameras, found.values()) if key(c) is not None and key(c) == key(name)]
        rivals = [f for f in _left(footage, found) if key(f) == key(name)]
        if len(fitting) == len(rivals) == 1:
            found[name] = fitting[0]


def _pair_contained(found: dict[str, str], footage: Sequence[str], cameras: Sequence[str]) -> None:
    free = _left(cameras, found.values())
    names = _left(footage, found)
    fits = {name: [c for c in free if _is_within(_words(c), _words(name))] for name in names}
    for name, fitting in fits.items():
        if len(fitting) == 1 and sum(fitting[0] in other for other in fits.values()) == 1:
            found[name] = fitting[0]


def _left(names: Sequence[str], taken: Iterable[str]) -> list[str]:
    gone = set(taken)
    return [name for name in names if name not in gone]


def _words(name: str) -> tuple[str, ...]:
    return tuple(re.findall(r"[^\W_]+", _DUPLICATE.sub("", name).casefold()))


def _is_within(few: tuple[str, ...], many: tuple[str, ...]) -> bool:
    """Whether some words occur consecutively among others."""
    return bool(few) and any(many[i : i + len(few)] == few for i in range(len(many) - len(few) + 1))


def _joined(name: str) -> str:
    return "".join(_words(name))


def _number(name: str) -> int | None:
    numbers = re.findall(r"\d+", _DUPLICATE.sub("", name))
    return int(numbers[-1]) if numbers else None


def footage_name(path: Path) -> str:
    """Return a name for a view of footage: the file's without frame numbers, or its folder's if that says nothing."""
    if path.suffix.lower() not in IMAGE_SUFFIXES:
        return path.stem
    name = re.sub(r"%0?\d*d|#+|\*", "", path.stem).strip("-_. ")
    return path.parent.name or name if name.lower() in _GENERIC_NAMES | {""} else name
