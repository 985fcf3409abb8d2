"""Interlaced videos are told from others."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from kfmocap.core.calibration.balls.ball_detection import background_of
from kfmocap.core.shot.interlacing import FieldWatch, shows_two_fields
from render.drawing import Canvas
from render.drawn_takes import HARDSHIPS, drawn_take
from render.waving import SensorNoise

TAKE = replace(drawn_take(3, HARDSHIPS["usual"]), distractors=True)
CAMERA = TAKE.cameras[0]


@cache
def canvas() -> Canvas:
    """The empty room, which takes a second to paint."""
    return Canvas(CAMERA)


def pictures(fields: int, speed: float) -> list[np.ndarray]:
    """Frames as Motion JPEG keeps them, whole or woven of two fields, of somebody who waves a wand."""
    take, sensor, images = replace(TAKE, speed=speed), SensorNoise(CAMERA.size, 1), []
    for k in range(8):
        parts = []
        for field in range(fields):
            moments = k / 2 + (field + np.linspace(0.05, 0.95, 6)) / (30 * fields)
            parts.append(sensor.record(canvas().drawn(take.wand_things(moments))))
        image = parts[0].copy()
        image[1::2] = parts[-1][1::2]
        images.append(cv2.imdecode(cv2.imencode(".jpg", image)[1], cv2.IMREAD_COLOR))
    return images


@pytest.mark.parametrize("speed", [1.0, 1.8])
def test_fields_that_are_woven_are_seen_where_something_moves(speed):
    for fields, interlaced in ((1, False), (2, True)):
        images = pictures(fields, speed)
        assert shows_two_fields(images, background_of(images)) == interlaced


def test_a_room_in_which_nothing_moves_says_nothing():
    images = [SensorNoise(CAMERA.size, seed).record(canvas().drawn([])) for seed in range(5)]
    assert not shows_two_fields(images, background_of(images))


@pytest.mark.parametrize(("fields", "interlaced"), [(1, False), (2, True)])
def test_frames_that_are_given_one_by_one_show_their_fields_though_the_room_has_stripes_as_fine(fields, interlaced):
    watch, stripes = FieldWatch(), np.zeros((CAMERA.size[1], CAMERA.size[0], 3), np.uint8)
    stripes[1:200:2] = 60
    for k, image in enumerate(pictures(fields, 1.0)):
        watch.add(cv2.add(cv2.convertScaleAbs(image, alpha=0.75), stripes), 10 * k)
    assert watch.interlaced == interlaced


def test_grain_is_not_taken_for_fields():
    watch, chance = FieldWatch(), np.random.default_rng(4)
    for k in range(4):
        grain = chance.normal(0, 1, (240, 320, 3)) * np.linspace(10, 60, 320)[:, None]
        watch.add(np.clip(120 + grain, 0, 255).astype(np.uint8), 10 * k)
    assert not watch.interlaced
