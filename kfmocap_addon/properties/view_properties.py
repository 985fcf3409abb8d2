"""What a scene knows of a view beyond its camera object."""

from typing import Any

import bpy

from .pointer_polls import is_camera


def _show_in_time(self: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """Let the footage show the frames that the view's offset, rate and fields say."""
    from ..scene_io.cameras import footage_background

    shot = self.id_data.kfmocap
    footage_background.show_in_time(self, shot.first, shot.frame_start)


class KFMocapView(bpy.types.PropertyGroup):
    """A view; its name is the camera's in the calibration. The footage is the camera's background clip."""

    camera: bpy.props.PointerProperty(
        type=bpy.types.Object, poll=is_camera, name="Camera", description="Camera object with the footage behind it"
    )
    size: bpy.props.IntVectorProperty(
        size=2, min=1, default=(1920, 1080), name="Size", description="Width and height of the footage, pixels"
    )
    aspect: bpy.props.FloatVectorProperty(
        size=2, min=1.0, default=(1.0, 1.0), name="Pixel Aspect", description="Width and height of a pixel"
    )
    offset: bpy.props.FloatProperty(
        name="Offset",
        description="Frame f of the shot is this footage's frame every * f + offset; frames, and fractions of a frame",
        precision=3,
        update=_show_in_time,
    )
    every: bpy.props.IntProperty(
        name="Every",
        description="Frames of this footage for each frame of the shot: 2 if it has 60 frames per second and the shot "
        "30",
        default=1,
        min=1,
        soft_max=16,
        update=_show_in_time,
    )
    fields: bpy.props.EnumProperty(
        items=[
            ("progressive", "Progressive", "Every frame was taken at one instant"),
            (
                "top-first",
                "Top First",
                "Interlaced, upper field first: the topmost line belongs to the field taken first",
            ),
            (
                "bottom-first",
                "Bottom First",
                "Interlaced, lower field first: the second line belongs to the field taken first",
            ),
        ],
        name="Fields",
        description="Order of the fields of interlaced footage",
        update=_show_in_time,
    )
    sequence: bpy.props.StringProperty(
        name="Sequence", description="Pattern of the file names, where the footage is an image sequence"
    )
    keypoints: bpy.props.StringProperty(
        name="Keypoints", description="2D keypoints of this view, relative to the footage's folder"
    )
    distortions: bpy.props.StringProperty(
        name="Distortion", description="OpenCV's distortion as JSON, where Blender's movie clip has no model for it"
    )
    calibrated: bpy.props.BoolProperty(
        default=True,
        name="Calibrated",
        description="The camera's place and lens are known. Tick this after placing the camera by hand",
    )
    lens_known: bpy.props.BoolProperty(
        default=True,
        name="Lens Known",
        description="The focal length beside this is the footage's, for a picture of 36 mm width, and stays; else it "
        "is found too, less exactly. Lenses stay as they are when a tripod is moved, as long as zoom and size do",
    )

    missing: bpy.props.BoolProperty(
        name="Missing", description="The footage was not where the file says when that was opened"
    )
    faults: bpy.props.StringProperty(
        name="Faults", description="What tracking found wrong with the footage; empty where nothing is"
    )
    found_gaps: bpy.props.StringProperty(
        name="Gaps",
        description="Frames of the footage before which others are missing, with how many; negative where so many are "
        "repeated",
        update=_show_in_time,
    )
    misfit: bpy.props.StringProperty(
        name="Misfit", description="How far the camera is off the key poses or the other cameras; empty where it fits"
    )
    fitting_offset: bpy.props.StringProperty(
        name="Fitting Offset",
        description="An offset with which the footage fits the key poses better; empty where none is known",
    )

    @property
    def gaps(self) -> tuple[Any, ...]:
        """Where the footage lacks frames or has them once too often, see `core.shot.shot.Gap`."""
        from ..scene_io.cameras.view_gaps import unpacked_gaps

        return unpacked_gaps(self.found_gaps)

    @property
    def has_camera(self) -> bool:
        """Whether its camera is in the scene, and is one: users may delete it, or give it other data by scripts."""
        owner = self.camera
        return owner is not None and owner.type == "CAMERA" and owner.name in self.id_data.objects

    @property
    def can_be_restored(self) -> bool:
        """Whether its camera is gone from the scene, but not from the file."""
        return self.camera is not None and self.camera.type == "CAMERA" and not self.has_camera

    @property
    def is_calibrated(self) -> bool:
        """Whether its camera is known, also from a tracker of Blender's that moves it."""
        owner = self.camera
        return self.calibrated or bool(owner and (owner.animation_data or owner.constraints or owner.parent))

    @property
    def residual(self) -> bpy.types.Image | None:
        """The picture of where the footage contradicts the model, if one is shown."""
        return bpy.data.images.get(self.residual_name)

    @property
    def residual_name(self) -> str:
        """The name of that picture."""
        return f"KF Mocap residual {self.name}"


CLASSES = (KFMocapView,)
