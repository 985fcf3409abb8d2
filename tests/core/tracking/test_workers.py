"""How many processes a shot is tracked in makes no difference to the motion."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kfmocap.core.body import landmark_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.errors import WorkerEndedError
from kfmocap.core.evidence import segment_evidence
from kfmocap.core.formats.shot_toml import read_shot_spec
from kfmocap.core.runtime.processes.worker_memory import WorkerMemory
from kfmocap.core.runtime.processes.worker_pool import WorkerPool
from kfmocap.core.shot.fingerprint import made_of
from kfmocap.core.shot.footage_faults.footage_times import FootageRate
from kfmocap.core.shot.footage_files.image_sequences import image_files
from kfmocap.core.shot.shot import Shot, View
from kfmocap.core.tracking import tracker
from kfmocap.core.tracking.footage_reading import reader
from kfmocap.core.tracking.prepare import prepare_shot
from kfmocap.core.tracking.results.track_result import TrackResult
from kfmocap.core.tracking.retracking import Excerpt, track_excerpts
from kfmocap.core.tracking.scheduling import segment_tracking, shot_checks, worker_counts
from kfmocap.core.tracking.scheduling.run_context import RunContext, SolvedShot
from synthetic import CAMERAS, figure, film, shot_of, swing

BODY = figure()
LENGTH = 13
TRUTH = swing(BODY, LENGTH)


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Shot:
    return shot_of(film(tmp_path_factory.mktemp("film"), [BODY], [TRUTH], CAMERAS), [BODY], [TRUTH], (0, 4, 8, 12))


def tracked_by(workers: int, shot: Shot, monkeypatch: pytest.MonkeyPatch) -> TrackResult:
    monkeypatch.setattr(worker_counts, "MIN_PARALLEL_WORK", 0)
    return tracker.track(replace(shot, settings=replace(shot.settings, threads=workers)))


make = segment_tracking.result_of_segments


def same(one: Motion, other: Motion) -> bool:
    return np.array_equal(one.translations, other.translations) and np.array_equal(one.rotations, other.rotations)


def test_one_and_two_processes_find_the_same_motion_to_the_last_bit(
    filmed: Shot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    alone, together = (tracked_by(n, filmed, monkeypatch) for n in (1, 2))
    assert same(alone.motions[0], together.motions[0])
    np.testing.assert_array_equal(alone.deviation[0], together.deviation[0])
    assert alone.footage_offset == together.footage_offset
    assert [s.energy for s in alone.segments] == [s.energy for s in together.segments]
    assert not list(tmp_path.iterdir())  # the frames that the processes shared are gone


@pytest.mark.parametrize("workers", [1, 2])
def test_what_is_known_once_all_is_solved_is_handed_out_before_all_is_refined(
    workers: int, filmed: Shot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With more than one worker; it is what the result says at last."""
    monkeypatch.setattr(worker_counts, "MIN_PARALLEL_WORK", 0)
    shot = replace(filmed, settings=replace(filmed.settings, threads=workers))
    found: list[SolvedShot] = []
    refined: list[int] = []

    def solved(pool: WorkerPool, known: SolvedShot) -> None:
        assert pool.workers == workers and not refined
        found.append(known)

    monkeypatch.setattr(segment_tracking, "result_of_segments", lambda *args: refined.append(1) or make(*args))
    result = tracker.track(shot, pictures=[0, 8], run=RunContext(solved=solved))
    assert len(found) == (workers > 1)
    for known in found:
        assert known.footage_offset == result.footage_offset
        assert [sorted(view) for view in known.pictures] == [[0, 8]] * len(shot.views)
        for early, late in zip(known.pictures, result.pictures, strict=True):
            assert all(early[frame] is late[frame] for frame in (0, 8))


def test_a_worker_that_is_killed_ends_the_tracking_with_a_message(
    filmed: Shot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pools: list[WorkerPool] = []

    def kept(workers: int, imports: Sequence[str]) -> WorkerPool:
        pools.append(WorkerPool(workers, imports))
        return pools[-1]

    def kill(_what: str, _fraction: float) -> bool:
        pools[0]._processes[0].kill()
        return True

    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(worker_counts, "MIN_PARALLEL_WORK", 0)
    monkeypatch.setattr(segment_tracking, "WorkerPool", kept)
    with pytest.raises(WorkerEndedError, match="ended unexpectedly"):
        tracker.track(replace(filmed, settings=replace(filmed.settings, threads=2)), kill)
    assert not list(tmp_path.iterdir())


def test_a_correction_solves_the_two_segments_beside_it_and_decodes_nothing(
    filmed: Shot, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory, decoded = WorkerMemory(), []
    frames_at = reader.frames_at

    def counted(view: View, frames: Sequence[int], *rest: Any, **options: Any) -> Iterator[np.ndarray]:
        for frame, image in zip(frames, frames_at(view, frames, *rest, **options), strict=True):
            decoded.append(frame)
            yield image

    def looked_at(view: View, *_: int) -> None:
        checked.append(view.camera.name)

    checked: list[str] = []
    monkeypatch.setattr(reader, "frames_at", counted)
    monkeypatch.setattr(shot_checks, "check_view", looked_at)
    whole = tracker.track(filmed, run=RunContext(memory=memory))
    assert len(decoded) == 2 * LENGTH and len(checked) == len(filmed.views)
    decoded.clear()
    checked.clear()
    excerpt = Excerpt(0, 8, (None, (whole.motions[0][[9]],)), whole.footage_offset)
    moved = corrected(filmed, 1, 0.01)
    [warm] = track_excerpts(moved, [excerpt], run=RunContext(memory=memory))
    assert not decoded and not checked and [(s.first, s.last) for s in warm.segments] == [(0, 4), (4, 8)]
    [cold] = track_excerpts(moved, [excerpt])
    assert decoded and same(warm.motions[0], cold.motions[0])


def test_the_views_of_a_segment_that_is_solved_alone_are_divided_among_processes_that_are_there(
    filmed: Shot, monkeypatch: pytest.MonkeyPatch
) -> None:
    shot, done_here = replace(filmed, settings=replace(filmed.settings, threads=2)), list[int]()
    whole, excerpt = tracker.track(filmed), Excerpt(0, 4)
    measured = segment_evidence.frame_evidence
    monkeypatch.setattr(segment_evidence, "frame_evidence", lambda *a, **k: done_here.append(1) or measured(*a, **k))
    [alone] = track_excerpts(shot, [excerpt], run=RunContext(memory=WorkerMemory()))
    of_all = len(done_here)
    done_here.clear()
    with closing(WorkerMemory()) as memory:
        memory.start_workers(2)
        [divided] = track_excerpts(shot, [excerpt], run=RunContext(memory=memory))
        assert 0 < len(done_here) < of_all
        assert same(alone.motions[0], divided.motions[0])
        np.testing.assert_array_equal(alone.deviation[0], divided.deviation[0])
        warm = replace(excerpt, footage_offset=0.0, earlier=(whole.motions[0][:5],))
        both = [track_excerpts(shot, [warm], run=RunContext(memory=m))[0] for m in (memory, WorkerMemory())]
        assert same(*(one.motions[0] for one in both))


def test_a_worker_that_is_killed_while_it_works_on_views_ends_the_tracking_with_a_message(filmed: Shot) -> None:
    shot = replace(filmed, settings=replace(filmed.settings, threads=2))

    def kill(_what: str, _fraction: float) -> bool:
        assert memory._pool is None, "in use"
        pools[0]._processes[0].kill()
        return True

    with closing(WorkerMemory()) as memory:
        memory.start_workers(2)
        pools = [memory._pool]
        with pytest.raises(WorkerEndedError, match="ended unexpectedly"):
            track_excerpts(shot, [Excerpt(0, 4)], kill, run=RunContext(memory=memory))


@pytest.mark.parametrize(("keys", "threads"), [((0, 20, 39, 59), None), ((10, 30), 2), ((0, 59), 4), ((20, 39), 1)])
def test_the_number_of_workers_follows_from_the_shot_file(
    keys: tuple[int, ...], threads: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker_counts, "worker_count", lambda given=None: given or 8)
    spec = read_shot_spec(Path(__file__).parents[3] / "examples/walk/shot.toml")
    for least in (1, 100_000):
        monkeypatch.setattr(worker_counts, "MIN_PARALLEL_WORK", least)
        posed = replace(spec.selected(keyframes=keys), settings=replace(spec.settings, threads=threads))
        shot = prepare_shot(posed)
        assert worker_counts.workers_for(posed) == worker_counts.workers_of(shot, threads or 8)
    assert worker_counts.workers_for(spec.selected(keyframes="auto")) == 1


@pytest.mark.parametrize("known", [False, True])
def test_footage_is_checked_once(known: bool, filmed: Shot, monkeypatch: pytest.MonkeyPatch) -> None:
    checked: list[View] = []
    monkeypatch.setattr(shot_checks, "check_view", lambda view, *_: checked.append(view))
    with shot_checks.footage_checked(filmed, RunContext(footage_checked=known)):
        pass
    assert len(checked) == (0 if known else len(filmed.views))


def test_the_rate_of_footage_that_has_not_changed_is_not_looked_up_again(
    filmed: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, memory, file = [], WorkerMemory(), tmp_path / "cam.mp4"
    file.write_bytes(b"video")
    view, rate = replace(filmed.views[0], footage=file), FootageRate(30.0, 0.0, 0)
    monkeypatch.setattr(reader, "footage_rate", lambda *of: asked.append(of) or rate)
    for changed in (False, False, True):
        if changed:
            os.utime(file, (1, 1))
        assert reader.kept_rate(filmed, view, memory) is rate
    assert len(asked) == 2


def test_frames_of_footage_that_has_changed_are_decoded_again(filmed: Shot, tmp_path: Path) -> None:
    file = tmp_path / filmed.views[0].footage.name
    shutil.copytree(filmed.views[0].footage.parent, tmp_path, dirs_exist_ok=True)
    view = replace(filmed.views[0], footage=file)
    before = made_of(view, 1.0)
    assert before == made_of(view, 1.0)
    os.utime(next(iter((image_files(file) or {0: file}).values())), (1, 1))
    assert before != made_of(view, 1.0)


def corrected(shot: Shot, key: int, metres: float) -> Shot:
    """The shot with one key pose moved to the side."""
    performer = shot.performers[0]
    step = np.zeros((len(performer.key_poses.frames), BODY.dof))
    step[key, :3] = metres
    keys = replace(performer.key_poses, poses=performer.key_poses.poses.moved(step))
    return replace(shot, performers=(replace(performer, key_poses=keys),))


def test_after_a_correction_solving_begins_with_the_motion_that_there_is(filmed: Shot) -> None:
    """It comes to the same motion as from the beginning, in fewer iterations."""
    wrong = tracker.track(corrected(filmed, 1, 0.02)).motions[0]
    excerpt = Excerpt(0, 8, (None, (wrong[[9]],)), 0.0)
    [cold] = track_excerpts(filmed, [excerpt])
    [warm] = track_excerpts(filmed, [replace(excerpt, earlier=(wrong[:9],))])
    names = list(BODY.landmarks)
    places = [landmark_positions(BODY, r.motions[0], names) for r in (cold, warm)]
    truth = landmark_positions(BODY, TRUTH[:9], names)
    errors = [np.linalg.norm(p - truth, axis=-1).mean() for p in places]
    assert errors[1] < max(1.1 * errors[0], errors[0] + 0.001)
    assert all(b.iterations < a.iterations for a, b in zip(cold.segments, warm.segments, strict=True))
    keys = filmed.performers[0].key_poses
    np.testing.assert_array_equal(warm.motions[0].rotations[[0, 4, 8]], keys.poses.rotations[:3])


def test_if_the_footage_offset_is_to_be_measured_tracking_ignores_the_earlier_motion(filmed: Shot) -> None:
    excerpt = Excerpt(0, 8, (None, (TRUTH[[9]],)))
    [cold] = track_excerpts(filmed, [excerpt])
    [again] = track_excerpts(filmed, [replace(excerpt, earlier=(TRUTH[:9],))])
    assert same(cold.motions[0], again.motions[0]) and cold.footage_offset == again.footage_offset


def test_a_motion_that_leaves_a_doubt_is_not_begun_with(filmed: Shot) -> None:
    astray = TRUTH[:9].moved(np.sin(np.arange(9) * np.pi / 4)[:, None] * np.full(BODY.dof, 1.0))
    excerpt = Excerpt(0, 8, (None, (TRUTH[[9]],)), 0.0)
    [cold] = track_excerpts(filmed, [excerpt])
    [warm] = track_excerpts(filmed, [replace(excerpt, earlier=(astray,))])
    assert same(cold.motions[0], warm.motions[0])
