"""Takes: a body, its motion, the cameras that film it, and the shot file written from them. Needs no Blender."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from kfmocap.core.body import Body, human, landmark_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.formats import save_cameras, write_trc
from numpy.typing import ArrayLike

from .motions import MOTIONS
from .people import Person, Wardrobe, true_landmarks

KEY_STEP = 20
_FIGURE = ("figure", "isosurface", "shapes", "textures", "video_encoding")
TRACED = (*_FIGURE, "camera_lens", "render_scene")
"""The modules, besides this one, whose changes make traced pictures out of date."""
PAINTED = (*_FIGURE, "drawing", "painted_scene", "people")
"""The same of painted pictures."""
MOMENTS = 10
"""Into how many the time from one picture to the next is divided; a shutter is open for the middle half of them."""


@dataclass(frozen=True, eq=False)
class Take:
    """A motion and the cameras that film it.

    Pictures of a `person` are painted, with the blur of an exposure of half the time from one to the next; those of the
    usual figure, whose skeleton is that of the tracker's body, are traced by Blender, sharp.

    Attributes
    ----------
    fps : float
        Frames, or fields, per second.
    keys : tuple of int
        Frames that get a key pose.
    fields : str
        "progressive", or the field order of an interlaced video: "top-first" or "bottom-first".
    board : ndarray, shape (F, 3), optional
        Path of the centre of a board that passes in front of the performer, metres.
    person : Person, optional
    between : Motion, optional
        Of a person: the motion at `MOMENTS` times the frame rate.
    """

    name: str
    body: Body
    motion: Motion
    cameras: tuple[Camera, ...]
    fps: float
    keys: tuple[int, ...]
    fields: str = "progressive"
    board: np.ndarray | None = None
    person: Person | None = None
    between: Motion | None = None

    @property
    def landmarks(self) -> list[str]:
        """Names of the body's landmarks."""
        return list(self.body.landmarks)

    def truth(self) -> np.ndarray:
        """Landmarks in the world, metres, shape (F, L, 3)."""
        if self.person is not None:
            return true_landmarks(self.body, self.motion)
        return landmark_positions(self.body, self.motion, self.landmarks)

    def exposed(self, frame: int) -> Motion:
        """The motion of a person while a frame is exposed."""
        assert self.between is not None
        open_for = np.arange(-(MOMENTS // 4), MOMENTS // 4 + 1)
        return self.between[np.clip(MOMENTS * frame + open_for, 0, len(self.between) - 1)]

    def digest(self) -> str:
        """Hash of everything that its pictures depend on."""
        looks = TRACED if self.person is None else PAINTED
        sources = [Path(__file__).with_name(f"{name}.py").read_bytes() for name in looks]
        truth = self.truth()
        seen = [(c.name, c.size, c.distortions.tolist(), c.project(truth).round(3).tolist()) for c in self.cameras]
        board = None if self.board is None else self.board.round(6).tolist()
        described = repr((seen, self.fields, board, self.person))
        return hashlib.sha256(b"".join(sources) + described.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Plan:
    """How to make a take; without `keys` it has a key frame about every `KEY_STEP` frames."""

    motion: str
    frames: int
    fps: float
    cameras: tuple[Camera, ...]
    keys: tuple[int, ...] | None = None
    fields: str = "progressive"
    person: Person | None = None


def make_take(name: str, frames: int | None = None, board: bool = False) -> Take:
    """Make a take of `PLANS`; with `board`, a board passes between cam01 and the figure in the opposite direction.

    Raises
    ------
    ValueError
        A board before a person: it is not painted.
    """
    plan = PLANS[name]
    length = frames or plan.frames
    if board and plan.person is not None:
        raise ValueError(f"no board is painted before the person of '{name}'")
    usual = {"shoulder_width": 0.375, "upper_arm": 0.298, "torso": 0.52, "head": 0.32396}
    body = human(1.78, usual, collar_bones=False) if plan.person is None else plan.person.body()
    x = np.linspace(1.2, -1.2, length)
    path = np.stack([x, np.full(length, -1.3), np.full(length, 0.75)], axis=1) if board else None
    moving = MOTIONS[plan.motion]
    motion = moving(body, length, plan.fps)
    between = None if plan.person is None else moving(body, MOMENTS * (length - 1) + 1, MOMENTS * plan.fps)
    keys = plan.keys if plan.keys is not None and length == plan.frames else key_frames(length)
    return Take(
        name,
        body,
        motion,
        plan.cameras,
        plan.fps,
        tuple(keys),
        fields=plan.fields,
        board=path,
        person=plan.person,
        between=between,
    )


def key_frames(frames: int) -> list[int]:
    """Key frames about every `KEY_STEP` frames, including both ends."""
    return [int(k) for k in np.linspace(0, frames - 1, round(frames / KEY_STEP) + 1).round()]


def is_written(take: Take, out: Path) -> bool:
    """Whether a folder holds the footage of exactly this take."""
    shot = out / "shot.toml"
    return shot.exists() and take.digest() in shot.read_text()


def write_shot(take: Take, out: Path) -> None:
    """Write the calibration, the true landmarks and, last, the shot file of a take whose videos are rendered."""
    save_cameras(out / "calibration.toml", {camera.name: camera for camera in take.cameras})
    write_trc(out / "landmarks.trc", take.landmarks, take.truth(), take.fps)
    fields = "" if take.fields == "progressive" else f'fields = "{take.fields}"\n'
    views = "".join(f'\n[[view]]\ncamera = "{c.name}"\nfootage = "{c.name}.mp4"\n{fields}' for c in take.cameras)
    (out / "shot.toml").write_text(
        f"# rendered from {take.digest()}\n\n"
        f'[shot]\nname = "{take.name}"\nfps = {take.fps}\nframes = [0, {len(take.motion) - 1}]\n\n'
        f'[calibration]\nfile = "calibration.toml"\n{views}\n'
        f'[[performer]]\nname = "person"\nlandmarks = "landmarks.trc"\nkeyframes = {list(take.keys)}\n'
    )


def camera_looking_at(
    name: str,
    place: ArrayLike,
    at: ArrayLike,
    focal: float,
    *,
    distortions: ArrayLike = (0.0, 0.0, 0.0, 0.0),
    size: tuple[int, int] = (640, 480),
) -> Camera:
    """Make a camera at a place, metres, that looks at a point, its picture upright; focal length in pixels."""
    forward = np.subtract(at, place)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    matrix = [[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]]
    return Camera.create(name, size, matrix, R, -R @ np.asarray(place, float), distortions=distortions)


_WIDE = (640, 360)
BESIDE_THE_WALK = (
    camera_looking_at("cam01", (0.0, -4.7, 1.05), (0.0, 0.0, 0.93), 780.0, size=_WIDE),
    camera_looking_at("cam02", (4.1, -3.2, 1.5), (0.05, 0.05, 0.86), 700.0, size=_WIDE),
    camera_looking_at(
        "cam03", (-4.0, 3.1, 1.6), (0.05, -0.05, 0.86), 690.0, distortions=(-0.16, 0.06, 0.0005, -0.0007), size=_WIDE
    ),
)
"""From the right side, oblique from the front, oblique from behind (through a lens with distortion)."""
ALL_ROUND = (
    camera_looking_at("cam01", (0.0, -4.6, 1.2), (0.0, 0.0, 0.98), 900.0),
    camera_looking_at("cam02", (3.9, 2.4, 1.4), (0.0, 0.0, 0.96), 900.0),
    camera_looking_at("cam03", (-3.9, 2.4, 1.4), (0.0, 0.0, 0.96), 900.0),
)
BEFORE_THE_CROSSING = (camera_looking_at("cam01", (0.0, -4.7, 1.1), (0.0, 0.0, 0.95), 780.0),)
BEFORE_THE_RING = (camera_looking_at("cam01", (0.0, -5.0, 1.2), (0.03, 0.0, 0.9), 900.0),)
_SPORTS = Wardrobe(
    ((0.68, 0.2, 0.16), (0.82, 0.78, 0.72)), (0.13, 0.15, 0.2), (0.72, 0.53, 0.43), pattern=0.11, sleeve=-0.5, leg=-0.35
)
ATHLETE = Person(
    1.8, _SPORTS, {"shoulder_width": 1.06, "torso": 0.96, "upper_arm": 1.04, "forearm": 1.03, "thigh": 1.02}, 1.06
)
"""Whose shoulders rise with the arms, as the tracker's body's do not."""
THROW_KEYS = (0, 15, 26, 41, 52, 61, 66, 71)
PLANS = {
    "walk": Plan("walk", 60, 30.0, BESIDE_THE_WALK),
    "crossing": Plan("crossing", 97, 50.0, BEFORE_THE_CROSSING, (0, 96), person=ATHLETE),
    "throw": Plan("throw", 72, 60.0, BEFORE_THE_RING, THROW_KEYS, "top-first", ATHLETE),
    "whirl": Plan("whirl", 97, 30.0, ALL_ROUND, (0, 24, 48, 72, 96), person=ATHLETE),
}
"""The example in the repository, and the experiments of the papers."""
