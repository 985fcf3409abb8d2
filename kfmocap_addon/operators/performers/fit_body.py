"""Fit Body: lengths and widths of the parts, from the key poses over the footage."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import bpy

from ....core.runtime.processes.worker_process import Work
from ...scene_io.linked import linked_file
from ..conditions import Conditional, has_footage, has_shot
from ..job_operator import JobOperator
from ..key_conditions import has_whole_key_pose

if TYPE_CHECKING:
    from ....core.fitting.body_fit import BodyFit


def has_own_shape(context: bpy.types.Context) -> str:
    """The body of a performer may get other proportions: it is no character's skin."""
    armatures = [slot.armature for slot in context.scene.kfmocap.performers if slot.armature is not None]
    fixed = [why for armature in armatures if (why := _why_fixed(armature))]
    return fixed[0] if fixed and len(fixed) == len(armatures) else ""


def _why_fixed(armature: bpy.types.Object) -> str:
    """Return why a body keeps its proportions; empty where they can be changed."""
    if file := linked_file(armature.data):
        return f"The bones of {armature.name} are linked from {file}, and keep their lengths: change them there"
    from ...scene_io.body.part_meshes import is_of_skin  # loads NumPy, which must not slow down Blender's start

    return _OF_SKIN if is_of_skin(armature) else ""


_OF_SKIN = "A skinned character keeps its proportions: set its height instead"
_MOVES = "Also move your key poses of the whole body to where the fitted body lies best on the footage"


class FitBody(Conditional, JobOperator, bpy.types.Operator):
    """Make the parts as long and as wide as the performers in the footage, from the frames on which you posed the whole
    body: three or more in different postures are best. 2D keypoints give lengths more exactly. Esc cancels"""

    bl_idname = "kfmocap.fit_body"
    bl_label = "Fit Body"
    conditions = (has_shot, has_footage, has_own_shape, has_whole_key_pose)

    adjust_poses: bpy.props.BoolProperty(
        name="Adjust Key Poses",
        description=_MOVES,
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        what = " ".join((cls.__doc__ or "").split())
        return f"{what}. {_MOVES}" if properties.adjust_poses else what

    def prepare(self, context: bpy.types.Context) -> Work:
        from ....core.fitting.body_fit import fit_bodies
        from ...scene_io import scene as scenes

        shot = scenes.shot_from_scene(context.scene)
        return partial(fit_bodies, shot)

    def finish(self, context: bpy.types.Context, result: BodyFit) -> None:
        from ....core.shot.shot import KeyPoses
        from ...scene_io.body import body_armature
        from ...scene_io.keys import key_pose_curves

        shot = context.scene.kfmocap
        for slot, body, poses, growth in zip(shot.performers, result.bodies, result.poses, result.growth, strict=True):
            if why := _why_fixed(slot.armature):
                self.report({"INFO"}, f"{slot.name}: {why}")
                continue
            body_armature.reshape(slot.armature, body)
            if self.adjust_poses:
                key_pose_curves.write_key_poses(slot.armature, KeyPoses.whole(result.frames, poses), shot.frame_start)
            change = f"{abs(growth):.0%} {'larger' if growth > 0 else 'smaller'}"
            count = len(result.frames)
            keys = f"{count} key pose{'s' if count > 1 else ''}"
            self.report({"INFO"}, f"{slot.name}: fitted to {keys}; {change} than before")


CLASSES = (FitBody,)
