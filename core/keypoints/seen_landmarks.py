"""Which landmarks a detector found at all, and therefore which parts of the body are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body import Body
from ..body.motion import Motion
from ..body.unknown_parts import resting_parts, unknown_parts
from ..numerics import rotations
from ..numerics.arrays import Array, Bools
from .keypoint_offsets import KeypointOffsets
from .keypoint_rays import Keypoints

MIN_CONFIDENCE = 0.3
"""A keypoint counts as seen from this confidence on; below, most detectors' own programs do not draw it."""
MIN_FRAMES = 3
"""A landmark counts as seen if it has that confidence on at least this many frames of one view."""
USUAL_CONFIDENCE = 0.7
"""Confidence that detectors reach for the best tenth of their keypoints, at least."""
HABIT_SIGMA = 0.5
"""Standard deviation of a part that is out of sight from its mean rotation on frames on which it is seen, radians."""
HABIT_TIME = 0.2
"""How long such a deviation lasts, seconds: the frames of this time count as one."""


def with_usual_confidence(keypoints: Keypoints) -> Keypoints:
    """Return the keypoints with all confidence raised by the same factor if even the best tenth is unsure.

    What detectors call their confidence differs, and falls in dark or blurred pictures; only the differences within a
    shot say which keypoints are good.
    """
    found = keypoints.confidence[keypoints.confidence > 0]
    best = float(np.quantile(found, 0.9)) if len(found) else 1.0
    return replace(keypoints, confidence=np.minimum(keypoints.confidence * max(1.0, USUAL_CONFIDENCE / best), 1.0))


def without_guesses(keypoints: Keypoints) -> Keypoints:
    """Return the keypoints without landmarks that no view finds with some confidence.

    Some detectors give a position to every keypoint whatever they see; these are guesses.
    """
    often = min(MIN_FRAMES, len(keypoints))
    seen = (keypoints.confidence >= MIN_CONFIDENCE).any(axis=0).sum(axis=0) >= often
    return replace(keypoints, confidence=keypoints.confidence * seen)


def unseen_parts(body: Body, keypoints: Keypoints) -> tuple[str, ...]:
    """Return the names of the body's parts that no keypoint shows on any frame."""
    return unknown_parts(body, found_landmarks(keypoints))


def found_landmarks(keypoints: Keypoints) -> list[str]:
    """Return the names of the landmarks that are found on any frame."""
    found = keypoints.confidence.any(axis=(0, 1))
    return [name for name, is_found in zip(keypoints.names, found, strict=True) if is_found]


def habit_precision(body: Body, keypoints: Keypoints, fps: float) -> Array:
    """Return the precision of each part's usual rotation as a prior, 1/radians^2, (F, P); 0 where the part is seen.

    Without this prior, a limb that leaves the picture would keep turning as it did when it was last seen. Parts that no
    keypoint shows on any frame have no prior, nor have hands and feet if the detector does not find them.
    """
    carried = body.ancestry[KeypointOffsets.on(body, keypoints.names).parts]  # (L, P): what a landmark shows
    shown = (keypoints.confidence.any(axis=0)[:, :, None] & carried).any(axis=1)
    return (~shown & shown.any(axis=0)) / (HABIT_SIGMA**2 * HABIT_TIME * fps)


def usual_turns(motion: Motion, precision: Array) -> Array:
    """Return the mean rotations (P, 3, 3) of parts over the frames on which they are seen."""
    return rotations.mean(motion.rotations, (precision == 0).astype(float))


def resting_degrees(body: Body, keypoints: Keypoints) -> Bools:
    """Return which degrees of freedom belong to parts that rest because no keypoint shows them, shape (F, D)."""
    resting = np.zeros(1 + len(body), bool)
    resting[[1 + part for part in resting_parts(body, unseen_parts(body, keypoints))]] = True
    return np.tile(np.repeat(resting, 3), (len(keypoints), 1))


def with_resting(motion: Motion, fixed: Bools) -> Motion:
    """Return the motion with its rest rotation for all parts that are fixed, bool (F, D), on all frames."""
    held = fixed[:, 3:].reshape(len(fixed), -1, 3).all(axis=(0, 2))
    return Motion(motion.translations, np.where(held[:, None, None], np.eye(3), motion.rotations))
