"""Small balls of the L-frame before boards in the range of its colour, among red books; the takes are drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.calibration.balls.ball_detection import Picture, find_spots
from kfmocap.core.calibration.lframe.lframe_markers import find_lframe
from kfmocap.core.calibration.lframe.lframe_matching import identified_together
from kfmocap.core.calibration.solving.camera_rig import rig_of
from kfmocap.core.capture.capture_videos import CaptureVideos, CaptureVideoView
from kfmocap.core.capture.colours import Colour, parsed
from render.drawn_takes import HARDSHIPS, drawn_take
from render.waving import WandTake, lframe_pictures
from render_wand import write_video

RED = parsed("red", "lframe colour")
MOST = 20


def pictures_of(take: WandTake, camera: int) -> list[np.ndarray]:
    return list(lframe_pictures(replace(take, lframe_frames=4), camera))


@pytest.mark.parametrize(("seed", "hardship"), [(51, "usual"), (52, "dim")])
def test_balls_are_spots_before_boards_in_the_range_of_their_colour(seed, hardship):
    take = drawn_take(seed, HARDSHIPS[hardship])
    for k, camera in enumerate(take.cameras[:2]):
        still = Picture.of(np.mean(pictures_of(take, k), axis=0).round().astype(np.uint8))
        spots = find_spots(still, RED, MOST)
        apart = np.linalg.norm(spots.centres[:, None] - camera.project(take.lframe_points), axis=-1)
        assert apart.min(axis=0).max() < 2.0
        assert len(spots) < MOST  # books are longer than wide, boards no redder than their neighbours


@pytest.mark.parametrize("seed", [13, 53])
def test_all_views_tell_the_lframe_before_boards_in_the_range_of_its_colour(seed, tmp_path: Path):
    drawn = drawn_take(seed, HARDSHIPS["usual"])
    take = replace(drawn, cameras=drawn.cameras[:3], offsets=drawn.offsets[:3])
    views = []
    for k, camera in enumerate(take.cameras):
        video = tmp_path / f"{camera.name}.avi"
        write_video(video, pictures_of(take, k), take.fps, camera.size)
        views.append(CaptureVideoView(camera.name, video, video))
    videos = CaptureVideos(take.lframe_points, RED, 0.035, take.length, (RED, RED), 0.03, tuple(views))
    seen = [find_lframe(view, videos, take.cameras[0].size).candidates.centres for view in views]
    told = identified_together(rig_of(list(take.cameras)), seen, take.lframe_points)
    assert told is not None
    for camera, own, points in zip(take.cameras, told, seen, strict=True):
        assert (own >= 0).all()
        assert np.linalg.norm(points[own] - camera.project(take.lframe_points), axis=1).max() < 2.0


def test_there_are_no_spots_of_any_hue():
    assert len(find_spots(Picture.of(np.full((60, 60, 3), 90, np.uint8)), Colour(), MOST)) == 0


def test_the_purest_of_a_range_that_passes_through_red_is_red():
    np.testing.assert_allclose(Colour(hue=(340.0, 20.0)).pure(), [0, 0, 1])
    np.testing.assert_allclose(Colour(hue=(100.0, 140.0)).pure(), [0, 1, 0], atol=0.02)
