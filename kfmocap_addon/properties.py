"""What a scene knows of its shot beyond Blender's own data."""

from collections.abc import Callable

import bpy

from .export.presets import PRESETS
from .scene_io.sides import PERFORMERS


def _is_camera(_self: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    return candidate.type == "CAMERA"


def _is_armature(_self: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    return candidate.type == "ARMATURE"


def _show_range(self: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """The scene runs over the frames of the shot."""
    self.id_data.frame_start = self.frame_start
    self.id_data.frame_end = self.frame_start + max(self.length, 1) - 1


def _show_confidence(self: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """The parts' colours follow what the scene says."""
    from .scene_io import bone_confidence

    bone_confidence.show_colours(self.id_data)


def _show_in_time(self: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """The footage shows the frames that the view's offset and fields say."""
    from .scene_io import footage_background

    shot = self.id_data.kfmocap
    footage_background.show_in_time(self, shot.first, shot.frame_start)


def _show_opacity(self: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    for view in self.views:
        for background in view.camera.data.background_images if view.camera is not None else ():
            background.alpha = self.opacity


def _show_model(self: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    from .scene_io import shown_model

    shown_model.show_model(self.id_data)


def _show_performer(self: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    """The trunk's bones have the performer's colour."""
    from .scene_io import body_armature

    if self.armature is not None:
        body_armature.show_colour(self.armature, self.colour)


def _height(self: bpy.types.PropertyGroup) -> float:
    from .scene_io import performer_size

    return performer_size.height(self.armature) if self.armature is not None else 0.0


def _set_height(self: bpy.types.PropertyGroup, value: float) -> None:
    from .scene_io import performer_size

    _reshape(self, lambda: performer_size.set_height(self.armature, value))


def _measure(name: str, label: str, what: str) -> object:
    """A measure of the body as a field, which is read from the armature and changes it."""

    def get(self: bpy.types.PropertyGroup) -> float:
        from .scene_io import performer_size

        return performer_size.measure(self.armature, name) if self.armature is not None else 0.0

    def put(self: bpy.types.PropertyGroup, value: float) -> None:
        from .scene_io import performer_size

        _reshape(self, lambda: performer_size.set_measure(self.armature, name, value))

    description = f"{what}, metres; key poses stay as they are"
    return bpy.props.FloatProperty(
        get=get, set=put, min=0.01, soft_max=1.0, unit="LENGTH", precision=3, name=label, description=description
    )


def _reshape(slot: bpy.types.PropertyGroup, change: Callable[[], None]) -> None:
    """Change a performer's body; what stands in the way is said beside the mouse."""
    from ..core.errors import KFMocapError

    try:
        if slot.armature is not None:
            change()
    except KFMocapError as error:
        text = str(error)
        if not bpy.app.background:
            bpy.context.window_manager.popup_menu(
                lambda menu, _context: menu.layout.label(text=text), title="KF Mocap", icon="ERROR"
            )


class KFMocapView(bpy.types.PropertyGroup):
    """A view; its name is the camera's in the calibration. The footage is the camera's background clip."""

    camera: bpy.props.PointerProperty(
        type=bpy.types.Object,
        poll=_is_camera,
        name="Camera",
        description="Camera object with the footage behind it",
    )
    size: bpy.props.IntVectorProperty(
        size=2,
        min=1,
        default=(1920, 1080),
        name="Size",
        description="Width and height of the footage, pixels",
    )
    aspect: bpy.props.FloatVectorProperty(
        size=2, min=1.0, default=(1.0, 1.0), name="Pixel Aspect", description="Width and height of a pixel"
    )
    offset: bpy.props.FloatProperty(
        name="Offset",
        description="Frame f of the shot is this footage's frame f + offset, which may lie between two frames",
        precision=3,
        update=_show_in_time,
    )
    fields: bpy.props.EnumProperty(
        items=[
            ("progressive", "Progressive", "Every frame was taken at one instant"),
            ("top-first", "Top First", "Interlaced: the lines with the topmost were taken first"),
            ("bottom-first", "Bottom First", "Interlaced: the lines between were taken first"),
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
        name="Distortion",
        description="OpenCV's distortion as JSON, where Blender's movie clip has no model for it",
    )
    calibrated: bpy.props.BoolProperty(
        default=True,
        name="Calibrated",
        description="The camera's place and lens are known. Tick this after placing the camera by hand",
    )

    missing: bpy.props.BoolProperty(
        name="Missing", description="The footage was not where the file says when that was opened"
    )
    misfit: bpy.props.StringProperty(
        name="Misfit", description="How far the camera is off the key poses or the other cameras; empty where it fits"
    )

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


class KFMocapSuggestion(bpy.types.PropertyGroup):
    """A key frame that would help; its name is that of the parts which no camera sees just before or after."""

    frame: bpy.props.IntProperty(name="Frame", description="Scene frame on which the parts are seen")
    hidden: bpy.props.IntVectorProperty(
        size=2, name="Hidden", description="First and last scene frame on which they are not"
    )


class KFMocapHelpfulKey(bpy.types.PropertyGroup):
    """A key frame that would help most; its name is that of the parts which are expected to be farthest off there."""

    frame: bpy.props.IntProperty(name="Frame", description="Scene frame")
    error: bpy.props.FloatProperty(name="Error", description="Expected error of the bones there, mean, mm")
    gain: bpy.props.FloatProperty(
        name="Gain", description="By how much a key pose there would lower the expected error over the shot, mean, mm"
    )


class KFMocapLostPart(bpy.types.PropertyGroup):
    """A part of a limb that may be lost on some frames; its name is the bone's."""

    frames: bpy.props.IntVectorProperty(size=2, name="Frames", description="First and last scene frame")


class KFMocapMark(bpy.types.PropertyGroup):
    """A joint that the animator clicked in a view; its name is the landmark's."""

    view: bpy.props.StringProperty(name="View", description="Name of the view")
    frame: bpy.props.IntProperty(name="Frame", description="Scene frame")
    pixel: bpy.props.FloatVectorProperty(
        size=2,
        precision=2,
        name="Pixel",
        description="Place on the undistorted footage from its upper left, pixels; whole numbers are pixel centres",
    )


class KFMocapPlant(bpy.types.PropertyGroup):
    """Frames on which a point of a sole stands on the ground, or, as the animator's edit, does not; its name is the
    point's, such as "heel.L".
    """

    first: bpy.props.IntProperty(name="First", description="First scene frame")
    last: bpy.props.IntProperty(name="Last", description="Last scene frame")
    planted: bpy.props.BoolProperty(default=True, name="Planted", description="It stands on the ground")


def _is_performer(self: bpy.types.PropertyGroup, candidate: bpy.types.Object) -> bool:
    return any(slot.armature == candidate for slot in self.id_data.kfmocap.performers)


class KFMocapHold(bpy.types.PropertyGroup):
    """A prop that a performer holds over a range of frames."""

    prop: bpy.props.PointerProperty(
        type=bpy.types.Object, poll=_is_performer, name="Prop", description="The performer that is held"
    )
    holder: bpy.props.PointerProperty(
        type=bpy.types.Object, poll=_is_performer, name="Held By", description="The performer that holds it"
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
        name="Replace My Keys", description="Make them on frames that have a key of yours, too; else these stay"
    )


class KFMocapPerformer(bpy.types.PropertyGroup):
    """Somebody to track, by name; the armature is the body, its keys are the key poses."""

    armature: bpy.props.PointerProperty(
        type=bpy.types.Object, poll=_is_armature, name="Armature", description="The performer's body"
    )
    person: bpy.props.IntProperty(
        min=0,
        name="Person",
        description=(
            "Which of the people in the views' keypoints the performer is, from 1 in the order in which they appear. "
            "0: the key poses say, or the order of the performers"
        ),
    )
    identity: bpy.props.StringProperty(
        name="Found", description="Which person the performer was found to be when keypoints were used last"
    )
    found_person: bpy.props.IntProperty(name="Found Person", description="The number of that person; 0 for none")
    colour: bpy.props.FloatVectorProperty(
        size=3,
        subtype="COLOR_GAMMA",
        min=0.0,
        max=1.0,
        default=PERFORMERS[0],
        update=_show_performer,
        name="Colour",
        description="Of the outlines and bones of head and trunk; those of the limbs have their sides' colours",
    )
    height: bpy.props.FloatProperty(
        get=_height,
        set=_set_height,
        min=0.3,
        max=3.0,
        unit="LENGTH",
        precision=3,
        name="Height",
        description="From the soles to the top of the head, metres; all lengths and widths change with it, key poses "
        "stay as they are",
    )
    shoulder_width: _measure("shoulder_width", "Shoulder Width", "Between the centres of the shoulder joints")
    hip_width: _measure("hip_width", "Hip Width", "Between the centres of the hip joints")
    torso: _measure("torso", "Torso", "From the pelvis to the base of the neck")
    head: _measure("head", "Head", "From the base of the neck to the top of the head")
    upper_arm: _measure("upper_arm", "Upper Arm", "From the centre of the shoulder joint to the elbow")
    forearm: _measure("forearm", "Forearm", "From the elbow to the wrist")
    hand: _measure("hand", "Hand", "From the wrist to the finger tips")
    thigh: _measure("thigh", "Thigh", "From the centre of the hip joint to the knee")
    shin: _measure("shin", "Shin", "From the knee to the ankle")
    foot: _measure("foot", "Foot", "From the ankle to the big toe")
    suggestions: bpy.props.CollectionProperty(type=KFMocapSuggestion)
    helpful: bpy.props.CollectionProperty(type=KFMocapHelpfulKey)
    lost: bpy.props.CollectionProperty(type=KFMocapLostPart)
    marks: bpy.props.CollectionProperty(type=KFMocapMark)
    fingers: bpy.props.BoolProperty(
        name="Fingers", description="Files that the command line writes of this scene have its fingers, by keypoints"
    )
    plants: bpy.props.CollectionProperty(type=KFMocapPlant)
    plant_edits: bpy.props.CollectionProperty(type=KFMocapPlant)
    plants_found: bpy.props.StringProperty(
        name="Plants Found", description="The points of the feet whose plants were looked for; empty before that"
    )


class KFMocapExport(bpy.types.PropertyGroup):
    """What to export, and what was exported last."""

    written: bpy.props.StringProperty(
        name="Written", description="Paths of the files that were written last, one to a line"
    )
    path: bpy.props.StringProperty(
        subtype="FILE_PATH", name="Last Name", description="Path that was chosen last, without an ending"
    )

    preset: bpy.props.EnumProperty(
        items=[(key, preset.label, preset.description) for key, preset in PRESETS.items()],
        name="For",
        description="The program that is to read the files: names of the bones, and unit",
    )
    bvh: bpy.props.BoolProperty(default=True, name="BVH", description="Skeleton and motion as text, Y up")
    fbx: bpy.props.BoolProperty(default=True, name="FBX", description="Skeleton and motion for other programs, Y up")
    glb: bpy.props.BoolProperty(
        name="glTF", description="Skeleton and motion for the web and game engines, Y up (.glb)"
    )
    vrma: bpy.props.BoolProperty(
        name="VRM", description="VRM animation, which any VRM character plays: humans only, in metres (.vrma)"
    )
    usdc: bpy.props.BoolProperty(name="USD", description="Skeleton and motion as USD, Y up (.usdc)")
    use_range: bpy.props.BoolProperty(name="Frame Range", description="Export some frames alone, not the whole shot")
    first: bpy.props.IntProperty(default=1, name="First", description="First scene frame to export")
    last: bpy.props.IntProperty(default=250, name="Last", description="Last scene frame to export, inclusive")
    use_rate: bpy.props.BoolProperty(name="Frame Rate", description="Export at another frame rate than the scene's")
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
        description="The performer moves through the world. Off: it stays over its first place, but rises and sinks",
    )
    leave_out_unknown: bpy.props.BoolProperty(
        name="Leave Out Unknown",
        description="Leave out the bones of parts that nothing has shown, of people not wholly in the picture",
    )


class KFMocapBone(bpy.types.PropertyGroup):
    """A bone that plays a role in the character's skeleton; its name is the role's."""

    bone: bpy.props.StringProperty(name="Bone", description="The bone of the character that plays this role")
    chain: bpy.props.IntProperty(name="Place", description="Its place in the chain, from the hips or hand outward")


class KFMocapLimbError(bpy.types.PropertyGroup):
    """How far a limb of the character is from where it should be; its name is the limb's."""

    degrees: bpy.props.FloatProperty(name="Degrees", description="Worst rotation error of its bones")
    distance: bpy.props.FloatProperty(name="Distance", description="Worst position error of its bones, mm")


class KFMocapRetarget(bpy.types.PropertyGroup):
    """What motion is sent to, and how."""

    target: bpy.props.PointerProperty(
        type=bpy.types.Object, poll=_is_armature, name="Character", description="Armature that is to move"
    )
    source: bpy.props.PointerProperty(
        type=bpy.types.Object,
        poll=_is_armature,
        name="Motion From",
        description="Armature whose motion is sent, over the frames of the scene. Empty: the performer",
    )
    preset: bpy.props.EnumProperty(
        items=[
            ("auto", "Automatic", "The preset that knows most of its bones, else their names, else their places"),
            ("kfmocap", "KF Mocap", "A body of this add-on"),
            ("rigify", "Rigify", "A generated rig, through its FK controls"),
            ("rigify-ik", "Rigify, IK Limbs", "A generated rig, arms and legs through their IK controls"),
            ("rigify-metarig", "Rigify Metarig", "The metarig that a rig is generated from"),
            ("mixamo", "Mixamo", "Bones named mixamorig:Hips and so on"),
            ("unreal", "Unreal", "Unreal's mannequin"),
            ("unity", "Unity Humanoid", "Bones named as in Unity's humanoid avatar, or by the VRM standard"),
            ("vrm", "VRM", "Bones named as VRoid names them"),
            ("makehuman", "MakeHuman", "MakeHuman's default rig"),
        ],
        name="Rig",
        description="What kind of rig the character has",
    )
    bones: bpy.props.CollectionProperty(type=KFMocapBone)
    active_bone: bpy.props.IntProperty(name="Active Bone", description="The role shown in the list of bones")
    errors: bpy.props.CollectionProperty(type=KFMocapLimbError)
    root: bpy.props.EnumProperty(
        items=[
            ("world", "On the Hips", "The character moves through the world"),
            ("root-bone", "On the Root Bone", "The way over the ground goes on the rig's root bone"),
            ("in-place", "In Place", "The character stays over its first place"),
        ],
        name="Root Motion",
        description="Where the way through the world goes",
    )
    feet: bpy.props.EnumProperty(
        items=[
            ("keep", "Keep", "Planted feet move as the performer's do, whatever the length of the legs"),
            ("clean", "Clean", "Planted feet stand quite still, flat on the floor"),
            ("off", "Off", "Joint angles alone"),
        ],
        name="Feet",
        description="How feet are kept where they stood",
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
    angle: bpy.props.FloatProperty(
        default=0.00872665,
        min=0.0,
        soft_max=0.0872665,
        subtype="ANGLE",
        name="Rotation",
        description="How far a bone may turn away for the sake of fewer keys",
    )
    distance: bpy.props.FloatProperty(
        default=1.0, min=0.0, soft_max=20.0, name="Location (mm)", description="The same of places, mm"
    )


class KFMocapSegment(bpy.types.PropertyGroup):
    """A segment between key poses that was tracked."""

    first: bpy.props.IntProperty(name="First", description="In the footage's count")
    last: bpy.props.IntProperty(name="Last", description="In the footage's count")
    digest: bpy.props.StringProperty(name="Digest", description="Of all that its motion depends on")


class KFMocapScene(bpy.types.PropertyGroup):
    """The shot that a scene shows."""

    shot: bpy.props.StringProperty(name="Shot", description="Name of the shot, and of the files exported")
    zero: bpy.props.IntProperty(
        default=1, name="Zero", description="Scene frame that shows frame 0 in the footage's count"
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
            ("WIRE", "Wire", "The parts' edges"),
            (
                "OUTLINE",
                "Outline",
                "A line around each part where it is seen, the performer's left blue and the right orange, and a grey "
                "one where it is hidden",
            ),
            ("SOLID", "Solid", "The parts before the footage"),
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
        items=[
            ("gauss-newton", "Gauss-Newton", "All frames between two key poses at once: the best results"),
            ("relaxation", "Relaxation", "Frame by frame in sweeps, as first published: for comparison"),
        ],
        name="Solver",
        description="How the frames between the key poses are found",
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
    settings: bpy.props.StringProperty(name="Settings", description="Further settings of the tracker as JSON")
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


CLASSES = (
    KFMocapView,
    KFMocapSuggestion,
    KFMocapHelpfulKey,
    KFMocapLostPart,
    KFMocapMark,
    KFMocapPlant,
    KFMocapHold,
    KFMocapFrames,
    KFMocapPerformer,
    KFMocapSegment,
    KFMocapExport,
    KFMocapBone,
    KFMocapLimbError,
    KFMocapRetarget,
    KFMocapScene,
)
