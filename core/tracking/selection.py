"""A part of a shot: some of its views, some of its key poses, another solver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..body.motion import Motion
from ..errors import ShotError
from ..shot.settings import check_solver
from ..shot.shot import KeyPoses, Performer, Shot
from ..shot.shot_spec import check_are_whole, check_cameras, check_is_auto
from .prepare import with_proposed_keys


def selected(
    shot: Shot,
    views: Sequence[str] | str | None = None,
    keyframes: Sequence[int] | NDArray[np.integer[Any]] | Literal["auto"] | None = None,
    solver: str | None = None,
    offsets: Mapping[str, float] | None = None,
) -> Shot:
    """Restrict a shot to the views of some cameras and the key poses on some frames, and choose the solver.

    Parameters
    ----------
    views : sequence of str, or str, optional
    keyframes : sequence or array of int, or "auto", optional
        Frames in the footage's count; each must have a key pose. "auto" keeps all key poses and adds proposals from
        keypoints.
    solver : str, optional
    offsets : mapping of str to float, optional
        Offsets of some cameras' footage.

    Raises
    ------
    ShotError
        There is no such view, key pose or solver, or there are no keypoints.
    KeypointError
        The keypoints do not show a performer well enough.
    """
    known = [view.camera.name for view in shot.views]
    if offsets is not None:
        check_cameras(offsets, known, where="--offset")
        shot = replace(
            shot, views=tuple(replace(view, offset=offsets.get(view.camera.name, view.offset)) for view in shot.views)
        )
    if views is not None:
        views = [views] if isinstance(views, str) else views
        check_cameras(views or ("",), known, where="--views")
        shot = replace(shot, views=tuple(view for view in shot.views if view.camera.name in views))
    if isinstance(keyframes, str):
        check_is_auto(keyframes)
        if not any(view.keypoints for view in shot.views):
            raise ShotError("no view has keypoints to propose key poses from", where="--keyframes")
        shot = with_proposed_keys(shot)
    elif keyframes is not None:
        check_are_whole(list(keyframes), where="--keyframes")
        performers = tuple(_at(performer, list(keyframes), shot.frames[0]) for performer in shot.performers)
        shot = replace(shot, performers=performers)
    if solver is not None:
        check_solver(solver, where="--solver")
        shot = replace(shot, settings=replace(shot.settings, solver=solver))
    return shot


def _at(performer: Performer, keyframes: Sequence[int], first: int) -> Performer:
    keys = performer.key_poses
    known = [first + int(f) for f in keys.frames]
    for frame in keyframes:
        if frame not in known:
            todo = f"there are {', '.join(map(str, known))}"
            raise ShotError(f"{performer.name} has no key pose at frame {frame}", where="--keyframes", todo=todo)
    rows = np.flatnonzero(np.isin(known, keyframes))
    if not len(rows):
        raise ShotError("at least one key frame is needed", where="--keyframes")
    poses = Motion(keys.poses.translations[rows], keys.poses.rotations[rows])
    return replace(performer, key_poses=KeyPoses(keys.frames[rows], poses, keys.fixed[rows]))
