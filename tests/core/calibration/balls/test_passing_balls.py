"""Small balls that pass before a known background: found in dim light and as pale streaks, and nothing else is."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from kfmocap.core.calibration.balls.ball_detection import Picture, background_of, find_balls
from kfmocap.core.calibration.balls.passing_balls import Backdrop, BallSample, PassingBalls, PassingFrame
from kfmocap.core.calibration.wand_detection import WandAppearance, find_pairs
from kfmocap.core.capture.colours import parsed
from render.drawing import Ball, Canvas, Rod
from render.waving import PAINT, SensorNoise
from synthetic import look_at

SIZE = (480, 270)
CAMERA = replace(
    look_at("cam", (0.0, -3.0, 1.2), (0.0, 0.0, 1.0), SIZE, 430.0), distortions=np.array([-0.1, 0, 0, 0.0])
)
DIM, NOISE = 0.55, 4.0
COLOURS = ("green", "blue")


@pytest.fixture(scope="module")
def canvas() -> Canvas:
    return Canvas(CAMERA)


def filmed(canvas: Canvas, things: list[Ball | Rod], seed: int, light: float = DIM) -> np.ndarray:
    """In dim light with much noise, as Motion JPEG keeps it."""
    image = SensorNoise(SIZE, seed, NOISE).record(np.float32(light) * canvas.drawn(things))
    return cv2.imdecode(cv2.imencode(".jpg", image)[1], cv2.IMREAD_COLOR)


def waved(seed: int, path: float) -> tuple[list[Ball | Rod], np.ndarray]:
    """A wand of two balls, 30 mm wide, and a dark rod, that move by `path` metres during the exposure; their pixels."""
    rng = np.random.default_rng([seed, 3])
    middle = np.array([rng.uniform(-0.5, 0.5), rng.uniform(-0.3, 0.3), rng.uniform(0.7, 1.5)])
    half, way = rng.normal(size=(2, 3)) * [1, 0.4, 1]
    half *= 0.25 / np.linalg.norm(half)
    way *= path / np.linalg.norm(way)
    moments = np.linspace(-0.5, 0.5, 15)[:, None] * way
    ends = [middle + half, middle - half]
    balls = [Ball(end + moments, 0.015, PAINT[colour]) for end, colour in zip(ends, COLOURS, strict=True)]
    rod = Rod(ends[0] - 0.06 * half + moments, ends[1] + 0.06 * half + moments, 0.004, PAINT["wood"])
    return [*balls, rod], CAMERA.project(np.array(ends))


@pytest.fixture(scope="module")
def appearance(canvas: Canvas) -> WandAppearance:
    """Learned from frames on which the wand moves slowly or fast."""
    images = [filmed(canvas, waved(seed, 0.01 + 0.01 * (seed % 4))[0], seed) for seed in range(24)]
    learned = WandAppearance.learned(images, [parsed(colour, "here") for colour in COLOURS])
    assert None not in learned.passing
    return learned


def even(image: np.ndarray) -> np.ndarray:
    return Picture.of(image).even


def compared(appearance: WandAppearance, image: np.ndarray) -> PassingFrame:
    return appearance.backdrop.frame(even(image))


@pytest.mark.parametrize("light", [DIM, 0.75 * DIM, 1.2 * DIM])
def test_streaks_three_balls_long_are_found_in_dim_light_whatever_the_exposure(canvas, appearance, light):
    alone, found, errors, sigmas, others = 0, 0, [], [], 0
    for seed in range(100, 120):
        things, pixels = waved(seed, 0.1)
        image = filmed(canvas, things, seed, light)
        for colour, passing, true in zip(COLOURS, appearance.passing, pixels, strict=True):
            balls = find_balls(Picture.of(image, appearance.background), parsed(colour, "here"))
            alone += bool((np.linalg.norm(balls.centres - true, axis=1) < 2).any())
            brought_out = passing.find(compared(appearance, image))
            off = np.linalg.norm(brought_out.centres - true, axis=1)
            others += int((off > 4).sum())
            if (off < 2).any():
                found += 1
                errors.append(off.min())
                sigmas.append(brought_out.sigma[off.argmin()])
    assert found >= 32 > 2 * alone
    assert others <= 4
    assert np.median(errors) < 0.8
    assert 0.5 < np.sqrt(np.mean((np.array(errors) / sigmas) ** 2) / 2) < 2


def test_rods_shadows_and_noise_are_not_taken_for_balls(canvas, appearance):
    for seed in range(200, 208):
        things, _ = waved(seed, 0.05)
        shadow = np.float32(1) - 0.2 * (np.indices(SIZE[::-1])[1] > 30 * (seed - 195)).astype(np.float32)
        light = np.float32(DIM) * shadow[..., None] * canvas.drawn([things[2]])
        image = SensorNoise(SIZE, seed, NOISE).record(light)
        assert sum(len(passing.find(compared(appearance, image)).centres) for passing in appearance.passing) == 0


def test_a_wand_is_found_as_a_pair(canvas, appearance):
    right = 0
    for seed in range(300, 312):
        things, pixels = waved(seed, 0.08)
        pairs = find_pairs(filmed(canvas, things, seed), [parsed(c, "here") for c in COLOURS], 0.5 / 0.03, appearance)
        off = np.linalg.norm(pairs.centres - pixels, axis=-1).max(axis=1)
        right += bool((off < 2.5).any())
    assert right >= 10


def test_too_few_samples_or_large_ones_teach_nothing(canvas):
    images = [even(filmed(canvas, [], seed)) for seed in range(5)]
    backdrop = Backdrop.of(images, background_of(images))
    sample = BallSample(images[0], np.array([100.0, 80.0]), 2.0)
    assert PassingBalls.learned(backdrop, [sample] * 3) is None
    assert PassingBalls.learned(backdrop, [replace(sample, radius=12.0)] * 9) is None


@pytest.mark.parametrize("centre", [(-0.8, 2.0), (39.9, 2.0), (3.0, -0.8), (3.0, 29.8)])
def test_a_ball_that_the_pictures_edge_cuts_may_have_its_centre_outside(centre: tuple[float, float]) -> None:
    even = np.zeros((30, 40, 3), np.uint8)
    backdrop = Backdrop(np.zeros((30, 40, 3), np.float32), np.full(3, 0.01, np.float32))
    row, column = min(max(round(centre[1]), 0), 29), min(max(round(centre[0]), 0), 39)
    sample = BallSample(even, np.array(centre), 2.0)
    assert not backdrop.passes(sample)
    even[row, column] = (0, 0, 250)
    assert backdrop.passes(sample)
    assert backdrop.unmixed(sample)[2] > 0.9
