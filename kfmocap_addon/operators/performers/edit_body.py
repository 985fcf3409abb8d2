"""Adding bodies, using armatures as bodies, and editing their parts."""

from typing import Any

import bpy
from mathutils import Vector

from ....core.errors import BodyError
from ...properties.body_fields import MEASURES, USUAL_HEIGHT, height_field, length_field
from ...viewports.see_through import see_through_skins
from ..conditions import Conditional, in_object_mode
from ..mixin import OfPerformer, ReportingOperator

_FOOT = ("Foot", "From the ankle forward to the big toe")
LENGTHS = (*(name for name in MEASURES if name != "foot"), "foot_forward")
"""Measures of a new body; the foot's is its length forward of the ankle, as measured on the floor. Measures that are
not given follow from the height."""


def _length(name: str) -> object:
    label, what = MEASURES.get(name, _FOOT)
    return length_field(label, f"{what}, metres; 0: as an average person of that height has it", min=0.0)


class AddBody(Conditional, bpy.types.Operator):
    """Add a body to track: an armature with its parts, from a height or from measured lengths. It stands at the 3D
    cursor, or beside the bodies that do, and is a performer of the shot"""

    bl_idname = "kfmocap.add_body"
    bl_label = "KF Mocap Body"
    conditions = (in_object_mode,)

    performer: bpy.props.StringProperty(
        default="Performer", name="Name", description="Name of the performer and the armature"
    )
    height: height_field("From the soles to the top of the head, metres", default=USUAL_HEIGHT)
    measured: bpy.props.BoolProperty(name="Measured Lengths", description="Give lengths of the performer's limbs, too")
    shoulder_width: _length("shoulder_width")
    hip_width: _length("hip_width")
    torso: _length("torso")
    head: _length("head")
    upper_arm: _length("upper_arm")
    forearm: _length("forearm")
    hand: _length("hand")
    thigh: _length("thigh")
    shin: _length("shin")
    foot_forward: _length("foot_forward")

    def act(self, context: bpy.types.Context) -> None:
        from ....core.body import human
        from ...scene_io import performers

        lengths = {name: getattr(self, name) for name in LENGTHS if self.measured and getattr(self, name) > 0}
        body = human(round(self.height, 6), {name: round(value, 6) for name, value in lengths.items()})
        context.view_layer.update()  # of what a script has just moved
        place = _free_place(context.scene)[:]
        select_only(context, performers.add_performer(context.scene, body, self.performer or "Performer", place))

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.prop(self, "performer")
        layout.prop(self, "height")
        layout.prop(self, "measured")
        if self.measured:
            column = layout.column(align=True)
            for name in LENGTHS:
                column.prop(self, name)


_BESIDE = 0.75  # metres: arms may reach into each other


def _free_place(scene: bpy.types.Scene) -> Vector:
    """Return the 3D cursor's position, or one beside the bodies that stand there on this frame and would hide the new
    one.
    """
    place = scene.cursor.location.copy()
    armatures = [slot.armature for slot in scene.kfmocap.performers if slot.armature is not None]
    roots = [arm.matrix_world @ next(bone for bone in arm.pose.bones if bone.parent is None).head for arm in armatures]
    while any((root - place).xy.length < _BESIDE for root in roots):
        place.x += _BESIDE
    return place


def _candidate(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the armature that is active, deforms the active mesh or is in the active instance of a linked collection,
    else that mesh, else None.
    """
    active = context.active_object
    if active is None or active.type == "ARMATURE":
        return active
    if active.type == "EMPTY" and active.instance_collection is not None and active.instance_collection.library:
        return _leading_armature(active.instance_collection)
    if active.type != "MESH" or active.parent_type == "BONE":
        return None
    return next(
        (m.object for m in list[Any](active.modifiers) if m.type == "ARMATURE" and m.object is not None), active
    )


def _leading_armature(collection: bpy.types.Collection) -> bpy.types.Object | None:
    """Return the only armature of a collection, or the only one that does not follow another."""
    found = [o for o in collection.all_objects if o.type == "ARMATURE"]
    if len(found) > 1:
        from ...scene_io.characters.followed_bones import leader_of

        found = [armature for armature in found if leader_of(armature) not in found]
    return found[0] if len(found) == 1 else None


def _can_be_body(context: bpy.types.Context) -> str:
    candidate = _candidate(context)
    if candidate is None:
        return "Make an armature active first, or the mesh of a prop, or a linked character"
    return in_object_mode(context) if candidate.type == "MESH" else ""


def _armature_is_new(context: bpy.types.Context) -> str:
    candidate = _candidate(context)
    known = any(slot.armature == candidate for slot in context.scene.kfmocap.performers)
    return f"{candidate.name} is a performer already" if known else ""


class UseArmature(Conditional, bpy.types.Operator):
    """Make the active armature a performer of the shot: one whose bones carry meshes, or a skinned character, whose
    skin is divided into parts. Control rigs, such as Rigify's, are tracked through their FK controls. An active mesh
    without an armature becomes a prop: it gets a bone that moves it, and its keys become those of the bone"""

    bl_idname = "kfmocap.use_armature"
    bl_label = "Use Active Object"
    conditions = (_can_be_body, _armature_is_new)

    def act(self, context: bpy.types.Context) -> None:
        from ...retargeting.tracked_bodies.prop_body import use_as_prop
        from ...retargeting.tracked_bodies.skinned_body import use_as_body

        candidate = _candidate(context)
        if candidate.type == "MESH":
            hung = len(candidate.children_recursive)
            select_only(context, use_as_prop(context.scene, candidate))
            if hung:
                what = f"what hangs on it ({hung} object{'s' if hung > 1 else ''}) belongs to its one rigid part"
                self.report({"INFO"}, f"{candidate.name}: {what}. Limbs are tracked on the bones of an armature")
            return
        taken, remarks = use_as_body(context.scene, candidate)
        if context.mode == "OBJECT":
            select_only(context, taken)  # its mesh was active, or an instance of it
        see_through_skins(context.window)
        for text in remarks:
            self.report({"WARNING"}, text)


class RemovePerformer(OfPerformer, ReportingOperator, bpy.types.Operator):
    """Remove this performer from the shot. The armature and its keys stay in the scene; if the armature was deleted,
    the parts that it left behind are removed, too"""

    bl_idname = "kfmocap.remove_performer"
    bl_label = "Remove Performer"
    bl_options = {"REGISTER", "UNDO"}

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io import performers

        self.slot(context)
        performers.remove(context.scene, self.performer)


def _bone_is_active(context: bpy.types.Context) -> str:
    if context.mode == "POSE" and context.active_pose_bone is not None:
        return ""
    return "Go to pose mode and click on the bone whose part you want to edit"


class EditPart(Conditional, bpy.types.Operator):
    """Edit the mesh of the active bone: the tracker takes the convex hull of what you make of it"""

    bl_idname = "kfmocap.edit_part"
    bl_label = "Edit Part"
    conditions = (_bone_is_active,)

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io.body import part_meshes

        armature, bone = context.active_object, context.active_pose_bone.name
        part = next(iter(part_meshes.meshes_on(armature, bone)), None)
        if part is None:
            raise BodyError(f"No mesh is parented to the bone {bone}")
        bpy.ops.object.mode_set(mode="OBJECT")
        part.hide_select = part.hide_viewport = False
        context.view_layer.update()
        if not part.visible_get():
            part.hide_select = True
            raise BodyError(f"{part.name} is hidden: show it and its collection first")
        select_only(context, part)
        bpy.ops.object.mode_set(mode="EDIT")


def _part_is_edited(context: bpy.types.Context) -> str:
    return "" if edited_part(context) is not None else "No part is being edited: use Edit Part"


class FinishPart(Conditional, bpy.types.Operator):
    """Go back to posing. Parts cannot be clicked on again, so that they are never in the way of the bones"""

    bl_idname = "kfmocap.finish_part"
    bl_label = "Finish Part"
    conditions = (_part_is_edited,)

    mirror: bpy.props.BoolProperty(
        default=True, name="Both Sides", description="Give the same part of the other side the mirrored shape"
    )

    def act(self, context: bpy.types.Context) -> None:
        from ...scene_io.body import part_meshes

        part = edited_part(context)
        if context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        part_meshes.check_part(part)
        if self.mirror:
            part_meshes.mirror_part(part)
        part.hide_select = True
        part_meshes.show_parts(context.scene)
        select_only(context, part.parent)
        if part.parent.visible_get():
            bpy.ops.object.mode_set(mode="POSE")


def edited_part(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the active mesh if it is a performer's part, as after Edit Part, else None."""
    active = context.active_object
    if active is None or active.type != "MESH" or active.parent_type != "BONE":
        return None
    return active if any(slot.armature == active.parent for slot in context.scene.kfmocap.performers) else None


def select_only(context: bpy.types.Context, owner: bpy.types.Object) -> None:
    """Make an object the active and only selected one."""
    for other in context.selected_objects:
        other.select_set(False)
    if owner.name in context.view_layer.objects:
        owner.select_set(True)
        context.view_layer.objects.active = owner


def add_to_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """Draw the entry of the menu Add > Armature."""
    self.layout.operator_context = "INVOKE_REGION_WIN"
    self.layout.operator(AddBody.bl_idname, icon="OUTLINER_OB_ARMATURE")


MENUS = (("VIEW3D_MT_armature_add", add_to_menu),)
CLASSES = (AddBody, UseArmature, RemovePerformer, EditPart, FinishPart)
