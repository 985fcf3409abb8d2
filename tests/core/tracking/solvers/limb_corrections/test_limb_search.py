"""Lost limbs are found by what the model leaves uncovered, and like limbs are told apart by their motion."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from kfmocap.core.body import human, landmark_positions, part_poses
from kfmocap.core.body.limbs import limb_pairs, limbs
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.shoulder_rhythm import shoulder_rhythms
from kfmocap.core.errors import CancelledError
from kfmocap.core.evidence.foreground_images.foreground import LEVELS_PER_UNIT
from kfmocap.core.evidence.rendering.label_images import DEPTH_STEP, NEAR_PLANE, render_labels
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.settings import Settings
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from kfmocap.core.tracking.solvers.limb_corrections import limb_search
from kfmocap.core.tracking.solvers.limb_corrections.limb_search import _seen_shares, found_limbs
from kfmocap.core.tracking.solvers.limb_corrections.swapped_limbs import (
    exchanges,
    swaps,
    untangled,
    with_places_exchanged,
)
from kfmocap.core.tracking.solvers.limb_evidence.limb_images import UncoveredImages, ViewRatios, search_stride
from kfmocap.core.tracking.solvers.limb_evidence.limb_likelihood import PATCH_RADIUS, pixel_log_ratios
from kfmocap.core.tracking.solvers.limb_evidence.limb_model import LimbModel, limb_of
from synthetic import at_rest, coloured, ends_held, look_at, poses_of, silhouette

Array = np.ndarray
BODY = human(1.75)
LENGTH, FPS = 13, 15.0
CAMERA = look_at("side", (4.0, 0.3, 1.1), (0, 0, 0.95), size=(120, 160), focal=150.0)
FRONT = look_at("front", (0.3, -4.0, 1.1), (0, 0, 0.95), size=(120, 160), focal=150.0)


def walk(length: int = LENGTH, fps: float = FPS) -> Motion:
    """Legs and hanging arms that swing against each other, once to and fro in a second."""
    motion = at_rest(BODY, length)
    Q = motion.rotations.copy()
    for side, turn in (("L", -1.4), ("R", 1.4)):
        Q[:, BODY.index(f"upper_arm.{side}")] = rotations.exp(np.array([0, 0, turn]))
    phase = np.sin(2 * np.pi * (np.arange(length) / fps + 0.1))
    for name, size in (("thigh.L", 0.5), ("thigh.R", -0.5), ("upper_arm.L", -0.6), ("upper_arm.R", 0.6)):
        turn = np.zeros((length, 3))
        turn[:, 0] = size * phase
        part = BODY.index(name)
        Q[:, part] = Q[:, part] @ rotations.exp(turn)
    return Motion(motion.translations, Q)


def seen(motion: Motion) -> ViewFrames:
    poses = poses_of([BODY], [motion])
    images = np.stack([silhouette([BODY], poses, f, CAMERA, samples=1) for f in range(len(motion))])
    return ViewFrames(CAMERA, np.zeros_like(images), 0, images[None])


def problem_of(motion: Motion, *views: ViewFrames) -> SegmentProblem:
    return SegmentProblem(views, (BODY,), 0, FPS, (ends_held(BODY, len(motion)),))


def error_mm(found: Motion, truth: Motion, name: str) -> Array:
    a, b = (landmark_positions(BODY, motion, [name])[:, 0] for motion in (found, truth))
    return 1000 * np.linalg.norm(a - b, axis=-1)


def turned(motion: Motion, name: str, angle: float) -> Motion:
    """A part turned about its x axis, most in the middle of the motion and not at its ends."""
    Q, turn = motion.rotations.copy(), np.zeros((len(motion), 3))
    turn[:, 0] = angle * np.sin(np.linspace(0, np.pi, len(motion)))
    Q[:, BODY.index(name)] = Q[:, BODY.index(name)] @ rotations.exp(turn)
    return Motion(motion.translations, Q)


def exchanged(motion: Motion, pair: tuple[list[int], list[int]], frames: slice | Array) -> Motion:
    """A motion whose like limbs are each where the other is on some frames."""
    R, _ = part_poses(BODY, motion)
    Q = motion.rotations.copy()
    for chain, other in (pair, pair[::-1]):
        parent = R[:, BODY.parents[chain[0]]]
        for part, like in zip(chain, other, strict=True):
            Q[frames, part] = (np.swapaxes(parent @ BODY.R_parent_rest[part], -1, -2) @ R[:, like])[frames]
            parent = R[:, like]
    return Motion(motion.translations, Q)


def test_an_arm_half_a_metre_away_is_found() -> None:
    truth = walk()
    lost = turned(truth, "upper_arm.L", -1.0)
    (found,) = found_limbs(problem_of(truth, seen(truth)), [lost], seed=0, workspace=Workspace())
    assert error_mm(lost, truth, "LWrist").max() > 400
    assert np.median(error_mm(found, truth, "LWrist")) < 0.4 * np.median(error_mm(lost, truth, "LWrist"))


def jumping_jack(length: int = 15) -> tuple[Motion, Motion]:
    """Arms that hang on the first and the last frame and are overhead between them, on collar bones that rise with
    them; and the same motion with arms that hang all the time.
    """
    hanging = at_rest(BODY, length)
    for side, turn in (("L", -1.4), ("R", 1.4)):
        hanging.rotations[:, BODY.index(f"upper_arm.{side}")] = rotations.exp(np.array([0, 0, turn]))
    Q = hanging.rotations.copy()
    up = np.sin(np.linspace(0, np.pi, length)) ** 2
    for shoulder in shoulder_rhythms(BODY):
        sign = 1 if BODY.names[shoulder.arm].endswith("L") else -1
        Q[:, shoulder.arm] = Q[:, shoulder.arm] @ rotations.exp(np.outer(2.5 * sign * up, [0, 0, 1]))
        Q[:, shoulder.collar] = Q[:, shoulder.collar] @ rotations.exp(0.36 * up[:, None] * shoulder.raising)
    return Motion(hanging.translations, Q), hanging


@pytest.mark.parametrize("seed", range(3))
def test_thin_arms_are_found_overhead_between_key_poses_on_which_they_hang(seed: int) -> None:
    truth, hanging = jumping_jack()
    far = [replace(camera, matrix=camera.matrix * [[0.6], [0.6], [1.0]]) for camera in (CAMERA, FRONT)]
    problem = replace(problem_of(truth, *coloured(BODY, truth, far)), fps=30.0)
    (found,) = found_limbs(problem, [hanging], seed=seed, workspace=Workspace())
    for wrist, shoulder in (("LWrist", "LShoulder"), ("RWrist", "RShoulder")):
        assert error_mm(hanging, truth, wrist).max() > 900
        assert np.median(error_mm(found, truth, wrist)) < 60
        assert error_mm(found, truth, shoulder).max() < 0.5 * error_mm(hanging, truth, shoulder).max()


def test_an_arm_that_swings_all_the_way_round_is_found() -> None:
    _, hanging = jumping_jack(22)
    arm, turn = BODY.index("upper_arm.L"), 2 * np.pi * np.linspace(0, 1, 22)
    Q = hanging.rotations.copy()
    Q[:, arm] = rotations.exp(np.outer(-turn, [0, 1, 0])) @ Q[:, arm]  # about the line through both shoulders
    truth = Motion(hanging.translations, Q)
    problem = replace(problem_of(truth, *coloured(BODY, truth, (CAMERA, FRONT))), fps=24.0)
    (found,) = found_limbs(problem, [hanging], seed=0, workspace=Workspace())
    assert error_mm(hanging, truth, "LWrist").max() > 900
    assert error_mm(found, truth, "LWrist").max() < 200


def test_the_smaller_a_performer_is_in_the_picture_the_more_of_its_pixels_are_searched() -> None:
    truth = walk(3)

    def stride(focal: float) -> int:
        camera = look_at("side", (4.0, 0.3, 1.1), (0, 0, 0.95), size=(120, 160), focal=focal)
        view = ViewFrames(camera, np.zeros((3, 120, 160), np.uint8), 0, np.zeros((1, 3, 120, 160), np.uint8))
        return search_stride(view, problem_of(truth, view), 0, [truth])

    assert [stride(focal) for focal in (100.0, 350.0, 600.0, 5000.0)] == [1, 2, 3, 3]


def test_another_seed_of_the_shot_draws_other_poses() -> None:
    truth = walk()
    lost, problem = turned(truth, "upper_arm.L", -1.0), problem_of(truth, seen(truth))
    found = [
        found_limbs(replace(problem, settings=Settings(search_seed=seed)), [lost], seed=0, workspace=Workspace())[0]
        for seed in (0, 0, 1)
    ]
    np.testing.assert_array_equal(found[0].rotations, found[1].rotations)
    assert np.abs(found[0].difference(found[2])).max() > 1e-3


def test_a_limb_is_held_the_less_the_more_of_it_another_view_sees_on_the_background() -> None:
    truth = walk(3)
    views = coloured(BODY, truth, (CAMERA, FRONT))
    empty = replace(views[1], foreground=np.full_like(views[1].foreground, 4))
    left = [BODY.index(f"{name}.L") for name in ("upper_arm", "forearm")]
    geometry, poses = Geometry.of([BODY]), poses_of([BODY], [truth])

    def looks(*views: ViewFrames) -> list[ViewRatios]:
        return [ViewRatios.of(view, problem_of(truth, *views), 0, [truth]) for view in views]

    def held(*views: ViewFrames) -> Array:
        return _seen_shares(looks(*views), geometry, poses, left)

    assert held(views[0]).min() > 0.4 and held(*views).min() > 0.4
    seen = render_labels(geometry, looks(views[1])[0].camera, 0, *poses).share[:, left]
    assert seen.min() > 0.4
    np.testing.assert_allclose(held(views[0], empty), held(views[0]) * (1 - seen), atol=1e-6)


def test_points_show_the_pixel_nearest_to_them_and_nothing_beyond_the_picture_or_behind_others() -> None:
    rng = np.random.default_rng(2)
    images = rng.integers(4, 253, (2, 5, *CAMERA.size[::-1]), np.uint8)
    depth = rng.integers(1500, 2500, images.shape[1:], np.uint16)
    points = rng.normal((0.3, 0.0, 1.0), (2.0, 1.0, 1.5), size=(3, 200, 4, 3))
    world = np.moveaxis(points, -1, 1).astype(np.float32)
    R, t = CAMERA.pose(0)
    x = points @ R.T + t
    far = x[..., 2]
    x = x @ CAMERA.matrix.T
    column, row = np.rint(x[..., :2] / np.maximum(x[..., 2:], NEAR_PLANE)).astype(int).transpose(3, 0, 1, 2)
    inside = (column >= 0) & (column < CAMERA.size[0]) & (row >= 0) & (row < CAMERA.size[1])
    frame = np.broadcast_to(np.arange(1, 4)[:, None, None], inside.shape)
    assert 0.2 < inside.mean() < 0.8
    for part, others in product((0, 1), (None, depth)):
        expected, place = np.zeros(inside.shape), (frame[inside], row[inside], column[inside])
        expected[inside] = (images[part][place] - 128.0) / LEVELS_PER_UNIT
        if others is not None:
            expected[inside] *= far[inside] < others[place] * DEPTH_STEP
        found = UncoveredImages(CAMERA, 0, tuple(images), others, None).at(part, slice(1, 4), world)
        np.testing.assert_allclose(found, expected.mean(axis=-1), atol=1e-5)


@pytest.mark.parametrize(("bend", "swing"), [(0.0, 0.0), (0.0, 1.4), (2.4, 0.0), (2.4, 1.0), (1.5, 0.7)])
def test_a_limb_counts_by_what_it_covers_even_where_it_points_at_the_camera_or_is_folded(
    bend: float, swing: float
) -> None:
    motion = at_rest(BODY, 1)
    chain = next(chain for chain in limbs(BODY) if BODY.names[chain[0]] == "upper_arm.L")
    motion.rotations[:, BODY.index("upper_arm.L")] = rotations.exp(np.array([-swing, 0, 0]))
    motion.rotations[:, BODY.index("forearm.L")] = rotations.exp(np.array([-bend, 0, 0]))
    problem = problem_of(motion)
    limb, parts = limb_of(problem, [motion], (0, chain), np.random.default_rng(0), 200)
    far = look_at("far", (40.0, 0, 1.4), (0, 0, 1.4), size=(900, 900), focal=16000.0)
    geometry, (R, T) = problem.geometry().subset(parts), poses_of([BODY], [motion])
    drawn = render_labels(geometry, far, 0, R[:, parts], T[:, parts])
    area = np.count_nonzero(drawn.part >= 0) * (40.0 / 16000.0) ** 2
    even = tuple(np.full((1, 900, 900), 128 + LEVELS_PER_UNIT, np.uint8) for _ in parts)
    (found,) = pixel_log_ratios(limb, [UncoveredImages(far, 0, even, None, None, stride=1)], limb.begin[:, None])
    assert found * PATCH_RADIUS**2 == pytest.approx(area, rel=0.2)


def test_what_is_as_large_from_all_sides_covers_the_same_however_it_turns() -> None:
    images, rng = UncoveredImages(CAMERA, 0, (), None, None), np.random.default_rng(4)
    poses = rotations.exp(rng.normal(size=(2, 9, 3))), rng.normal((0.0, 0.0, 1.0), 0.3, (2, 9, 3))
    found, nearly = (
        images.seen_areas(area, slice(0, 2), poses) for area in np.array([[0.04, 0.04, 0.04 + d] for d in (0, 1e-9)])
    )
    assert found.shape == (2, 9)
    np.testing.assert_allclose(found, nearly, rtol=1e-6)


def test_however_a_limb_turns_it_stays_within_the_window_that_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit what it shows in the whole picture."""
    truth = walk(5)
    problem = problem_of(truth, *coloured(BODY, truth, (CAMERA,)))
    geometry, poses = problem.geometry(), poses_of([BODY], [truth])
    look = ViewRatios.of(problem.views[0], problem, 0, [truth])
    for chain in limbs(BODY):
        limb, parts = limb_of(problem, [truth], (0, chain), np.random.default_rng(0))
        drawn = rotations.exp(np.random.default_rng(1).normal(0.0, 3.0, (5, 400, len(chain), 3)))
        window = look.uncovered(geometry, poses, parts)
        with monkeypatch.context() as whole:
            whole.setattr(
                ViewRatios, "_within_reach", lambda self, *_: tuple(map(slice, (0, 0), self.foreground.shape[1:]))
            )
            full = look.uncovered(geometry, poses, parts)
        assert window.ratio[0].size < 0.9 * full.ratio[0].size
        np.testing.assert_array_equal(
            *(pixel_log_ratios(limb, [each], rotations.log(drawn)) for each in (window, full))
        )


def with_arm_lost_beside_another() -> tuple[Motion, Motion, Motion]:
    """The true motion of one of two performers, the same with an arm elsewhere, and the other's, far away."""
    truth = walk()
    return truth, turned(truth, "upper_arm.L", -1.5), Motion(truth.translations + (0, 30.0, 0), truth.rotations)


def beside_another(truth: Motion) -> SegmentProblem:
    """Pictures of the first of two performers; those of the other show nobody."""
    views = coloured(BODY, truth, (CAMERA, FRONT))
    both = tuple(replace(v, foreground=np.concatenate([v.foreground, np.full_like(v.foreground, 4)])) for v in views)
    return SegmentProblem(both, (BODY, BODY), 0, FPS, (ends_held(BODY, LENGTH),) * 2)


def test_of_several_performers_a_limb_is_only_found_exactly_where_it_may_be_once_found_roughly(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    truth, lost, away = with_arm_lost_beside_another()
    promised: list[tuple[bool, bool]] = []

    def likeliest(limb: LimbModel, *asked: object) -> tuple[Array, float]:
        promising = asked[-1]
        assert callable(promising)
        there = rotations.log(truth.rotations[:, limb.chain])
        promised.append((promising(limb.begin), promising(there)))
        return limb.begin, 0.0

    monkeypatch.setattr(limb_search, "likeliest_limb", likeliest)
    found_limbs(beside_another(truth).alone(0), [lost, away], seed=0, workspace=Workspace())
    assert promised == [(False, True)]


def test_with_several_performers_only_limbs_that_are_hardly_seen_in_place_are_searched_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    truth, lost, away = with_arm_lost_beside_another()
    problem = beside_another(truth)
    looked: list[str] = []

    def likeliest(limb: LimbModel, *_: object) -> tuple[Array, float]:
        looked.append(BODY.names[limb.chain[0]])
        return limb.begin, 0.0

    monkeypatch.setattr(limb_search, "likeliest_limb", likeliest)
    found_limbs(problem.alone(0), [lost, away], seed=0, workspace=Workspace())
    assert looked == ["upper_arm.L"]


@pytest.mark.parametrize("seed", range(3))
def test_an_arm_that_points_the_other_way_is_found_in_two_views(seed: int) -> None:
    truth = walk(20)
    lost = turned(truth, "upper_arm.L", -2.2)
    problem = problem_of(truth, *coloured(BODY, truth, (CAMERA, FRONT)))
    (found,) = found_limbs(problem, [lost], seed=seed, workspace=Workspace())
    before, after = (np.median(error_mm(motion, truth, "LWrist")) for motion in (lost, found))
    assert before > 600 and after < 0.25 * before


def test_limbs_that_are_seen_where_they_are_stay_there() -> None:
    truth = walk()
    (found,) = found_limbs(problem_of(truth, seen(truth)), [truth], seed=2, workspace=Workspace())
    nearer = [part for chain in limbs(BODY) for part in chain if BODY.names[part].endswith(".L")]
    np.testing.assert_array_equal(found.rotations[:, nearer], truth.rotations[:, nearer])


def test_the_trunk_and_key_poses_stay_to_the_last_bit() -> None:
    truth = walk()
    lost = turned(turned(truth, "upper_arm.L", -1.0), "thigh.R", 0.8)
    problem = problem_of(truth, seen(truth))
    problem.fixed[0][7, 3 + 3 * BODY.index("upper_arm.L") :] = True
    (found,) = found_limbs(problem, [lost], seed=1, workspace=Workspace())
    assert (found.rotations != lost.rotations).any()
    np.testing.assert_array_equal(found.translations, lost.translations)
    trunk = [BODY.index(name) for name in ("pelvis", "spine", "chest", "head")]
    np.testing.assert_array_equal(found.rotations[:, trunk], lost.rotations[:, trunk])
    np.testing.assert_array_equal(found.rotations[[0, 7, -1]], lost.rotations[[0, 7, -1]])


def test_without_foreground_images_nothing_is_searched_for() -> None:
    truth = walk()
    lost = turned(truth, "upper_arm.L", -1.0)
    blind = ViewFrames(CAMERA, np.zeros((LENGTH, 160, 120), np.uint8), 0)
    (found,) = found_limbs(problem_of(truth, blind), [lost], seed=0, workspace=Workspace())
    np.testing.assert_array_equal(found.rotations, lost.rotations)


@pytest.mark.parametrize("pair", limb_pairs(BODY), ids=["arms", "legs"])
def test_limbs_taken_for_one_another_between_two_meetings_get_their_own_way_again(
    pair: tuple[list[int], list[int]],
) -> None:
    truth = walk(30)
    phase = np.sin(2 * np.pi * (np.arange(30) / FPS + 0.1))
    meetings = np.flatnonzero(np.diff(np.sign(phase))) + 1
    mixed = exchanged(truth, pair, slice(meetings[0], meetings[1]))
    tip = BODY.names[pair[0][-1]]
    name = "LWrist" if tip.startswith("hand") else "LAnkle"
    assert error_mm(mixed, truth, name).max() > 200
    found = untangled(BODY, mixed, pair, FPS)
    assert (error_mm(found, truth, name) > 60).sum() <= 1  # where they meet they may be taken either way
    np.testing.assert_allclose(untangled(BODY, truth, pair, FPS).rotations, truth.rotations, atol=1e-12)


def test_like_limbs_that_meet_twice_are_exchanged_in_between() -> None:
    """Unless they are posed there."""
    truth = walk(20)
    meetings = np.flatnonzero(np.diff(np.sign(np.sin(2 * np.pi * (np.arange(20) / FPS + 0.1))))) + 1
    problem = problem_of(truth)
    problem = replace(problem, fixed=(np.zeros_like(problem.fixed[0]),))
    found = [exchange.motions[0] for exchange in exchanges(problem, [truth])]
    assert len(found) == len(limb_pairs(BODY))
    for pair, motion in zip(limb_pairs(BODY), found, strict=True):
        frames = np.flatnonzero(np.abs(motion.rotations - truth.rotations).max(axis=(1, 2, 3)) > 1e-6)
        assert np.abs(frames[[0, -1]] - (meetings - [0, 1])).max() <= 1
        expected = exchanged(truth, pair, slice(frames[0], frames[-1] + 1))
        np.testing.assert_allclose(motion.rotations, expected.rotations, atol=1e-9)
    posed = problem.fixed[0].copy()
    posed[9] = True
    assert not list(exchanges(replace(problem, fixed=(posed,)), [truth]))


def test_like_limbs_are_exchanged_between_a_meeting_and_a_key_pose_where_they_are_near_each_other() -> None:
    """At the first key pose the legs are 0.6 times as far apart as they come to be, at the last one 0.75 times."""
    truth = walk(20)
    problem = problem_of(truth)
    (legs,) = [pair for pair in limb_pairs(BODY) if BODY.index("thigh.L") in pair[0]]
    changed = []
    for exchange in exchanges(problem, [truth]):
        frames = np.flatnonzero(
            np.abs(exchange.motions[0].rotations - truth.rotations)[:, legs[0]].max(axis=(1, 2, 3)) > 1e-6
        )
        changed += [(frames[0], frames[-1])] if len(frames) else []
    assert problem.fixed[0][[0, -1]].all() and changed == [(1, 5), (7, 13)]


def test_legs_that_were_led_to_each_others_places_come_back() -> None:
    """With each other's directions they would end beside where they belong, by as much as the hips are apart."""
    truth, frames = walk(20), np.arange(20) // 10 == 1
    (legs,) = [pair for pair in limb_pairs(BODY) if BODY.index("thigh.L") in pair[0]]
    ends = {name: landmark_positions(BODY, truth, [name])[:, 0] for name in ("LAnkle", "RAnkle")}
    led_astray = with_places_exchanged(BODY, truth, legs, frames)
    places, directions = with_places_exchanged(BODY, led_astray, legs, frames), exchanged(led_astray, legs, frames)
    for name, other in (("LAnkle", "RAnkle"), ("RAnkle", "LAnkle")):
        there = landmark_positions(BODY, led_astray, [name])[:, 0]
        assert 1000 * np.linalg.norm(there - ends[other], axis=1)[frames].max() < 50
        assert error_mm(places, truth, name).max() < 5 and error_mm(directions, truth, name)[frames].min() > 150
        np.testing.assert_allclose(there[~frames], ends[name][~frames], atol=1e-9)


def test_limbs_exchange_directions_and_with_one_view_or_if_they_reach_across_places() -> None:
    """Those of one of several performers exchange directions only where that makes them no rougher: limbs that follow
    each other's pictures leap there and back. In one view, depth is lost.
    """
    truth = walk(20)
    (legs,) = [pair for pair in limb_pairs(BODY) if BODY.index("thigh.L") in pair[0]]
    astray = np.isin(np.arange(20), range(1, 12))
    led_astray, mixed = with_places_exchanged(BODY, truth, legs, astray), exchanged(truth, legs, astray)
    alone = problem_of(truth, seen(truth), seen(truth))
    fixed = ends_held(BODY, len(truth))
    several = replace(alone, bodies=(BODY, BODY), fixed=(fixed, fixed)).alone(1)
    across = with_places_exchanged(BODY, truth, legs, np.ones(20, dtype=bool))
    kinds = {
        "across from key pose to key pose": [exchange.places for exchange in exchanges(several, [truth, across])],
        "several": [exchange.places for exchange in exchanges(several, [truth, truth])],
        "across": [exchange.places for exchange in exchanges(several, [truth, led_astray])],
        "mixed": [exchange.places for exchange in exchanges(several, [truth, mixed])],
        "one view": [
            exchange.places for exchange in exchanges(replace(several, views=several.views[:1]), [truth, truth])
        ],
        "alone": [exchange.places for exchange in exchanges(alone, [truth])],
        "alone in one view": [
            exchange.places for exchange in exchanges(replace(alone, views=alone.views[:1]), [truth])
        ],
    }
    assert not kinds["several"] and True in kinds["across"] and set(kinds["mixed"]) == {False}
    assert True in kinds["across from key pose to key pose"]  # though they would leap beside the key poses
    one_view = kinds["alone in one view"]
    assert len(one_view) >= 2 * len(kinds["alone"]) and one_view == [True, False] * (len(one_view) // 2)
    assert kinds["one view"] == kinds["alone"] == [False] * len(kinds["alone"])


def test_in_one_view_and_among_others_limbs_are_exchanged_between_any_minima_of_their_distance() -> None:
    """Legs that passed each other early, and then stood apart in depth while they passed each other in the picture."""
    motion = at_rest(BODY, 30)
    Q = motion.rotations.copy()
    for name, side in (("thigh.L", 1), ("thigh.R", -1)):
        turn = np.zeros((30, 3))
        turn[:, 0] = side * (0.45 - 0.04 * np.cos(np.arange(30) * 4 * np.pi / 29 - np.pi))
        Q[:, BODY.index(name)] = rotations.exp(turn)
    motion = Motion(motion.translations, Q)
    several = problem_of(motion, seen(motion), seen(motion))
    free = replace(several, fixed=(np.zeros_like(several.fixed[0]),))
    assert not list(exchanges(free, [motion]))
    assert len(list(exchanges(replace(free, views=free.views[:1]), [motion]))) == 2
    both = replace(free, bodies=(BODY,) * 2, fixed=free.fixed * 2)
    assert len(list(swaps(both.alone(1), [motion, motion]))) == 1


@pytest.mark.parametrize("late", [(2, 0), (0, -2), (-2, 2)])
def test_like_limbs_change_places_where_that_makes_the_motion_smoothest(late: tuple[int, int]) -> None:
    """They were mistaken for each other two frames off a meeting: the smoothed distance does not show when."""
    truth = walk(20)
    (legs,) = [pair for pair in limb_pairs(BODY) if BODY.index("thigh.L") in pair[0]]
    meetings = np.flatnonzero(np.diff(np.sign(np.sin(2 * np.pi * (np.arange(20) / FPS + 0.1))))) + 1
    first, end = (int(meeting) + by for meeting, by in zip(meetings, late, strict=True))
    mixed = exchanged(truth, legs, slice(first, end))
    ways = [exchange.motions[0] for exchange in exchanges(problem_of(truth), [mixed])]
    assert min(np.abs(motion.rotations - truth.rotations).max() for motion in ways) < 1e-9


def test_limbs_that_slowly_turn_back_are_not_exchanged() -> None:
    motion = at_rest(BODY, 40)
    Q = motion.rotations.copy()
    for name, side in (("thigh.L", 1), ("thigh.R", -1)):
        turn = np.zeros((40, 3))
        turn[:, 0] = side * (0.45 + 0.25 * np.cos(np.arange(40) * 2 * np.pi / 40))
        Q[:, BODY.index(name)] = rotations.exp(turn)
    motion = Motion(motion.translations, Q)
    (legs,) = [pair for pair in limb_pairs(BODY) if BODY.index("thigh.L") in pair[0]]
    np.testing.assert_allclose(untangled(BODY, motion, legs, FPS).rotations, motion.rotations, atol=1e-12)


def test_key_poses_are_not_exchanged() -> None:
    truth, (arms, legs) = walk(30), limb_pairs(BODY)
    mixed = exchanged(exchanged(truth, arms, slice(6, 13)), legs, slice(6, 13))
    free = np.ones(30, bool)
    free[9] = False
    found = untangled(BODY, mixed, legs, FPS, free)
    np.testing.assert_allclose(found.rotations[9], mixed.rotations[9], atol=1e-12)


@pytest.mark.parametrize("pair", limb_pairs(BODY), ids=["arms", "legs"])
def test_limbs_that_never_meet_stay_as_they_are(pair: tuple[list[int], list[int]]) -> None:
    still = at_rest(BODY, 8)
    assert untangled(BODY, still, pair, FPS) is still


def test_a_search_reports_every_limb_and_can_be_ended() -> None:
    truth = walk(5)
    reported: list[float] = []
    found_limbs(problem_of(truth, seen(truth)), [truth], 0, Workspace(on_step=lambda done, _: reported.append(done)))
    assert reported == [k / len(limbs(BODY)) for k in range(len(limbs(BODY)))]

    def end(_done: float, _motions: object) -> None:
        raise CancelledError

    with pytest.raises(CancelledError):
        found_limbs(problem_of(truth, seen(truth)), [truth], 0, Workspace(on_step=end))


def test_a_small_childs_limb_found_elsewhere_gains_as_much_as_a_larger_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its pixels show a smaller area, by which they count."""
    gains = []
    for height in (1.5, 1.2):
        body = human(height)
        chain = limbs(body)[0]
        problem = SegmentProblem((), (body,), 0, FPS, (ends_held(body, LENGTH),))
        before, found = at_rest(body, LENGTH), at_rest(body, LENGTH)
        found.rotations[1:-1, chain[0]] = rotations.exp(np.array([0.0, 0.0, 1.0]))
        limb, _ = limb_of(problem, [before], (0, chain), np.random.default_rng(0))
        likelier = np.full(LENGTH, limb.areas.sum())
        monkeypatch.setattr(limb_search, "pixel_gains", lambda *_, likelier=likelier: likelier)
        gains.append(limb_search._gain_elsewhere(limb, [], np.ones(LENGTH), before, found))
    assert gains[0] > 0
    np.testing.assert_allclose(gains[1], gains[0], rtol=0.01)
