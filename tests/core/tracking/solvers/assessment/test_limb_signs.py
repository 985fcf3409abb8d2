"""Signs that a limb is lost: it turns away at a key pose, or the images speak less for it, or against it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from kfmocap.core.body.limbs import limbs
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.solvers.assessment.limb_signs import (
    bend_of,
    bent_limbs,
    faded_limbs,
    refuted_limbs,
    unshown_limbs,
    weakly_shown_limbs,
)
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from kfmocap.core.tracking.solvers.limb_evidence.limb_likelihood import MIN_GAIN
from kfmocap.core.tracking.solvers.limb_evidence.limb_support import SupportOfLimb
from swinging_arm import ARM, BODY, FPS, FRAMES, TRUTH, WHOLE, astray
from synthetic import ends_held

Array = np.ndarray
LIMBS = limbs(BODY)


def held(performers: int) -> SegmentProblem:
    return SegmentProblem((), (BODY,) * performers, 0, FPS, (ends_held(BODY, FRAMES),) * performers)


ALONE = replace(held(1), before=(WHOLE[:1],), after=(WHOLE[-1:],))


def supported(problem: SegmentProblem, of: dict[tuple[int, int], Array]) -> Iterator[SupportOfLimb]:
    """Support of all limbs: of some by performer and number of the limb, of all others full."""
    for i in problem.sought:
        for k, chain in enumerate(LIMBS):
            yield i, chain, np.zeros(FRAMES), partial(of.get, (i, k), np.full(FRAMES, 60.0))


def shown(share: float, first: int, last: int) -> Array:
    """Support that is lower on some frames."""
    found = np.full(FRAMES, 60.0)
    found[first : last + 1] *= share
    return found


def test_a_limb_that_turns_away_at_a_key_pose_is_bent_and_no_other() -> None:
    assert bent_limbs(ALONE, 0, astray()) == [ARM]
    assert bent_limbs(ALONE, 0, TRUTH) == []


def test_nothing_is_bent_where_no_motion_is_known_beside_the_segment() -> None:
    assert bent_limbs(replace(ALONE, before=None, after=None), 0, astray()) == []


@pytest.mark.filterwarnings("error")
def test_between_key_poses_next_to_each_other_what_counts_as_bent_is_the_error_of_a_key_pose() -> None:
    """No frame there shows how the limb moves otherwise."""
    short = replace(ALONE, fixed=(ends_held(BODY, 3),), after=(WHOLE[4:5],))
    assert bend_of(short, 0, TRUTH[:3], ARM) < 1
    assert bend_of(short, 0, astray()[:3], ARM) > 1


def test_who_moves_as_suddenly_between_the_key_poses_may_do_so_at_one() -> None:
    """Blows follow one another: one of them begins at a key pose."""
    jerky = TRUTH.rotations.copy()
    turns = np.zeros((FRAMES, 3))
    turns[1:-1, 0] = 0.5 * (np.arange(FRAMES - 2) // 2 % 2)
    jerky[:, ARM[0]] = jerky[:, ARM[0]] @ rotations.exp(turns)
    assert bend_of(ALONE, 0, Motion(TRUTH.translations, jerky), ARM) < 1


@pytest.mark.parametrize(("against", "pixels", "expected"), [(2, 90, False), (2, 70, True), (0.5, 70, False)])
def test_sides_refute_a_limb_that_its_pixels_show_less_than_on_the_key_poses(
    against: float, pixels: float, expected: bool
) -> None:
    """How sides look is learned on few key poses: over many frames the error of that adds up."""
    between = np.arange(FRAMES) % (FRAMES - 1) > 0
    sides = np.where(between, -against * MIN_GAIN / between.sum(), 1.0)
    support = sides + np.where(between, pixels, 100.0)
    assert bool(refuted_limbs(ALONE, [(0, ARM, sides, lambda: support)])) == expected


@pytest.mark.parametrize(
    ("support", "fades"),
    [
        (shown(0.3, 4, 7), True),
        (shown(-0.5, 4, 6), True),
        (shown(0.3, 4, 5), False),
        (shown(0.7, 2, 9), False),
        (np.full(FRAMES, 5.0), False),
    ],
)
def test_a_limb_has_faded_whose_support_falls_for_more_than_a_moment(support: Array, fades: bool) -> None:
    """One that is little seen all the time has not."""
    problem = held(2)
    assert faded_limbs(problem, supported(problem, {(1, 0): support})) == ([(1, LIMBS[0])] if fades else [])


def test_the_limb_that_has_faded_most_comes_first() -> None:
    problem = held(2)
    support = supported(problem, {(0, 0): shown(0.3, 4, 7), (0, 1): shown(0.4, 5, 9), (1, 0): shown(-0.2, 5, 8)})
    assert faded_limbs(problem, support) == [(1, LIMBS[0]), (0, LIMBS[0]), (0, LIMBS[1])]


@pytest.mark.parametrize(
    ("support", "weak"),
    [
        (shown(1.0, 0, 0), False),
        (shown(0.6, 5, 7), True),
        (shown(0.6, 6, 6), False),  # a moment
        (shown(0.8, 3, 9), False),  # shown a little less
        (shown(0.5, 1, FRAMES - 2), True),  # lost nearly all the time: its median is low, too
        (shown(0.1, 0, FRAMES), False),  # hardly seen on the key poses either
    ],
)
def test_a_limb_is_weak_where_its_support_falls_below_that_of_the_key_poses(support: Array, weak: bool) -> None:
    problem = held(1)
    assert weakly_shown_limbs(problem, supported(problem, {(0, 1): support})) == ([(0, LIMBS[1])] if weak else [])


def test_a_limb_that_images_do_not_show_on_its_key_poses_is_unshown() -> None:
    """Its sleeve looks like the wall. What they show between the key poses does not count."""
    two, like_the_wall, well = held(2), shown(-0.1, 0, FRAMES - 1), shown(0.0, 1, FRAMES - 2)
    assert unshown_limbs(two, supported(two, {(1, 2): like_the_wall, (0, 0): well})) == [(1, LIMBS[2])]


def test_without_key_poses_no_limb_is_unshown() -> None:
    free = replace(held(1), fixed=(np.zeros_like(held(1).fixed[0]),))
    assert unshown_limbs(free, supported(free, {(0, 1): np.full(FRAMES, -1.0)})) == []
