"""Small balls measured again where a solution expects them, on rendered pictures whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from kfmocap.core.calibration.remeasure import remeasured, with_lframes_remeasured
from kfmocap.core.calibration.solving.camera_rig import rig_of
from kfmocap.core.calibration.solving.wand_motion import Wand
from kfmocap.core.calibration.video_markers import SeenBalls, SeenView, VideoMarkers
from kfmocap.core.capture.capture import Markers
from kfmocap.core.formats.wand_toml import load_wand
from kfmocap.core.shot.footage import probe
from render.drawing import Canvas, Rod
from render.drawn_takes import VGA_CAMERAS, vga_take
from render.waving import PAINT, SensorNoise
from render_wand import write_take, write_video

FRAMES = 20
TAKE = replace(vga_take(), cameras=VGA_CAMERAS[:1], offsets=(0.0,), frames=FRAMES, lframe_frames=3)
CAMERA = TAKE.cameras[0]


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> VideoMarkers:
    """As the first look finds them: aside, towards the light, and on every other frame only."""
    videos = load_wand(write_take(TAKE, tmp_path_factory.mktemp("wand")))
    found = np.arange(0, FRAMES, 2)
    wand = TAKE.truth(0)[found] + [0.15, -0.3]
    lframe = CAMERA.project(TAKE.lframe_points)[None] + [-0.3, -0.4]
    view = SeenView(
        videos.views[0],
        probe(videos.views[0].wand),
        SeenBalls(Markers(np.zeros(1, int), lframe, np.full((1, 4), 0.15)), np.full((1, 4), 2.4)),
        SeenBalls(Markers(found, wand, np.full((len(found), 2), 0.2)), np.full((len(found), 2), 1.8)),
    )
    return VideoMarkers(videos, (view,))


@pytest.fixture(scope="module")
def again(before: VideoMarkers) -> VideoMarkers:
    return remeasured(before, true_solution())


def true_solution() -> SimpleNamespace:
    frames = np.arange(0, FRAMES, 2)
    ends = TAKE.wand(frames / TAKE.fps)
    across = (ends[:, 0] - ends[:, 1]) / TAKE.length
    wand = Wand(frames, ends.mean(axis=1), across, TAKE.length)
    return SimpleNamespace(rig=rig_of([CAMERA]), wand=wand, lframe_world=TAKE.lframe_points)


def without_lframe(found: VideoMarkers) -> VideoMarkers:
    """The same where the first look did not find the L-frame."""
    nothing = np.zeros((0, 4))
    lframe = SeenBalls(Markers(np.zeros(0, int), np.zeros((0, 4, 2)), nothing), nothing)
    return replace(found, views=(replace(found.views[0], lframe=lframe),))


def test_balls_of_the_wand_are_measured_on_all_frames_to_a_tenth_of_a_pixel_across_the_rod(before, again):
    markers = again.views[0].wand.corrected(CAMERA.matrix, CAMERA.distortions)
    truth = TAKE.truth(0)[markers.frames]
    rod = truth[:, ::-1] - truth
    rod /= np.linalg.norm(rod, axis=-1, keepdims=True)
    off = markers.points - truth
    across = off[..., 1] * rod[..., 0] - off[..., 0] * rod[..., 1]
    assert len(markers) > 1.6 * len(before.views[0].wand.markers)
    assert np.sqrt(np.mean(across**2)) < 0.08
    assert np.sqrt(np.mean(off**2)) < 0.2
    assert np.abs(off.mean(axis=(0, 1))).max() < 0.12


def test_balls_of_the_lframe_are_measured_to_a_quarter_of_a_pixel(again):
    markers = again.views[0].lframe.corrected(CAMERA.matrix, CAMERA.distortions)
    np.testing.assert_allclose(markers.points[0], CAMERA.project(TAKE.lframe_points), atol=0.25)


def test_the_lframe_measured_by_a_better_solution_is_nearer(before):
    """A short arm that the first solution takes to rise by three degrees draws its ball along with it."""
    first = true_solution()
    first.lframe_world = TAKE.lframe_points + np.outer([0, 0, 0, 1], [0, 0, 0.012])
    rough = remeasured(before, first)
    assert off_short_arm(rough) > 2 * off_short_arm(with_lframes_remeasured(rough, true_solution()))


def off_short_arm(found: VideoMarkers) -> float:
    """How far aside of the short arm its ball lies, pixels."""
    markers = found.views[0].lframe.corrected(CAMERA.matrix, CAMERA.distortions)
    corner, *_, ball = CAMERA.project(TAKE.lframe_points)
    along, off = (ball - corner) / np.linalg.norm(ball - corner), markers.points[0, 3] - ball
    return float(abs(along[0] * off[1] - along[1] * off[0]))


def test_balls_of_the_lframe_that_the_first_look_missed_are_found_where_they_are_expected(before):
    solution = true_solution()
    solution.lframe_world = TAKE.lframe_points + [0.005, -0.005, 0.0]
    seen = remeasured(without_lframe(before), solution).views[0].lframe
    markers = seen.corrected(CAMERA.matrix, CAMERA.distortions)
    np.testing.assert_allclose(markers.points[0], CAMERA.project(TAKE.lframe_points), atol=0.25)


def test_a_ball_of_the_lframe_that_is_covered_is_not_found_and_its_others_are(before, tmp_path):
    """A table's leg stands before the short arm's ball."""
    ball = TAKE.lframe_points[3]
    towards = CAMERA.centre_world() - ball
    leg = ball + 0.2 * towards / np.linalg.norm(towards)
    things = [*TAKE.lframe_things(), Rod((leg - [0, 0, 0.15])[None], (leg + [0, 0, 0.1])[None], 0.05, PAINT["cloth"])]
    picture = SensorNoise(CAMERA.size, 7).record(Canvas(CAMERA).drawn(things))
    video = tmp_path / "covered.avi"
    write_video(video, [picture] * 3, TAKE.fps, CAMERA.size)
    found = without_lframe(before)
    [view] = found.views
    found = replace(found, views=(replace(view, videos=replace(view.videos, lframe=video)),))
    points = remeasured(found, true_solution()).views[0].lframe.markers.points[0]
    assert np.isfinite(points).all(axis=1).tolist() == [True, True, True, False]


def test_large_balls_keep_their_outlines(before):
    videos = replace(before.videos, wand_diameter=0.3, lframe_diameter=0.3)
    found = replace(before, videos=videos)
    frames = np.arange(0, FRAMES, 2)
    wand = Wand(frames, np.zeros((len(frames), 3)), np.tile([1.0, 0, 0], (len(frames), 1)), 0.5)
    solution = SimpleNamespace(rig=rig_of([CAMERA]), wand=wand, lframe_world=TAKE.lframe_points)
    assert remeasured(found, solution).views[0] is found.views[0]
