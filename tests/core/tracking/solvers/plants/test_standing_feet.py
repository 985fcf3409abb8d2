"""Feet that stand: they come to rest where the evidence lets them, and feet that creep are left alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.body import part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics.frame_ranges import runs
from kfmocap.core.retargeting.contacts import foot_paths
from kfmocap.core.retargeting.foot_clean_up import with_clean_feet
from kfmocap.core.shot.shot import KeyPoses
from kfmocap.core.tracking.solvers.descent_stages import DescentStage
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.plant_factor import PlantFactor
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.plants import plant_evidence, standing_feet
from kfmocap.core.tracking.solvers.plants.standing_feet import with_plants_at_rest, with_standing_feet
from kfmocap.core.tracking.solvers.protocol import SolvedFrames
from kfmocap.core.tracking.track_state import TrackState
from kfmocap.core.tracking.tracker import track
from made_evidence import no_evidence
from render.motions import MOTIONS
from standing_bodies import (
    BODY,
    EXACT,
    FIXED,
    FPS,
    FRAMES,
    SOLES,
    STEP,
    evidence,
    planted,
    problem_of,
    rested,
    soles_of,
    tracked,
)
from synthetic import CAMERAS, film, shot_of
from synthetic import at_rest as standing

Array = np.ndarray


def _walk_on_heels_and_toes() -> Motion:
    """A walk whose heels and tips of the toes stand while they are planted, and with them all of the sole."""
    rough = MOTIONS["walk"](BODY, FRAMES, FPS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(foot_paths, "BALL_SHARE", 1.0)
        return with_clean_feet(BODY, rough, FPS, KeyPoses.whole([], rough[:0]))


WALK = _walk_on_heels_and_toes()
CREEP = 0.1
"""Metres per second."""
SLOW = 0.05
"""The same, of a foot that stands if pictures say so."""
HEELS = np.array([name.startswith("heel") for name in SOLES.names])


def creeping(speed: float = CREEP) -> Motion:
    """The walk on ground that slides."""
    path = speed / FPS * np.arange(FRAMES)[:, None] * [1.0, 0.0, 0.0]
    return Motion(WALK.translations + path, WALK.rotations)


def settled(*motions: Motion) -> tuple[Motion, ...]:
    return rested(*motions).motions


def steps_of(motion: Motion, while_planted: Array) -> Array:
    steps = np.linalg.norm(np.diff(soles_of(motion), axis=0), axis=2)
    return np.asarray(steps[while_planted[1:] & while_planted[:-1]])


@pytest.fixture(scope="module")
def walks() -> list[tuple[Motion, Motion]]:
    """The walk as it was tracked, and with its feet at rest."""
    return [(motion, *settled(motion)) for motion in (tracked(WALK, seed) for seed in range(6))]


def test_the_feet_of_a_walk_stand(walks: list[tuple[Motion, Motion]]) -> None:
    """A planted point moves at most 2 mm from frame to frame and 10 mm over the whole plant."""
    for before, after in walks:
        stands = planted(WALK) & planted(after)
        assert steps_of(before, stands).max() > 0.005
        assert steps_of(after, stands).max() < 0.002
        for column, path in zip(stands.T, np.moveaxis(soles_of(after), 1, 0), strict=True):
            assert all(np.ptp(path[first : last + 1], axis=0).max() < 0.010 for first, last in runs(column))


def test_their_plants_are_found(walks: list[tuple[Motion, Motion]]) -> None:
    assert np.mean([planted(after) == planted(WALK) for _, after in walks]) > 0.95


def test_they_stand_nearer_to_where_they_stood(walks: list[tuple[Motion, Motion]]) -> None:
    errors = [
        [np.linalg.norm(soles_of(motion) - soles_of(WALK), axis=2)[planted(WALK)].mean() for motion in pair]
        for pair in walks
    ]
    before, after = np.mean(errors, axis=0)
    assert after < 0.9 * before


@pytest.mark.parametrize(("angle", "share"), [(0.005, 0.5), (0.1, 1.0)])
def test_the_rest_of_the_body_makes_half_of_a_short_step_that_is_left(angle: float, share: float) -> None:
    """To the least cost of the evidence without plants. An arm moves by millimetres, or by centimetres."""
    arm, inner = 3 + 3 * BODY.index("upper_arm.L"), np.arange(1, FRAMES - 1)
    wanted = np.zeros((FRAMES, BODY.dof))
    wanted[inner, arm] = angle * np.sin(np.pi * inner / (FRAMES - 1))
    sure = evidence()
    pull = (sure.diagonal @ wanted[..., None])[..., 0]
    pull[:-1] -= wanted[1:] / STEP**2
    pull[1:] -= wanted[:-1] / STEP**2
    problem, before = problem_of(BODY), SolvedFrames((WALK,))
    found = with_plants_at_rest(problem, [replace(sure, gradient=-pull)], (WALK,), before, ratios=[EXACT])
    assert found.planted[0] is not None and found.planted[0].any()
    turned = WALK.difference(found.motions[0])[:, arm]
    np.testing.assert_allclose(turned, share * wanted[:, arm], atol=0.02 * angle)


def found_heights(motion: Motion, keyed: bool) -> Array:
    """Heights of the soles once they stand, F x C, by evidence that leaves open a centimetre, with a key pose on the
    first frame that shows the floor or not.
    """
    sure, fixed = evidence(), FIXED & (np.arange(FRAMES) == 0)[:, None]
    vague = replace(sure, diagonal=sure.diagonal / 9, first=sure.first / 9)
    before = SolvedFrames((motion,), keyed=(np.array([0]),) if keyed else ())
    found = with_plants_at_rest(replace(problem_of(BODY), fixed=(fixed,)), [vague], (motion,), before, ratios=[EXACT])
    return soles_of(found.motions[0])[..., 2]


def test_they_stand_at_the_height_at_which_key_poses_have_them() -> None:
    """All of the body is tracked ever higher, up to 2 cm; the right foot stands on what the left one stood on."""
    high = 0.02 * np.sin(np.pi / 2 * np.arange(FRAMES) / (FRAMES - 1))[:, None] * [0.0, 0.0, 1.0]
    motion = Motion(WALK.translations + high, WALK.rotations)
    right = planted(WALK) & [name.endswith("R") for name in SOLES.names]
    without, with_floor = (
        np.abs(found_heights(motion, keyed) - soles_of(WALK)[..., 2])[right].mean() for keyed in (False, True)
    )
    assert without > 0.0025
    assert with_floor < 0.6 * without


def test_a_foot_that_stands_on_a_step_stays_there() -> None:
    """The whole body is lifted by 0.1 m after the key pose."""
    lifted = WALK.translations + 0.1 * (np.arange(FRAMES) > 4)[:, None] * [0.0, 0.0, 1.0]
    motion = Motion(lifted, WALK.rotations)
    np.testing.assert_array_equal(found_heights(motion, keyed=True), found_heights(motion, keyed=False))


def test_key_poses_stay(walks: list[tuple[Motion, Motion]]) -> None:
    for before, after in walks:
        assert np.array_equal(after.translations[[0, -1]], before.translations[[0, -1]])
        np.testing.assert_allclose(after.rotations[[0, -1]], before.rotations[[0, -1]], atol=1e-12)


def test_feet_that_creep_are_not_held() -> None:
    """They seem planted: so slow are also feet that stand, in motions that are not tracked as well."""
    for seed in range(6):
        motion = tracked(creeping(), seed)
        assert planted(motion).any(axis=0).all()
        [found] = settled(motion)
        assert found is motion


def test_a_plant_is_as_long_as_it_seems_before_the_refinement() -> None:
    """The left heel stands from the key pose on, but is tracked as if it were set down a frame later."""
    motion = tracked(WALK, 2)
    motion.translations[1:3, 2] += [0.006, 0.004]
    assert planted(WALK)[0, 0] and not planted(motion)[0, 0]
    steps = [
        np.linalg.norm(np.diff(soles_of(found)[:2, 0], axis=0))
        for before in (motion, WALK)
        for found in with_plants_at_rest(
            problem_of(BODY), [evidence()], (motion,), SolvedFrames((before,)), ratios=[EXACT]
        ).motions
    ]
    assert steps[0] > 0.004 and steps[1] < 0.001


def say(monkeypatch: pytest.MonkeyPatch, odds: float) -> None:
    """Have the pictures say with these log odds on each of a plant's frames that its point stands."""
    monkeypatch.setattr(plant_evidence, "log_odds_of_standing", lambda _view, _first, path: odds * len(path))


def held_heel(motion: Motion, before: Motion, ratio: float) -> Array:
    """When the left heel is held, by the motion before the refinement."""
    found = with_plants_at_rest(
        problem_of(BODY), [evidence()], (motion,), SolvedFrames((before,)), ratios=[ratio * EXACT]
    )
    return np.asarray(found.planted[0][:, 0])


@pytest.mark.parametrize("told", [True, False])
def test_a_plant_that_only_seems_one_before_the_refinement_is_tested_by_the_pictures(
    told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The left heel stands from the key pose on, but is tracked with a jitter in which it never seems to."""
    say(monkeypatch, 0.01 * told)
    motion = tracked(WALK, 2)
    last = runs(planted(WALK)[:, 0])[0][1]
    motion.translations[1 : last + 4, 2] += 0.03 * (np.arange(1, last + 4) % 4 > 1)
    assert planted(WALK)[: last + 1, 0].all() and not planted(motion)[1 : last + 4, 0].any()
    assert not held_heel(motion, motion, 100.0).any()
    held = held_heel(motion, WALK, 100.0)
    assert held[: last + 1].all() if told else not held.any()


@pytest.mark.parametrize("told", [True, False])
def test_a_plant_that_seems_too_long_to_pass_may_be_as_long_as_before_the_refinement(
    told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A foot that stands for half a second glides on, so slowly that it seems to stand."""
    say(monkeypatch, 0.01 * told)
    at_rest = standing(BODY, FRAMES)
    glide = np.cumsum(np.clip(np.arange(FRAMES) - 15, 0, 4) / 4)[:, None] * [1.0 / FPS, 0.0, 0.0]
    slow, quick = (Motion(at_rest.translations + speed * glide, at_rest.rotations) for speed in (SLOW, 1.0))
    assert planted(slow)[:, 0].all()
    assert planted(quick)[:15, 0].all() and not planted(quick)[18:, 0].any()
    assert not held_heel(slow, slow, 1.0).any()
    held = held_heel(slow, quick, 1.0)
    assert held[:16].all() and not held[-1] if told else not held.any()


@pytest.mark.parametrize("odds", [0.0, -0.2])
def test_a_plant_ends_before_a_step_on_which_the_point_clearly_moves_if_pictures_let_it(
    odds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The feet seem to stand until they have left by 3 cm."""
    say(monkeypatch, odds)
    seeming = np.tile(np.arange(FRAMES)[:, None] < 17, 4)
    monkeypatch.setattr(type(SOLES), "planted", lambda *_: seeming)
    way = (0.03 * (np.arange(FRAMES) > 15) + 0.1 * (np.arange(FRAMES) > 16))[:, None] * [1.0, 0.0, 0.0]
    motion = Motion(standing(BODY, FRAMES).translations + way, standing(BODY, FRAMES).rotations)
    held = held_heel(motion, motion, 1.0)
    assert held.tolist() == [f < 16 and odds == 0 for f in range(FRAMES)]


@pytest.mark.parametrize(("step", "clear"), [(0.01, 0.5), (0.01, 0.0), (0.006, 5.0), (0.006, 0.1)])
def test_a_long_plant_ends_where_evidence_and_pictures_have_the_point_leave(
    step: float, clear: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A foot that stands for half a second seems to, too, while it leaves by some millimetres a frame; as a whole,
    pictures show it standing. The smaller its steps, the more clearly pictures must show it leave.
    """
    seeming = np.tile(np.arange(FRAMES)[:, None] < 21, 4)
    monkeypatch.setattr(type(SOLES), "planted", lambda *_: seeming)
    way = step * np.clip(np.arange(FRAMES) - 17, 0, None)[:, None] * [1.0, 0.0, 0.0]
    motion = Motion(standing(BODY, FRAMES).translations + way, standing(BODY, FRAMES).rotations)

    def odds(_view: object, _first: int, path: Array) -> float:
        """Say that a point stands, but not once it has left."""
        left = np.linalg.norm(path - path[0], axis=1) > step / 2
        return float(np.where(left & (clear > 0), -clear, 1.0).sum())

    monkeypatch.setattr(plant_evidence, "log_odds_of_standing", odds)
    held = held_heel(motion, motion, 1.0)
    leaves = step * clear > 0.004
    assert held.tolist() == [f < (18 if leaves else 21) for f in range(FRAMES)]


def test_a_plant_takes_in_the_frames_beside_it_on_which_the_point_may_stand_by_the_evidence() -> None:
    """The heel that is tracked as if it were set down a frame later is held from the key pose on where the shot shows
    errors of that size.
    """
    motion = tracked(WALK, 2)
    motion.translations[1:3, 2] += [0.006, 0.004]
    steps, held = [], []
    for ratio in (10.0, 1.0):
        found = with_plants_at_rest(
            problem_of(BODY), [evidence()], (motion,), SolvedFrames((motion,)), ratios=[ratio * EXACT]
        )
        steps.append(np.linalg.norm(np.diff(soles_of(found.motions[0])[:2, 0], axis=0)))
        held.append(found.planted[0][0, 0])
    assert held == [True, False]
    assert steps[0] < 0.001 and steps[1] > 0.004


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("twice", [False, True])
def test_a_point_that_flickers_stands_on_with_the_other_one_if_the_pictures_say_so(
    told: bool, twice: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The ball of a foot jitters by some millimetres for half of its plant, while the heel stands, or seems to
    stand twice.
    """
    rest = standing(BODY, FRAMES)
    turns = np.zeros((FRAMES, BODY.dof))
    turns[(np.arange(FRAMES) > 14) & (np.arange(FRAMES) % 4 > 1), 3 + 3 * BODY.index("foot.L")] = 0.1
    turns[-1] = 0
    motion = tracked(rest, 1).moved(turns)
    heel, ball = soles_of(motion)[:, 0], soles_of(motion)[:, 1]
    assert np.linalg.norm(np.diff(ball - heel, axis=0), axis=1).max() > 0.008
    apparent = planted(motion)
    assert apparent[:, 0].all() and not apparent[:, 1].all()
    apparent[20, 0] = not twice
    monkeypatch.setattr(type(SOLES), "planted", lambda *_: apparent)

    def odds(_view: object, _first: int, path: Array) -> float:
        """Say that a point stands, on each of a plant's frames, or nothing."""
        return 0.2 * len(path) if told else 0.0

    monkeypatch.setattr(plant_evidence, "log_odds_of_standing", odds)
    assert rested(motion).planted[0][:, 1].all() == told


@pytest.mark.parametrize(("odds", "gain", "held"), [(0.5, 0.3, True), (0.5, 5.0, False), (0.0, 0.3, False)])
def test_pictures_make_a_plant_longer_where_they_show_the_point_in_its_place(
    odds: float, gain: float, held: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A foot that stands is tracked 16 mm aside on two frames: farther than the evidence leaves open."""
    motion = tracked(standing(BODY, FRAMES), 1)
    motion.translations[1:3, 0] += 0.016
    monkeypatch.setattr(plant_evidence, "log_odds_of_standing", lambda _view, _first, path: odds * len(path))

    def gains(_view: object, _first: int, _place: Array, stood: Array) -> Array:
        return np.where(stood, 0.0, gain)

    monkeypatch.setattr(plant_evidence, "log_gain_by_displacement", gains)
    found = rested(motion).planted[0]
    assert found[4:, 0].all() and found[:3, 0].all() == held


def test_the_segments_beside_show_whether_a_foot_that_pauses_stands() -> None:
    """Still for 3 frames at the end of a segment, at 120 frames per second: too briefly, unless it stands on."""
    fps, around = 120.0, 2 * FRAMES
    problem, shares = replace(problem_of(BODY), fps=fps), []
    for still in (4, 16):
        speed = np.where((np.arange(around) > FRAMES - 5) & (np.arange(around) < FRAMES - 1 + still), 0.0, 1.0)
        glides = standing(BODY, around)
        glides = Motion(glides.translations + np.cumsum(speed / fps)[:, None] * [1.0, 0.0, 0.0], glides.rotations)
        for known in (glides[:FRAMES], glides):
            found = with_plants_at_rest(
                problem, [evidence()], (glides[:FRAMES],), SolvedFrames((known,)), ratios=[EXACT]
            )
            shares.append(found.planted[0][-2:].mean())
    assert shares == [0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize("told", [True, False])
def test_a_foot_that_stands_briefly_where_the_shot_ends_is_held_if_the_pictures_say_so(
    told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may stand on. In the middle of the shot it would have left, and is not held."""
    say(monkeypatch, 0.01 * told)
    problem, helds = replace(problem_of(BODY), fps=120.0), []
    for first in (FRAMES - 5, 12):
        speed = np.where((np.arange(FRAMES) > first) & (np.arange(FRAMES) < first + 5), 0.0, 1.0)
        glides = standing(BODY, FRAMES)
        glides = Motion(glides.translations + np.cumsum(speed / 120.0)[:, None] * [1.0, 0.0, 0.0], glides.rotations)
        frames = SolvedFrames((glides,))
        helds.append(with_plants_at_rest(problem, [evidence()], (glides,), frames, ratios=[EXACT]).planted[0])
    assert helds[0][-4:].all() == told and not helds[0][: FRAMES - 6].any()
    assert not helds[1].any()


@pytest.mark.parametrize(
    ("segment", "solved", "known"),
    [((10, 20), 31, (0, 30)), ((10, 20), 21, (0, 20)), ((0, 10), 31, (0, 20)), ((20, 30), 31, (10, 30))],
)
def test_what_is_known_beside_a_segment_are_the_segments_next_to_it_that_are_solved(
    segment: tuple[int, int], solved: int, known: tuple[int, int]
) -> None:
    keys = np.array([0, 10, 15, 20, 30])
    found = TrackState((WALK,), solved=solved).beside(segment, [(0, 10), (10, 20), (20, 30)], [keys])
    assert found.first == segment[0] - known[0]
    assert [known[0] + frame for frame in found.keyed[0]] == [k for k in keys if known[0] <= k <= known[1]]
    assert np.array_equal(found.motions[0].translations, WALK.translations[known[0] : known[1] + 1])


def test_held_plants_are_returned_and_creeping_feet_are_not() -> None:
    found = [rested(tracked(WALK, seed)) for seed in range(6)]
    assert np.mean([stands.planted[0] == planted(WALK) for stands in found]) > 0.9
    for stands in found:
        [motion], [held] = stands.motions, stands.planted
        assert steps_of(motion, held & HEELS).max() < 0.001  # heels; the balls are held where the feet roll
        assert steps_of(motion, SOLES.standing(held, part_poses(BODY, motion), FPS)).max() < 0.002
    creeps = rested(tracked(creeping(), 1))
    assert planted(creeps.motions[0]).mean() > 0.3 and not creeps.planted[0].any()


def test_feet_stand_where_the_shot_shows_larger_errors_than_the_evidence_predicts() -> None:
    """Half as large again, such as where feet are half hidden."""
    motion = WALK.moved(1.5 * WALK.difference(tracked(WALK, 2)))
    shares = [
        with_plants_at_rest(
            problem_of(BODY), [evidence()], (motion,), SolvedFrames((motion,)), ratios=[ratio * EXACT]
        ).planted[0][planted(WALK)]
        for ratio in (1.0, 4.0)
    ]
    assert shares[0].mean() < 0.5 < 0.9 < shares[1].mean()


def test_no_ratio_lets_a_foot_stand_that_key_poses_have_in_two_places() -> None:
    """Both ends of its plant are held, 3 cm apart: whatever the evidence says, it moves between them."""
    path = np.linspace(0.0, 0.03, FRAMES)[:, None] * [1.0, 0.0, 0.0]
    still = standing(BODY, FRAMES)
    crept = Motion(still.translations + path, still.rotations)
    found = with_plants_at_rest(problem_of(BODY), [evidence()], (crept,), SolvedFrames((crept,)), ratios=[100 * EXACT])
    assert planted(crept).all() and not found.planted[0].any()


def test_feet_that_stand_between_key_poses_on_neighbouring_frames_are_planted() -> None:
    """There is nothing to hold, and the motion stays."""
    fixed = np.ones_like(FIXED)
    keyed = replace(problem_of(BODY), fixed=(fixed,))
    found = with_plants_at_rest(keyed, [evidence()], (WALK,), SolvedFrames((WALK,)), ratios=[EXACT])
    assert found.motions[0] is WALK
    assert np.array_equal(found.planted[0], planted(WALK))


def test_each_performer_stands_alone() -> None:
    stands, creeps = tracked(WALK, 1), tracked(creeping(), 1)
    beside = settled(creeps, stands)
    [alone] = settled(stands)
    assert beside[0] is creeps
    np.testing.assert_allclose(beside[1].translations, alone.translations, atol=1e-4)
    np.testing.assert_allclose(beside[1].rotations, alone.rotations, atol=1e-4)


def test_the_plants_of_all_segments_are_those_of_the_shot(tmp_path: Path) -> None:
    """Somebody who only turns their head, with a key pose in the middle."""
    turns = np.zeros((7, BODY.dof))
    turns[:, 3 + 3 * BODY.index("head") + 2] = np.linspace(0.0, 0.3, 7)
    truth = standing(BODY, 7).moved(turns)
    shot = shot_of(film(tmp_path, [BODY], [truth], CAMERAS), [BODY], [truth], (0, 3, 6))
    assert track(shot).planted[0].all()
    assert track(replace(shot, settings=replace(shot.settings, plants=False))).planted == (None,)


@pytest.mark.parametrize("case", ["settings", "one view"])
def test_feet_stay_without_plants_in_the_settings_and_in_one_view(case: str) -> None:
    """One view alone hardly contradicts a plant."""
    motion, problem = tracked(WALK, 0), problem_of(BODY, plants=case != "settings")
    problem = replace(problem, views=problem.views[: 1 if case == "one view" else 2])
    evidence_there = no_evidence(len(problem.views), FRAMES, len(BODY))
    solution = SegmentSolution.of([motion], evidence_there, iterations=1, energy=[0.0])
    found = with_standing_feet(problem, solution, [], SolvedFrames((motion,)), [EXACT], workspace=Workspace())
    assert found.motions[0] is motion
    assert found.planted == (None,)


@pytest.mark.parametrize(
    ("speed", "odds", "held"), [(SLOW, 5.0, True), (SLOW, 0.0, False), (CREEP, 5.0, False), (0.0, -500.0, False)]
)
def test_pictures_overrule_the_evidence_where_it_may_be_wrong_but_not_key_poses(
    speed: float, odds: float, held: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Clear pictures of both views let a foot stand that creeps slowly by the evidence, and release one that stands."""
    monkeypatch.setattr(plant_evidence, "log_odds_of_standing", lambda *_: odds)
    motion = tracked(creeping(speed), 1)
    stands = rested(motion).planted[0][planted(motion)].mean()
    assert (stands > 0.6) == held
    path = np.linspace(0.0, 0.03, FRAMES)[:, None] * [1.0, 0.0, 0.0]
    still = standing(BODY, FRAMES)
    crept = Motion(still.translations + path, still.rotations)
    assert not rested(crept).planted[0].any()


@pytest.mark.parametrize(("jump", "is_one"), [(0.018, True), (0.05, False)])
def test_a_foot_that_stands_does_not_jump_aside_and_stand_again(jump: float, is_one: bool) -> None:
    """A plant that a jump of the solution divides is held as one, or on one side of the jump if the jump is too far."""
    first, last = max(runs(planted(WALK)[:, 0]), key=np.ptp)
    middle = (first + last) // 2
    shift = np.zeros((FRAMES, BODY.dof))
    shift[middle + 1 : -1, 0] = jump
    divided = tracked(WALK, 1).moved(shift)
    assert len(runs(planted(divided)[first : last + 1, 0])) == 2
    unsure, frames = [4 * EXACT], SolvedFrames((divided,))
    found = with_plants_at_rest(problem_of(BODY), [evidence()], (divided,), frames, ratios=unsure)
    [held] = found.planted
    assert held is not None and held[first : last + 1, 0].any()
    assert bool(held[middle : middle + 2, 0].all()) == is_one
    assert steps_of(found.motions[0], held).max() < 0.002


@pytest.mark.parametrize(
    ("aside", "is_long", "is_polished"), [(0.002, False, False), (0.1, False, True), (0.1, True, False)]
)
def test_what_plants_move_farther_than_the_normal_equations_hold_is_polished_with_them(
    aside: float, is_long: bool, is_polished: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Feet of two performers that stand are tracked as if they slid, so that they are put back; not in a long segment,
    whose evidence is large. The images are sampled as for the solution: a correction's has fewer pixels.
    """
    asked: list[tuple[Motion, ...]] = []
    none = no_evidence(len(CAMERAS), FRAMES, 2 * len(BODY))

    def polish(
        _problem: SegmentProblem,
        start: tuple[Motion, ...],
        _workspace: Workspace,
        stages: Sequence[DescentStage],
        plants: Sequence[PlantFactor | None],
    ) -> SegmentSolution:
        assert all(plant is not None and plant.steps.any() for plant in plants)
        assert [stage.sampling_of(4) for stage in stages] == [none.sampling] and not stages[-1].plants
        asked.append(start)
        return SegmentSolution.of([WALK, WALK], none, iterations=1, energy=[0.0])

    monkeypatch.setattr(standing_feet, "descend", polish)
    monkeypatch.setattr(standing_feet, "can_be_parted", lambda _: is_long)
    rest = standing(BODY, FRAMES)
    swing = aside * np.sin(np.linspace(0, np.pi, FRAMES))[:, None] * [1.0, 0.0, 0.0]
    seeming = np.ones((FRAMES, 4), bool)
    monkeypatch.setattr(type(SOLES), "planted", lambda *_: seeming)
    motion = Motion(rest.translations + swing, rest.rotations)
    solution = SegmentSolution.of([motion, motion], none, iterations=1, energy=[0.0])
    found = with_standing_feet(
        problem_of(BODY, BODY),
        solution,
        [evidence()] * 2,
        SolvedFrames(solution.motions),
        [1e4 * EXACT] * 2,
        workspace=Workspace(),
    )
    assert all(planted is not None and planted.all() for planted in found.planted)
    assert len(asked) == is_polished and (found.motions[0] is WALK) == is_polished
