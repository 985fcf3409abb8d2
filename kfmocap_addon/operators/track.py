"""Track: the frames between the key poses, from the footage."""

import bpy

from .reporting import explained, progress_shown, reported


class Track(bpy.types.Operator):
    """Fill in every frame between the key poses from the footage. Keys you set stay as they are; those of an
    earlier tracking are replaced"""

    bl_idname = "kfmocap.track"
    bl_label = "Track"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return explained(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...core import tracking
        from .. import review
        from .. import scene as scenes

        with progress_shown(context) as progress, reported(self) as outcome:
            shot = scenes.shot_from_scene(context.scene)
            result = tracking.track(shot, progress)
            scenes.write_motions(context.scene, result.motions)
            review.write_review(context.scene, shot, result)
            self.report({"INFO"}, f"Tracked {shot.length} frames in {sum(result.seconds.values()):.1f} s")
        return outcome.value


CLASSES = (Track,)
