"""Which landmarks a detector saw at all, and which parts of the body it thus shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body import Body
from ..body.motion import Motion
from ..body.unknown_parts import resting_parts, unknown_parts
from ..numerics import rotations
from ..numerics.arrays import Array, Bools
from .keypoint_factor import Keypoints, Places

LEAST_CONFIDENCE = 0.3
"""A keypoint is seen with at least this confidence: below, most detectors' own programs do not draw it."""
SEEN_OFTEN = 3
"""A landmark is seen that is found in a view with that confidence on so many frames."""
HABIT_DEVIATION = 0.5
"""Usual departure of a part that is out of sight from how it is turned on average where it is seen, radians."""
HABIT_TIME = 0.2
"""How long a part goes on departing from that to the same side, seconds: frames within count as one."""


def without_guesses(keypoints: Keypoints) -> Keypoints:
    """Return the keypoints without those of landmarks that are nowhere found with some confidence: detectors that name
    every keypoint whatever they see only guess at them.
    """
    often = min(SEEN_OFTEN, len(keypoints))
    seen = (keypoints.confidence >= LEAST_CONFIDENCE).any(axis=0).sum(axis=0) >= often
    return replace(keypoints, confidence=keypoints.confidence * seen)


def unseen_parts(body: Body, keypoints: Keypoints) -> tuple[str, ...]:
    """Return the names of the body's parts that keypoints show on no frame."""
    return unknown_parts(body, found_landmarks(keypoints))


def found_landmarks(keypoints: Keypoints) -> list[str]:
    """Return the names of the landmarks that are found on any frame."""
    found = keypoints.confidence.any(axis=(0, 1))
    return [name for name, is_found in zip(keypoints.names, found, strict=True) if is_found]


def habit_precision(body: Body, keypoints: Keypoints, fps: float) -> Array:
    """Return the precision with which parts are turned as usual on frames on which they are out of sight, (F, P).

    A limb that leaves the picture would go on turning as it did when it was seen last. Parts that no keypoint shows on
    any frame are left alone, as are hands and feet of which a detector says nothing.
    """
    carried = body.ancestry[Places.on(body, keypoints.names).parts]  # (L, P): what a landmark shows
    shown = (keypoints.confidence.any(axis=0)[:, :, None] & carried).any(axis=1)
    return (~shown & shown.any(axis=0)) / (HABIT_DEVIATION**2 * HABIT_TIME * fps)


def usual_turns(motion: Motion, precision: Array) -> Array:
    """Return the mean rotations (P, 3, 3) of parts over the frames on which they are not out of sight."""
    return rotations.mean(motion.rotations, (precision == 0).astype(float))


def resting_degrees(body: Body, keypoints: Keypoints) -> Bools:
    """Return the degrees of freedom of parts that rest, as no keypoint shows them, shape (F, D)."""
    resting = np.zeros(1 + len(body), bool)
    resting[[1 + part for part in resting_parts(body, unseen_parts(body, keypoints))]] = True
    return np.tile(np.repeat(resting, 3), (len(keypoints), 1))


def with_resting(motion: Motion, fixed: Bools) -> Motion:
    """Return a motion whose parts that are held on all frames rest."""
    held = fixed[:, 3:].reshape(len(fixed), -1, 3).all(axis=(0, 2))
    return Motion(motion.translations, np.where(held[:, None, None], np.eye(3), motion.rotations))
