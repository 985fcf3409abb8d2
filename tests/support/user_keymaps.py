"""Keys as in other keymaps than Blender's default."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy


@contextmanager
def orbiting_with_alt() -> Iterator[None]:
    """Have Alt and the left mouse button orbit the 3D view, as in the industry compatible keymap."""
    keymap = bpy.context.window_manager.keyconfigs.user.keymaps["3D View"]
    item = keymap.keymap_items.new("view3d.rotate", "LEFTMOUSE", "PRESS", alt=True)
    try:
        yield
    finally:
        keymap.keymap_items.remove(item)
