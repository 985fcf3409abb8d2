"""Bodies of any size are tracked alike: a shot in other lengths has the same motion in these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import Body, human
from kfmocap.core.body.body import Part
from kfmocap.core.body.body_size import body_size
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.grips import shot_with_grips
from kfmocap.core.shot.holds import Hold
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot, View
from kfmocap.core.tracking.results.track_result import TrackResult
from kfmocap.core.tracking.retracking import Excerpt, track_excerpts
from kfmocap.core.tracking.scheduling.run_context import RunContext
from kfmocap.core.tracking.shot_scale import HUMAN_SIZE, HUMAN_SIZES, PROP_SIZE, ShotScale
from kfmocap.core.tracking.tracker import track
from synthetic import box, figure, film, look_at, shot_of, swing

FIGURE, LENGTH = figure(), 9
TRUTH = swing(FIGURE, LENGTH)
KEYS = (0, 4, 8)
SMALL = 0.1 * HUMAN_SIZES[0] / body_size(FIGURE)
"""Scale with which the figure is a tenth as large as the smallest person."""


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> list[View]:
    eyes = {"front": (0.5, -2.8, 1.5), "side": (-2.4, -1.4, 1.3)}
    filming = [look_at(name, eye, size=(160, 120), focal=190) for name, eye in eyes.items()]
    return film(tmp_path_factory.mktemp("filmed"), [FIGURE], [TRUTH], filming)


def shot_at(views: Sequence[View], factor: float, settings: Settings | None = None) -> Shot:
    """The shot with all lengths multiplied."""
    return ShotScale(factor).shot(shot_of(views, [FIGURE], [TRUTH], KEYS, settings))


@pytest.fixture(scope="module")
def small(views: list[View]) -> TrackResult:
    return track(shot_at(views, SMALL))


def assert_times(found: TrackResult, small: TrackResult, factor: float) -> None:
    """Check that a result is another one with its lengths multiplied."""
    lengths = (
        lambda result: result.motions[0].translations,
        lambda result: result.errors[0].deviation,
        lambda result: result.errors[0].interval,
        lambda result: np.array([one.accelerations[0][0] for one in result.segments]),
    )
    for length in lengths:
        np.testing.assert_allclose(length(found), factor * length(small), rtol=1e-7, atol=1e-9 * factor)
    np.testing.assert_allclose(found.motions[0].rotations, small.motions[0].rotations, atol=1e-7)


@pytest.mark.parametrize("factor", [0.1, 1000.0])
def test_a_shot_in_other_lengths_has_the_same_motion_in_these(
    views: list[View], small: TrackResult, factor: float
) -> None:
    shot = shot_at(views, factor * SMALL)
    found = track(shot)
    assert_times(found, small, factor)
    keys = shot.performers[0].key_poses
    np.testing.assert_array_equal(found.motions[0][keys.frames].translations, keys.poses.translations)


def test_a_body_of_human_size_is_tracked_as_it_is(views: list[View]) -> None:
    shot = shot_at(views, 1.2 * HUMAN_SIZES[0] / body_size(FIGURE))
    scale = ShotScale.of(shot)
    assert scale.factor == 1
    assert scale.shot(shot) is shot
    result = track(shot)
    assert scale.result(result, shot.performers) is result


def test_a_small_body_is_tracked_as_well_as_one_of_human_size(views: list[View], small: TrackResult) -> None:
    usual = HUMAN_SIZE / body_size(FIGURE)
    found = track(shot_at(views, usual)).motions[0].translations / usual
    np.testing.assert_allclose(small.motions[0].translations / SMALL, found, atol=1e-5)


def test_excerpts_of_a_small_shot_are_its_motion(views: list[View], small: TrackResult) -> None:
    [again] = track_excerpts(shot_at(views, SMALL), [Excerpt(0, LENGTH - 1)])
    assert_times(again, small, 1.0)


def test_settings_and_what_is_shown_on_the_way_are_in_the_lengths_of_the_shot(views: list[View]) -> None:
    rates = []
    for factor in (SMALL, 100 * SMALL):
        shown: list[Motion] = []
        settings = Settings(correlation_length=0.04, outline_correlation=0.05, root_acceleration=2.0)
        shot = shot_at(views, factor, settings)  # which scales the settings, too
        assert shot.settings.correlation_length == pytest.approx(0.04 * factor)
        found = track(
            shot,
            observe=lambda _segment, _iteration, motions, shown=shown: shown.append(motions[0]),
            run=RunContext(show=lambda _segment, motions, shown=shown: shown.append(motions[0])),
        )
        place = shot.performers[0].key_poses.poses.translations[0]
        assert len(shown) > 2
        for motion in (shown[0], shown[-1], found.motions[0]):
            assert np.linalg.norm(motion.translations[0] - place) < 0.3 * factor
        rates.append(found.motions[0].translations / factor)
    np.testing.assert_allclose(*rates, rtol=1e-7)


def lying(body: Body) -> Body:
    """The same body on its back."""
    G = rotations.exp(np.array([-np.pi / 2, 0.0, 0.0]))
    parts = (
        replace(
            part, head_world=G @ part.head_world, tail_world=G @ part.tail_world, R_world_rest=G @ part.R_world_rest
        )
        for part in body.parts
    )
    return Body(tuple(parts), body.landmarks)


def prop(length: float) -> Body:
    """A stick."""
    end = np.array([0.0, length, 0.0])
    return Body(
        (Part("stick", -1, np.zeros(3), end, np.eye(3), box((0, 0, 0), (0.1 * length, length, 0.1 * length))),), {}
    )


def scaled(body: Body, factor: float) -> Body:
    return ShotScale(factor).shot(shot_with(body)).performers[0].body


def shot_with(*bodies: Body) -> Shot:
    people = [
        Performer(
            str(i), body, KeyPoses.whole([0], Motion(np.zeros((1, 3)), np.eye(3)[None, None].repeat(len(body), 1)))
        )
        for i, body in enumerate(bodies)
    ]
    return Shot("sizes", 30.0, (0, 9), (), tuple(people))


ADULT = human(1.75)


@pytest.mark.parametrize(
    ("bodies", "factor"),
    [
        ([ADULT], 1.0),
        ([lying(ADULT)], 1.0),
        ([human(1.05)], 1.0),
        ([human(2.2)], 1.0),
        ([scaled(ADULT, 0.2)], HUMAN_SIZE / 0.2 / body_size(ADULT)),
        ([scaled(ADULT, 5.0)], HUMAN_SIZE / 5 / body_size(ADULT)),
        ([ADULT, prop(9.0), scaled(ADULT, 0.1)], 1.0),
        ([scaled(ADULT, 0.2), prop(1.5)], HUMAN_SIZE / 0.2 / body_size(ADULT)),
        ([prop(0.3)], 1.0),
        ([prop(1.5)], 1.0),
        ([prop(0.02)], PROP_SIZE / body_size(prop(0.02))),
        ([prop(10.0)], HUMAN_SIZE / body_size(prop(10.0))),
    ],
)
def test_people_and_what_they_hold_keep_their_size(bodies: Sequence[Body], factor: float) -> None:
    shot = shot_with(*bodies)
    assert ShotScale.of(shot).factor == pytest.approx(factor)
    assert ShotScale.of(ShotScale.of(shot).shot(shot)).factor == 1


def test_size_is_the_height_of_people() -> None:
    assert [body_size(human(height)) for height in (1.0, 1.75, 2.0)] == pytest.approx([1.0, 1.75, 2.0], rel=0.03)


def test_a_grip_and_what_landmarks_are_off_are_lengths() -> None:
    pair = shot_with(ADULT, prop(0.3))
    held = replace(pair, holds=(Hold("1", "0", "hand.R", (0, 9)),))
    tracked, given = (scale.shot(held).performers[0] for scale in (ShotScale(2.0), ShotScale(1.0)))
    assert tracked.joint_deviation is None is given.joint_deviation
    off = replace(pair, performers=(replace(given, joint_deviation=np.full(len(ADULT), 0.01)), pair.performers[1]))
    assert ShotScale(2.0).shot(off).performers[0].joint_deviation == pytest.approx(0.02)
    gripped, twice = (ShotScale(k).shot(shot_with_grips(held)).holds[0].grip for k in (1.0, 2.0))
    np.testing.assert_allclose(twice.places, 2 * gripped.places)
    np.testing.assert_allclose(shot_with_grips(ShotScale(2.0).shot(held)).holds[0].grip.places, twice.places)
