"""An estimate of a performer's body: the shape of its parts, its key poses, and the priors on the shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..body import Body, part_poses
from ..body.measures.shaping import mirrored_parts, shaped
from ..body.motion import Motion
from ..evidence.part_shapes import SHIFT_SIGMA, STRETCH_SIGMA
from ..keypoints.keypoint_offsets import KeypointOffsets
from ..keypoints.keypoint_rays import Keypoints
from ..numerics.arrays import Array

SIZE_SIGMA = 0.08
"""Standard deviation of a performer's size, relative to the body's."""
LENGTH_SIGMA = 0.08
"""Standard deviation of a part's length, relative to what the size suggests; for widths see
`core.evidence.part_shapes.STRETCH_SIGMA`."""
STRETCH_ASYMMETRY, SHIFT_ASYMMETRY = 0.02, 0.004
"""Standard deviation of the difference between left and right parts: relative for lengths, in metres for shifts."""
OFFSET_SIGMA, LIMB_OFFSET_SIGMA = 0.03, 0.01
"""Standard deviations of the offsets of keypoints from their landmarks, and along limbs, metres. Along limbs they are
smaller than for a motion (`core.keypoints.keypoint_offsets`): a few frames cannot tell an offset from a limb's
length."""
PART_DOF = 6
"""Unknowns of a part: stretch and shift along its axes."""


@dataclass(frozen=True, eq=False)
class BodyEstimate:
    """An estimate of one performer.

    Attributes
    ----------
    body : Body
        P parts.
    motions : mapping of float to Motion
        The K key poses, by the delay of the views that show them.
    keypoints : Keypoints
        On the K frames; L of them, none where there are none.
    places : KeypointOffsets
        Of the keypoints on the body.
    shape : ndarray, shape (1 + 6 P + 3 L,)
        Changes since the start: growth, stretch (beyond the growth) and shift of every part, the keypoints' offsets.
    posed : ndarray, shape (K, D)
        Changes of the key poses since the start.
    """

    body: Body
    motions: Mapping[float, Motion]
    keypoints: Keypoints
    places: KeypointOffsets
    shape: Array
    posed: Array

    def joints(self) -> Array:
        """Return the joints in the world, metres, shape (K, P, 3)."""
        return part_poses(self.body, self.motions[0.0])[1]

    def keypoint_places(self) -> Array:
        """Return the keypoints' places in the world, metres, shape (K, L, 3)."""
        return self.places.world(part_poses(self.body, self.motions[0.0]))

    def part_changes(self, step: Array) -> Array:
        """Return how far a step of the shape stretches and shifts each part, shape (P, 6)."""
        P = len(self.body)
        each = step[1 : 1 + PART_DOF * P].reshape(P, PART_DOF)
        return np.concatenate([np.clip(step[0] + each[:, :3], -0.15, 0.15), each[:, 3:]], axis=1)

    def moved(self, step: Array) -> BodyEstimate:
        """Return the estimate after increments of the shape and then the poses."""
        n, P, names = len(self.shape), len(self.body), self.keypoints.names
        changes = self.part_changes(step)
        body = shaped(self.body, changes[:, :3], changes[:, 3:])
        offsets = self.places.offsets + step[1 + PART_DOF * P : n].reshape(-1, 3)
        places = replace(KeypointOffsets.on(body, names), offsets=offsets)
        poses = step[n:].reshape(self.posed.shape)
        motions = {delay: motion.moved(poses) for delay, motion in self.motions.items()}
        return BodyEstimate(body, motions, self.keypoints, places, self.shape + step[:n], self.posed + poses)

    def prior(self) -> Array:
        """Return the inverse covariance of the shape, shape (n, n)."""
        P = len(self.body)
        deviation = np.full(len(self.shape), SIZE_SIGMA)
        deviation[1 : 1 + PART_DOF * P] = np.tile(
            [STRETCH_SIGMA, LENGTH_SIGMA, STRETCH_SIGMA, SHIFT_SIGMA, SHIFT_SIGMA, SHIFT_SIGMA], P
        )
        names = self.keypoints.names
        limbs = [name.endswith(("Elbow", "Wrist", "Knee", "Ankle")) for name in names]
        deviation[1 + PART_DOF * P :] = np.repeat(np.where(limbs, LIMB_OFFSET_SIGMA, OFFSET_SIGMA), 3)
        H = np.diag(1 / deviation**2)
        for left, right in mirrored_parts(self.body):
            for k, sign in enumerate((1, 1, 1, -1, 1, 1)):  # a bone's frame is mirrored along its x axis
                row = np.zeros(len(H))
                row[1 + PART_DOF * left + k], row[1 + PART_DOF * right + k] = 1, -sign
                H += np.outer(row, row) / (STRETCH_ASYMMETRY if k < 3 else SHIFT_ASYMMETRY) ** 2
        return H
