"""Balls in pictures: where they are, which they are, and what is taken for none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest
from kfmocap.core.calibration.balls.ball_centres import centres_of
from kfmocap.core.calibration.balls.ball_detection import Picture, background_of, find_balls, without_rods
from kfmocap.core.calibration.balls.found_balls import Balls
from kfmocap.core.calibration.lframe.lframe_detection import TRIED_FOCALS, LFrameModel, identified, static_balls
from kfmocap.core.calibration.wand_detection import Pairs, likeliest_pairs, swapped_ends
from kfmocap.core.capture.colours import parsed
from kfmocap.core.errors import CalibrationError
from render.drawing import GAMMA, Ball, Canvas, Rod, outline
from render.waving import CAMERAS, LFRAME, PAINT, SensorNoise
from synthetic import look_at

SIZE = (480, 270)
CAMERA = replace(
    look_at("cam", (0.0, -3.0, 1.2), (0.0, 0.0, 1.0), SIZE, 430.0), distortions=np.array([-0.1, 0, 0, 0.0])
)


@pytest.fixture(scope="module")
def canvas() -> Canvas:
    return Canvas(CAMERA)


def seen_by(canvas: Canvas, things: list[Ball | Rod], seed: int = 0) -> np.ndarray:
    return SensorNoise(SIZE, seed).record(canvas.drawn(things))


def filmed_by(canvas: Canvas, things: list[Ball | Rod], seed: int = 0) -> np.ndarray:
    """As Motion JPEG keeps it: a colour for every other pixel alone."""
    return cv2.imdecode(cv2.imencode(".jpg", seen_by(canvas, things, seed))[1], cv2.IMREAD_COLOR)


def found(image: np.ndarray, colour: str) -> Balls:
    return find_balls(Picture.of(image), parsed(colour, "here"))


def middles(balls: Balls) -> np.ndarray:
    return centres_of(balls.centres, balls.semi_axes[:, 1], CAMERA.matrix, CAMERA.distortions)


def nearest(balls: Balls, point: np.ndarray) -> Balls:
    return balls[[int(np.argmin(np.linalg.norm(balls.centres - point, axis=1)))]]


def test_balls_are_found_to_a_tenth_of_a_pixel(canvas):
    errors = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        places = np.array([[x, rng.uniform(-0.6, 0.6), rng.uniform(0.6, 1.6)] for x in (-0.9, -0.3, 0.3, 0.9)])
        colours = ["red", "green", "blue", "yellow"]
        image = seen_by(canvas, [Ball(p[None], 0.05, PAINT[c]) for p, c in zip(places, colours, strict=True)], seed)
        for place, colour in zip(places, colours, strict=True):
            off = middles(found(image, colour)) - CAMERA.project(place)
            errors.append(np.linalg.norm(off, axis=1).min())
    assert np.median(errors) < 0.1 and np.max(errors) < 0.3


@pytest.mark.parametrize("colour", ["red", "green", "blue"])
def test_a_ball_of_four_to_six_pixels_is_measured_by_its_colour(canvas, colour):
    """Less exactly than a large one, and it says so."""
    errors, sigmas = [], []
    for seed in range(6):
        rng = np.random.default_rng([seed, 5])
        place = np.array([rng.uniform(-0.6, 0.6), rng.uniform(-0.4, 0.4), rng.uniform(0.8, 1.4)])
        things = [Ball(place[None], rng.uniform(0.012, 0.018), PAINT[colour])]
        balls = found(seen_by(canvas, things, seed), colour)
        ball = nearest(balls, CAMERA.project(place))
        errors.append(ball.centres[0] - CAMERA.project(place))
        sigmas.append(ball.sigma[0])
    assert np.sqrt(np.mean(np.square(errors))) < 0.3 and np.abs(errors).max() < 0.8
    assert min(sigmas) > 0.1


def rods_about(
    centre: np.ndarray, count: int, start: float, radius: float, paint: str
) -> Iterator[tuple[Rod, np.ndarray]]:
    """Rods that come to a ball from all around, beginning so far from its centre, and where they end."""
    for angle in 2 * np.pi * np.arange(count) / count:
        other = centre + [0.35 * np.cos(angle), -0.3, 0.35 * np.sin(angle)]
        along = (other - centre) / np.linalg.norm(other - centre)
        yield Rod((centre + start * along)[None], other[None], radius, PAINT[paint]), other


def test_a_rod_hardly_shifts_a_small_ball(canvas):
    before, after, centre = [], [], np.array([0.1, 0.0, 1.0])
    for k, (rod, other) in enumerate(rods_about(centre, 8, 0.0155, 0.006, "cloth")):
        image = seen_by(canvas, [Ball(centre[None], 0.017, PAINT["green"]), rod], k)
        ball = nearest(found(image, "green"), CAMERA.project(centre))
        again, good = without_rods(Picture.of(image), ball, CAMERA.project(other)[None, None])
        assert good.all()
        before.append(ball.centres[0] - CAMERA.project(centre))
        after.append(again.centres[0] - CAMERA.project(centre))
    assert np.sqrt(np.mean(np.square(after))) < 0.3
    assert np.sqrt(np.mean(np.square(after))) < np.sqrt(np.mean(np.square(before)))


@pytest.mark.parametrize("distortions", [(0.0, 0.0, 0.0, 0.0), (-0.25, 0.08, 0.002, -0.001)])
def test_the_middle_of_a_ball_is_not_the_centre_of_its_outline(distortions):
    camera = replace(CAMERA, distortions=np.array(distortions))
    for centre in ([0.9, 0.5, 1.6], [-0.8, 0.1, 1.5], [0.0, 0.0, 1.2], [-0.7, -0.5, 1.7]):
        C, zero = np.array(centre), np.zeros(3)
        ring = cv2.projectPoints(outline(C, 0.09, 720), zero, zero, camera.matrix, camera.distortions)[0][:, 0]
        middle = cv2.projectPoints(C[None], zero, zero, camera.matrix, camera.distortions)[0][0, 0]
        ellipse, axes, _ = cv2.fitEllipse(ring.astype(np.float32))
        ellipse, radius = np.array(ellipse), min(axes) / 2
        corrected = centres_of(ellipse[None], np.array([radius]), camera.matrix, camera.distortions)[0]
        uncorrected = np.linalg.norm(ellipse - middle)
        assert np.linalg.norm(corrected - middle) < max(0.25 * uncorrected, 0.01)
        if abs(centre[0]) > 0.5:
            assert uncorrected > 0.08


def test_motion_blur_is_weighted_down_and_its_middle_taken(canvas):
    sigmas, errors, place = [], [], np.array([0.2, 0.0, 1.1])
    for length in (0.0, 0.05, 0.1):
        way = np.linspace(-0.5, 0.5, 15)[:, None] * [length, 0, 0.3 * length]
        ball = nearest(found(seen_by(canvas, [Ball(way + place, 0.06, PAINT["blue"])]), "blue"), CAMERA.project(place))
        errors.append(float(np.linalg.norm(middles(ball)[0] - CAMERA.project(place))))
        sigmas.append(float(ball.sigma[0]))
    assert sigmas[0] < sigmas[1] < sigmas[2]
    assert all(e < 3 * s for e, s in zip(errors, sigmas, strict=True))


@pytest.mark.parametrize("colour", ["green", "blue"])
def test_a_small_ball_that_its_motion_makes_pale_is_found_before_a_background_that_is_known(canvas, colour):
    """It is four pixels wide, its path four to six."""
    alone, before, errors = 0, 0, []
    background = background_of([filmed_by(canvas, [], seed) for seed in range(100, 105)])
    for seed in range(24):
        rng = np.random.default_rng([seed, 11])
        place = np.array([rng.uniform(-0.9, 0.9), rng.uniform(-0.3, 0.3), rng.uniform(0.6, 1.6)])
        path = rng.normal(size=3) * [1, 0, 1]
        way = np.linspace(-0.5, 0.5, 15)[:, None] * path / np.linalg.norm(path) * rng.uniform(0.03, 0.045)
        image = filmed_by(canvas, [Ball(way + place, 0.015, PAINT[colour])], seed)
        true = CAMERA.project(place)
        for known in (None, background):
            balls = find_balls(Picture.of(image, known), parsed(colour, "here"))
            off = np.linalg.norm(middles(balls) - true, axis=1)
            if known is None:
                alone += bool((off < 2).any())
            elif (off < 2).any():
                before += 1
                errors.append(off.min())
    assert before > 1.2 * alone
    assert np.median(errors) < 0.5


def test_nothing_passes_before_a_background_that_is_known(canvas):
    background = background_of([filmed_by(canvas, [], seed) for seed in range(100, 105)])
    for seed in range(3):
        image = filmed_by(canvas, [], seed)
        for colour in ("red", "green", "blue"):
            assert len(find_balls(Picture.of(image, background), parsed(colour, "here"))) == len(found(image, colour))


def test_what_a_rod_hides_does_not_shift_the_ball(canvas):
    before, after, centre = [], [], np.array([0.1, 0.0, 1.0])
    for k, (rod, other) in enumerate(rods_about(centre, 12, 0.06, 0.022, "skin")):
        image = seen_by(canvas, [Ball(centre[None], 0.065, PAINT["green"]), rod], k)
        ball = found(image, "green")[:1]
        again, good = without_rods(Picture.of(image), ball, CAMERA.project(other)[None, None])
        assert good.all()
        for errors, balls in ((before, ball), (after, again)):
            errors.append(np.linalg.norm(middles(balls)[0] - CAMERA.project(centre)))
    assert np.median(after) < 0.16 and np.mean(after) < np.mean(before)


def test_things_that_are_not_balls_are_not_found(canvas):
    long = Rod(np.array([[-0.6, 0, 1.0]]), np.array([[-0.2, 0, 1.3]]), 0.04, PAINT["red"])
    speck = Ball(np.array([[0.3, 0, 1.2]]), 0.008, PAINT["red"])
    image = seen_by(canvas, [long, speck])
    corner = np.array([[330, 190], [390, 200], [350, 240]])
    cv2.fillPoly(image, [corner], (20, 20, 210))
    assert len(found(image, "red")) == 0


def test_noise_in_the_dark_is_not_taken_for_a_ball():
    rng = np.random.default_rng(0)
    image = np.clip(rng.normal(12, 6, (120, 160, 3)), 0, 255).astype(np.uint8)
    assert sum(len(found(image, colour)) for colour in ("red", "green", "blue")) == 0


def balls_at(camera, points: np.ndarray, diameter: float = 0.06) -> Balls:
    R, t = camera.pose(0)
    radii = camera.matrix[0, 0] * diameter / 2 / (points @ R.T + t)[:, 2]
    return Balls(camera.project(points), radii[:, None, None] * np.eye(2), np.full(len(points), 0.1))


def frame_for(camera, points: np.ndarray = LFRAME, diameter: float | None = 0.06) -> LFrameModel:
    return LFrameModel(points, diameter, (np.array(camera.size) - 1) / 2, [s * max(camera.size) for s in TRIED_FOCALS])


@pytest.mark.parametrize("diameter", [0.06, None])
@pytest.mark.parametrize("points", [LFRAME, np.array([[0, 0, 0], [0.3, 0, 0], [0.6, 0, 0], [0, 0.2, 0]])])
def test_the_lframe_is_identified_from_all_sides_and_which_end_is_which(points, diameter):
    for seed in range(12):
        rng = np.random.default_rng(seed)
        angle, far, high = 2 * np.pi * seed / 12, rng.uniform(3, 5), rng.uniform(1.2, 2.5)
        eye = (far * np.cos(angle), far * np.sin(angle), high)
        camera = look_at("cam", eye, (0.2, 0.1, 0.3), (960, 540), rng.uniform(700, 1300))
        order = rng.permutation(4)
        balls = balls_at(camera, points[order])
        balls = replace(balls, centres=balls.centres + rng.normal(0, 0.2, (4, 2)))
        assert list(order[identified(balls, frame_for(camera, points, diameter), "here")]) == [0, 1, 2, 3]


def test_balls_of_the_same_colour_that_lie_about_are_not_the_lframe():
    points = np.concatenate([[[-0.9, 0.5, 0], [1.3, -0.4, 0], [0.4, 0.9, 0.0]], LFRAME])
    for camera in CAMERAS:
        balls = balls_at(camera, points)
        assert identified(balls, frame_for(camera), "here") == [3, 4, 5, 6]


def test_a_mirrored_lframe_is_refused_by_its_name():
    with pytest.raises(CalibrationError, match=r"cam01.*mirror image"):
        identified(balls_at(CAMERAS[0], LFRAME * [1, -1, 1]), frame_for(CAMERAS[0]), "cam01")


def test_too_few_balls_are_refused():
    with pytest.raises(CalibrationError, match="3 of the L-frame's 4 balls"):
        identified(balls_at(CAMERAS[0], LFRAME[:3]), frame_for(CAMERAS[0]), "cam01")


def test_only_what_stands_still_is_of_the_lframe():
    still, rng = balls_at(CAMERAS[0], LFRAME), np.random.default_rng(0)
    seen = []
    for k in range(9):
        moving = balls_at(CAMERAS[0], np.array([[0.3 + 0.05 * k, 0.4, 0.5]]))
        both = Balls.joined([still, moving])
        seen.append(replace(both, centres=both.centres + rng.normal(0, 0.1, (5, 2))))
    kept = static_balls(seen)
    assert len(kept) == 4
    np.testing.assert_allclose(np.sort(kept.centres, axis=0), np.sort(still.centres, axis=0), atol=0.15)


def pairs_of(points: np.ndarray, radii: np.ndarray | float = 6.0) -> Pairs:
    """Pairs (n, 2, 2) as they would be found; `radii` are the first balls', the second ones' are 6 px."""
    n = len(points)
    sizes = np.broadcast_to(radii, n), np.full(n, 6.0)
    ends = (Balls(points[:, e], sizes[e][:, None, None] * np.eye(2), np.full(n, 0.1)) for e in (0, 1))
    return Pairs(tuple(ends), (points[:, 0], points[:, 1]))


def waved(frames: int) -> np.ndarray:
    t = np.arange(frames) / 30
    middle = np.stack([300 + 150 * np.sin(1.7 * t), 200 + 90 * np.sin(2.3 * t + 1)], axis=1)
    way = 60 * np.stack([np.sin(1.1 * t), np.cos(1.1 * t)], axis=1)
    return np.stack([middle - way, middle + way], axis=1)


def test_the_wand_is_followed_past_balls_that_lie_or_roll():
    wand, rng = waved(120), np.random.default_rng(1)
    rolling = np.stack([np.linspace(50, 600, 120), np.full(120, 350.0)], axis=1)
    seen, truth = [], []
    for k in range(120):
        still = np.array([410.0, 300.0]) + rng.normal(0, 0.2, 2)
        candidates = np.array([[still, wand[k, 1]], wand[k], [rolling[k], wand[k, 1]], [still, rolling[k]]])
        order = np.array([3]) if 40 <= k < 46 else rng.permutation(4)
        seen.append(pairs_of(candidates[order], np.where(order == 2, 10.0, 6.0)))
        truth.append(-1 if 40 <= k < 46 else int(np.flatnonzero(order == 1)[0]))
    path = likeliest_pairs(seen)
    assert (path[:40] == truth[:40]).all() and (path[46:] == truth[46:]).all()
    assert (path[40:46] == -1).all()


def test_no_pairs_at_all_give_no_wand():
    assert list(likeliest_pairs([pairs_of(np.empty((0, 2, 2)))] * 3)) == [-1, -1, -1]
    assert len(likeliest_pairs([])) == 0


def test_ends_of_one_colour_keep_their_places_through_gaps_and_crossings():
    t = np.arange(150) / 30
    middle = np.stack([300 + 80 * t, 200 + 40 * np.sin(2 * t)], axis=1)
    tilt = 0.9 * np.sin(1.3 * t)  # mostly upright: the first end is the upper one
    way = 50 * np.abs(np.cos(0.8 * t))[:, None] * np.stack([np.sin(tilt), np.cos(tilt)], axis=1)
    points = np.stack([middle - way, middle + way], axis=1)
    mixed, flips = points.copy(), np.random.default_rng(0).random(150) < 0.5
    mixed[flips] = mixed[flips][:, ::-1]
    mixed[60:64] = np.nan
    swapped = swapped_ends(mixed, np.full(150, 6.0))
    mixed[swapped] = mixed[swapped][:, ::-1]
    sure = np.isfinite(mixed[:, 0, 0]) & (np.linalg.norm(way, axis=1) > 8)
    np.testing.assert_array_equal(mixed[sure], points[sure])


def test_linear_light_comes_back_from_grey_levels():
    light = np.full((20, 20, 3), 0.3, np.float32)
    grey = SensorNoise((20, 20), 0).record(light).mean() / 255
    assert grey**GAMMA == pytest.approx(0.3, abs=0.01)
