"""Being told when something in Blender changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from ..session import SESSION


def watch(changed: Callable[..., Any], replaced: Callable[..., Any]) -> None:
    """Call functions until the session ends: one after every change, one when other data takes the place of all.

    Both must be persistent handlers of Blender's, which forgets others when a file is opened.
    """
    at = bpy.app.handlers
    for handlers in (at.undo_post, at.redo_post, at.load_post):
        handlers.append(replaced)
        SESSION.on_end(handlers.remove, replaced)
    at.depsgraph_update_post.append(changed)
    SESSION.on_end(at.depsgraph_update_post.remove, changed)
