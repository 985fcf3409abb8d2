"""What character motion is sent to, and how."""

import bpy

from ...core.choices import FEET, ROOT_MOTIONS
from ...core.retargeting.bone_roles.bone_presets import PRESETS
from .choice_items import choice_items
from .pointer_polls import is_armature, is_character
from .tolerance_fields import shift_tolerance, turn_tolerance


class KFMocapBone(bpy.types.PropertyGroup):
    """A bone that plays a role in the character's skeleton; its name is the role's."""

    bone: bpy.props.StringProperty(name="Bone", description="The bone of the character that plays this role")
    chain: bpy.props.IntProperty(
        name="Place",
        description="Its place in a chain such as the spine, counted from the hips or the hand outward, from 0",
    )


class KFMocapLimbError(bpy.types.PropertyGroup):
    """How far a limb of the character is from where it should be; its name is the limb's."""

    degrees: bpy.props.FloatProperty(name="Degrees", description="Worst rotation error of its bones, degrees")
    distance: bpy.props.FloatProperty(name="Distance", description="Worst position error of its bones, mm")


class KFMocapRetarget(bpy.types.PropertyGroup):
    """What motion is sent to, and how."""

    target: bpy.props.PointerProperty(
        type=bpy.types.Object, poll=is_character, name="Character", description="Armature that is to move"
    )
    source: bpy.props.PointerProperty(
        type=bpy.types.Object,
        poll=is_armature,
        name="Motion From",
        description="Armature whose motion is sent, over the frames of the scene. Empty: the performer",
    )
    preset: bpy.props.EnumProperty(
        items=[
            (
                "auto",
                "Automatic",
                "The preset that fits most of its bones; failing that, bones are found by name, then by place",
            ),
            *((name, preset.label, preset.description) for name, preset in PRESETS.items()),
        ],
        name="Rig",
        description="What kind of rig the character has",
    )
    bones: bpy.props.CollectionProperty(type=KFMocapBone)
    active_bone: bpy.props.IntProperty(name="Active Bone", description="The role shown in the list of bones")
    errors: bpy.props.CollectionProperty(type=KFMocapLimbError)
    root: bpy.props.EnumProperty(
        items=choice_items(ROOT_MOTIONS),
        name="Root Motion",
        description="Which bone carries the motion through the world",
    )
    feet: bpy.props.EnumProperty(
        items=choice_items(FEET), name="Feet", description="How feet are kept where they stood"
    )
    hands: bpy.props.BoolProperty(name="Keep Hands", description="Hands that stand still in the world stay there")
    live: bpy.props.BoolProperty(
        name="Live",
        description="The character follows by constraints, so that every change of the motion shows at once. Feet are "
        "not kept; send again without this to get keys",
    )
    layer: bpy.props.BoolProperty(
        name="As Layer", description="Keep the character's present action below, as a strip of the NLA"
    )
    sparse: bpy.props.BoolProperty(name="Fewer Keys", description="Leave out keys that smooth curves make unnecessary")
    angle: turn_tolerance(0.5, "How far a bone may turn away for the sake of fewer keys, degrees")
    distance: shift_tolerance(1.0, "How far a bone may move away for the sake of fewer keys, mm")


CLASSES = (KFMocapBone, KFMocapLimbError, KFMocapRetarget)
