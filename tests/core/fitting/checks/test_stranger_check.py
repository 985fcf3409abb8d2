"""Who moves beside the performers is named, and what hangs on the wall or stands there is not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from kfmocap.core.fitting.checks.picture_findings import Strangers
from kfmocap.core.fitting.checks.posed_views import PosedView, posed_views
from kfmocap.core.fitting.checks.stranger_check import strangers_in
from kfmocap.core.fitting.key_frame_views import pictured_key_frames
from kfmocap.core.fitting.shot_cameras import checked_frames, fit_by_key_poses
from kfmocap.core.shot.footage import frames_at
from kfmocap.core.shot.shot import Shot, View
from synthetic import figure, film, look_at, shot_of, swing

BODY = figure()
TRUTH = swing(BODY, 16, size=0.9)[::4]
FRONT, SIDE = look_at("front", (0.5, -2.8, 1.5)), look_at("side", (-2.4, -1.4, 1.3))


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Shot:
    views: list[View] = film(tmp_path_factory.mktemp("film"), [BODY], [TRUTH], [FRONT, SIDE])
    return shot_of(views, [BODY], [TRUTH], range(len(TRUTH)))


def posed(shot: Shot, way: float, light: float | None = None) -> list[PosedView]:
    """With somebody at the left edge of the front view, who goes by so many pixels a frame, or other light there."""
    frames = checked_frames(shot)
    pictures = [dict(zip(frames, frames_at(view, frames, 1.0, grey=False), strict=True)) for view in shot.views]
    for frame, image in pictures[0].items():
        height, width = image.shape[:2]
        place = (round(0.14 * width + way * frame), height // 2)
        shown = image.copy()
        cv2.ellipse(shown, place, (width // 7, height // 2), 0, 0, 360, (20, 60, 40), -1)
        there = (shown != image).any(axis=-1)
        image[there] = shown[there] if light is None else np.round(light * image[there])
    return posed_views(shot, pictured_key_frames(shot, np.array(frames), pictures), np.array(frames))


def test_who_passes_is_named_in_the_view_that_shows_it(shot: Shot) -> None:
    views = posed(shot, way=-0.4 * FRONT.size[0])
    [found] = strangers_in(views, ())
    assert (found.camera, found.frame) == ("front", 0)
    assert "moves beside the performers" in found.summary and "frame 0" in found.brief
    assert strangers_in(views, {"front"}) == []  # something else explains it


@pytest.mark.parametrize("light", [0.5, 1.5])
def test_shadows_and_patches_of_light_are_not_named(shot: Shot, light: float) -> None:
    assert strangers_in(posed(shot, way=-0.4 * FRONT.size[0], light=light), ()) == []


def test_what_stands_still_is_not_named(shot: Shot) -> None:
    assert strangers_in(posed(shot, way=0.0), ()) == []
    assert not any(isinstance(own, Strangers) for own in fit_by_key_poses(shot))
