"""2D keypoints as a pose detector would find them: with the errors that detectors make. Needs no Blender.

Joints lie beside the true ones, on the body and in each view; noise is correlated in time and grows with speed and
where a joint is hidden; some keypoints leap, some are missing, and at times left is taken for right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from kfmocap.core.body import Body
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.formats.keypoint_layouts import HALPE_26, mirrored_name
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

Array = NDArray[np.float64]

JOINT_OFFSET = {"Hip": (0.020, 0.035, 0.040), "Shoulder": (0.012, 0.022, 0.018)}
OTHER_OFFSET = (0.010, 0.018, 0.014)
"""Standard deviations of a joint's offset on the body: across, along and out of the part it belongs to, metres."""
HIP_FORWARD = 0.03
"""By how much detectors put hips before the joints, metres."""
VIEW_OFFSET, NOISE, PIXEL = 0.006, 0.011, 0.7
"""Standard deviations of a view's own offset and of the noise, metres at the performer, and pixels."""
CORRELATION, OUTLIERS, MISSING, EXCHANGED = 0.12, 0.02, 0.02, 0.02
"""Correlation time of the noise, seconds; shares of keypoints that leap, are missing, are on the other side."""
LEAST_CONFIDENCE = 0.25
"""A hidden joint's confidence; about half of them are not reported at all."""


@dataclass(frozen=True)
class Errors:
    """Draws the errors of a detector on one shot."""

    seed: int
    fps: float

    def detected(
        self, body: Body, R: Array, T: Array, cameras: Sequence[Camera], seen: NDArray[np.bool_]
    ) -> list[list[dict[str, object]]]:
        """What the detector finds in each view, in COCO's results format.

        Parameters
        ----------
        R, T : ndarray, shape (F, P, 3, 3) and (F, P, 3)
            True world poses of the parts.
        seen : ndarray of bool, shape (V, F, L)
            Which landmarks each view sees, in the order of the body's.
        """
        rng = np.random.default_rng([self.seed, 77])
        names = list(body.landmarks)
        points = self._misplaced(body, names, R, T, rng)
        return [
            self._in_view(names, points, camera, seen[v], np.random.default_rng([self.seed, 78, v]))
            for v, camera in enumerate(cameras)
        ]

    def _misplaced(self, body: Body, names: list[str], R: Array, T: Array, rng: np.random.Generator) -> Array:
        """Where the detector believes the joints to be, shape (F, L, 3): the same on both sides of the body, nearly."""
        parts, local = body.landmark_arrays(names)
        drawn: dict[str, Array] = {}
        out = np.empty((len(T), len(names), 3))
        for k, name in enumerate(names):
            joint = name[1:] if mirrored_name(name) != name else name
            if joint not in drawn:
                drawn[joint] = rng.normal(size=3) * JOINT_OFFSET.get(joint, OTHER_OFFSET)
                drawn[joint][2] += HIP_FORWARD * (joint == "Hip" and joint != name)
            offset = drawn[joint] * [1 if name[0] == "L" else -1, 1, 1] + 0.005 * rng.normal(size=3)
            out[:, k] = np.einsum("fab,b->fa", R[:, parts[k]], local[k] + offset) + T[:, parts[k]]
        return out

    def _in_view(
        self, names: list[str], points: Array, camera: Camera, seen: NDArray[np.bool_], rng: np.random.Generator
    ) -> list[dict[str, object]]:
        F, L = points.shape[:2]
        speed = np.linalg.norm(np.gradient(points, axis=0), axis=-1) * self.fps
        shifted = points + VIEW_OFFSET * (rng.normal(size=(1, L, 3)) + self._slow(rng, (F, L, 3), 0.5))
        uv = camera.project(shifted.reshape(-1, 3)).reshape(F, L, 2)
        focal = (camera.matrix[0, 0] + camera.matrix[1, 1]) / 2
        scale = focal / np.linalg.norm(points - camera.centre_world(), axis=-1)
        size = (NOISE * scale + PIXEL) * (1 + 0.15 * np.minimum(speed, 6)) * np.where(seen, 1, 2.5)
        error = size[..., None] * (0.75 * self._slow(rng, (F, L, 2), CORRELATION) + 0.5 * rng.normal(size=(F, L, 2)))
        leaping = self._spells(rng, (F, L), OUTLIERS)
        angle = rng.uniform(0, 2 * np.pi, L)
        far = scale[..., None] * rng.uniform(0.06, 0.25, (1, L, 1))
        error += np.where(leaping[..., None], far * np.stack([np.cos(angle), np.sin(angle)], axis=-1), 0.0)
        confidence = np.clip(rng.beta(9, 1.2, (F, L)) - 0.4 * leaping * rng.random((F, L)), 0.05, 1)
        confidence = np.where(seen, confidence, np.clip(rng.normal(LEAST_CONFIDENCE, 0.2, (F, L)), 0.05, 0.9))
        gone = (rng.random((F, L)) < MISSING) | (~seen & self._spells(rng, (F, L), 0.5))
        found = uv + error
        order = [names.index(mirrored_name(name)) for name in names]
        for limb in (("Hip", "Knee", "Ankle", "BigToe", "Heel"), ("Shoulder", "Elbow", "Wrist")):
            turned = self._spells(rng, (F, 1), EXCHANGED)[:, 0]
            columns = [k for k, name in enumerate(names) if name[1:] in limb]
            others = [order[k] for k in columns]
            found[np.ix_(turned, columns)] = found[np.ix_(turned, others)]
            gone[np.ix_(turned, columns)] = gone[np.ix_(turned, others)]
        width, height = camera.size
        gone |= ((found < 0) | (found > [width - 1, height - 1])).any(axis=-1)
        return [_person(f, names, found[f], np.where(gone[f], 0.0, confidence[f])) for f in range(F)]

    def _slow(self, rng: np.random.Generator, shape: tuple[int, ...], seconds: float) -> Array:
        """Noise of unit deviation that is correlated over a time."""
        width, pad = seconds * self.fps / np.sqrt(2), int(4 * seconds * self.fps) + 1
        raw = rng.normal(size=(shape[0] + 2 * pad, *shape[1:]))
        smooth = gaussian_filter1d(raw, max(width, 1e-3), axis=0)
        return np.asarray(smooth[pad : pad + shape[0]] * np.sqrt(max(2 * np.sqrt(np.pi) * width, 1.0)))

    def _spells(self, rng: np.random.Generator, shape: tuple[int, int], share: float) -> NDArray[np.bool_]:
        """True on a share of the frames, for about a tenth of a second each time."""
        length = max(1, round(0.1 * self.fps))
        begun = rng.random((shape[0] + length - 1, shape[1])) < 1 - (1 - share) ** (1 / length)
        return np.asarray(np.lib.stride_tricks.sliding_window_view(begun, length, axis=0).any(axis=-1))


def _person(frame: int, names: list[str], points: Array, confidence: Array) -> dict[str, object]:
    """One frame's person in the order of HALPE_26; neck and hip centre are the middles of the sides."""
    table = np.zeros((len(HALPE_26), 3))
    for k, name in enumerate(HALPE_26):
        if name in names and confidence[names.index(name)] > 0:
            table[k] = [*points[names.index(name)], confidence[names.index(name)]]
    for middle, side in (("Neck", "Shoulder"), ("Hip", "Hip")):
        pair = table[[HALPE_26.index(f"L{side}"), HALPE_26.index(f"R{side}")]]
        table[HALPE_26.index(middle)] = pair.mean(axis=0) if (pair[:, 2] > 0).all() else 0
    return {"image_id": frame, "category_id": 1, "keypoints": table.round(2).ravel().tolist(), "score": 1.0}
