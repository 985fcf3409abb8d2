"""A single camera from the 2D keypoints of a performer who stands or walks on the floor.

The apparent size of the limbs gives the distance of the performer; from that, the positions of the feet in the picture
give the height and the tilt of the camera. Compare F. Lv, T. Zhao, R. Nevatia, Camera calibration from video of a
walking human, IEEE PAMI 28 (2006). One view hardly shows the focal length, and shows the tilt only if the performer
walks towards the camera or away from it. Priors about how people usually film decide what remains open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ...body.human import FRACTIONS
from ...cameras.camera import Camera
from ...errors import CaptureError
from ...numerics.arrays import Array
from ...numerics.robust_kernels import NORMAL_MAD, Cauchy
from .limb_bundle import SINGLE_BONES
from .limb_residuals import (
    JOINTS,
    LIMB_ENDS,
    LOG_FOCAL_SIGMA,
    PROPORTION_SIGMA,
    USUAL_FOCAL,
    JointSightings,
    usual_lengths,
)
from .performer_views import USUAL_CORRELATION, PerformerView, joint_sightings
from .performer_world import ANKLE_SHARE, LEVEL_SIGMA

TILT_SIGMA = np.radians(10.0)
"""Standard deviation of the tilt of a camera from the horizontal, radians."""
USUAL_HEIGHT, LOG_HEIGHT_SIGMA = 1.3, 0.5
"""Usual height of a camera above the floor, metres, and the standard deviation of its logarithm."""
SWAY_SIGMA = np.radians(5.0)
"""Standard deviation of a performer's lean to one side of the picture, radians, in the median over a shot."""
UNUSUAL_ROLL = np.radians(15.0)
"""Roll of a camera about its line of sight beyond which the user is told that it is unusual, radians."""
LENGTH_QUANTILE = 0.8
"""Quantile of the limbs' apparent lengths, relative to their true ones, that gives the scale: most limbs look too
short, because they point towards the camera or away from it."""
_ROBUST_SCALE, _LEAN_SCALE = 3.0, 2.0  # scales of the kernels, in standard deviations
_MIN_DEPTH = 0.05  # metres


@dataclass(frozen=True, eq=False)
class SingleViewCalibration:
    """A camera that was found from one view, and how certain it is.

    Attributes
    ----------
    camera : Camera
        Metres, z up from the floor, the origin below the performer's hips on the first frame, x to the right of the
        picture.
    tilt : float
        By how much the camera looks down, radians.
    tilt_deviation : float
        Standard deviation of the tilt, radians.
    focal_deviation : float
        Standard deviation of the focal length, as a share of it; 0 if the lens is known.
    standing : int
        Number of frames on which a foot is seen.
    """

    camera: Camera
    tilt: float
    tilt_deviation: float
    focal_deviation: float
    standing: int

    @property
    def _roll(self) -> float:
        """Angle between the rows of the picture and the horizon, radians."""
        return float(np.arcsin(-self.camera.pose(0)[0][0, 2]))

    @property
    def cameras(self) -> dict[str, Camera]:
        """The camera by its name."""
        return {self.camera.name: self.camera}

    @property
    def summary_lines(self) -> list[str]:
        """Return the lines that tell the user about the result."""
        R, t = self.camera.pose(0)
        lens = f"focal length {self.camera.matrix[0, 0]:.0f} px"
        if self.focal_deviation:
            lens += f" within {100 * self.focal_deviation:.0f} %"
        rows = [
            f"{self.camera.name}: {lens}, {-R[:, 2] @ t:.1f} m above the floor, looks down by "
            f"{np.degrees(self.tilt):.0f} degrees within {np.degrees(self.tilt_deviation):.0f}",
            "scale from the performer's height; with one camera, what the performer does not show is a guess",
        ]
        if self.focal_deviation:
            rows.append("the lens is not known, and with it how far away the performer is: give the lens if you can")
        if abs(roll := self._roll) > UNUSUAL_ROLL:
            rows.append(
                f"it is taken to be turned by {np.degrees(roll):.0f} degrees about its line of sight: if it stood "
                "level, the performer is not upright for long enough"
            )
        if not self.standing:
            rows.append("no foot is seen: how high the camera is above the floor is a guess")
        return rows


def camera_by_performer(
    view: PerformerView, height: float, frames: tuple[int, int], *, correlated: float = USUAL_CORRELATION
) -> SingleViewCalibration:
    """Solve for a stationary camera from the keypoints of one performer.

    Parameters
    ----------
    view : PerformerView
    height : float
        Height of the performer, metres, which gives the scale.
    frames : tuple of int
        First and last frame of the shot, in the shot's count.
    correlated : float
        How many neighbouring frames have the same error of the detector, and therefore count as one.

    Raises
    ------
    CaptureError
        No frame shows a limb.
    """
    standing = _Standing.of(joint_sightings([view], frames, correlated), height)
    if not len(standing.scale):
        todo = "let the whole performer be seen, and check that the keypoints belong to this footage"
        raise CaptureError("no frame shows a limb", where=f"keypoints of camera '{view.camera}'", todo=todo)
    knows_lens = view.lens is not None

    def tried(x: Array) -> _TriedCamera:
        usual = USUAL_FOCAL * max(view.size)
        matrix = view.matrix(usual if knows_lens else usual * np.exp(LOG_FOCAL_SIGMA * x[3]))
        above = USUAL_HEIGHT * np.exp(LOG_HEIGHT_SIGMA * x[2])
        return _TriedCamera(TILT_SIGMA * x[0], LEVEL_SIGMA * x[1], above, matrix)

    def residuals(x: Array) -> Array:
        """All residuals in standard deviations, as are the unknowns themselves, relative to their usual values."""
        level = _robust(x[1:2], _LEAN_SCALE)
        return np.concatenate([standing.residuals(tried(x)), x[:1], level, x[2:]])

    found = least_squares(residuals, np.zeros(3 if knows_lens else 4))
    best = tried(found.x)
    deviation = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    return SingleViewCalibration(
        _camera(view, best, standing.first_hips(best)),
        float(best.tilt),
        float(TILT_SIGMA * deviation[0]),
        0.0 if knows_lens else float(LOG_FOCAL_SIGMA * deviation[3]),
        int(np.isfinite(standing.ankles).all(axis=2).any(axis=1).sum()),
    )


@dataclass(frozen=True, eq=False)
class _TriedCamera:
    """A camera that is tried, above the floor of a world whose origin is not fixed yet.

    Attributes
    ----------
    tilt, roll : float
        By how much it looks down, and is turned about its line of sight, radians.
    height : float
        Above the floor, metres.
    matrix : ndarray, shape (3, 3)
        Intrinsic matrix, pixels.
    """

    tilt: float
    roll: float
    height: float
    matrix: Array

    @property
    def down(self) -> Array:
        """Unit vector towards the floor in the camera's frame."""
        return np.array(
            [np.sin(self.roll), np.cos(self.roll) * np.cos(self.tilt), np.cos(self.roll) * np.sin(self.tilt)]
        )

    def rays(self, points: Array) -> Array:
        """Return the points at unit depth in camera axes, (..., 3), for pixels (..., 2)."""
        matrix = self.matrix
        plane = (points - matrix[:2, 2]) / matrix[[0, 1], [0, 1]]
        return np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1)


@dataclass(frozen=True, eq=False)
class _Standing:
    """The performer in the picture, on the F frames on which a limb is seen; in pixels, NaN where unseen.

    Attributes
    ----------
    scale : ndarray, shape (F,)
        Pixels per metre at the performer's distance.
    ankles : ndarray, shape (F, 2, 2)
        Positions of both ankles.
    hips, shoulders : ndarray, shape (F, 2)
        Positions of their middles.
    ankle_height, tall : float
        Height of a standing foot's ankle above the floor, and of the shoulders above the ankles when upright, metres.
    correlated : float
        How many frames count as one.
    """

    scale: Array
    ankles: Array
    hips: Array
    shoulders: Array
    ankle_height: float
    tall: float
    correlated: float

    @classmethod
    def of(cls, seen: JointSightings, height: float) -> _Standing:
        joint = dict(zip(JOINTS, np.moveaxis(seen.points[0], 1, 0), strict=True))
        hips, shoulders = (joint[f"R{name}"] / 2 + joint[f"L{name}"] / 2 for name in ("Hip", "Shoulder"))
        lengths = dict(zip(LIMB_ENDS, usual_lengths(height), strict=True))
        looks = [
            np.linalg.norm(joint[a] - joint[b], axis=1) / lengths[limb]
            for limb in SINGLE_BONES
            for a, b in LIMB_ENDS[limb]
        ]
        looks.append(np.linalg.norm(shoulders - hips, axis=1) / (FRACTIONS["torso"] * height))
        some = np.flatnonzero(np.isfinite(looks).any(axis=0))
        return cls(
            scale=np.nanquantile(np.array(looks)[:, some], LENGTH_QUANTILE, axis=0) if len(some) else np.zeros(0),
            ankles=np.stack([joint["RAnkle"], joint["LAnkle"]], axis=1)[some],
            hips=hips[some],
            shoulders=shoulders[some],
            ankle_height=float(ANKLE_SHARE * lengths["shin"]),
            tall=float(lengths["shin"] + lengths["thigh"] + FRACTIONS["torso"] * height),
            correlated=seen.correlated,
        )

    def residuals(self, camera: _TriedCamera) -> Array:
        """Relative distances of the lower ankle from the floor, by frame, and the performer's median lean, if known;
        both in standard deviations.
        """
        focal, down = camera.matrix[1, 1], camera.down
        depth = focal / self.scale
        below = (camera.rays(self.ankles) @ down) * depth[:, None]
        below = below[np.isfinite(below).any(axis=1)]
        lower = np.maximum(np.nanmax(below, axis=1), _MIN_DEPTH) if len(below) else np.zeros(0)
        # A performer of other proportions seems farther away or nearer, so errors of heights are relative.
        off = np.log(lower / max(camera.height - self.ankle_height, _MIN_DEPTH)) / PROPORTION_SIGMA
        return np.concatenate([_robust(off, _ROBUST_SCALE, self.correlated), self._leaning(camera, depth)])

    def _leaning(self, camera: _TriedCamera, depth: Array) -> Array:
        """Return the median angle in the picture between the performer and the vertical there; empty if it is not
        seen.
        """
        feet = self.ankles.mean(axis=1)
        body = self.shoulders - feet
        seen = np.isfinite(body).all(axis=1)
        if not seen.any():
            return np.zeros(0)
        head = camera.rays(feet[seen]) * depth[seen, None] - self.tall * camera.down
        vertical = head[:, :2] / np.maximum(head[:, 2:], _MIN_DEPTH) * camera.matrix[[0, 1], [0, 1]]
        vertical += camera.matrix[:2, 2] - feet[seen]
        across = vertical[:, 0] * body[seen, 1] - vertical[:, 1] * body[seen, 0]
        angle = np.arctan2(across, (vertical * body[seen]).sum(axis=1))
        middle = np.median(angle)
        spread = NORMAL_MAD * np.median(np.abs(angle - middle))  # bending at times makes it less certain
        return np.array([middle / np.hypot(SWAY_SIGMA, spread)])

    def first_hips(self, camera: _TriedCamera) -> Array:
        """Position of the hips on the first frame on which they are seen, in camera axes, metres."""
        frame = int(np.argmax(np.isfinite(self.hips).all(axis=1)))
        point = np.where(np.isfinite(self.hips[frame]), self.hips[frame], camera.matrix[:2, 2])
        return np.asarray(camera.rays(point) * camera.matrix[1, 1] / self.scale[frame])


def _robust(residuals: Array, scale: float, correlated: float = 1.0) -> Array:
    """Residuals whose squares are the robust costs of the given ones, of which `correlated` count as one."""
    return np.asarray(np.sign(residuals) * np.sqrt(Cauchy(scale).cost(residuals**2) / correlated))


def _camera(view: PerformerView, camera: _TriedCamera, hips: Array) -> Camera:
    """Return the camera in the performer's world."""
    up = -camera.down
    right = np.array([1.0, 0.0, 0.0]) - up[0] * up
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(up, right), up], axis=1)
    centre = -hips @ R  # beside the hips, and above the floor
    t = -R @ np.array([centre[0], centre[1], camera.height])
    return view.camera_at(camera.matrix, R, t)
