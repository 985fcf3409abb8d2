"""Small balls are where a model of their image puts them, whatever lights, hides or smears them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from kfmocap.core.calibration.balls import ball_images
from kfmocap.core.calibration.balls.ball_appearance import BallAppearance, BallGuess
from kfmocap.core.calibration.balls.ball_images import fit_ball
from render.drawing import Canvas
from render.drawn_takes import HARDSHIPS, drawn_take
from render.waving import lframe_pictures

SIZE = 31
FINE = 12  # rays across each pixel
RED, WOOD = np.array([0.01, 0.01, 0.6]), np.array([0.03, 0.035, 0.04])
GUESS = BallGuess(np.array([15.0, 15.0]), 2.3)


def pictures(centre, radius=2.3, *, path=(0.0, 0.0), rod=None, light=(0.0, -0.8, -0.6)):
    """A ball, lit from one side, on a striped floor, and the floor alone: levels, shapes (31, 31, 3)."""
    v, u = (np.indices((SIZE * FINE, SIZE * FINE)) + 0.5) / FINE - 0.5
    stripes = 0.35 + 0.15 * np.sin(0.9 * u + 0.3 * v)
    floor = stripes[..., None] * [0.8, 0.9, 1.0]
    total = np.zeros_like(floor)
    for moment in np.linspace(-0.5, 0.5, 21):
        x, y = u - centre[0] - moment * path[0], v - centre[1] - moment * path[1]
        image = floor.copy()
        if rod is not None:
            image[(np.abs(x * rod[1] - y * rod[0]) < 0.6) & (x * rod[0] + y * rod[1] > 0)] = WOOD
        inside = x**2 + y**2 < radius**2
        normal = np.stack([x, y, -np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0))], axis=-1) / radius
        shade = 0.35 + 0.65 * np.clip(normal @ np.asarray(light), 0, 1)
        image[inside] = (shade[..., None] * RED)[inside]
        total += image / 21
    return [recorded(image) for image in (total, floor)]


def recorded(light):
    pixels = light.reshape(SIZE, FINE, SIZE, FINE, 3).mean(axis=(1, 3))
    levels = 255 * cv2.GaussianBlur(pixels, (0, 0), 0.4) ** (1 / 2.2)
    return np.clip(levels + np.random.default_rng(5).normal(0, 1.0, levels.shape), 0, 255)


@pytest.mark.parametrize("centre", [(15.0, 15.0), (15.4, 14.7)])
def test_a_ball_that_is_lit_from_above_is_measured_where_it_is(centre):
    image, floor = pictures(centre)
    ball = fit_ball(image, floor, GUESS)
    np.testing.assert_allclose(ball.centre, centre, atol=0.06)
    assert ball.explained > 0.95
    assert np.linalg.norm(ball.centre - centre) < 3 * ball.sigma


def test_a_ball_that_moved_is_measured_in_the_middle_of_the_exposure():
    centre, path = np.array([15.2, 14.9]), np.array([3.0, -2.0])
    image, floor = pictures(centre, path=path)
    ball = fit_ball(image, floor, replace(GUESS, path=0.7 * path))
    np.testing.assert_allclose(ball.centre, centre, atol=0.12)
    assert np.linalg.norm(ball.path - path) < 0.25 * np.linalg.norm(path)


def test_a_rod_does_not_pull_the_ball_and_makes_it_less_certain_along_its_own_direction():
    centre, rod = np.array([15.1, 15.2]), np.array([0.8, 0.6])
    image, floor = pictures(centre, rod=rod)
    ball = fit_ball(image, floor, replace(GUESS, rods=rod[None], starts=np.ones(1)))
    off = ball.centre - centre
    assert abs(off @ [-rod[1], rod[0]]) < 0.06 and abs(off @ rod) < 0.15
    assert abs(ball.elongation @ rod) > 0.95 * np.linalg.norm(ball.elongation) > 0.3


def test_a_background_that_has_changed_is_replaced_by_what_lies_around_the_ball():
    image, floor = pictures((15.0, 15.0))
    ball = fit_ball(image, 255 - floor, GUESS)
    np.testing.assert_allclose(ball.centre, 15.0, atol=0.3)


def test_where_there_is_no_ball_none_explains_the_picture():
    _, floor = pictures((15.0, 15.0))
    ball = fit_ball(floor + 2.0, floor, replace(GUESS, light=RED))
    assert ball.explained < 0.5
    assert fit_ball(floor, floor, replace(GUESS, centre=np.array([3.0, 15.0]))) is None


def test_colour_that_is_kept_for_every_other_pixel_alone_shifts_a_resting_ball_little(monkeypatch):
    def off():
        misses = []
        for k in range(12):
            centre = 15.0 + np.array([0.3 * (k % 4), 0.4 * (k // 4)])
            image, floor = pictures(centre, light=(0.0, 0.0, -1.0))
            stored = cv2.imencode(".jpg", image.round().astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 95])[1]
            ball = fit_ball(cv2.imdecode(stored, cv2.IMREAD_COLOR), floor, replace(GUESS, centre=centre.round()))
            misses.append(ball.centre - centre)
        return np.sqrt(np.mean(np.square(misses)))

    now = off()
    monkeypatch.setattr(ball_images, "_COMPARED", np.eye(3))
    assert now < 0.1 and now < off()


def test_balls_of_an_lframe_are_measured_better_by_how_they_look_all():
    """A rod before a ball hides what would tell the light's side from the ball's place: other balls tell it."""
    take = replace(drawn_take(55, HARDSHIPS["usual"]), lframe_frames=1)
    arms = {0: (1, 3), 1: (0, 2), 2: (1,), 3: (0,)}
    off = []
    for k, camera in enumerate(take.cameras[:2]):
        [image] = lframe_pictures(take, k)
        floor = 255 * (np.array(take.light) * Canvas(camera, take.still_things()).drawn([])) ** (1 / 2.2)
        places_cam = take.lframe_points @ camera.R_cam_world[0].T + camera.t_cam_world[0]
        pixels, guesses = camera.project(take.lframe_points), []
        for ball, others in arms.items():
            ways = pixels[list(others)] - pixels[ball]
            along, place = places_cam[list(others)] - places_cam[ball], places_cam[ball]
            nearer = -along @ place / (np.linalg.norm(along, axis=1) * np.linalg.norm(place))
            starts = np.where(nearer > 0, np.sqrt(1 - nearer**2), 1.0)
            radius = camera.matrix[0, 0] * 0.0175 / place[2]
            rods = ways / np.linalg.norm(ways, axis=1, keepdims=True)
            guesses.append(BallGuess(pixels[ball], radius, rods=rods, starts=starts))
        alone = [fit_ball(image, floor, guess) for guess in guesses]
        appearance = BallAppearance.common([ball.appearance for ball in alone])
        alike = [fit_ball(image, floor, replace(guess, appearance=appearance)) for guess in guesses]
        off.append([[ball.centre for ball in balls] - pixels for balls in (alone, alike)])
    alone_off, alike_off = np.sqrt(np.mean(np.square(off), axis=(0, 2, 3)))
    assert alike_off < 0.95 * alone_off
