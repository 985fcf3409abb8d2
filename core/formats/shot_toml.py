"""Reading shot files. Paths in a shot file are relative to its folder."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_type_hints

from ..cameras.world_axes import AXES, METRES, FileWorld
from ..errors import ShotError, located
from ..numerics.sequences import first_repeated
from ..shot.holds import Hold, check_names
from ..shot.settings import Settings
from ..shot.shot import FIELD_ORDERS, Gap
from ..shot.shot_spec import (
    KeyFrames,
    PerformerSpec,
    ShotSpec,
    ViewSpec,
    checked_file_name,
    checked_keyframes,
    result_names,
)
from .toml_tables import Table, check_kind, is_integer, read_toml

_TABLES = ("shot", "calibration", "view", "performer", "hold", "track")
_CALIBRATION = ("file", "resized", "unit", "up")
_VIEW = ("camera", "footage", "offset", "every", "fields", "keypoints", "missing", "twice")
_PERFORMER = ("name", "height", "landmarks", "keyframes", "keyposes", "person", "mesh", "fingers", "first_row")
_HOLD = ("prop", "holder", "part", "frames")
_MAX_GAPS = _MAX_EVERY = 1000


def read_shot_spec(path: Path | str) -> ShotSpec:
    """Read a shot file; the files that it names are not opened.

    Raises
    ------
    ShotError
        One message that names the file and the field.
    """
    path = Path(path)
    values = read_toml(path, "the shot file", ShotError)
    check_kind(values, path, "shot", ShotError)
    document = Table(values, str(path), _TABLES)
    head = Table(document.value("shot"), f"{path} [shot]", ("name", "fps", "frames"))
    name, fps, frames = checked_file_name(head.text("name"), head.where), head.positive("fps"), _frames(head)
    settings = _settings(document, path)
    calibration = Table(document.value("calibration"), f"{path} [calibration]", _CALIBRATION)
    views = [_view(table, path.parent) for table in _tables(document, "view", path, _VIEW)]
    _check_distinct([view.camera for view in views], f"{path} [[view]] camera")
    _check_distinct([str(view.footage) for view in views], f"{path} [[view]] footage")
    performers = [_performer(table, path.parent, frames) for table in _tables(document, "performer", path, _PERFORMER)]
    _check_distinct([performer.name for performer in performers], f"{path} [[performer]] name")
    result_names(name, [performer.name for performer in performers], f"{path} [[performer]]")
    return ShotSpec(
        path=path,
        name=name,
        fps=fps,
        frames=frames,
        calibration=calibration.path("file", path.parent),
        views=tuple(views),
        performers=tuple(performers),
        settings=settings,
        holds=tuple(_hold(table, performers, frames) for table in _tables(document, "hold", path, _HOLD, least=0)),
        resized=calibration.flag("resized"),
        world=_world(calibration),
    )


def _world(calibration: Table) -> FileWorld:
    unit, up = calibration.text("unit", None), calibration.text("up", "z")
    for key, value, known in (("unit", unit, METRES), ("up", up, AXES)):
        if value is not None and value not in known:
            raise calibration.error(key, f"unknown value '{value}'", f"use {', '.join(known)}")
    return FileWorld(unit, up)


def _frames(head: Table) -> tuple[int, int]:
    frames = head.integers("frames")
    if len(frames) != 2 or not 0 <= frames[0] <= frames[1]:
        raise head.error("frames", f"must be [first, last] with 0 <= first <= last, not {frames}")
    return frames[0], frames[1]


def _tables(document: Table, key: str, path: Path, keys: Sequence[str], *, least: int = 1) -> list[Table]:
    values = document.value(key, [])
    if not isinstance(values, list) or len(values) < least:
        todo = f"write two brackets, [[{key}]], not [{key}]" if isinstance(values, Mapping) else None
        raise ShotError(f"there must be at least one [[{key}]]", where=str(path), todo=todo)
    return [Table(v, f"{path} [[{key}]] {i}", keys) for i, v in enumerate(values, 1)]


def _check_distinct(names: list[str], where: str) -> None:
    if (name := first_repeated(names)) is not None:
        raise ShotError(f"'{name}' is there twice", where=where)


def _view(table: Table, folder: Path) -> ViewSpec:
    fields = table.text("fields", "progressive")
    if fields not in FIELD_ORDERS:
        raise table.error("fields", f"unknown value '{fields}'", f"use {', '.join(FIELD_ORDERS)}")
    keypoints = table.path("keypoints", folder, None)
    if keypoints is not None and not keypoints.exists():
        raise table.error("keypoints", f"there is no such file or folder: {keypoints}")
    offset = float(table.number("offset", 0.0))
    every = table.value("every", None)
    if every is not None and not (is_integer(every) and 1 <= every <= _MAX_EVERY):
        raise table.error("every", f"{every!r} is not a whole number from 1 to {_MAX_EVERY}")
    footage, gaps = table.path("footage", folder), _gaps(table)
    return ViewSpec(
        camera=table.text("camera"),
        footage=footage,
        offset=offset,
        fields=fields,
        keypoints=keypoints,
        where=table.where,
        gaps=gaps,
        every=every,
    )


def _gaps(table: Table) -> tuple[Gap, ...]:
    """Read where frames are missing in a view's footage, and where they are there twice."""
    counts: Counter[int] = Counter()
    for key, each in (("missing", 1), ("twice", -1)):
        frames = table.integers(key, [])
        if len(frames) > _MAX_GAPS:
            raise table.error(key, f"{len(frames)} frames are more than {_MAX_GAPS}")
        for frame in frames:
            if frame < 1 or counts[frame] * each < 0:
                raise table.error(key, f"{frame} cannot be one of them", "number the footage's frames from 0")
            counts[frame] += each
    return tuple(Gap(frame, count) for frame, count in sorted(counts.items()))


def _settings(document: Table, path: Path) -> Settings:
    kinds = get_type_hints(Settings)
    names = [field.name for field in dataclasses.fields(Settings)]
    table = Table(document.value("track", {}), f"{path} [track]", names)
    values = {name: _setting(table, name, kinds[name]) for name in names if name in table}
    with located(str(path)):
        return Settings(**values)


def _setting(table: Table, name: str, kind: Any) -> Any:
    """Return a setting's value, checked to be of the type that `Settings` declares for it."""
    kinds = [k for k in get_args(kind) if k is not type(None)] if isinstance(kind, UnionType) else [kind]
    value = table.value(name)
    if float in kinds:
        return float(table.number(name))
    if int in kinds and type(value) is int:
        return table.number(name)
    if type(value) not in kinds:
        meant = {bool: "true or false", int: "a whole number", str: "a text in quotes"}[kinds[0]]
        raise table.error(name, f"must be {meant}, not {value!r}")
    return value


def _performer(table: Table, folder: Path, frames: tuple[int, int]) -> PerformerSpec:
    return PerformerSpec(
        name=table.text("name"),
        height=table.number("height", None),
        keyframes=_keyframes(table, frames),
        landmarks=table.path("landmarks", folder, None),
        keyposes=table.path("keyposes", folder, None),
        where=table.where,
        person=_person(table),
        mesh=table.path("mesh", folder, None),
        fingers=table.flag("fingers"),
        first_row=_first_row(table),
    )


def _first_row(table: Table) -> int | None:
    number: Any = table.value("first_row", None)
    if number is not None and not (is_integer(number) and number >= 0):
        raise table.error("first_row", f"must be the number of a frame, from 0, not {number!r}")
    return number


def _hold(table: Table, performers: Sequence[PerformerSpec], frames: tuple[int, int]) -> Hold:
    chosen = table.integers("frames")
    if len(chosen) != 2 or not frames[0] <= chosen[0] <= chosen[1] <= frames[1]:
        what = f"must be [first, last] within the shot's frames {frames[0]} to {frames[1]}, not {chosen}"
        raise table.error("frames", what)
    prop, holder, part = (table.text(key) for key in ("prop", "holder", "part"))
    hold = Hold(prop, holder, part, (chosen[0], chosen[1]), where=table.where)
    check_names(hold, [performer.name for performer in performers])
    return hold


def _person(table: Table) -> int | None:
    number: Any = table.value("person", None)
    if number is not None and (type(number) is not int or number < 1):
        raise table.error("person", f"must be the number of a person, from 1, not {number!r}")
    return number


def _keyframes(table: Table, frames: tuple[int, int]) -> KeyFrames | None:
    if "keyframes" not in table:
        return None
    if table.value("keyframes") == "auto":
        return "auto"
    return checked_keyframes(table.integers("keyframes"), frames, where=f"{table.where} keyframes")
