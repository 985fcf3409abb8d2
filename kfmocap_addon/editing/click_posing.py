"""Posing a body by clicked joints: the state of the tool Place Joints between mouse events."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from ...core.body import Body, landmark_positions, part_poses
from ...core.body.kinematics import tip_positions
from ...core.body.motion import Motion, stacked
from ...core.cameras.camera import Camera
from ...core.errors import KeypointError
from ...core.numerics.arrays import Array
from ...core.posing.alternatives import Neighbour, alternative_poses
from ...core.posing.clicks import MAX_STEPS, Click, ClickFit, ClickSolver, click_keypoints, pixel, ray
from ...core.posing.depth import limb_flipped
from ...core.posing.standing import lowest_point
from ..scene_io import active_performer, joint_marks
from ..scene_io import scene as scenes
from ..scene_io.body import body_armature, body_channels, shown_pose
from ..scene_io.cameras import scene_cameras
from ..scene_io.keys import key_pose_curves

PLACING_ORDER = [
    side + joint
    for joints in (("Shoulder", "Elbow", "Wrist"), ("Hip", "Knee", "Ankle"))
    for side in "LR"
    for joint in joints
]
PLACING_ORDER += ["Head", "Nose", "Neck", "LBigToe", "RBigToe", "LHeel", "RHeel", "LHand", "RHand"]
"""Landmarks in the order in which they are asked for; others of the body follow."""
DRAGGING_STEPS = 4
"""Largest number of steps of the fit while a joint is dragged."""

_State = tuple[joint_marks.Snapshot, ClickFit]


class Placing:
    """Marks of one frame, and the pose that is fitted to them.

    Parameters
    ----------
    scene : bpy.types.Scene
    slot : KFMocapPerformer
    bones : set of str, optional
        These alone are moved; by default the whole body.

    Raises
    ------
    KFMocapError
        The armature is not a performer's body, or a camera cannot be used.
    """

    def __init__(self, scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, bones: set[str] | None = None) -> None:
        self.slot, self.scene, self.frame = slot, scene, scene.frame_current
        self.bones = bones
        self.body = body_armature.body_from_armature(slot.armature)
        self.landmarks = landmarks_in_order(self.body)
        self.marks = joint_marks.on_frame(slot, self.frame)
        self._before = shown_pose.shown_values(slot.armature), joint_marks.all_marks(slot)
        self._cameras = _cameras_now(scene)
        self._held = _held(self.body, self.bones)
        self._given = shown_pose.read_shown_pose(slot.armature)
        self._solver = ClickSolver(self.body, self._given, self._held, self._floor())
        self._history: list[_State] = []
        self._undone: list[_State] = []
        self.fitted = ClickFit(self._given, self._given)
        self.alternatives: list[Motion] = []
        """Poses that look alike from one view, likeliest first; those of the marks as they are, once asked for."""
        self.alternative = 0
        if self.marks:
            self._fit()

    @property
    def pose(self) -> Motion:
        """The pose fitted to the clicks."""
        return self.fitted.pose

    def views(self) -> set[str]:
        """Return the names of the views that joints can be clicked in."""
        return set(self._cameras)

    def joints(self) -> dict[str, Vector]:
        """Return the landmarks of the pose in the world, metres."""
        points = landmark_positions(self.body, self.pose, self.landmarks)[0]
        return {name: Vector(point) for name, point in zip(self.landmarks, points, strict=True)}

    def missing(self, view: str) -> list[str]:
        """Landmarks without a mark in a view, in the order in which they are asked for."""
        return [name for name in self.landmarks if (view, name) not in self.marks]

    def place_of(self, view: str, landmark: str) -> tuple[float, float]:
        """Place in the picture of a mark."""
        x, y = ray(self._cameras[view].matrix, self.marks[view, landmark])
        return float(x), float(y)

    def is_inside(self, view: str, place: tuple[float, float]) -> bool:
        """Whether a place lies in the view's picture."""
        camera, size = self._cameras[view], np.array(self._cameras[view].size)
        return bool(np.all(np.abs(pixel(camera.matrix, place) - (size - 1) / 2) <= size / 2))

    def is_there(self) -> bool:
        """Whether the scene still has the armature: the user may remove it meanwhile."""
        try:
            return active_performer.is_present(self.scene, self.slot)
        except ReferenceError:
            return False

    def is_changed(self) -> bool:
        """Whether marks were added or removed, and not all of that was undone."""
        return bool(self._history)

    def remember(self) -> None:
        """Keep marks and pose as they are, for `undo`."""
        self._history.append((dict(self.marks), self.fitted))
        self._undone.clear()

    def undo(self) -> bool:
        """Undo the last change of marks and pose; returns whether there was one."""
        return self._exchange(self._history, self._undone)

    def redo(self) -> bool:
        """Redo the last change that was undone; returns whether there was one."""
        return self._exchange(self._undone, self._history)

    def _exchange(self, source: list[_State], other: list[_State]) -> bool:
        if not source:
            return False
        other.append((dict(self.marks), self.fitted))
        self.marks, self.fitted = source.pop()
        self.alternatives = []
        self.show()
        return True

    def mark(self, view: str, landmark: str, place: tuple[float, float], dragging: bool = False) -> None:
        """Add or move a mark, and fit the pose to all marks."""
        x, y = pixel(self._cameras[view].matrix, place)
        self.marks[view, landmark] = float(x), float(y)
        self._fit(DRAGGING_STEPS if dragging else MAX_STEPS, search=not dragging)

    def unmark(self, view: str, landmark: str) -> None:
        """Remove a mark."""
        self.remember()
        del self.marks[view, landmark]
        self._fit_afresh()

    def flip(self, view: str, landmark: str) -> None:
        """Turn the part that leads to a landmark to the other side of the view's picture plane."""
        R, _ = self._cameras[view].pose(0)
        flipped = limb_flipped(self.body, self.pose, landmark, R[2])
        pose = self._given.moved(np.where(self._held, 0.0, self._given.difference(flipped)))
        self.fitted = ClickFit(pose, pose)
        self._fit(MAX_STEPS, search=False)

    def ask_alternatives(self, view: str) -> None:
        """Find the poses that look alike from a view, and show the likeliest if the present one is clearly less likely;
        `undo` takes it back.
        """
        found = alternative_poses(self.body, self.pose, self.centre_of(view), self._neighbours(), held=self._held)
        self.remember()
        poses, now = [found.poses[[i]] for i in range(len(found.poses))], found.number_of(self.pose)
        if (first := found.first_to_show(now)) == now:
            self.alternatives, self.alternative = poses, first
        else:
            self.choose(first, poses)

    def choose(self, number: int, alternatives: list[Motion] | None = None) -> None:
        """Pose the body as in an alternative, fitted to the marks."""
        poses = self.alternatives if alternatives is None else alternatives
        self.fitted = ClickFit(poses[number], poses[number])
        self._fit(MAX_STEPS, search=False)
        self.alternatives, self.alternative = poses, number

    def bones_of_alternatives(self) -> Array:
        """Ends of every bone of every alternative in the world, shape (N, P, 2, 3)."""
        poses = part_poses(self.body, stacked(self.alternatives))
        return np.stack([poses[1], tip_positions(self.body, poses)], axis=2)

    def centre_of(self, view: str) -> Array:
        """Return the place of a view's camera in the world, shape (3,)."""
        R, t = self._cameras[view].pose(0)
        return np.asarray(-R.T @ t)

    def _neighbours(self) -> list[Neighbour]:
        """Return the pose that the curves through other key frames have here; the farther they are, the less it
        counts.
        """
        frames = [frame for frame in key_pose_curves.keyed_bones(self.slot.armature)[0] if frame != self.frame]
        if not frames:
            return []
        near = min(abs(frame - self.frame) for frame in frames)
        return [Neighbour(self._given, near / scenes.frame_rate(self.scene))]

    def _floor(self) -> float:
        """Return the height of the floor: of the lowest point in the key poses of other frames, else in the given pose,
        as bodies are added standing on it.
        """
        armature = self.slot.armature
        frames = [frame for frame in key_pose_curves.keyed_bones(armature)[0] if frame != self.frame]
        poses = self._given
        if frames:
            channels = body_channels.list_channels(armature)
            values = body_channels.evaluate_channels(armature, channels, np.array(frames))
            poses = body_channels.motion_of_values(armature, values)
        return float(lowest_point(self.body, poses).min())

    def _fit(self, steps: int = MAX_STEPS, search: bool = True) -> None:
        """Pose the body on the marks, from the pose that it has."""
        self.alternatives = []
        clicks = [
            Click(self._cameras[view], name, at)
            for (view, name), at in self.marks.items()
            if view in self._cameras and name in self.body.landmarks
        ]
        self.fitted = self._solver.fit(click_keypoints(clicks, 0), self.fitted, steps, search)
        self.show()

    def show(self) -> None:
        """Show the marks in the scene, and the pose on the armature."""
        joint_marks.put(self.slot, self.frame, self.marks)
        shown_pose.show_pose(self.slot.armature, self.pose, self.bones)

    def key(self) -> None:
        """Make the pose a key pose."""
        if not self.marks:
            raise KeypointError(
                "no joint is marked on this frame", where=f"frame {self.frame}", todo="click joints with Place Joints"
            )
        self.show()
        key_pose_curves.key_current_pose(self.slot.armature, self.frame, self.bones)

    def restore(self) -> None:
        """Leave scene and armature as they were."""
        values, everything = self._before
        shown_pose.show_values(self.slot.armature, values)
        joint_marks.restore(self.slot, everything)

    def _fit_afresh(self) -> None:
        self.fitted = ClickFit(self._given, self._given)
        self._fit()


def _held(body: Body, bones: set[str] | None) -> NDArray[np.bool_]:
    """Return which degrees of freedom do not move, shape (D,): all but those of the bones, if any are named."""
    free = np.array([bones is None or name in bones for name in body.names])
    return ~np.concatenate([np.repeat(free[0], 3), np.repeat(free, 3)])


def _cameras_now(scene: bpy.types.Scene) -> dict[str, Camera]:
    """Return the calibrated cameras of the shot as they are on the current frame of the scene, by the names of their
    views.
    """
    slots = [slot for slot in scene.kfmocap.views if slot.is_calibrated and slot.has_camera]
    cameras = scene_cameras.read_cameras(scene, [slot.camera for slot in slots], scene.frame_current, 1)
    return {slot.name: camera for slot, camera in zip(slots, cameras, strict=True)}


def landmarks_in_order(body: Body) -> list[str]:
    """Return a body's landmarks in the order in which they are asked for."""
    first = [name for name in PLACING_ORDER if name in body.landmarks]
    return first + [name for name in body.landmarks if name not in first]


def landmark_label(landmark: str) -> str:
    """Return a landmark's name as the interface shows it: "Left Big Toe" for LBigToe."""
    side = {"L": "Left ", "R": "Right "}.get(landmark[0], "") if landmark[1:2].isupper() else ""
    name = landmark[1:] if side else landmark
    return side + "".join(" " + c if c.isupper() and i else c for i, c in enumerate(name))
