"""Pairs of frames that do not continue each other are named in whichever segment and view they are, and keypoints that
were found in other frames.
"""

from __future__ import annotations

import pickle
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any, cast

import cv2
import numpy as np
import pytest
from kfmocap.core.body.kinematics import part_poses, tip_positions
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.keypoints.keypoint_delay import frames_off_by_view
from kfmocap.core.keypoints.keypoint_rays import Keypoints
from kfmocap.core.runtime.processes.worker_memory import WorkerMemory
from kfmocap.core.runtime.timing import Seconds
from kfmocap.core.shot.footage_faults.continuity import block_change
from kfmocap.core.shot.shot import View
from kfmocap.core.tracking.footage_reading import reader
from kfmocap.core.tracking.footage_reading.picture_store import StoredView
from kfmocap.core.tracking.footage_reading.segment_footage import ReadingResources, SegmentFootage
from kfmocap.core.tracking.solvers.registry import solver_named
from synthetic import CAMERAS, figure, look_at, shot_of, swing
from synthetic import film as pictured
from walking_film import FRAMES, film

SIZE = (320, 184)
BODY = figure()
TRUTH = swing(BODY, FRAMES)


def view(folder: Path, name: str, frames: np.ndarray) -> View:
    (folder / name).mkdir()
    for f, grey in enumerate(frames):
        cv2.imwrite(str(folder / name / f"{f:03d}.png"), cv2.merge([grey] * 3))
    return View(look_at(name, (0.5, -2.8, 1.5), size=SIZE), folder / name / "%03d.png")


@pytest.mark.parametrize("keys", [(0, FRAMES - 1), (0, 6, FRAMES - 1), (0, 7, FRAMES - 1), (0, 8, FRAMES - 1)])
def test_a_frame_that_is_missing_in_one_view_gets_no_weight_there(tmp_path: Path, keys: tuple[int, ...]) -> None:
    views = [view(tmp_path, "left", film(3.0)), view(tmp_path, "right", film(3.0, moved=1, seed=2))]
    shot = shot_of(views, [BODY], [TRUTH], keys)
    footage = SegmentFootage(shot, solver_named("relaxation"), ())
    parts = list(footage.by_segment([TRUTH], (), Seconds()))
    assert footage.torn == ([], [FRAMES // 2])
    torn = np.concatenate([part[1].opened().torn if hasattr(part[1], "opened") else part[1].torn for part in parts])
    assert np.flatnonzero(torn).tolist() == [FRAMES // 2 - 1]


def test_how_much_frames_change_is_measured_once_for_several_jobs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    views = [view(tmp_path, "left", film(3.0)), view(tmp_path, "right", film(3.0, moved=1, seed=2))]
    shot = shot_of(views, [BODY], [TRUTH], (0, 7, FRAMES - 1))
    compared: list[int] = []
    monkeypatch.setattr(reader, "block_change", lambda *of: compared.append(1) or block_change(*of))

    def torn(memory: WorkerMemory | None) -> tuple[list[int], ...]:
        footage = SegmentFootage(shot, solver_named("relaxation"), (), ReadingResources(memory=memory))
        list(footage.by_segment([TRUTH], (), Seconds()))
        return footage.torn

    memory = WorkerMemory()
    assert torn(memory) == torn(memory) == torn(None) == ([], [FRAMES // 2])
    assert len(compared) == 2 * 2 * (FRAMES - 1), "of two views, with the memory once, and once without"


def test_keypoints_found_in_other_frames_are_measured_over_all_segments(tmp_path: Path) -> None:
    """Their numbers are one too high."""
    seen = swing(BODY, 33, size=1.5)
    views = [replace(view, keypoints=tmp_path) for view in pictured(tmp_path, [BODY], [seen], CAMERAS)]
    shot = shot_of(views, [BODY], [seen], (0, 16, 32))
    tips = tip_positions(BODY, part_poses(BODY, seen))[np.r_[0, :32]]
    poses = [np.stack([view.camera.poses(0, 33)[k] for view in views]) for k in (0, 1)]
    placed = np.einsum("vfab,flb->vfla", poses[0], tips) + poses[1][:, :, None]
    rays = placed[..., :2] / placed[..., 2:]
    keypoints = Keypoints(BODY.names, rays, np.ones(rays.shape[:3]), *poses)
    footage = SegmentFootage(shot, solver_named("gauss-newton"), (), keypoints=[keypoints])
    list(footage.by_segment([seen], (), Seconds()))
    assert frames_off_by_view(footage.movements) == pytest.approx((-1.0, -1.0), abs=0.2)


class Pool:
    """Two workers, of which neither takes what waits for it until it is told to."""

    workers = 2

    def __init__(self) -> None:
        self.waiting: list[tuple[Any, Future[Any]]] = []

    def submit(self, work: Any, _progress: object) -> Future[Any]:
        self.waiting.append((pickle.loads(pickle.dumps(work)), Future()))
        return self.waiting[-1][1]


def test_workers_make_the_foreground_images_that_the_threads_that_read_would_make(tmp_path: Path) -> None:
    shot = shot_of(pictured(tmp_path, [BODY], [TRUTH], CAMERAS), [BODY], [TRUTH], (0, FRAMES - 1))
    solver, pool = solver_named("gauss-newton"), Pool()
    [alone] = SegmentFootage(shot, solver, ()).by_segment([TRUTH], (), Seconds())
    (tmp_path / "files").mkdir()
    footage = SegmentFootage(shot, solver, (), ReadingResources(tmp_path / "files", cast(Any, pool)))
    with ThreadPoolExecutor() as thread:
        reading = thread.submit(list, footage.by_segment([TRUTH], (), Seconds()))
        for number in range(len(shot.views)):
            while len(pool.waiting) <= number:
                time.sleep(0.01)
            work, made = pool.waiting[number]
            made.set_result(work())
        [shared] = reading.result()
    for own, other in zip(alone, shared, strict=True):
        assert isinstance(own, ViewFrames) and own.foreground is not None
        assert isinstance(other, StoredView) and other.frames.colours is not None
        np.testing.assert_array_equal(own.foreground, other.opened().foreground)


def test_reading_that_is_stopped_does_not_wait_for_workers(tmp_path: Path) -> None:
    shot = shot_of(pictured(tmp_path, [BODY], [TRUTH], CAMERAS), [BODY], [TRUTH], (0, 6, FRAMES - 1))
    (tmp_path / "files").mkdir()
    pool = Pool()
    resources = ReadingResources(tmp_path / "files", cast(Any, pool))
    footage = SegmentFootage(shot, solver_named("gauss-newton"), (), resources).by_segment([TRUTH], (), Seconds())
    done = Event()

    def make() -> None:  # those of the first segment alone
        made = 0
        while not done.wait(0.01):
            while made < min(len(pool.waiting), len(shot.views)):
                work, result = pool.waiting[made]
                result.set_result(work())
                made += 1

    with ThreadPoolExecutor() as thread:
        making = thread.submit(make)
        try:
            next(footage)
            while len(pool.waiting) < 2 * len(shot.views):  # those of the second are begun before it is asked for
                time.sleep(0.01)
            footage.close()
        finally:
            done.set()
        making.result()
    assert all(result.cancelled() for _, result in pool.waiting[len(shot.views) :])
