"""The section "Key Poses": the poses that tracking meets."""

from collections.abc import Sequence

import bpy

from ..operators.conditions import is_placing, no_performer
from ..operators.performers.exchange_people import ExchangePeople
from ..operators.posing.clear_marks import ClearMarks
from ..operators.posing.copy_pose import CopyPose, MirrorPose, PastePose
from ..operators.posing.nudge_pose import BreakdownPose, NudgeDepth, NudgePose
from ..operators.posing.place_joints import PlaceJoints
from ..operators.posing.pose_from_files import ImportKeypoints, MarkKeypoints, PoseFromKeypoints, PoseFromLandmarks
from ..operators.posing.set_key_pose import AcceptProposals, RefuseProposal, RemoveKeyPose, SetKeyPose
from ..operators.posing.show_key_pictures import ShowKeyPictures
from ..operators.tracking.go_to_frame import GoToFrame
from ..properties.section_properties import sections_of
from ..scene_io import active_performer
from ..scene_io.key_pictures import KeyPictures
from ..session import SESSION
from ..viewports import key_list
from . import performer_rows
from .guide import in_shot
from .section import FoldedPart, PerformerPart, Section, draw_as_form
from .texts import draw_hidden, draw_text

_COLUMNS, _PICTURE_COLUMNS, _PICTURE_SCALE = 6, 2, 6.0


class KeyPosesPanel(Section, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_key_poses"
    bl_label = "Key Poses"

    def draw_content(self, context: bpy.types.Context) -> None:
        layout, properties = self.layout, context.scene.kfmocap
        slot = active_performer.chosen(context)
        if slot is None:
            draw_text(layout, context, no_performer(context), "INFO")
        else:
            performer_rows.draw_title(layout, context, slot)
            draw_hidden(layout, context, slot.armature, "The body")
            _draw_advice(layout, context, slot, key_list.known_keys().entries(slot.armature))
        column = layout.column(align=True)
        row = column.row(align=True)
        row.operator(PlaceJoints.bl_idname, icon="OUTLINER_OB_ARMATURE")
        row.operator(ClearMarks.bl_idname, text="", icon="X")
        row.prop(properties, "show_marks", text="", icon="HIDE_OFF" if properties.show_marks else "HIDE_ON")
        row = column.row(align=True)
        row.operator(SetKeyPose.bl_idname, icon="KEY_HLT")
        row.operator(RemoveKeyPose.bl_idname, text="", icon="KEY_DEHLT")
        for each in performer_rows.in_order(context):
            if each != slot:
                performer_rows.draw_title(layout, context, each)
            rows = key_list.known_keys().entries(each.armature) or ()
            _draw_rows(layout, context.scene.frame_current, rows, accepts=each == slot)


class KeyPicturesPanel(FoldedPart, PerformerPart, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_key_pictures"
    bl_label = "Pictures"
    bl_parent_id = KeyPosesPanel.bl_idname

    def draw(self, context: bpy.types.Context) -> None:
        layout, slot = self.layout, active_performer.chosen(context)
        layout.operator(ShowKeyPictures.bl_idname, icon="IMAGE_DATA")
        icons = SESSION.of(KeyPictures).icons(slot.armature)
        grid = layout.grid_flow(row_major=True, columns=_PICTURE_COLUMNS, even_columns=True)
        for row in key_list.known_keys().entries(slot.armature) or ():
            if row.frame in icons:
                _draw_picture(grid.column(align=True), context.scene.frame_current, row, icons[row.frame])


def _draw_picture(column: bpy.types.UILayout, frame: int, row: key_list.KeyPoseEntry, icon: int) -> None:
    """Draw a key pose's picture and, below it, the button that goes to its frame and those for a proposal."""
    column.template_icon(icon_value=icon, scale=_PICTURE_SCALE)
    buttons = column.row(align=True)
    button = buttons.operator(GoToFrame.bl_idname, text=str(row.frame), depress=row.frame == frame)
    button.frame, button.reason = row.frame, row.description
    if row.proposed:
        buttons.operator(AcceptProposals.bl_idname, text="", icon="CHECKMARK").frame = row.frame
        buttons.operator(RefuseProposal.bl_idname, text="", icon="X").frame = row.frame


class PoseToolsPanel(PerformerPart, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_pose_tools"
    bl_label = "From Other Poses"
    bl_parent_id = KeyPosesPanel.bl_idname

    def draw(self, context: bpy.types.Context) -> None:
        slot = active_performer.chosen(context)
        before, after = _sides_with_key_poses(key_list.known_keys().entries(slot.armature), context.scene.frame_current)
        column = self.layout.column(align=True)
        row = column.row(align=True)
        row.operator(CopyPose.bl_idname, text="Copy", icon="COPYDOWN")
        row.operator(PastePose.bl_idname, text="Paste", icon="PASTEDOWN").flipped = False
        row.operator(PastePose.bl_idname, text="", icon="PASTEFLIPDOWN").flipped = True
        column.operator(MirrorPose.bl_idname, icon="MOD_MIRROR")
        row = column.row(align=True)
        _part(row, before).operator(NudgePose.bl_idname, text="", icon="TRIA_LEFT").side = "BEFORE"
        _part(row, before and after).operator(BreakdownPose.bl_idname)
        _part(row, after).operator(NudgePose.bl_idname, text="", icon="TRIA_RIGHT").side = "AFTER"
        column.operator(NudgeDepth.bl_idname, text="Closer to the Camera").distance = -0.05
        column.operator(NudgeDepth.bl_idname, text="Away from the Camera").distance = 0.05


def _sides_with_key_poses(rows: tuple[key_list.KeyPoseEntry, ...] | None, frame: int) -> tuple[bool, bool]:
    """Return whether there are key poses before and after a frame; both are assumed until they have been looked up."""
    own = [row.frame for row in rows or () if not row.proposed]
    return rows is None or any(f < frame for f in own), rows is None or any(f > frame for f in own)


def _part(row: bpy.types.UILayout, enabled: bool) -> bpy.types.UILayout:
    part = row.row(align=True)
    part.enabled = enabled
    return part


class PoseFilesPanel(FoldedPart, PerformerPart, bpy.types.Panel):
    bl_idname = "KFMOCAP_PT_pose_files"
    bl_label = "From Keypoints and Landmarks"
    bl_parent_id = KeyPosesPanel.bl_idname

    def draw(self, context: bpy.types.Context) -> None:
        layout, properties = self.layout, context.scene.kfmocap
        known = [view.name for view in properties.views if view.keypoints]
        text = f"Keypoints of {', '.join(known)}" if known else "No view has keypoints yet"
        draw_text(layout, context, text, "INFO")
        layout.operator(ImportKeypoints.bl_idname, icon="IMPORT")
        if len(properties.performers) > 1 and known:
            _draw_people(layout, context)
        layout.operator(MarkKeypoints.bl_idname, icon="PIVOT_CURSOR")
        frames = layout.column()
        draw_as_form(frames)
        frames.prop(properties.key_frames, "choice")
        for choice, name in (("EVERY", "step"), ("LISTED", "listed")):
            if properties.key_frames.choice == choice:
                frames.prop(properties.key_frames, name)
        frames.prop(properties.key_frames, "replace")
        column = layout.column(align=True)
        column.operator(PoseFromKeypoints.bl_idname, icon="ARMATURE_DATA")
        column.operator(PoseFromLandmarks.bl_idname, icon="EMPTY_AXIS")


def _draw_people(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw which of the people in the keypoints each performer is."""
    column = layout.column(align=True)
    for slot in context.scene.kfmocap.performers:
        draw_text(column, context, f"{slot.name}: {slot.identity or 'not looked for yet'}")
        column.prop(slot, "person", text=f"{slot.name} is Person")
    column.operator(ExchangePeople.bl_idname, icon="ARROW_LEFTRIGHT")


def _draw_advice(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    slot: bpy.types.PropertyGroup,
    rows: tuple[key_list.KeyPoseEntry, ...] | None,
) -> None:
    """Draw a hint on what to do next."""
    if is_placing(context):
        several = sum(view.is_calibrated for view in context.scene.kfmocap.views) > 1
        where = ", in two views or more." if several else ". One camera does not show depth: A shows other poses."
        draw_text(layout, context, f"Click the joints{where} Enter keys the pose, Esc cancels", "INFO")
        return
    if missing := PlaceJoints.missing(context):
        draw_text(layout, context, missing, "INFO")
        return
    if rows is None:
        return
    scene, column = context.scene, layout.column(align=True)
    inside = in_shot(scene, rows)
    own = [row.frame for row in inside if not row.proposed]
    if not inside:
        known = any(view.keypoints for view in scene.kfmocap.views)
        others = "From Keypoints below, or" if known else "on the first frame"
        which = f"in the shot yet, {scene.kfmocap.scene_first} to {scene.kfmocap.scene_last}" if rows else "yet"
        draw_text(column, context, f"No key pose {which}: {others} Place Joints, or Set Key Pose", "INFO")
        if "body" not in sections_of(context).shown:  # folded when the body was added
            column.prop(slot, "height")
        if scene.frame_current != scene.frame_start:
            column.operator(GoToFrame.bl_idname, text="To the First Frame", icon="REW").frame = scene.frame_start
    elif not own:
        draw_text(column, context, "Proposals only: correct them, then accept them, or just track", "INFO")
    elif len(own) < len(inside):
        draw_text(column, context, "Proposals are left: accept or refuse them, or just track", "INFO")
    elif (far := _open_end(scene, own)) is not None:
        count = "A second" if len(own) == 1 else "One more"
        draw_text(column, context, f"{count} key pose, on frame {far}, helps the tracker most", "INFO")
        if scene.frame_current != far:
            column.operator(GoToFrame.bl_idname, text=f"To Frame {far}", icon="FF").frame = far


def _open_end(scene: bpy.types.Scene, keyed: Sequence[int]) -> int | None:
    """Return the end of the shot that is farther from all key poses, if keypoints do not show the performer there."""
    to_start, to_end = min(keyed) - scene.frame_start, scene.frame_end - max(keyed)
    known = len(keyed) > 1 and any(view.keypoints for view in scene.kfmocap.views)
    if known or max(to_start, to_end) <= 0:
        return None
    return scene.frame_start if to_start > to_end else scene.frame_end


def _draw_rows(
    layout: bpy.types.UILayout, frame: int, rows: tuple[key_list.KeyPoseEntry, ...], accepts: bool = True
) -> None:
    """Draw a button for every key pose of a performer, which goes to its frame, and buttons to accept proposals."""
    if rows or not accepts:  # the chosen one's section says what to do
        layout.label(text="Frames with a key pose" if rows else "No key pose yet")
    grid = layout.grid_flow(row_major=True, columns=_COLUMNS, even_columns=True, align=True)
    for row in rows:
        icon = "QUESTION" if row.proposed else "BONE_DATA" if row.bones else "NONE"
        button = grid.operator(GoToFrame.bl_idname, text=str(row.frame), icon=icon, depress=row.frame == frame)
        button.frame, button.reason = row.frame, row.description
    if accepts and any(row.proposed for row in rows):
        accept = layout.row(align=True)
        this = accept.row(align=True)
        this.enabled = any(row.proposed and row.frame == frame for row in rows)
        this.operator(AcceptProposals.bl_idname, icon="CHECKMARK").every = False
        accept.operator(AcceptProposals.bl_idname, text="Accept All").every = True


CLASSES = (KeyPosesPanel, KeyPicturesPanel, PoseToolsPanel, PoseFilesPanel)
