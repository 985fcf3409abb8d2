"""The benchmark's shots: who does what, filmed how; and the files that describe them. Needs no Blender."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from kfmocap.core.body import Body
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.formats import save_cameras, write_trc
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import benchmark_movements as movements
from .detector_errors import Errors
from .movement_phrases import Movement
from .painted_scene import Sensor
from .people import Person, Wardrobe, posed_parts, true_landmarks
from .takes import camera_looking_at

Array = NDArray[np.float64]
Box = tuple[tuple[float, float, float], tuple[float, float, float]]

LOOKS = ("benchmark_movements", "benchmark_shots", "detector_errors", "drawing", "figure", "movement_phrases",
         "painted_scene", "people", "shapes", "textures")  # fmt: skip
"""The modules whose changes make rendered shots out of date."""
SIZE = (640, 360)


@dataclass(frozen=True)
class ShotPlan:
    """A shot.

    Attributes
    ----------
    half : str
        "deciding": constants may be chosen by it; "reporting": it only tells how well they were.
    keys : tuple of int
        Frames with key poses; the first and the last frame of the shot are the first and last of them.
    exposure : float
        Share of the time between frames.
    moments : int
        Times at which the exposure is sampled.
    boxes : tuple of Box
        Furniture: two corners each, metres.
    misaligned : float
        Standard deviation of the errors of the calibration that is written: degrees of rotation; five times as many
        thousandths of the focal length.
    voxel : float
        Of the figure's mesh, metres.
    """

    name: str
    half: str
    person: Person
    movement: Movement
    fps: float
    keys: tuple[int, ...]
    cameras: tuple[Camera, ...]
    exposure: float = 0.4
    moments: int = 3
    sensor: Sensor = field(default_factory=Sensor)
    boxes: tuple[Box, ...] = ()
    misaligned: float = 0.0
    voxel: float = 0.014

    @property
    def frames(self) -> int:
        """Number of frames."""
        return self.keys[-1] + 1

    @property
    def seconds(self) -> Array:
        """Middle of each frame's exposure, shape (F,)."""
        return np.arange(self.frames) / self.fps

    def exposed(self, frame: int) -> Array:
        """Times at which a frame's exposure is sampled, seconds, shape (M,)."""
        return (frame + self.exposure * ((np.arange(self.moments) + 0.5) / self.moments - 0.5)) / self.fps

    def digest(self) -> str:
        """Hash of everything that the shot's files depend on."""
        sources = [Path(__file__).with_name(f"{name}.py").read_bytes() for name in LOOKS]
        return hashlib.sha256(b"".join([*sources, self.name.encode()])).hexdigest()[:16]

    def written_cameras(self) -> dict[str, Camera]:
        """The cameras as the shot's calibration has them."""
        rng = np.random.default_rng([len(self.name), *self.name.encode()])
        return {camera.name: _misaligned(camera, self.misaligned, rng) for camera in self.cameras}


def _misaligned(camera: Camera, degrees: float, rng: np.random.Generator) -> Camera:
    turned, longer = rng.normal(size=3), rng.normal()
    if not degrees:
        return camera
    error = Rotation.from_rotvec(np.radians(degrees) * turned).as_matrix()
    matrix = camera.matrix.copy()
    matrix[[0, 1], [0, 1]] *= 1 + 0.005 * degrees * longer
    # About the camera's centre, so that it stays where it is.
    return replace(
        camera, matrix=matrix, R_cam_world=error @ camera.R_cam_world, t_cam_world=camera.t_cam_world @ error.T
    )


def ring(
    count: int,
    radius: float,
    focal: float,
    first: float,
    step: float,
    *,
    at: tuple[float, float, float] = (0.0, 0.0, 0.9),
    lens: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
) -> tuple[Camera, ...]:
    """Cameras around a point, from an angle on in steps, degrees; their heights and distances differ."""
    cameras = []
    for k in range(count):
        angle = np.radians(first + step * k)
        r, height = radius * (1, 1.08, 0.95, 1.04)[k % 4], (1.25, 1.75, 1.0, 1.5)[k % 4]
        place = (at[0] + r * np.cos(angle), at[1] + r * np.sin(angle), height)
        cameras.append(camera_looking_at(f"cam{k + 1:02d}", place, at, focal, distortions=lens, size=SIZE))
    return tuple(cameras)


_PLAIN = Wardrobe(((0.24, 0.33, 0.46),), (0.22, 0.22, 0.25), pattern=0.06, sleeve=0.9)
STRIPED = Wardrobe(((0.72, 0.7, 0.66), (0.22, 0.25, 0.4)), (0.18, 0.22, 0.33), pattern=0.035, sleeve=-0.45)
_CHECKED = Wardrobe(((0.62, 0.22, 0.2), (0.26, 0.12, 0.14)), (0.35, 0.37, 0.4), pattern=0.04, checks=True)
SPORTS = Wardrobe(((0.2, 0.42, 0.3),), (0.14, 0.14, 0.16), (0.42, 0.28, 0.2), (0.06, 0.05, 0.05), sleeve=-0.4, leg=-0.4)
_LIKE_THE_WALL = Wardrobe(
    ((0.60, 0.60, 0.55),), (0.53, 0.42, 0.32), (0.62, 0.5, 0.42), (0.4, 0.33, 0.26), (0.45, 0.36, 0.3)
)
_LIKE_THE_FLOOR = Wardrobe(((0.55, 0.43, 0.32), (0.6, 0.57, 0.5)), (0.57, 0.55, 0.5), (0.6, 0.47, 0.38), pattern=0.09)
_DARK = Wardrobe(((0.14, 0.14, 0.15),), (0.12, 0.12, 0.13), (0.72, 0.54, 0.45), (0.5, 0.36, 0.2))
_LIGHT = Wardrobe(((0.66, 0.6, 0.48), (0.5, 0.46, 0.4)), (0.46, 0.34, 0.3), (0.55, 0.38, 0.28), pattern=0.08)

_TALL = {"thigh": 1.05, "shin": 1.06, "torso": 0.96, "shoulder_width": 1.04, "upper_arm": 1.04}
_SHORT = {"thigh": 0.95, "shin": 0.94, "torso": 1.05, "hip_width": 1.08, "forearm": 0.95}
_BROAD = {"shoulder_width": 1.12, "hip_width": 0.95, "upper_arm": 0.95, "head": 0.95, "neck_rise": 1.6}
_SLIM = {"shoulder_width": 0.92, "torso": 1.03, "forearm": 1.06, "thigh": 0.97, "foot_forward": 0.94}

_DIM = Sensor(gain=0.5, photons=260.0, blur=0.8)
_GRAINY = Sensor(gain=0.7, photons=420.0, blur=0.7)
_SOFT = Sensor(photons=3000.0, blur=1.1)
_LENS = (-0.15, 0.05, 0.0, 0.0)

SHOTS = (
    ShotPlan("bow", "deciding", Person(1.62, _PLAIN, _SHORT), movements.BOW, 25.0, (0, 27, 54),
             ring(2, 4.0, 560, -110, 75)),
    ShotPlan("stretching", "reporting", Person(1.86, _LIGHT, _TALL, 1.12, 0.022), movements.STRETCHING, 24.0,
             (0, 26, 52), ring(2, 4.2, 500, -150, 70, at=(0, 0, 1.06))),
    ShotPlan("front_kick", "deciding", Person(1.74, SPORTS, _BROAD), movements.FRONT_KICK, 60.0, (0, 24, 54),
             ring(4, 4.0, 530, -80, 80), exposure=0.5, moments=4),
    ShotPlan("round_kick", "reporting", Person(1.68, _DARK, _SLIM), movements.ROUND_KICK, 50.0, (0, 23, 50),
             ring(4, 4.1, 540, -30, 85), exposure=0.5, moments=4),
    ShotPlan("punches", "deciding", Person(1.78, STRIPED, _TALL), movements.PUNCHES, 30.0, (0, 22, 44),
             ring(3, 3.9, 560, -125, 55), exposure=0.7, moments=5),
    ShotPlan("ball_throw", "reporting", Person(1.58, _CHECKED, _SHORT, 0.95), movements.THROW_A_BALL, 30.0,
             (0, 24, 48), ring(3, 3.9, 560, -140, 50), exposure=0.7, moments=5),
    ShotPlan("leap", "deciding", Person(1.71, _CHECKED, _SLIM, 0.95), movements.LEAP, 120.0, (0, 33, 66, 99),
             ring(2, 4.0, 500, -95, 80, at=(0.1, -0.1, 0.95)), moments=2, sensor=_GRAINY),
    ShotPlan("hop_turn", "reporting", Person(1.8, _PLAIN, _BROAD, 1.05), movements.HOP_TURN, 100.0, (0, 29, 58, 87),
             ring(2, 4.0, 500, -130, 80, at=(0, 0, 0.95)), moments=2, sensor=_GRAINY),
    ShotPlan("stroll_behind_bench", "deciding", Person(1.66, STRIPED, _BROAD, 1.08), movements.STROLL, 30.0,
             (0, 26, 52), ring(3, 4.1, 540, -100, 50), boxes=(((-0.75, -1.15, 0.0), (0.65, -0.8, 0.55)),)),
    ShotPlan("sitting_down", "reporting", Person(1.76, SPORTS, _SLIM), movements.SIT_DOWN, 30.0, (0, 26, 52),
             ring(3, 4.1, 540, -125, 45),
             boxes=(((-0.3, 0.12, 0.0), (0.3, 0.55, 0.43)), ((-0.95, -1.3, 0.0), (-0.25, -0.9, 0.62)))),
    ShotPlan("dance", "deciding", Person(1.63, _DARK, _SLIM), movements.DANCE, 24.0, (0, 24, 50),
             ring(8, 4.1, 540, -90, 45), exposure=0.6, moments=3, sensor=_DIM, misaligned=0.12),
    ShotPlan("lunges", "reporting", Person(1.83, _CHECKED, _BROAD), movements.LUNGES, 25.0, (0, 24, 48),
             ring(6, 4.1, 520, -75, 60), exposure=0.6, moments=3, sensor=_DIM, misaligned=0.12),
    ShotPlan("waving_far", "deciding", Person(1.72, _LIKE_THE_WALL, _BROAD), movements.WAVING, 30.0, (0, 17, 34, 51),
             ring(1, 4.3, 330, -85, 40, lens=_LENS), sensor=_SOFT),
    ShotPlan("picking_up_near", "reporting", Person(1.67, _LIKE_THE_FLOOR, _TALL, 1.0, 0.012), movements.PICK_UP, 30.0,
             (0, 17, 34, 51), ring(1, 2.9, 400, -95, 40, at=(0, -0.05, 0.8), lens=_LENS), sensor=_SOFT),
    ShotPlan("jump_spin", "deciding", Person(1.75, _LIGHT, _SHORT), movements.JUMP_SPIN, 60.0,
             (0, 12, 24, 36, 48, 60, 72, 83), ring(2, 4.2, 480, -130, 85, at=(0, 0, 1.05)), exposure=0.5, moments=4),
    ShotPlan("cartwheel", "reporting", Person(1.65, SPORTS, _SLIM, 0.97), movements.CARTWHEEL, 60.0, (0, 28, 56, 83),
             ring(3, 4.3, 470, -140, 75, at=(0, 0, 1.0)), exposure=0.5, moments=4),
)  # fmt: skip
"""In pairs of like difficulty: of each the first decides and the second reports."""
PLANS = {plan.name: plan for plan in SHOTS}


def write_description(plan: ShotPlan, body: Body, seen: NDArray[np.bool_], out: Path) -> None:
    """Write all but the footage: calibration, true landmarks, keypoints, and the shot files.

    Parameters
    ----------
    seen : ndarray of bool, shape (V, F, L)
        Which landmarks each view sees.
    """
    motion = plan.movement.motion(body, plan.seconds)
    save_cameras(out / "calibration.toml", plan.written_cameras())
    write_trc(out / "landmarks.trc", list(body.landmarks), true_landmarks(body, motion), plan.fps)
    errors = Errors(sum(plan.name.encode()), plan.fps)
    found = errors.detected(body, *posed_parts(body, motion), plan.cameras, seen)
    for camera, people in zip(plan.cameras, found, strict=True):
        (out / f"{camera.name}_keypoints.json").write_text(json.dumps(people), encoding="utf-8")
    for file, with_keypoints in (("shot_keypoints.toml", True), ("shot.toml", False)):
        (out / file).write_text(_shot_file(plan, with_keypoints), encoding="utf-8")


def _shot_file(plan: ShotPlan, keypoints: bool) -> str:
    views = "".join(
        f'\n[[view]]\ncamera = "{c.name}"\nfootage = "{c.name}/%04d.jpg"\n'
        + (f'keypoints = "{c.name}_keypoints.json"\n' if keypoints else "")
        for c in plan.cameras
    )
    return (
        f"# rendered from {plan.digest()}\n\n"
        f'[shot]\nname = "{plan.name}"\nfps = {plan.fps}\nframes = [0, {plan.frames - 1}]\n\n'
        f'[calibration]\nfile = "calibration.toml"\n{views}\n'
        f'[[performer]]\nname = "person"\nlandmarks = "landmarks.trc"\nkeyframes = {list(plan.keys)}\n'
    )


def is_current(plan: ShotPlan, folder: Path) -> bool:
    """Whether a folder holds exactly this shot."""
    shot = folder / "shot.toml"
    return shot.exists() and plan.digest() in shot.read_text(encoding="utf-8")
