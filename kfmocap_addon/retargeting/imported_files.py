"""Files of other programs, imported by Blender's importers into an empty file."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stderr
from pathlib import Path

import bpy

from ...core.errors import ShotError

_BINARY_FBX = b"Kaydara FBX Binary"


def import_alone(path: Path) -> None:
    """Import a file into an empty one, which replaces the one that is open.

    Parameters
    ----------
    path : Path
        With one of the endings of `IMPORTERS`.

    Raises
    ------
    ShotError
        Blender cannot read it.
    """
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    try:
        with redirect_stderr(io.StringIO()):  # importers print a traceback
            IMPORTERS[path.suffix.lower()](str(path.resolve()))
    except (RuntimeError, OSError, ValueError) as error:
        raise ShotError(f"Blender cannot read it: {last_line(error)}", where=str(path)) from error


def last_line(error: Exception) -> str:
    """Return what an error of Blender says: the last line, as a traceback of an importer may come before it."""
    return next((line.strip() for line in reversed(str(error).splitlines()) if line.strip()), "no reason is given")


def _import_fbx(path: str) -> None:
    """Import with the add-on, which knows more of what programs write; files as text with Blender's other importer."""
    with open(path, "rb") as file:
        binary = file.read(len(_BINARY_FBX)) == _BINARY_FBX
    if not binary:
        bpy.ops.wm.fbx_import(filepath=path, anim_offset=0.0)
        return
    with _lights_as_imported():
        bpy.ops.import_scene.fbx(filepath=path, anim_offset=0.0)


def _import_gltf(path: str) -> None:
    bpy.ops.import_scene.gltf(filepath=path)


IMPORTERS: Mapping[str, Callable[[str], None]] = {
    ".fbx": _import_fbx,
    ".glb": _import_gltf,
    ".gltf": _import_gltf,
    ".vrm": _import_gltf,
}
"""What imports a file, by its ending."""


@contextmanager
def _lights_as_imported() -> Iterator[None]:
    """Add the property to lights that Blender 5.0 removed, but which its FBX importer still sets."""
    light = bpy.data.lights.new("light", "POINT")
    settings = type(light.cycles) if hasattr(light, "cycles") else None
    bpy.data.lights.remove(light)
    if settings is None or hasattr(settings, "cast_shadow"):
        yield
        return
    settings.cast_shadow = bpy.props.BoolProperty()
    try:
        yield
    finally:
        del settings.cast_shadow
