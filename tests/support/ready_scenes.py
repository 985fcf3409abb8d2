"""For every tool a scene in which it finds what it needs, and arguments that make sense there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
from addon_shots import camera, metarig, motion, shot
from keypoint_shots import seen_places, write_openpose
from kfmocap.core.body.measures.shaping import shaped
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.errors import BodyError, CaptureError
from kfmocap.core.fitting.body_fit import BodyFit
from kfmocap.core.fitting.camera_fits.camera_refinement import RefinedCamera, Refinement
from kfmocap.core.fitting.key_frame_views import posed_key_frames
from kfmocap.core.formats.calibrations.calibration_files import save_cameras
from kfmocap.core.shot.shot import Shot
from kfmocap.core.shot.shot_spec import ViewSpec
from kfmocap.kfmocap_addon.operators.cameras import calibrate_cameras
from kfmocap.kfmocap_addon.scene_io import joint_marks, scene, unfinished_tracking
from kfmocap.kfmocap_addon.scene_io.keys import motion_curves

Arguments = dict[str, Any]
LFRAME = np.array([[0, 0, 0], [0.4, 0, 0], [0.9, 0, 0], [0, 0.6, 0]])
"""Its balls, metres."""


def fitted(given: Shot, _progress: object = None) -> BodyFit:
    """What fitting the bodies returns where it makes each a tenth larger, and moves its key poses by 1 cm."""
    bodies = tuple(shaped(p.body, np.full((len(p.body), 3), 0.1), np.zeros((len(p.body), 3))) for p in given.performers)
    frames = posed_key_frames(given, BodyError("there is no key pose of the whole body"))
    keys = [(p.key_poses.poses, np.isin(p.key_poses.frames, frames)) for p in given.performers]
    poses = tuple(Motion(poses.translations[on] + 0.01, poses.rotations[on]) for poses, on in keys)
    return BodyFit(bodies, poses, frames, (0.1,) * len(bodies))


def refined(given: Shot, _progress: object = None) -> Refinement:
    """What refining the cameras returns where they were right."""
    views = tuple(RefinedCamera(view.camera, 0.0, 1.0, clearness=1.0) for view in given.views)
    return Refinement(views, np.array([0]))


def solution(cameras: Sequence[Camera]) -> SimpleNamespace:
    """What of a solved capture is shown."""
    return SimpleNamespace(
        cameras={c.name: c for c in cameras},
        rig=SimpleNamespace(names=[c.name for c in cameras], offset=np.array([0.0, 3.4])),
        wand=SimpleNamespace(ends_world=np.random.default_rng(0).normal(0, 1, (30, 2, 3))),
        lframe_world=LFRAME,
        residual=np.full((8, 2), 0.3),
        findings=("the wand was waved at one depth",),
    )


def by_performer(views: Sequence[ViewSpec]) -> SimpleNamespace:
    """What calibrating from a performer finds, where the keypoints of all views are there."""
    if not all(view.keypoints for view in views):
        raise CaptureError("there are no keypoints of this view", where="view")
    found = {view.camera: replace(camera(k), name=view.camera) for k, view in enumerate(views, 1)}
    return SimpleNamespace(cameras=found, summary_lines=["scale from the performer's height"])


def make_ready(tool: str, folder: Path) -> Arguments:
    """Show a shot in which a tool, by its name without the add-on's, can do its work; its arguments."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if tool in _IN_EMPTY_SCENES:
        return _IN_EMPTY_SCENES[tool](folder)
    people = ("man", "woman") if tool in ("exchange_people", "choose_performer") else ("man",)
    given = shot(folder, people)
    scene.build_scene(given, scene=bpy.context.scene)
    bpy.context.scene.frame_set(4)
    return _READY[tool](folder) or {} if tool in _READY else {}


def _shot() -> Any:
    return bpy.context.scene.kfmocap


def _armature() -> bpy.types.Object:
    return _shot().performers[0].armature


def _activate(thing: bpy.types.Object, mode: str = "OBJECT") -> None:
    bpy.context.view_layer.objects.active = thing
    thing.select_set(True)
    bpy.ops.object.mode_set(mode=mode)


def _tracked(_folder: Path) -> None:
    bpy.ops.kfmocap.track()


def _proposed(_folder: Path) -> Arguments:
    motion_curves.write_motion(_armature(), motion(12), _shot().frame_start, [3, 4])
    return {"frame": 4, "every": True}


def _refused(folder: Path) -> Arguments:
    _proposed(folder)
    return {"frame": 4}


def _marked(_folder: Path) -> None:
    joint_marks.put(_shot().performers[0], 4, {("cam01", "LWrist"): (100.0, 90.0)})


def _captured(folder: Path) -> None:
    bpy.ops.kfmocap.load_capture(filepath=str(folder / "capture.toml"))


def _reported(folder: Path) -> None:
    _captured(folder)
    bpy.data.images.new(calibrate_cameras.REPORT, 8, 8)


def _ended(_folder: Path) -> None:
    journal = unfinished_tracking.begun(bpy.context.scene, [(0, 5)], resume=False)
    Path(journal.folder, "0_5.segment").write_bytes(b"")


def _bone_chosen(_folder: Path) -> None:
    _activate(_armature(), "POSE")
    _armature().data.bones.active = _armature().data.bones["hand.L"]


def _part_edited(folder: Path) -> None:
    _bone_chosen(folder)
    bpy.ops.kfmocap.edit_part()


def _residual(_folder: Path) -> None:
    bpy.ops.kfmocap.show_residual()


def _with_keypoints(folder: Path) -> None:
    given = shot(folder)
    places = seen_places(given.performers[0].body, motion(given.length))
    for slot, view in zip(_shot().views, given.views, strict=True):
        target = folder / f"{view.camera.name}_openpose"
        if not target.exists():
            write_openpose(target, view.camera, [places], first=given.frames[0])
        slot.keypoints = str(target)
    _shot().key_frames.choice, _shot().key_frames.step = "EVERY", 2


def _landmarks(folder: Path) -> Arguments:
    _shot().key_frames.choice, _shot().key_frames.step = "EVERY", 3
    return {"filepath": str(folder / "walk" / "landmarks.trc"), "first_row": 0}


def _suggested(folder: Path) -> None:
    _tracked(folder)
    helpful = _shot().performers[0].helpful.add()
    helpful.name, helpful.frame, helpful.error = "hand.L", 8, 20.0


def _missing(folder: Path) -> Arguments:
    _shot().views[0].missing = True
    return {"filepath": str(folder)}


def _deleted(_folder: Path) -> Arguments:
    armature = _armature()
    for collection in list(armature.users_collection):
        collection.objects.unlink(armature)
    return {"performer": 0}


def _without_camera(_folder: Path) -> Arguments:
    camera = bpy.context.scene.kfmocap.views[0].camera
    for collection in list(camera.users_collection):
        collection.objects.unlink(camera)
    return {"view": 0}


def _hidden(_folder: Path) -> Arguments:
    camera = bpy.context.scene.kfmocap.views[0].camera
    camera.hide_set(True)
    return {"hidden": camera.name}


def _own_calibration(folder: Path) -> Arguments:
    save_cameras(folder / "own.toml", [camera(1), camera(2)])
    return {"filepath": str(folder / "own.toml")}


def _prop(_folder: Path) -> None:
    mesh = bpy.data.meshes.new("box")
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    mesh.from_pydata(corners, [], [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    box = bpy.data.objects.new("box", mesh)
    bpy.context.scene.collection.objects.link(box)
    _activate(box)


def _views_forgotten(_folder: Path) -> None:
    _shot().views.clear()


def _character(folder: Path) -> None:
    _tracked(folder)
    _shot().retarget.target = metarig()


def _active_character(folder: Path) -> None:
    _character(folder)
    _activate(_shot().retarget.target)


def _listed(folder: Path) -> None:
    _character(folder)
    bpy.ops.kfmocap.find_bones()


def _following(folder: Path) -> None:
    _character(folder)
    _shot().retarget.live = True
    bpy.ops.kfmocap.send_to_rig()


def _sent(folder: Path) -> None:
    _character(folder)
    bpy.ops.kfmocap.send_to_rig()


_IN_EMPTY_SCENES: dict[str, Callable[[Path], Arguments]] = {
    "add_footage": lambda folder: {"directory": str(folder), "files": [{"name": "cam01.mp4"}, {"name": "cam02.mp4"}]},
    "load_shot": lambda folder: {"filepath": str(folder / "walk" / "shot.toml")},
    "add_videos": lambda folder: {"directory": str(folder), "files": [{"name": "cam01.mp4"}]},
}
_READY: dict[str, Callable[[Path], Arguments | None]] = {
    "accept_proposals": _proposed,
    "refuse_proposal": _refused,
    "bake": _tracked,
    "simplify": _tracked,
    "clear_between": lambda folder: _tracked(folder) or {"where": "EVERYWHERE"},
    "clear_marks": _marked,
    "calibrate": _captured,
    "calibrate_from_performer": _with_keypoints,
    "show_calibration_report": _reported,
    "continue_tracking": _ended,
    "edit_part": _bone_chosen,
    "finish_part": _part_edited,
    "hide_residual": _residual,
    "mark_keypoints": _with_keypoints,
    "pose_from_keypoints": _with_keypoints,
    "pose_from_landmarks": _landmarks,
    "next_suggestion": _suggested,
    "relink_footage": _missing,
    "restore_body": _deleted,
    "restore_camera": _without_camera,
    "show_hidden": _hidden,
    "import_calibration": _own_calibration,
    "use_armature": _prop,
    "use_scene_cameras": _views_forgotten,
    "find_bones": _character,
    "forget_bones": _listed,
    "save_bone_map": lambda folder: _listed(folder) or {"filepath": str(folder / "bones_out.json")},
    "send_to_rig": _character,
    "stop_following": _following,
    "take_motion_back": _sent,
    "hand_shape": _active_character,
    "exchange_people": lambda _folder: {"other": "woman"},
    "remove_videos": _captured,
    "choose_performer": lambda _folder: {"performer": 1},
    "look_through": lambda _folder: {"view": 1},
    "remove_performer": lambda _folder: {"performer": 0},
    "remove_view": lambda _folder: {"view": 0},
}
"""By a tool's name what it needs beside a shot that is loaded; most need no more."""
