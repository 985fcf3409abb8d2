"""Some segments of a shot are tracked alone, and fit what is beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.body import landmark_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.smoothness import acceleration
from kfmocap.core.errors import CancelledError, ShotError
from kfmocap.core.fitting.shot_cameras import track_and_check
from kfmocap.core.shot.segments import segments
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import KeyPoses, Shot, View
from kfmocap.core.tracking import retracking
from kfmocap.core.tracking.results.track_result import TrackResult
from kfmocap.core.tracking.retracking import PREVIEW_ITERATIONS, Excerpt, digest, digests, track_excerpts
from kfmocap.core.tracking.tracker import track
from synthetic import CAMERAS, figure, film, shot_of, swing

BODY, LENGTH = figure(), 16
TRUTH = swing(BODY, LENGTH)
KEYS = (0, 5, 10, 15)


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> list[View]:
    return film(tmp_path_factory.mktemp("film"), [BODY], [TRUTH], CAMERAS)


@pytest.fixture(scope="module")
def whole(views: list[View]) -> TrackResult:
    return track(shot(views))


def shot(views: Sequence[View], keys: Sequence[int] = KEYS) -> Shot:
    return shot_of(views, [BODY], [TRUTH], keys, Settings(limb_search=False))


def error_mm(motion: Motion, truth: Motion) -> float:
    names = list(BODY.landmarks)
    apart = landmark_positions(BODY, motion, names) - landmark_positions(BODY, truth, names)
    return 1000 * float(np.linalg.norm(apart, axis=-1).mean())


def test_the_part_that_is_the_whole_shot_gives_its_motion_to_the_last_bit(
    views: list[View], whole: TrackResult
) -> None:
    [again] = track_excerpts(shot(views), [Excerpt(0, LENGTH - 1)])
    np.testing.assert_array_equal(again.motions[0].rotations, whole.motions[0].rotations)
    np.testing.assert_array_equal(again.motions[0].translations, whole.motions[0].translations)


def test_a_segment_is_tracked_alone_as_well_as_with_the_others(views: list[View], whole: TrackResult) -> None:
    beside = tuple((whole.motions[0][[frame]],) for frame in (4, 11))
    [found] = track_excerpts(shot(views), [Excerpt(5, 10, beside)])
    assert len(found.motions[0]) == 6
    assert error_mm(found.motions[0], TRUTH[5:11]) < 1.1 * error_mm(whole.motions[0][5:11], TRUTH[5:11])


def test_the_motion_passes_smoothly_from_and_to_what_is_beside_it(views: list[View], whole: TrackResult) -> None:
    beside = tuple((whole.motions[0][[frame]],) for frame in (4, 11))
    bends = []
    for around in (beside, (None, None)):
        [found] = track_excerpts(shot(views), [Excerpt(5, 10, around)])
        motion = whole.motions[0].replaced(5, found.motions[0])
        bends.append(np.abs(acceleration(motion[[4, 5, 6, 9, 10, 11]])[[0, 3]]).max())
    assert bends[0] < bends[1]


def test_a_part_reads_its_own_frames_of_a_moving_camera(views: list[View], whole: TrackResult) -> None:
    """The camera's poses are those of the shot's frames, not those from its first on."""
    still = [replace(v.camera, R_cam_world=np.repeat(v.camera.R_cam_world, LENGTH, 0)) for v in views]
    far = np.arange(LENGTH)[:, None] < 5
    moving = [
        replace(c, t_cam_world=np.where(far, v.camera.t_cam_world + 9, v.camera.t_cam_world))
        for c, v in zip(still, views, strict=True)
    ]
    there = [replace(v, camera=c) for v, c in zip(views, moving, strict=True)]
    [found], [expected] = (track_excerpts(shot(v), [Excerpt(5, 10)]) for v in (there, views))
    assert error_mm(found.motions[0], expected.motions[0]) < 1


def test_segments_are_chosen_by_a_frame() -> None:
    segments = [(0, 5), (5, 10), (10, 15)]
    assert retracking.segments_at(segments, 7) == [(5, 10)]
    assert retracking.segments_at(segments, 5) == [(0, 5), (5, 10)]
    assert retracking.segments_at(segments, 16) == []
    assert retracking.segments_after(segments, 5) == retracking.segments_after(segments, 7) == [(5, 10), (10, 15)]
    assert retracking.segments_before(segments, 5) == [(0, 5)]
    assert retracking.segments_before(segments, 7) == [(0, 5), (5, 10)]


def test_an_excerpt_has_the_segments_of_the_shot(views: list[View]) -> None:
    s = shot(views, (3, 7, 10))
    assert segments(s) == [(0, 3), (3, 7), (7, 10), (10, 15)]
    assert segments(s.between(3, 10)) == [(0, 4), (4, 7)]
    assert segments(s.between(0, 7)) == [(0, 3), (3, 7)]


def test_the_frame_on_screen_is_shown_first_without_changing_the_result(views: list[View], whole: TrackResult) -> None:
    """Coarse, then segment by segment in their order, the last of each as it is found."""
    shown: list[tuple[tuple[int, int], Motion]] = []
    s = shot(views)
    tracked = track_and_check(
        s, [Excerpt(0, 15)], show=lambda segment, motions: shown.append((segment, motions[0])), looking_at=12
    )
    assert np.array_equal(tracked.results[0].motions[0].rotations, whole.motions[0].rotations)
    assert [segment for segment, _ in shown[:PREVIEW_ITERATIONS]] == [(10, 15)] * PREVIEW_ITERATIONS
    solved = list(dict.fromkeys(segment for segment, _ in shown[PREVIEW_ITERATIONS:]))
    assert solved == [(0, 5), (5, 10), (10, 15)]
    for first, last in solved:
        motions = [motion for segment, motion in shown if segment == (first, last)]
        assert len(motions[0]) == last + 1 - first
        assert error_mm(motions[-1], whole.motions[0][first : last + 1]) < 2


@pytest.mark.parametrize(("frame", "known"), [(7, (True, False)), (12, (False, True))])
def test_the_frame_on_screen_is_shown_with_the_poses_beside_its_part(
    views: list[View], monkeypatch: pytest.MonkeyPatch, frame: int, known: tuple[bool, bool]
) -> None:
    given: list[tuple[object, object]] = []
    monkeypatch.setattr(retracking, "track", lambda *_, around, **__: given.append(around))
    beside = ((TRUTH[[4]],), (TRUTH[[15]],))
    parts = [Excerpt(0, 5), Excerpt(5, 15, beside)]
    retracking.preview_segment(shot(views), parts, frame, lambda *_: None, progress=None, memory=None)
    assert given == [tuple(pose if kept else None for pose, kept in zip(beside, known, strict=True))]


def test_progress_goes_on_from_part_to_part_and_cancels(views: list[View]) -> None:
    told: list[float] = []

    def progress(_what: str, fraction: float) -> bool:
        told.append(fraction)
        return True

    s = shot(views)
    track_excerpts(s, [Excerpt(0, 5), Excerpt(10, 15)], progress)
    assert told == sorted(told) and told[-1] == 1 and min(told) < 0.2 and any(0.4 < f < 0.6 for f in told)
    with pytest.raises(CancelledError):
        track_excerpts(s, [Excerpt(0, 5), Excerpt(10, 15)], lambda _what, fraction: fraction < 0.7)


def test_a_performer_without_key_poses_is_reported(views: list[View]) -> None:
    with pytest.raises(ShotError, match=r"no key pose.*performer|performer.*no key pose"):
        track(shot(views, ()))


def changed(s: Shot, frame: int) -> Shot:
    keys = s.performers[0].key_poses
    there = int(np.flatnonzero(keys.frames == frame)[0])
    poses = keys.poses.replaced(there, keys.poses[[there]].moved(np.full((1, BODY.dof), 1e-3)))
    person = replace(s.performers[0], key_poses=replace(keys, poses=poses))
    return replace(s, performers=(person,))


def test_a_key_pose_changes_the_digests_of_the_segments_beside_it_alone(views: list[View]) -> None:
    s = shot(views)
    other = changed(s, 5)
    same = [digest(s, segment) == digest(other, segment) for segment in segments(s)]
    assert same == [False, False, True]


@pytest.mark.parametrize("what", ["camera", "footage", "settings", "body", "fps", "removed key"])
def test_the_digest_covers_all_that_the_motion_depends_on(views: list[View], what: str) -> None:
    s, view, person = shot(views), views[0], shot(views).performers[0]
    parted = replace(person.body.parts[1], vertices=1.1 * person.body.parts[1].vertices)
    other = {
        "camera": lambda: replace(s, views=(replace(view, camera=view.camera.reduced(1.01)), views[1])),
        "footage": lambda: replace(s, views=(replace(view, footage=Path("other.mp4")), views[1])),
        "settings": lambda: replace(s, settings=replace(s.settings, prediction=False)),
        "body": lambda: replace(
            s, performers=(replace(person, body=replace(person.body, parts=(person.body.parts[0], parted))),)
        ),
        "fps": lambda: replace(s, fps=s.fps + 1),
        "removed key": lambda: shot(views, (0, 10, 15)),
    }[what]()
    assert digest(s, (5, 10)) == digest(shot(views), (5, 10))
    assert digest(s, (5, 10)) != digest(other, (5, 10))


def test_what_no_key_pose_fixes_and_where_the_footage_is_do_not_count(views: list[View]) -> None:
    s = shot(views)
    moved = replace(s, name="other", views=tuple(replace(v, footage=Path("/far") / v.footage.name) for v in s.views))
    assert digest(s, (0, 5)) == digest(moved, (0, 5))
    keys = s.performers[0].key_poses
    free = KeyPoses(keys.frames, keys.poses, keys.fixed & (np.arange(BODY.dof) > 5))
    loose = replace(s, performers=(replace(s.performers[0], key_poses=free),))
    rotations = keys.poses.rotations.copy()
    rotations[:, 0] = keys.poses.rotations[:, 1]
    turned = replace(free, poses=Motion(keys.poses.translations + 0.3, rotations))
    tracked = replace(s, performers=(replace(s.performers[0], key_poses=turned),))
    assert digest(loose, (0, 5)) == digest(tracked, (0, 5)) != digest(s, (0, 5))


def test_bodies_that_are_remembered_do_not_change_a_digest(views: list[View]) -> None:
    s = shot(views)
    assert digests(s, segments(s)) == {segment: digest(s, segment) for segment in segments(s)}
    larger = replace(BODY, parts=tuple(replace(part, vertices=1.1 * part.vertices) for part in BODY.parts))
    other = replace(s, performers=tuple(replace(performer, body=larger) for performer in s.performers))
    assert set(digests(s, segments(s)).values()).isdisjoint(digests(other, segments(s)).values())
