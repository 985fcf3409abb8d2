"""What to export, and what was exported last."""

import bpy

from ..export.export_formats import EXPORT_FORMATS
from ..export.presets import PRESETS


class KFMocapExport(bpy.types.PropertyGroup):
    """What to export, and what was exported last; for each of `EXPORT_FORMATS`, whether it is written."""

    written: bpy.props.StringProperty(
        name="Written", description="Paths of the files that were written last, one to a line"
    )
    path: bpy.props.StringProperty(
        subtype="FILE_PATH", name="Last Name", description="Path that was chosen last, without an ending"
    )

    whom: bpy.props.EnumProperty(
        items=[
            ("PERFORMERS", "Performers", "The motion of every performer, on the body that was tracked"),
            ("CHARACTER", "Character", "The character that is chosen in Send to Rig, with all its bones"),
        ],
        name="Whom",
        description="Whose motion is written",
    )
    preset: bpy.props.EnumProperty(
        items=[(key, preset.label, preset.description) for key, preset in PRESETS.items()],
        name="For",
        description="The program that will read the files: it decides the names of the bones and the unit of length",
    )
    use_range: bpy.props.BoolProperty(name="Frame Range", description="Export only some frames, not the whole shot")
    first: bpy.props.IntProperty(default=1, name="First", description="First scene frame to export")
    last: bpy.props.IntProperty(default=250, name="Last", description="Last scene frame to export, inclusive")
    use_rate: bpy.props.BoolProperty(name="Frame Rate", description="Export at a frame rate other than the scene's")
    fps: bpy.props.FloatProperty(
        default=30.0,
        min=1.0,
        soft_max=240.0,
        precision=3,
        name="Rate",
        description="Frames per second of the files; between the shot's frames rotations are interpolated by slerp",
    )
    root_motion: bpy.props.BoolProperty(
        default=True,
        name="Root Motion",
        description="The performer moves through the world. Off: it stays above where it starts, but moves up and down",
    )
    leave_out_unknown: bpy.props.BoolProperty(
        name="Leave Out Unknown",
        description="Leave out the bones of parts that no key pose, keypoint or camera has shown",
    )


for _name, _known in EXPORT_FORMATS.items():
    KFMocapExport.__annotations__[_name] = bpy.props.BoolProperty(
        default=_known.is_default, name=_known.label, description=_known.description
    )
CLASSES = (KFMocapExport,)
