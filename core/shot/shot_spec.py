"""The content of a shot file, before any of the files that it names is read."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..cameras.world_axes import FileWorld
from ..errors import ShotError
from ..numerics.sequences import is_whole
from .holds import Hold
from .settings import Settings, check_solver
from .shot import Gap

KeyFrames = tuple[int, ...] | Literal["auto"]
"""Increasing frame numbers of the footage, or "auto" to choose key frames from 2D keypoints."""

_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")
_MAX_NAME_BYTES = 100  # bytes: two of them and an ending are well below the limit of file systems


@dataclass(frozen=True)
class ViewSpec:
    """A view of a shot file: the attributes of `View`, with the camera by its name.

    Attributes
    ----------
    where : str
        File and table, for error messages.
    every : int, optional
        None if the shot file does not state it: every frame of the footage is one of the shot, and its frame rate must
        be the other views'.
    """

    camera: str
    footage: Path
    offset: float = 0.0
    fields: str = "progressive"
    keypoints: Path | None = None
    where: str = ""
    gaps: tuple[Gap, ...] = ()
    every: int | None = None


@dataclass(frozen=True)
class PerformerSpec:
    """A performer of a shot file.

    Attributes
    ----------
    name : str
    height : float or None
        Metres; None to estimate it.
    keyframes : tuple of int, "auto" or None
        None if the shot file states none.
    landmarks, keyposes : Path or None
        File from which the key poses are taken (TRC or C3D landmarks, or BVH); if both are None, 2D keypoints are used.
    where : str
        File and table, for error messages.
    person : int, optional
        Which of the people that keypoints show it is, see `core.shot.shot.Performer`.
    mesh : Path, optional
        The shape of a prop, which is not a person.
    fingers : bool
        See `core.shot.shot.Performer`.
    first_row : int, optional
        Frame number that the first row of landmarks or key poses shows; by default that of the shot's first frame.
    """

    name: str
    height: float | None = None
    keyframes: KeyFrames | None = None
    landmarks: Path | None = None
    keyposes: Path | None = None
    where: str = ""
    person: int | None = None
    mesh: Path | None = None
    fingers: bool = False
    first_row: int | None = None

    def uncounted(self, count: int) -> int:
        """Return the number of rows of a file, or 0 if it is said which frame the first of them shows."""
        return count if self.first_row is None else 0

    def rows(self, frames: NDArray[np.int64], count: int, shot_first: int) -> NDArray[np.int64]:
        """Return the rows of a file of landmarks or key poses that show some frames.

        Parameters
        ----------
        frames : ndarray of int, shape (K,)
            Frame numbers.
        count : int
            Number of rows that the file has.
        shot_first : int
            The shot's first frame number.

        Raises
        ------
        ShotError
            The file has no row for a frame.
        """
        begin = shot_first if self.first_row is None else self.first_row
        for frame in frames.tolist():
            if not begin <= frame < begin + count:
                what = f"key frame {frame} has no row: rows show frames {begin} to {begin + count - 1}"
                raise ShotError(what, todo="choose other key frames, or state in first_row which frame the first shows")
        return frames - begin


@dataclass(frozen=True)
class ShotSpec:
    """A shot file with its paths resolved and its settings checked.

    Attributes
    ----------
    path : Path
        The file.
    name : str
    fps : float
    frames : tuple of int
        First and last frame number of the footage, inclusive.
    calibration : Path
    views : tuple of ViewSpec
    performers : tuple of PerformerSpec
    settings : Settings
    holds : tuple of Hold
        With frame numbers of the footage.
    resized : bool
        Whether footage was resized, uncropped, after its camera was calibrated.
    world : FileWorld
        The calibration's.
    """

    path: Path
    name: str
    fps: float
    frames: tuple[int, int]
    calibration: Path
    views: tuple[ViewSpec, ...]
    performers: tuple[PerformerSpec, ...]
    settings: Settings = field(default_factory=Settings)
    holds: tuple[Hold, ...] = ()
    resized: bool = False
    world: FileWorld = field(default_factory=FileWorld)

    @property
    def named_keyframes(self) -> list[tuple[int, ...]] | None:
        """The key frames of every performer; None unless they are named for all of them."""
        named = [p.keyframes for p in self.performers if isinstance(p.keyframes, tuple)]
        return named if named and len(named) == len(self.performers) else None

    def files(self) -> list[Path]:
        """Return the files, folders and image sequences that it names."""
        views = [file for view in self.views for file in (view.footage, view.keypoints)]
        performers = [file for one in self.performers for file in (one.landmarks, one.keyposes, one.mesh)]
        return [self.calibration, *(file for file in (*views, *performers) if file is not None)]

    def selected(
        self,
        *,
        views: Sequence[str] | str | None = None,
        keyframes: Sequence[int] | NDArray[np.integer[Any]] | Literal["auto"] | None = None,
        solver: str | None = None,
        offsets: Mapping[str, float] | None = None,
    ) -> ShotSpec:
        """Return the specification with choices that override the file's.

        Parameters
        ----------
        views : sequence of str, or str, optional
            Keep the views of these cameras, or of this one, only.
        keyframes : sequence or array of int, or "auto", optional
            The key frames of every performer.
        solver : str, optional
        offsets : mapping of str to float, optional
            Offsets of some cameras' footage.

        Raises
        ------
        ShotError
            There is no such view or solver, or a key frame is outside the shot.
        """
        spec = self
        known = [view.camera for view in self.views]
        if offsets is not None:
            check_cameras(offsets, known, where="--offset")
            spec = replace(spec, views=tuple(replace(v, offset=offsets.get(v.camera, v.offset)) for v in spec.views))
        if views is not None:
            views = [views] if isinstance(views, str) else views
            check_cameras(views, known, where="--views")
            if not views:
                raise ShotError("no view is named", where="--views", todo=f"there are {', '.join(known)}")
            spec = replace(spec, views=tuple(view for view in spec.views if view.camera in views))
        if keyframes is not None:
            keys: KeyFrames = "auto"
            if isinstance(keyframes, str):
                check_is_auto(keyframes)
            else:
                keys = checked_keyframes(list(keyframes), self.frames, where="--keyframes")
            spec = replace(spec, performers=tuple(replace(p, keyframes=keys) for p in self.performers))
        if solver is not None:
            check_solver(solver, where="--solver")
            spec = replace(spec, settings=replace(self.settings, solver=solver))
        return spec


def check_cameras(names: Iterable[str], known: Sequence[str], *, where: str) -> None:
    """Check that views have cameras of some names.

    Raises
    ------
    ShotError
        No view has one of them.
    """
    for name in names:
        if name not in known:
            raise ShotError(f"no view has the camera '{name}'", where=where, todo=f"there are {', '.join(known)}")


def check_is_auto(keyframes: str) -> None:
    """Check that key frames given as a word are to be chosen.

    Raises
    ------
    ShotError
        The word is another one than "auto".
    """
    if keyframes != "auto":
        todo = 'give a list of frame numbers, or "auto"'
        raise ShotError(f"key frames are '{keyframes}'", where="--keyframes", todo=todo)


def checked_keyframes(frames: Sequence[int], shot_frames: tuple[int, int], *, where: str) -> tuple[int, ...]:
    """Return key frames sorted and without repetition.

    Raises
    ------
    ShotError
        There are none, or one is not a whole number or lies outside the shot's first and last frame.
    """
    if not frames:
        raise ShotError("at least one key frame is needed", where=where)
    first, last = shot_frames
    check_are_whole(frames, where=where)
    for frame in frames:
        if not first <= frame <= last:
            what = f"key frame {frame} lies outside the shot's frames {first} to {last}"
            raise ShotError(what, where=where, todo="frames are counted from 0" if frame == last + 1 else None)
    return tuple(sorted({int(frame) for frame in frames}))


def check_are_whole(keyframes: Sequence[object], *, where: str) -> None:
    """Check that key frames are whole numbers, as those of a mask of frames are not.

    Raises
    ------
    ShotError
        One is not.
    """
    for frame in keyframes:
        if not is_whole(frame):
            raise ShotError(f"key frame {frame} is not a whole number", where=where, todo="give frame numbers")


def checked_file_name(name: str, where: str) -> str:
    """Return a name if it is a valid file name on every system, also with a performer's name and an ending added.

    Raises
    ------
    ShotError
        It is not.
    """
    unsafe = re.search(r'[<>:"/\\|?*\x00-\x1f\x7f]', name) or name.startswith(".") or name.endswith((".", " "))
    if not name or unsafe or _RESERVED.fullmatch(name):
        todo = 'leave out < > : " / \\ | ? * and dots at the ends'
        if _RESERVED.fullmatch(name):
            todo = "Windows keeps it for itself: choose another one"
        raise ShotError(f"'{name}' cannot be a file's name", where=f"{where} name", todo=todo)
    if len(name.encode(errors="replace")) > _MAX_NAME_BYTES:
        what = f"'{name[:20]}...' is too long for a file's name"
        raise ShotError(what, where=f"{where} name", todo=f"shorten it to {_MAX_NAME_BYTES} letters")
    return name


def result_names(
    shot: str, performers: Sequence[str], where: str = "[[performer]]", shot_where: str = "[shot]"
) -> list[str]:
    """Return the names, without endings, of the files with the performers' motions.

    Errors name the places where the performers' names and the shot's are written.

    Raises
    ------
    ShotError
        One of them is not a valid file name, or two differ only in case, which some systems do not distinguish.
    """
    checked_file_name(shot, shot_where)
    if len(performers) == 1:
        return [shot]
    folded = [name.casefold() for name in performers]
    for i, name in enumerate(performers):
        checked_file_name(name, where)
        if folded[i] in folded[:i]:
            other = performers[folded.index(folded[i])]
            what = f"'{name}' and '{other}' differ in capitals alone, and so would the names of their files"
            raise ShotError(what, where=f"{where} name", todo="rename one of them")
    return [f"{shot}_{name}" for name in performers]
