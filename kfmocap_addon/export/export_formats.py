"""The formats of exported files: what the panel shows of them, and which of Blender's exporters writes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any


@dataclass(frozen=True)
class ExportFormat:
    """A format of exported files.

    Attributes
    ----------
    label, description : str
        Shown to the animator.
    exporter : tuple of str
        Blender's operator that writes it, as in `bpy.ops`: module and name.
    remedy : str
        What to do if this Blender lacks that operator.
    is_default : bool
        Whether it is written unless the animator chooses otherwise.
    """

    label: str
    description: str
    exporter: tuple[str, str]
    remedy: str
    is_default: bool = False


def _with_add_on(label: str, description: str, exporter: tuple[str, str], add_on: str, **default: bool) -> ExportFormat:
    """Return a format whose exporter comes with an add-on."""
    remedy = f"enable the add-on {add_on} format under Edit > Preferences > Add-ons"
    return ExportFormat(label, description, exporter, remedy, **default)


_GLTF = ("export_scene", "gltf")
EXPORT_FORMATS: Mapping[str, ExportFormat] = MappingProxyType(
    {
        "bvh": _with_add_on("BVH", "Skeleton and motion as text, Y up", ("export_anim", "bvh"), "BVH", is_default=True),
        "fbx": _with_add_on(
            "FBX", "Skeleton and motion for other programs, Y up", ("export_scene", "fbx"), "FBX", is_default=True
        ),
        "glb": _with_add_on("glTF", "Skeleton and motion for the web and game engines, Y up (.glb)", _GLTF, "glTF 2.0"),
        "vrma": _with_add_on(
            "VRM", "VRM animation, which any VRM character plays: humans only, in metres (.vrma)", _GLTF, "glTF 2.0"
        ),
        "usdc": ExportFormat(
            "USD",
            "Skeleton and motion as USD, Y up (.usdc)",
            ("wm", "usd_export"),
            "choose other kinds of files, or use a Blender that was built with USD",
        ),
    }
)
"""The formats by the endings of their files, which are also the names of their properties in `KFMocapExport`; files are
written in this order."""


def chosen_formats(settings: Any) -> tuple[str, ...]:
    """Return the formats that are switched on in the properties `KFMocapExport`."""
    return tuple(name for name in EXPORT_FORMATS if getattr(settings, name))
