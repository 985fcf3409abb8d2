"""Limbs that leap and stay away are searched for around a path without the leap, also beside a key pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.shot import Settings
from kfmocap.core.tracking.solvers.descent_stages import SETTLED
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.limb_corrections import long_leaps as module
from kfmocap.core.tracking.solvers.limb_corrections.bridges import BRIDGING, evenly_led
from kfmocap.core.tracking.solvers.limb_corrections.leaping_limbs import with_leaps_bridged
from kfmocap.core.tracking.solvers.limb_corrections.long_leaps import abrupt_steps, leaps_farther, long_leaps
from made_evidence import Landscape
from synthetic import at_rest, ends_held

BODY, FRAMES, FPS = human(1.75), 30, 30.0
ARM = [BODY.index(f"{name}.L") for name in ("upper_arm", "forearm", "hand")]
PROBLEM = SegmentProblem(
    (), (BODY,), 0, FPS, (ends_held(BODY, FRAMES),), settings=Settings(joint_acceleration=300.0, root_acceleration=30.0)
)


def swinging(frames: int = FRAMES, fps: float = FPS) -> Motion:
    motion = at_rest(BODY, frames)
    turns = np.zeros((frames, 3))
    turns[:, 0] = 0.6 * np.sin(2 * np.pi * np.arange(frames) / fps)
    motion.rotations[:, ARM[0]] = motion.rotations[:, ARM[0]] @ rotations.exp(turns)
    return motion


TRUTH = swinging()


def away(shares: Sequence[float], angle: float = 1.5) -> Motion:
    """The forearm is turned by shares of an angle."""
    Q = TRUTH.rotations.copy()
    Q[:, ARM[1]] = Q[:, ARM[1]] @ rotations.exp(np.asarray(shares)[:, None] * np.array([0.0, 0.0, angle]))
    return Motion(TRUTH.translations, Q)


BESIDE_A_KEY = np.where(np.arange(FRAMES) == 0, 0.0, np.clip((26 - np.arange(FRAMES)) / 10, 0, 1))
"""A leap on the first frame after a key pose, and a slow return."""


def with_angle(angle: np.ndarray) -> Motion:
    motion = at_rest(BODY, FRAMES)
    turns = np.zeros((FRAMES, 3))
    turns[:, 0] = angle
    motion.rotations[:, ARM[0]] = motion.rotations[:, ARM[0]] @ rotations.exp(turns)
    return motion


def test_a_step_that_its_neighbours_do_not_resemble_is_abrupt_also_beside_a_key_pose() -> None:
    [step] = abrupt_steps(PROBLEM, 0, away(BESIDE_A_KEY), ARM)
    assert (step.before, step.after) == (0, 1)
    assert 0.2 < step.size < 0.5  # the forearm is 25 cm long
    [step] = abrupt_steps(PROBLEM, 0, away(np.arange(FRAMES) > 14), ARM)[:1]
    assert (step.before, step.after) == (14, 15)


def test_what_moves_on_and_what_is_stopped_has_no_abrupt_steps() -> None:
    f = np.arange(FRAMES)
    assert abrupt_steps(PROBLEM, 0, TRUTH, ARM) == []
    assert abrupt_steps(PROBLEM, 0, with_angle(0.2 * np.minimum(f, 12)), ARM) == []  # stopped from 3 m/s


def test_a_leap_that_smoothness_spreads_over_close_frames_is_one() -> None:
    fps, F = 120.0, 4 * FRAMES
    spread = np.clip((np.arange(F) - 40) / 4, 0, 1)
    Q = swinging(F, fps).rotations
    Q[:, ARM[1]] = Q[:, ARM[1]] @ rotations.exp(spread[:, None] * np.array([0.0, 0.0, 1.5]))
    problem = replace(PROBLEM, fps=fps, fixed=(ends_held(BODY, F),))
    [step] = abrupt_steps(problem, 0, Motion(np.zeros((F, 3)), Q), ARM)
    assert step.before <= 41 and step.after >= 43


def test_an_interval_runs_from_a_leap_to_the_next_one_or_to_a_held_frame() -> None:
    def intervals(motion: Motion, problem: SegmentProblem = PROBLEM) -> set[tuple[int, int]]:
        return {(leap.first, leap.last) for leap in long_leaps(problem, 0, motion) if set(leap.parts) == set(ARM)}

    f = np.arange(FRAMES)
    assert intervals(away(BESIDE_A_KEY)) == {(1, FRAMES - 2)}
    assert intervals(away((f > 5) & (f < 20))) == {(1, 5), (6, 19), (20, FRAMES - 2)}
    leaping_on, several = away(1.0 * (f == 14) - 0.6 * (f == 15)), replace(PROBLEM, bodies=(BODY, BODY))
    assert {(14, 14), (15, 15)} < intervals(leaping_on)
    assert intervals(leaping_on, several) == {(1, 13), (1, 14), (14, 15), (15, FRAMES - 2), (16, FRAMES - 2)}
    held = PROBLEM.fixed[0].copy()
    held[24, 3 + 3 * ARM[1] : 6 + 3 * ARM[1]] = True  # only the forearm
    assert intervals(away(BESIDE_A_KEY), replace(PROBLEM, fixed=(held,))) == {(1, 23)}


def test_a_limb_leaps_farther_where_its_abrupt_steps_are_larger() -> None:
    f, leg = np.arange(FRAMES), [BODY.index(f"{name}.L") for name in ("thigh", "shin", "foot")]
    there_and_back = (f > 9) & (f < 15)
    still, near, far = TRUTH, away(0.5 * there_and_back), away(there_and_back)
    assert leaps_farther(PROBLEM, 0, still, far, [leg, ARM]) and leaps_farther(PROBLEM, 0, near, far, [ARM])
    assert not leaps_farther(PROBLEM, 0, far, near, [ARM]) and not leaps_farther(PROBLEM, 0, far, far, [ARM])
    assert not leaps_farther(PROBLEM, 0, still, far, [leg])


@pytest.mark.parametrize("right", [True, False])
def test_what_the_search_finds_is_kept_only_where_the_pictures_are_likelier_with_it(
    right: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong, asked = away(BESIDE_A_KEY), list[tuple[SegmentProblem, Motion]]()

    def search(problem: SegmentProblem, motions: Sequence[Motion], _place: object, _seed: int) -> Motion:
        asked.append((problem, motions[0]))
        return TRUTH

    monkeypatch.setattr(module, "freed_limb", search)
    landscape = Landscape(truth=TRUTH if right else wrong)
    solution = landscape.solution(PROBLEM, wrong)
    found = with_leaps_bridged(PROBLEM, solution, landscape, long_only=True)
    assert np.abs(found.motions[0].difference(TRUTH if right else wrong)).max() < 0.05
    assert right or found.motions is solution.motions
    problem, around = asked[0]
    assert abrupt_steps(PROBLEM, 0, around, ARM) == []  # searched for around a path without the leap
    assert problem.fixed[0][[0, -1]].all() and not problem.fixed[0][1:-1].any()


def test_a_limb_found_again_from_a_path_without_the_leap_moves_that_fast(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = away(BESIDE_A_KEY)
    landscape = Landscape(truth=TRUTH)
    solution = landscape.solution(PROBLEM, wrong)
    monkeypatch.setattr(module, "freed_limb", lambda *_: wrong)
    assert with_leaps_bridged(PROBLEM, solution, landscape, long_only=True).motions is solution.motions


def test_a_limb_is_led_evenly_from_one_pose_that_holds_all_of_it_to_the_next() -> None:
    held = PROBLEM.fixed[0].copy()
    held[12, 3 + 3 * ARM[0] : 6 + 3 * ARM[2]] = True
    held[20, 3 + 3 * ARM[0] : 6 + 3 * ARM[0]] = True  # the upper arm alone
    wrong = away(BESIDE_A_KEY)
    led = evenly_led(replace(PROBLEM, fixed=(held,)), 0, wrong, ARM)
    np.testing.assert_array_equal(led.rotations[[0, 12, -1]], wrong.rotations[[0, 12, -1]])
    np.testing.assert_array_equal(led.rotations[20, ARM[0]], wrong.rotations[20, ARM[0]])
    turns = rotations.log(np.swapaxes(led.rotations[:12, ARM[1]], -1, -2) @ led.rotations[1:13, ARM[1]])
    np.testing.assert_allclose(turns, np.broadcast_to(turns[0], turns.shape), atol=1e-12)
    others = np.setdiff1d(np.arange(len(BODY)), ARM)
    np.testing.assert_array_equal(led.rotations[:, others], wrong.rotations[:, others])


def test_among_several_performers_what_is_found_is_solved_by_fine_steps_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The trunk is still where the lost limb has drawn it, and coarse steps lead the limb away again."""
    landscape, wrong, asked = Landscape(truth=TRUTH), away(BESIDE_A_KEY), list[object]()
    both = replace(PROBLEM, bodies=(BODY, BODY), fixed=PROBLEM.fixed * 2)
    monkeypatch.setattr(module, "freed_limb", lambda *_: TRUTH)

    def tried(_problem: object, _noise: object, best: SegmentSolution, *_: object, stages: object) -> SegmentSolution:
        asked.append(stages)
        return best

    monkeypatch.setattr(module, "likelier_after_change", tried)
    solution = landscape.solution(PROBLEM, wrong)
    for problem, motions in ((PROBLEM, [wrong]), (both.alone(0), [wrong, TRUTH])):
        module.with_long_leaps_bridged(problem, 0, replace(solution, motions=motions), None, landscape)
    assert asked == [BRIDGING, SETTLED]
