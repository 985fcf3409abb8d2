"""The shot that a scene shows, beyond Blender's own data."""

import bpy

from ...core.choices import SOLVERS
from .choice_items import choice_items
from .export_properties import KFMocapExport
from .performer_properties import KFMocapPerformer
from .pointer_polls import is_performer
from .retarget_properties import KFMocapRetarget
from .view_properties import KFMocapView


def _show_range(self: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """Let the scene run over the frames of the shot."""
    self.id_data.frame_start = self.frame_start
    self.id_data.frame_end = self.frame_start + max(self.length, 1) - 1


def _move_footage(self: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """Let the footage of all views begin where the shot says."""
    from ..scene_io.cameras import footage_background

    for view in self.views:
        footage_background.show_in_time(view, self.first, self.frame_start)


def _frame_rate(self: bpy.types.PropertyGroup) -> float:
    from ..scene_io.scene import frame_rate

    return frame_rate(self.id_data)


def _set_frame_rate(self: bpy.types.PropertyGroup, fps: float) -> None:
    from ..scene_io.scene import set_rate

    set_rate(self.id_data, fps)


def _replaced_rate(self: bpy.types.PropertyGroup) -> float:
    from ..scene_io.scene import replaced_rate

    return replaced_rate(self.id_data) or 0.0


def _show_confidence(self: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """Give the parts the colours that the scene asks for."""
    from ..scene_io.review import bone_confidence

    bone_confidence.show_colours(self.id_data)


def _show_opacity(self: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    for view in self.views:
        for background in view.camera.data.background_images if view.camera is not None else ():
            background.alpha = self.opacity


def _show_model(self: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    from ..scene_io.body import shown_model

    shown_model.show_model(self.id_data)


class KFMocapHold(bpy.types.PropertyGroup):
    """A prop that a performer holds over a range of frames."""

    prop: bpy.props.PointerProperty(
        type=bpy.types.Object, poll=is_performer, name="Prop", description="The performer that is held"
    )
    holder: bpy.props.PointerProperty(
        type=bpy.types.Object, poll=is_performer, name="Held By", description="The performer that holds it"
    )
    bone: bpy.props.StringProperty(name="Bone", description="The bone of the performer that holds it, such as hand.R")
    first: bpy.props.IntProperty(name="First", description="First scene frame on which it is held")
    last: bpy.props.IntProperty(name="Last", description="Last scene frame on which it is held")


class KFMocapFrames(bpy.types.PropertyGroup):
    """The frames on which key poses are made of keypoints or landmarks."""

    choice: bpy.props.EnumProperty(
        items=[
            ("CURRENT", "This Frame", "The scene's current frame"),
            ("EVERY", "Every n-th", "The first frame, and every n-th after it"),
            ("LISTED", "Listed", "The frames of a list"),
            ("AUTO", "Proposed", "Frames that show the performer best, every 0.6 s or so, beside your key poses"),
        ],
        default="AUTO",
        name="Frames",
        description="On which frames key poses are made",
    )
    step: bpy.props.IntProperty(min=1, default=20, name="Every", description="From one key pose to the next, frames")
    listed: bpy.props.StringProperty(name="List", description="Scene frames, such as 1, 20, 40-42")
    replace: bpy.props.BoolProperty(
        name="Replace My Keys",
        description="Also make key poses on frames on which you have set keys. Off: those frames are left alone",
    )


class KFMocapSegment(bpy.types.PropertyGroup):
    """A segment between key poses that was tracked."""

    first: bpy.props.IntProperty(name="First", description="First frame, in the footage's count")
    last: bpy.props.IntProperty(name="Last", description="Last frame, in the footage's count")
    digest: bpy.props.StringProperty(name="Digest", description="Hash of everything that its motion depends on")


class KFMocapScene(bpy.types.PropertyGroup):
    """The shot that a scene shows."""

    shot: bpy.props.StringProperty(name="Shot", description="Name of the shot, and of the files exported")
    zero: bpy.props.IntProperty(
        default=1,
        update=_move_footage,
        name="Zero",
        description="Scene frame that shows frame 0 in the footage's count",
    )
    first: bpy.props.IntProperty(
        min=0, update=_show_range, name="First", description="First frame to track, in the footage's count"
    )
    last: bpy.props.IntProperty(
        min=0, update=_show_range, name="Last", description="Last frame to track, in the footage's count"
    )
    scene_first: bpy.props.IntProperty(
        get=lambda self: self.zero + self.first,
        min=0,
        set=lambda self, frame: setattr(self, "first", max(0, frame - self.zero)),
        name="First Frame",
        description="First scene frame to track; the timeline runs from here",
    )
    scene_last: bpy.props.IntProperty(
        get=lambda self: self.zero + self.last,
        min=0,
        set=lambda self, frame: setattr(self, "last", max(0, frame - self.zero)),
        name="Last Frame",
        description="Last scene frame to track; the timeline runs up to here",
    )
    frame_rate: bpy.props.FloatProperty(
        get=_frame_rate,
        set=_set_frame_rate,
        min=1.0,
        max=10000.0,
        precision=3,
        step=100,
        name="Frame Rate",
        description="Frames per second of the footage, and of the scene. Videos bring theirs; images have none",
    )
    replaced_rate: bpy.props.FloatProperty(
        get=_replaced_rate,
        name="Replaced Frame Rate",
        description="Frame rate of the shot, if something else has changed that of the scene since; otherwise 0",
    )
    views: bpy.props.CollectionProperty(type=KFMocapView)
    performers: bpy.props.CollectionProperty(type=KFMocapPerformer)
    stretches: bpy.props.CollectionProperty(type=KFMocapSegment)  # saved files know segments by this name
    opacity: bpy.props.FloatProperty(
        min=0.0,
        max=1.0,
        default=1.0,
        subtype="FACTOR",
        update=_show_opacity,
        name="Opacity",
        description="How much of the footage is seen behind the model, in all views",
    )
    display: bpy.props.EnumProperty(
        items=[
            ("WIRE", "Wire", "The edges of the parts"),
            (
                "OUTLINE",
                "Outline",
                "A line around each part: blue on the performer's left side, orange on the right, grey where the part "
                "is hidden",
            ),
            ("SOLID", "Solid", "The parts as solid shapes in front of the footage"),
            ("NONE", "Bones", "The bones alone, as rings around the parts"),
        ],
        default="OUTLINE",
        update=_show_model,
        name="Model",
        description="How the model is drawn over the footage",
    )
    performer: bpy.props.StringProperty(
        name="Performer", description="Who is posed, where no performer's armature is the active object"
    )
    show_plants: bpy.props.BoolProperty(
        default=True,
        name="In Timeline",
        description="Show in the timeline and the dope sheet when the chosen performer's feet are planted: blue the "
        "left, orange the right, the heel above the ball",
    )
    show_marks: bpy.props.BoolProperty(
        default=True, name="Show Marks", description="Show the clicked joints of this frame over the footage"
    )
    show_strip: bpy.props.BoolProperty(
        default=True,
        name="Strip Below Footage",
        description="Show along the lower edge of the footage where in the shot the chosen performer has key poses "
        "(diamonds; pale ones are proposals, small ones of some bones alone) and tracked frames (the grey band), "
        "and on which frames a part may be lost (red)",
    )
    holds: bpy.props.CollectionProperty(type=KFMocapHold)
    key_frames: bpy.props.PointerProperty(
        type=KFMocapFrames, name="Frames", description="Where key poses are made of keypoints or landmarks"
    )
    copied: bpy.props.StringProperty(name="Copied Pose", description="Values of the bones by their names, as JSON")
    solver: bpy.props.EnumProperty(
        items=choice_items(SOLVERS), name="Solver", description="How the frames between the key poses are found"
    )
    contact: bpy.props.BoolProperty(
        name="Contact", description="Performers do not pass through each other", default=True
    )
    show_confidence: bpy.props.BoolProperty(
        name="Colour by Error",
        description="Colour the parts by how far they may be off: green where they are sure, red at the limit, "
        "blue where no camera sees them",
        update=_show_confidence,
    )
    confidence_limit: bpy.props.FloatProperty(
        name="Red at",
        description="Expected error from which on a part is red, mm",
        default=30.0,
        min=1.0,
        soft_max=200.0,
        precision=0,
        update=_show_confidence,
    )
    export: bpy.props.PointerProperty(type=KFMocapExport, name="Export", description="What to export")
    retarget: bpy.props.PointerProperty(
        type=KFMocapRetarget, name="Retarget", description="Where motion is sent, and how"
    )
    settings: bpy.props.StringProperty(
        name="Settings", description="Settings of the tracker that have no field here, as JSON"
    )
    tracked: bpy.props.EnumProperty(
        items=[
            ("ALL", "All Performers", "Everybody together, so that one is known to hide the other"),
            ("CHOSEN", "Chosen Only", "The chosen performer; those that are tracked already stay as they are"),
        ],
        name="Whom",
        description="Who is tracked where there are several performers",
    )
    footage_offset: bpy.props.FloatProperty(
        name="Footage Offset",
        description="How much later than on their frames the footage shows the key poses, in frames, as the tracker "
        "found it",
        precision=3,
    )

    @property
    def shown_view(self) -> int:
        """Number of the view that is the scene's camera, -1 where none is."""
        camera = self.id_data.camera
        return next((i for i, v in enumerate(self.views) if camera is not None and v.camera == camera), -1)

    @property
    def frame_start(self) -> int:
        """Scene frame of shot frame 0."""
        return self.zero + self.first

    @property
    def length(self) -> int:
        """Number of frames; not positive where the last is before the first."""
        return self.last - self.first + 1


CLASSES = (KFMocapHold, KFMocapFrames, KFMocapSegment, KFMocapScene)
