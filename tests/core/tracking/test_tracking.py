"""Tracking of small filmed scenes whose true motion is known."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from kfmocap.core.body import Body, landmark_positions
from kfmocap.core.body.motion import Motion, stacked
from kfmocap.core.body.smoothness import acceleration
from kfmocap.core.errors import CancelledError, ShotError
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.fixed_degrees import fixed_degrees
from kfmocap.core.shot.keypose_spline import spline
from kfmocap.core.shot.segments import segments
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import KeyPoses, Shot, View
from kfmocap.core.tracking.scheduling import segment_tasks
from kfmocap.core.tracking.solvers import registry
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.tracker import track
from synthetic import CAMERAS, at_rest, figure, film, look_at, rigidly_moved, rigidly_moved_camera, shot_of, swing

BODY = figure()
LENGTH = 11
TRUTH = swing(BODY, LENGTH)
RELAXATION = Settings(solver="relaxation", sweeps=60)
solvers = pytest.mark.parametrize("settings", [Settings(), RELAXATION], ids=lambda s: s.solver)


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> list[View]:
    return film(tmp_path_factory.mktemp("film"), [BODY], [TRUTH], CAMERAS)


def shot(views: Sequence[View], keys: Sequence[int] = (0, LENGTH - 1), settings: Settings | None = None) -> Shot:
    return shot_of(views, [BODY], [TRUTH], keys, settings)


def apart_mm(a: Motion, b: Motion, body: Body = BODY) -> np.ndarray:
    """Mean distance of the landmarks on every frame."""
    names = list(body.landmarks)
    return 1000 * np.linalg.norm(landmark_positions(body, a, names) - landmark_positions(body, b, names), axis=-1).mean(
        1
    )


def spline_error(s: Shot, truths: Sequence[Motion]) -> float:
    return max(apart_mm(spline(p.key_poses, s.length), m).mean() for p, m in zip(s.performers, truths, strict=True))


@pytest.fixture(scope="module")
def tracked(views: list[View]) -> Motion:
    return track(shot(views)).motions[0]


@solvers
def test_tracking_finds_the_motion_that_the_key_poses_do_not_tell(views: list[View], settings: Settings) -> None:
    s = shot(views, settings=settings)
    result = track(s)
    assert spline_error(s, [TRUTH]) > 100
    assert apart_mm(result.motions[0], TRUTH).mean() < 0.25 * spline_error(s, [TRUTH])
    assert result.camera_frames == 2 * LENGTH
    assert result.visible[0].shape == (2, LENGTH, len(BODY)) and (result.visible[0] <= 1).all()
    assert result.residual[0].shape == (LENGTH,) and (result.residual[0] < 0.1).all()
    assert [(x.first, x.last) for x in result.segments] == [(0, LENGTH - 1)]
    assert result.segments[0].iterations > 0 and len(result.segments[0].energy) > 0
    assert {"footage", "label images", "gradients", "solve"} <= set(result.seconds)


def test_more_key_poses_bring_it_nearer(views: list[View], tracked: Motion) -> None:
    more = track(shot(views, (0, 5, 10))).motions[0]
    assert apart_mm(more, TRUTH).mean() < apart_mm(tracked, TRUTH).mean()


@solvers
def test_key_poses_are_met_to_the_last_bit(views: list[View], settings: Settings) -> None:
    keys = [0, 4, 10]
    found = track(shot(views, keys, settings)).motions[0]
    np.testing.assert_array_equal(found.translations[keys], TRUTH.translations[keys])
    np.testing.assert_array_equal(found.rotations[keys], TRUTH.rotations[keys])


def test_a_partial_key_pose_fixes_its_degrees_of_freedom_alone(views: list[View], tracked: Motion) -> None:
    """The key at frame 5 holds the forearm; the rest of its pose is nonsense and must not be taken."""
    forearm, D = BODY.index("forearm.L"), BODY.dof
    poses = TRUTH[[0, 5, 10]].moved(np.zeros((3, D)))
    poses.translations[1] += 3.0
    poses.rotations[1, [0, 1, 3]] = rotations.exp(np.array([1.0, 1.0, 1.0]))
    fixed = np.ones((3, D), bool)
    fixed[1] = False
    fixed[1, 3 + 3 * forearm : 6 + 3 * forearm] = True
    s = shot(views)
    person = replace(s.performers[0], key_poses=KeyPoses(np.array([0, 5, 10]), poses, fixed))
    s = replace(s, performers=(person,))
    found = track(s).motions[0]
    np.testing.assert_array_equal(found.rotations[5, forearm], poses.rotations[1, forearm])
    others = [0, 1, 3]
    assert np.abs(TRUTH.difference(found)[5, :3]).max() < 0.1
    assert np.abs(rotations.log(np.swapaxes(found.rotations, 2, 3) @ TRUTH.rotations)[5, others]).max() < 0.5
    assert apart_mm(found, TRUTH).mean() < 1.2 * apart_mm(tracked, TRUTH).mean()
    held = fixed_degrees(person, 0, LENGTH - 1)
    np.testing.assert_array_equal(held[[0, 5, 10]], fixed)
    assert not np.delete(held, [0, 5, 10], axis=0).any()


def test_the_order_of_the_cameras_does_not_matter(views: list[View], tracked: Motion) -> None:
    turned = track(shot(views[::-1])).motions[0]
    assert np.abs(turned.difference(tracked)).max() < 1e-6


def test_two_cameras_see_more_than_one(views: list[View], tracked: Motion) -> None:
    alone = [apart_mm(track(shot([view])).motions[0], TRUTH).mean() for view in views]
    assert apart_mm(tracked, TRUTH).mean() < min(alone)


def test_moving_the_world_moves_the_motion(views: list[View], tracked: Motion) -> None:
    G, s = rotations.exp(np.array([0.1, -0.2, 1.3])), np.array([2.0, -1.0, 0.3])
    turned = [replace(v, camera=rigidly_moved_camera(v.camera, G, s)) for v in views]
    there = track(shot_of(turned, [BODY], [rigidly_moved(BODY, TRUTH, G, s)], (0, LENGTH - 1))).motions[0]
    # The root's smoothness is the same along every axis, so only rounding of label images differs.
    assert apart_mm(there, rigidly_moved(BODY, tracked, G, s)).max() < 3


def test_reversing_time_reverses_the_motion(views: list[View], tracked: Motion, tmp_path: Path) -> None:
    """Not exactly: the pixels of a pair are those of its earlier frame."""
    backwards = []
    for view in views:
        home = tmp_path / view.camera.name
        home.mkdir()
        for f in range(LENGTH):
            shutil.copy(view.footage.parent / f"{f:03d}.png", home / f"{LENGTH - 1 - f:03d}.png")
        backwards.append(replace(view, footage=home / "%03d.png"))
    found = track(shot_of(backwards, [BODY], [TRUTH[::-1]], (0, LENGTH - 1))).motions[0]
    assert apart_mm(found[::-1], tracked).mean() < 0.15 * spline_error(shot(views), [TRUTH])


@pytest.mark.parametrize(
    ("settings", "limit"), [(Settings(), 6.0), (RELAXATION, 1e-6)], ids=["gauss-newton", "relaxation"]
)
def test_a_shot_split_at_a_key_pose_gives_the_same_motion(views: list[View], settings: Settings, limit: float) -> None:
    """Of relaxation exactly; Gauss-Newton also passes smoothly through the key pose."""
    whole = track(shot(views, (0, 5, 10), settings)).motions[0]
    for first, last in ((0, 5), (5, 10)):
        part = shot_of(views, [BODY], [TRUTH[first : last + 1]], (0, last - first), settings)
        part = replace(part, frames=(first, last))
        assert apart_mm(track(part).motions[0], whole[first : last + 1]).mean() < limit


@pytest.mark.parametrize(("keys", "count"), [((0, LENGTH - 1), 1), ((0, 4, LENGTH - 1), 2)])
def test_every_segment_is_refined_the_only_one_as_well(
    views: list[View], keys: Sequence[int], count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    refined = []
    refine = segment_tasks.refine_segment
    monkeypatch.setattr(segment_tasks, "refine_segment", lambda *a, **k: refined.append(a) or refine(*a, **k))
    track(shot(views, keys, Settings(footage_offset=0.0)))
    assert len(refined) == count


def test_motion_passes_smoothly_through_a_key_pose_between_segments(views: list[View], tmp_path: Path) -> None:
    """Pictures that show nothing leave smoothness alone to decide: segments on their own meet at an angle."""
    for f in range(LENGTH):
        cv2.imwrite(str(tmp_path / f"{f:03d}.png"), np.full((120, 160), 90, np.uint8))
    empty = [replace(views[0], footage=tmp_path / "%03d.png")]
    whole = track(shot(empty, (0, 5, 10))).motions[0]
    halves = [
        track(replace(shot_of(empty, [BODY], [TRUTH[a : a + 6]], (0, 5)), frames=(a, a + 5))).motions[0] for a in (0, 5)
    ]
    apart = stacked([halves[0], halves[1][1:]])
    kink, corner = (np.linalg.norm(acceleration(m)[3:6], axis=1).max() for m in (whole, apart))
    assert kink < 0.5 * corner


def test_a_camera_with_a_pose_per_frame_is_as_good_as_a_fixed_one(views: list[View], tracked: Motion) -> None:
    def still(view: View) -> View:
        camera = view.camera
        R, t = (np.repeat(a, LENGTH, axis=0) for a in (camera.R_cam_world, camera.t_cam_world))
        return replace(view, camera=replace(camera, R_cam_world=R, t_cam_world=t))

    found = track(shot([still(view) for view in views])).motions[0]
    assert np.abs(found.difference(tracked)).max() < 1e-9


def test_a_camera_that_moves_tracks_as_well(tmp_path: Path) -> None:
    eyes = [look_at("dolly", (0.8 - 0.06 * f, -2.8 + 0.02 * f, 1.5)) for f in range(LENGTH)]
    R, t = (np.concatenate([getattr(e, n) for e in eyes]) for n in ("R_cam_world", "t_cam_world"))
    dolly = replace(eyes[0], R_cam_world=R, t_cam_world=t)
    s = shot(film(tmp_path, [BODY], [TRUTH], (dolly, CAMERAS[1])))
    right = track(s).motions[0]
    assert apart_mm(right, TRUTH).mean() < 0.25 * spline_error(s, [TRUTH])
    # Its first pose held would be a wrong calibration.
    held = replace(s.views[0], camera=eyes[0])
    wrong = track(replace(s, views=(held, s.views[1]))).motions[0]
    assert apart_mm(wrong, TRUTH).mean() > 1.2 * apart_mm(right, TRUTH).mean()


@solvers
def test_two_performers_are_tracked_together(tmp_path: Path, settings: Settings) -> None:
    truths = [
        rigidly_moved(BODY, swing(BODY, 7, 0.4, seed), rotations.exp(np.array([0, 0, turn])), np.array(place))
        for seed, turn, place in ((1, 0.3, (-0.7, 0.2, 0)), (2, -0.4, (0.8, -0.2, 0)))
    ]
    cameras = [
        look_at(f"cam{i}", eye, size=(240, 130), focal=200) for i, eye in enumerate(((0.3, -4, 1.6), (-1, -3.6, 1)))
    ]
    filmed = film(tmp_path, [BODY] * 2, truths, cameras)
    # The performers are small and quick: 100 rad/s^2 at 30 frames a second would be against all likelihood.
    s = shot_of(filmed, [BODY] * 2, truths, (0, 6), settings, fps=12)
    result = track(s)
    assert len(result.motions) == len(result.visible) == len(result.residual) == 2
    for person, found, truth in zip(s.performers, result.motions, truths, strict=True):
        assert apart_mm(found, truth).mean() < 0.4 * apart_mm(spline(person.key_poses, 7), truth).mean()
        np.testing.assert_array_equal(found.rotations[[0, 6]], truth.rotations[[0, 6]])


def test_locked_joints_do_not_turn(views: list[View]) -> None:
    limits = BODY.parts[3].limits.copy()
    limits[1] = 0.0
    parts = (*BODY.parts[:3], replace(BODY.parts[3], limits=limits))
    s = shot(views)
    locked = replace(s.performers[0], body=replace(BODY, parts=parts))
    held = fixed_degrees(locked, 0, LENGTH - 1)
    assert held[:, 3 + 3 * 3 + 1].all() and held[1:-1].sum() == LENGTH - 2


def test_progress_rises_to_one_and_changes_nothing(views: list[View], tracked: Motion) -> None:
    told: list[float] = []

    def progress(what: str, fraction: float) -> bool:
        assert what
        told.append(fraction)
        return True

    found = track(shot(views), progress).motions[0]
    assert told == sorted(told) and 0 <= told[0] < 0.2 and told[-1] == 1
    np.testing.assert_array_equal(found.rotations, tracked.rotations)


def test_progress_does_not_leap(views: list[View]) -> None:
    """One segment: reading, solving and refining it each take a good part of the time."""
    told: list[float] = []
    track(shot(views, settings=Settings(threads=1)), lambda _, fraction: told.append(fraction) is None)
    assert np.diff(told).max() < 0.5


def test_the_polish_with_planted_feet_reports_and_can_be_cancelled(
    views: list[View], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It comes last, when other stages of the segment have reported most of the work."""
    done: list[float] = []
    polishing = []

    def settle(_problem: Any, solution: Any, _equations: Any, *_: Any, workspace: Workspace) -> Any:
        polishing.append(len(done))
        workspace.report(0.5, solution.motions)
        raise AssertionError("it was cancelled before")

    def progress(_: str, fraction: float) -> bool:
        done.append(fraction)
        return not polishing

    polished = replace(registry.GAUSS_NEWTON, settle=settle)
    monkeypatch.setattr(registry, "REGISTRY", {"gauss-newton": polished})
    with pytest.raises(CancelledError):
        track(shot(views), progress)
    [before] = polishing
    assert len(done) == before + 1 and done[before - 1] < done[before] < 1


@solvers
@pytest.mark.parametrize("calls", [1, 4])
def test_progress_cancels(views: list[View], settings: Settings, calls: int) -> None:
    told: list[float] = []

    def progress(_: str, fraction: float) -> bool:
        told.append(fraction)
        return len(told) < calls

    with pytest.raises(CancelledError):
        track(shot(views, settings=settings), progress)
    assert len(told) == calls


def test_every_iteration_can_be_watched(views: list[View]) -> None:
    seen: list[tuple[tuple[int, int], int]] = []

    def observe(span: tuple[int, int], number: int, motions: Sequence[Motion]) -> None:
        seen.append((span, number))
        assert len(motions) == 1 and len(motions[0]) == span[1] + 1 - span[0]

    result = track(shot(views, (0, 5, 10)), observe=observe)
    for segment in result.segments:
        span = (segment.first, segment.last)
        assert [n for s, n in seen if s == span] == list(range(segment.iterations))


def keyed(*frames: Sequence[int], length: int = 21, partial: Sequence[int] = ()) -> Shot:
    """Performers with key poses at those frames; `partial` are frames where they fix the root alone."""
    truth = at_rest(BODY, length)
    s = shot_of([], [BODY] * len(frames), [truth] * len(frames), [0])
    people = []
    for person, at in zip(s.performers, frames, strict=True):
        fixed = np.ones((len(at), BODY.dof), bool)
        fixed[np.isin(at, partial), 6:] = False
        people.append(replace(person, key_poses=KeyPoses(np.array(at), truth[list(at)], fixed)))
    return replace(s, performers=tuple(people))


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: keyed([0, 20]), [(0, 20)]),
        (lambda: keyed([0, 7, 20]), [(0, 7), (7, 20)]),
        (lambda: keyed([5, 12]), [(0, 5), (5, 12), (12, 20)]),
        (lambda: keyed([8]), [(0, 8), (8, 20)]),
        (lambda: keyed([0, 10, 20], partial=[10]), [(0, 20)]),
        (lambda: keyed([0, 5, 10, 20], [0, 10, 15, 20]), [(0, 10), (10, 20)]),
        (lambda: keyed([0, 5, 20], [0, 7, 20]), [(0, 20)]),
    ],
)
def test_segments_meet_where_every_performer_has_a_whole_key_pose(
    make: Callable[[], Shot], expected: list[tuple[int, int]]
) -> None:
    assert segments(make()) == expected


def test_key_poses_away_from_the_ends_hold_the_motion_before_and_after_them(views: list[View]) -> None:
    s = shot(views, (3, 7))
    found = track(s).motions[0]
    assert len(found) == LENGTH
    np.testing.assert_array_equal(found.rotations[[3, 7]], TRUTH.rotations[[3, 7]])
    assert apart_mm(found, TRUTH).mean() < 0.5 * spline_error(s, [TRUTH])


def test_a_shot_of_one_frame_is_refused(views: list[View]) -> None:
    with pytest.raises(ShotError, match="one frame"):
        track(replace(shot(views), frames=(0, 0)))


@pytest.mark.parametrize("keys", [(0, LENGTH - 1), (0,)], ids=["both ends", "start alone"])
def test_a_camera_that_sees_nobody_changes_nothing(
    tmp_path: Path, views: list[View], tracked: Motion, keys: tuple[int, ...]
) -> None:
    away = film(tmp_path, [BODY], [TRUTH], [look_at("side turned away", (-2.4, -1.4, 1.3), (-5.0, -3.0, 1.3))])
    found = track(shot([*views, *away], keys)).motions[0]
    alone = tracked if len(keys) == 2 else track(shot(views, keys)).motions[0]
    np.testing.assert_allclose(found.translations, alone.translations, atol=1e-9)
    np.testing.assert_allclose(found.rotations, alone.rotations, atol=1e-9)


def test_the_start_pose_alone_is_enough_to_follow_the_motion(views: list[View]) -> None:
    """And the end pose alone to follow it backward."""
    held = spline_error(shot(views, (0,)), [TRUTH])
    for key in (0, LENGTH - 1):
        assert apart_mm(track(shot(views, (key,))).motions[0], TRUTH).mean() < 0.25 * held
