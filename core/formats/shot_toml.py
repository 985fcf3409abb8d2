"""The shot file: a shot for batches and other programs. Paths in it are relative to it."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from ..body.inverse_kinematics import fit_body, fit_poses
from ..cameras.camera import Camera
from ..errors import LandmarkError, ShotError
from ..shot.footage import check_view
from ..shot.shot import FIELD_ORDERS, KeyPoses, Performer, PerformerRequest, Settings, Shot, View
from .bvh import body_of_bvh, poses_of_bvh, read_bvh
from .calibration_files import load_cameras
from .toml_tables import Table, named, read_toml
from .trc import Landmarks, read_trc

_TABLES = ("shot", "calibration", "view", "performer", "track")
_VIEW = ("camera", "footage", "offset", "fields", "keypoints")
_PERFORMER = ("name", "height", "landmarks", "keyframes", "keyposes")
NEEDED_LANDMARKS = tuple(
    side + joint for joint in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle") for side in "LR"
)
"""Landmarks that a key pose cannot do without: the main joints."""
_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")


def load_shot(
    path: Path | str,
    *,
    views: Sequence[str] | None = None,
    keyframes: Sequence[int] | Literal["auto"] | None = None,
    solver: str | None = None,
) -> Shot:
    """Read a shot file and all that it names but the footage's pictures.

    Parameters
    ----------
    path : path
    views : sequence of str, optional
        Use the views of these cameras only.
    keyframes : sequence of int or "auto", optional
        Use these key frames for every performer, in the footage's count, instead of the file's; "auto" has them chosen
        and posed by keypoints.
    solver : str, optional
        Use this solver instead of the file's.

    Returns
    -------
    Shot
        Of landmarks only the key frames were seen.

    Raises
    ------
    ShotError, CalibrationError, FootageError, LandmarkError, KeypointError, BodyError
        One message that names the file and the field.
    """
    path = Path(path)
    document = Table(read_toml(path, "the shot file", ShotError), str(path), _TABLES)
    head = Table(document.value("shot"), f"{path} [shot]", ("name", "fps", "frames"))
    name, fps, frames = shot_name(head.text("name"), head.where), _positive(head, "fps"), _frames(head)
    settings = _settings(document, path, solver)
    cameras = _cameras(document, path)
    shot_views = _views(document, path, cameras, views)
    for view in shot_views:
        with named(f"{path} [[view]] '{view.camera.name}' footage"):
            check_view(view, frames[0], frames[1] - frames[0] + 1)
    tables = _tables(document, "performer", path, _PERFORMER)
    _distinct([table.text("name") for table in tables], f"{path} [[performer]] name")
    made = [_performer(table, path.parent, frames, keyframes) for table in tables]
    performers = tuple(p.unknown() if isinstance(p, PerformerRequest) else p for p in made)
    shot = Shot(name, fps, frames, shot_views, performers, settings)
    wanted = [p if isinstance(p, PerformerRequest) else None for p in made]
    return replace(shot, performers=_from_keypoints(shot, wanted, path)) if any(wanted) else shot


def _from_keypoints(shot: Shot, wanted: Sequence[PerformerRequest | None], path: Path) -> tuple[Performer, ...]:
    """The performers, with those that only keypoints tell of."""
    from ..keypoints.proposals import proposed

    where = f"{path} [[performer]] {[p is not None for p in wanted].index(True) + 1}"
    if not any(view.keypoints for view in shot.views):
        todo = "name a TRC file as landmarks, a BVH file as keyposes, or keypoints in the views"
        raise ShotError("there is nothing to take the key poses from", where=where, todo=todo)
    if shot.settings.solver != "gauss-newton":
        raise ShotError("key poses from keypoints need the solver gauss-newton", where=where)
    with named(str(path)):
        return proposed(shot, wanted)


def load_shot_cameras(path: Path | str) -> dict[str, Camera]:
    """All cameras of a shot file's calibration by their names, whether a view uses them or not.

    Raises
    ------
    ShotError, CalibrationError
        One message that names the file and the field.
    """
    path = Path(path)
    return _cameras(Table(read_toml(path, "the shot file", ShotError), str(path), _TABLES), path)


def _cameras(document: Table, path: Path) -> dict[str, Camera]:
    calibration = Table(document.value("calibration"), f"{path} [calibration]", ("file",))
    with named(f"{calibration.where} file"):
        return load_cameras(calibration.path("file", path.parent))


def shot_name(name: str, where: str) -> str:
    """The name, if it can be a file's name on every system."""
    unsafe = re.search(r'[<>:"/\\|?*\x00-\x1f]', name) or name.startswith(".") or name.endswith((".", " "))
    if not name or unsafe or _RESERVED.fullmatch(name):
        todo = 'leave out < > : " / \\ | ? * and dots at the ends'
        raise ShotError(f"'{name}' cannot be a file's name", where=f"{where} name", todo=todo)
    return name


def _frames(head: Table) -> tuple[int, int]:
    frames = head.integers("frames")
    if len(frames) != 2 or not 0 <= frames[0] <= frames[1]:
        raise head.error("frames", f"must be [first, last] with 0 <= first <= last, not {frames}")
    return frames[0], frames[1]


def _positive(table: Table, key: str) -> float:
    value = table.number(key)
    if value <= 0:
        raise table.error(key, f"must be greater than 0, not {value}")
    return float(value)


def _tables(document: Table, key: str, path: Path, keys: Sequence[str]) -> list[Table]:
    values = document.value(key)
    if not isinstance(values, list) or not values:
        raise ShotError(f"there must be at least one [[{key}]]", where=str(path))
    return [Table(v, f"{path} [[{key}]] {i}", keys) for i, v in enumerate(values, 1)]


def _distinct(names: list[str], where: str) -> None:
    for name in names:
        if names.count(name) > 1:
            raise ShotError(f"'{name}' is there twice", where=where)


def _views(document: Table, path: Path, cameras: dict[str, Camera], chosen: Sequence[str] | None) -> tuple[View, ...]:
    tables = _tables(document, "view", path, _VIEW)
    names = [table.text("camera") for table in tables]
    _distinct(names, f"{path} [[view]] camera")
    for name in chosen or ():
        if name not in names:
            raise ShotError(f"no view has the camera '{name}'", where="--views", todo=f"there are {', '.join(names)}")
    if chosen is not None and not chosen:
        raise ShotError("no view is named", where="--views", todo=f"there are {', '.join(names)}")
    views = [_view(table, path.parent, cameras) for table in tables]
    return tuple(view for view in views if chosen is None or view.camera.name in chosen)


def _view(table: Table, folder: Path, cameras: dict[str, Camera]) -> View:
    name, fields = table.text("camera"), table.text("fields", "progressive")
    if name not in cameras:
        known = ", ".join(cameras)
        raise table.error("camera", f"the calibration has no camera '{name}'", f"its cameras are {known}")
    if fields not in FIELD_ORDERS:
        raise table.error("fields", f"unknown value '{fields}'", f"use {', '.join(FIELD_ORDERS)}")
    keypoints = table.path("keypoints", folder, None)
    if keypoints is not None and not keypoints.exists():
        raise table.error("keypoints", f"there is no such file or folder: {keypoints}")
    return View(cameras[name], table.path("footage", folder), float(table.number("offset", 0.0)), fields, keypoints)


def _settings(document: Table, path: Path, solver: str | None) -> Settings:
    kinds = get_type_hints(Settings)
    names = [field.name for field in dataclasses.fields(Settings)]
    table = Table(document.value("track", {}), f"{path} [track]", names)
    values = {name: _setting(table, name, kinds[name]) for name in names if name in table}
    if solver is not None:
        values["solver"] = solver
    with named(str(path)):
        return Settings(**values)


def _setting(table: Table, name: str, kind: Any) -> Any:
    """A setting's value, of the type that `Settings` declares for it."""
    kinds = [k for k in get_args(kind) if k is not type(None)] if isinstance(kind, UnionType) else [kind]
    value = table.value(name)
    if float in kinds:
        return float(table.number(name))
    if get_origin(kinds[0]) is tuple:
        if not isinstance(value, list) or any(type(v) not in (int, float) for v in value):
            raise table.error(name, f"must be a list of numbers, not {value!r}")
        return tuple(value)
    if type(value) not in kinds:
        meant = {bool: "true or false", int: "a whole number", str: "a text in quotes"}[kinds[0]]
        raise table.error(name, f"must be {meant}, not {value!r}")
    return value


def _performer(
    table: Table, folder: Path, frames: tuple[int, int], keyframes: Sequence[int] | Literal["auto"] | None
) -> Performer | PerformerRequest:
    name = table.text("name")
    height = table.number("height", None)
    if keyframes == "auto" or (keyframes is None and table.value("keyframes") == "auto"):
        return PerformerRequest(name, height)
    keys = _keyframes(table, frames, keyframes)
    if "keyposes" in table:
        return _posed_performer(table, folder, keys, frames[0])
    if "landmarks" not in table:
        return PerformerRequest(name, height, tuple(int(key) - frames[0] for key in keys))
    file = table.path("landmarks", folder)
    with named(f"{table.where} landmarks"):
        names, points = _at_keys(read_trc(file), file, keys, frames[0])
    with named(table.where):
        body = fit_body(names, points, height)
        return Performer(name, body, KeyPoses.whole(keys - frames[0], fit_poses(body, names, points)))


def _posed_performer(table: Table, folder: Path, keys: np.ndarray, first: int) -> Performer:
    """A performer whose key poses stand in a BVH file, of which row r is frame first + r."""
    if "landmarks" in table:
        raise table.error("keyposes", "key poses come from a BVH or from landmarks, not from both")
    file = table.path("keyposes", folder)
    with named(f"{table.where} keyposes"):
        skeleton = read_bvh(file)
        count = len(skeleton.positions_world)
        for key in keys:
            if key - first >= count:
                what = f"key frame {key} has no pose: they end at frame {first + count - 1}"
                raise ShotError(what, where=str(file))
        with named(str(file)):
            body = body_of_bvh(skeleton, table.number("height", None))
        poses = poses_of_bvh(skeleton, body, keys - first)
    return Performer(table.text("name"), body, KeyPoses.whole(keys - first, poses))


def _keyframes(table: Table, frames: tuple[int, int], override: Sequence[int] | None) -> np.ndarray:
    """Key frames in the footage's count, increasing."""
    where = "--keyframes" if override is not None else f"{table.where} keyframes"
    keys = sorted(set(override if override is not None else table.integers("keyframes")))
    if not keys:
        raise ShotError("at least one key frame is needed", where=where)
    for key in keys:
        if not frames[0] <= key <= frames[1]:
            what = f"key frame {key} lies outside the shot's frames {frames[0]} to {frames[1]}"
            raise ShotError(what, where=where)
    return np.array(keys, dtype=np.int64)


def _at_keys(landmarks: Landmarks, file: Path, keys: np.ndarray, first: int) -> tuple[list[str], np.ndarray]:
    """The landmarks at the key frames and nothing else, shape (K, L, 3): more the tracker may not see."""
    for name in NEEDED_LANDMARKS:
        if name not in landmarks.names:
            raise LandmarkError(f"landmark '{name}' is missing", where=str(file))
    for key in keys:
        if key - first >= len(landmarks):
            what = f"key frame {key} has no landmarks: they end at frame {first + len(landmarks) - 1}"
            raise LandmarkError(what, where=str(file))
    points = landmarks.points_world[keys - first]
    for k, key in enumerate(keys):
        for name in NEEDED_LANDMARKS:
            if not np.isfinite(points[k, landmarks.names.index(name)]).all():
                raise LandmarkError(f"landmark '{name}' is not known at key frame {key}", where=str(file))
    return list(landmarks.names), points
