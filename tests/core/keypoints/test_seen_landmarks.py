"""How sure detectors are: only the differences within a shot count, unless they are sure of what they see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from keypoint_shots import NAMES, cameras, keypoints_of, seen_places, strolling
from kfmocap.core.body import human
from kfmocap.core.keypoints.seen_landmarks import with_usual_confidence, without_guesses

FEET = [i for i, name in enumerate(NAMES) if name[1:] in ("Ankle", "BigToe", "Heel")]


def test_a_detector_that_is_never_sure_shows_what_it_finds_all_the_same() -> None:
    """Feet out of sight are guessed, with a fraction of the confidence in all else."""
    seen = keypoints_of(cameras(3), seen_places(human(), strolling(human(), 10)), confidence=0.25)
    seen.confidence[:, :, FEET] = 0.05
    found = without_guesses(with_usual_confidence(seen)).confidence
    others = np.setdiff1d(np.arange(len(NAMES)), FEET)
    assert (found[:, :, others] > 0.6).all() and not found[:, :, FEET].any()


def test_confidence_of_a_detector_that_is_sure_stays_as_it_is() -> None:
    seen = keypoints_of(cameras(2), seen_places(human(), strolling(human(), 10)), confidence=0.8)
    seen.confidence[0] = 0.1
    np.testing.assert_array_equal(with_usual_confidence(seen).confidence, seen.confidence)


def test_no_keypoints_have_no_confidence() -> None:
    seen = keypoints_of(cameras(2), seen_places(human(), strolling(human(), 3)))
    none = replace(seen, confidence=np.zeros_like(seen.confidence))
    assert not with_usual_confidence(none).confidence.any()
