"""The guide through the sections: when a step is done, its section folds and the next one opens."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import bpy

from ..operators.conditions import outside_shot
from ..properties.section_properties import sections_of
from ..scene_io import active_performer
from ..scene_io.review import bone_visibility
from ..session import SESSION
from ..viewports import key_list, viewport

STEPS = ("footage", "body", "key_poses", "track", "review")
"""Sections of the steps, in their order."""
_SETTLING = (0.1, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0)  # seconds: a slow machine needs longer for one drawing
LEAST_KEYS = 2
"""Number of key poses of each performer that completes the step: one at either end is enough to start with."""


def is_open(context: bpy.types.Context, section: str) -> bool:
    """Whether a section is open."""
    return section in sections_of(context).shown


def is_done(context: bpy.types.Context, section: str) -> bool:
    """Whether the step of a section is done."""
    if section == "export":
        return bool(context.scene.kfmocap.export.written)
    step = current_step(context)
    return step is not None and section in STEPS[: STEPS.index(step)]


def current_step(context: bpy.types.Context) -> str | None:
    """Return the section of the first step that is not done; None until key poses have been looked up.

    While there are proposed key poses and nothing is tracked, that is the section in which they are accepted or
    refused.
    """
    shot = context.scene.kfmocap
    if not shot.views or any(view.missing or not (view.has_camera and view.is_calibrated) for view in shot.views):
        return "footage"
    if not shot.performers or not all(active_performer.is_present(context.scene, slot) for slot in shot.performers):
        return "body"
    keys = [key_list.known_keys().entries(slot.armature) for slot in shot.performers]
    if any(entries is None for entries in keys):
        return None
    if any(len(in_shot(context.scene, entries)) < LEAST_KEYS for entries in keys if entries is not None):
        return "key_poses"
    if all(bone_visibility.is_tracked(slot.armature) for slot in shot.performers):
        return "review"
    return "key_poses" if any(entry.proposed for entries in keys if entries for entry in entries) else "track"


def in_shot(scene: bpy.types.Scene, entries: Sequence[key_list.KeyPoseEntry]) -> list[key_list.KeyPoseEntry]:
    """Return the key poses whose frames are the shot's: others count for nothing in tracking."""
    return [entry for entry in entries if not outside_shot(scene, entry.frame)]


def follow(context: bpy.types.Context) -> None:
    """Schedule the opening of the current step's section if the step has changed, which drawing code cannot do
    itself.

    All windows have the same sections open, which follow the scene of the first window: if each window opened those of
    its own scene, they would do so in turn for ever.
    """
    if bpy.app.background or context.scene != context.window_manager.windows[0].scene:
        return
    step = current_step(context)
    if step is None or step == sections_of(context).step:
        return
    if not bpy.app.timers.is_registered(_take_step):
        bpy.app.timers.register(_take_step, first_interval=0.0)


def _take_step() -> None:
    context = bpy.context
    with context.temp_override(window=context.window_manager.windows[0]):
        step = current_step(context)
        if step is not None:
            take_step(context, step)
            viewport.redraw(context)
            # Only when it draws again does Blender move panels below those that have grown.
            for wait in _SETTLING:
                bpy.app.timers.register(partial(_settle), first_interval=wait)


def _settle() -> None:
    viewport.redraw(bpy.context)


def take_step(context: bpy.types.Context, step: str) -> None:
    """Open the section of a step and fold those of finished steps; a step back, as when another performer is added,
    folds those of all other steps.
    """
    guided = sections_of(context)
    before, now = STEPS.index(guided.step) if guided.step in STEPS else -1, STEPS.index(step)
    if before == now:
        return
    folded = STEPS[:now] if now > before else STEPS
    guided.shown = (guided.shown - set(folded)) | {step} | ({"look"} if step != "footage" else set())
    guided.step = step


def register() -> None:
    """Have what is scheduled cancelled in the end."""
    SESSION.on_end(_cancel)


def _cancel() -> None:
    if bpy.app.timers.is_registered(_take_step):
        bpy.app.timers.unregister(_take_step)
