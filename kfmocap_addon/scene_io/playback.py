"""Whether Blender plays the keys of a scene's performers on their frames, as the tracker assumes."""

from __future__ import annotations

import bpy

from ...core.errors import ShotError


def check_playback(scene: bpy.types.Scene) -> None:
    """Check that keys are played on the frames on which they lie, and that every performer has its own.

    Raises
    ------
    ShotError
        Time is stretched, a strip of a performer's NLA is being edited, its action is linked, or two performers share
        their keys.
    """
    render = scene.render
    if render.frame_map_old != render.frame_map_new:
        raise ShotError(
            f"time is stretched from {render.frame_map_old} to {render.frame_map_new}, so keys are shown beside the "
            "footage of their frames",
            where=f"scene {scene.name}",
            todo="set both to 100 under Output > Frame Range > Time Stretching",
        )
    keyed_by: dict[tuple[str, int], str] = {}
    for slot in scene.kfmocap.performers:
        data = slot.armature.animation_data if slot.armature is not None else None
        if data is not None and data.use_tweak_mode:
            raise ShotError(
                "a strip of its NLA is being edited, whose frames are not those of the footage",
                where=f"performer {slot.name}",
                todo="leave the strip: Tab in the NLA editor",
            )
        if data is None or data.action is None or data.action_slot is None:
            continue
        if (library := data.action.library) is not None:
            raise ShotError(
                f"its action is linked from {bpy.path.basename(library.filepath)}, where no keys can be set from here",
                where=f"performer {slot.name}",
                todo="make it local: the chain beside its name in the Action Editor",
            )
        keys = data.action.name_full, data.action_slot.handle
        other = keyed_by.setdefault(keys, slot.name)
        if other != slot.name:
            raise ShotError(
                f"it has the same action as {other}, so both would have the same motion",
                where=f"performer {slot.name}",
                todo="make it a copy: the number beside the action's name in the Action Editor",
            )


def unreachable_keys(armature: bpy.types.Object | None) -> bool:
    """Whether an armature without an action of its own has one as a strip of the NLA."""
    data = armature.animation_data if armature is not None else None
    if data is None or data.action is not None:
        return False
    return any(strip.action for track in data.nla_tracks for strip in track.strips)
