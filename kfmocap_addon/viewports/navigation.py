"""Which events orbit, pan and zoom a 3D view in the user's own keymap."""

from __future__ import annotations

from typing import Any

import bpy

_TOOLS = ("view3d.rotate", "view3d.move", "view3d.zoom", "view3d.dolly", "view3d.view_roll", "view3d.view_pan")
_MODIFIERS = ("alt", "ctrl", "shift", "oskey")
_ANY = -1  # what Blender says of a modifier that may be held or not


def navigates(event: bpy.types.Event) -> bool:
    """Whether an event orbits, pans or zooms a 3D view in the user's keymap, while another key is held.

    In the industry compatible keymap these are mouse buttons with Alt, which tools would take for clicks.
    """
    held: Any = {name: getattr(event, name) for name in _MODIFIERS}
    keyconfig: Any = bpy.context.window_manager.keyconfigs.user
    keymap = keyconfig.keymaps.get("3D View") if keyconfig is not None else None
    return any(held.values()) and any(
        item.active and item.idname in _TOOLS and item.type == event.type and _suits(item, held)
        for item in (keymap.keymap_items if keymap is not None else ())
    )


def _suits(item: bpy.types.KeyMapItem, held: dict[str, bool]) -> bool:
    """Return whether a key of a keymap is meant by the modifiers that are held."""
    return all(getattr(item, name) in (_ANY, int(is_held)) for name, is_held in held.items())
