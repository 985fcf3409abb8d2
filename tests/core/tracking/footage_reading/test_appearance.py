"""Foreground images tell the performers from what is behind them, on frames whose poses nobody has told."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from kfmocap.core.evidence.foreground_images.cast_shadows import CastShadows, ShadowModel
from kfmocap.core.evidence.foreground_images.foreground import (
    LEVELS_PER_UNIT,
    MAX_LOG_RATIO,
    foreground_images,
    log_ratio,
)
from synthetic import cast, figure, look_at, pixel_grid, poses_of, swing, texture

Array = np.ndarray
BODY = figure()
LENGTH, BETWEEN = 7, 3
KEYS = (0, LENGTH - 1)
CAMERA = look_at("front", (0.5, -2.8, 1.5))
SCALE_AT_BODY = 190 / 2.8
WIDTH, HEIGHT = CAMERA.size
POSES = poses_of([BODY], [swing(BODY, LENGTH)])
BLUE, RED = np.array([200.0, 120, 60]), np.array([50.0, 90, 190])
"""Usual colours, blue green red."""
CONTRAST = 60


def blotches(seed: int) -> Array:
    """A smooth pattern that stands still in the picture, -1 to 1, shape (h, w, 1)."""
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 2)
    return np.clip(noise / np.abs(noise).std() / 3, -1, 1)[..., None]


def shown(frame: int) -> tuple[Array, Array]:
    """Part seen at every pixel, -1 for none, and the body's texture there, -1 to 1, shape (h, w, 1)."""
    part, _, local = cast([BODY], POSES[0][frame], POSES[1][frame], CAMERA, frame, pixel_grid(CAMERA.size))
    pattern = np.where(part >= 0, 2 * texture(part, np.nan_to_num(local)) - 1, 0)
    return part.reshape(HEIGHT, WIDTH), pattern.reshape(HEIGHT, WIDTH, 1)


def footage(body: Array, background: Array, grain: float = 1.5) -> tuple[Array, Array]:
    """Pictures of a figure of one colour before a background of another, both textured, and the figure's masks."""
    rng, still = np.random.default_rng(0), background + CONTRAST * blotches(1)
    pictures, masks = [], []
    for frame in range(LENGTH):
        part, pattern = shown(frame)
        image = np.where(part[..., None] >= 0, body + CONTRAST * pattern, still)
        pictures.append(np.clip(image + rng.normal(0, grain, image.shape), 0, 255).round().astype(np.uint8))
        masks.append(part >= 0)
    return np.stack(pictures), np.stack(masks)


def ratios(pictures: Array, masks: Array, fixed: bool, keys: tuple[int, ...] = KEYS) -> Array:
    return log_ratio(foreground_images(pictures, {k: masks[k] for k in keys}, SCALE_AT_BODY, fixed))


def inner(mask: Array) -> Array:
    return cv2.erode(mask.astype(np.uint8), np.ones((3, 3))) > 0


def outer(mask: Array) -> Array:
    return cv2.dilate(mask.astype(np.uint8), np.ones((3, 3))) == 0


def away(masks: Array, pixels: int) -> Array:
    """Where some key frame shows the background, the figure being that many pixels away; 5 cm are 3.4."""
    size = 2 * pixels + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return np.any([cv2.dilate(masks[k].astype(np.uint8), disc) == 0 for k in KEYS], axis=0)


@pytest.mark.parametrize("fixed", [True, False])
def test_a_painted_figure_is_found_on_frames_between_the_key_frames(fixed: bool) -> None:
    pictures, masks = footage(RED, BLUE)
    found = ratios(pictures, masks, fixed)[BETWEEN]
    assert (masks[BETWEEN] & ~masks[list(KEYS)].any(axis=0)).sum() > 300  # it is not where the key frames have it
    assert (found[inner(masks[BETWEEN])] > 1).mean() > 0.98
    assert (found[outer(masks[BETWEEN])] < -1).mean() > 0.98


def test_behind_a_fixed_camera_a_body_of_the_backgrounds_own_colours_is_found() -> None:
    pictures, masks = footage(BLUE, BLUE)
    seen = away(masks, 5)
    found, colours = (ratios(pictures, masks, fixed)[BETWEEN] for fixed in (True, False))
    inside, outside = inner(masks[BETWEEN]) & seen, outer(masks[BETWEEN]) & seen
    assert inside.sum() > 200
    assert (found[inside] > 0).mean() > 0.8 and (found[outside] < -1).mean() > 0.98
    assert np.mean(colours[inside]) < 0.5 * np.mean(found[inside])  # by its colours it could not be told


def test_a_camera_that_moves_has_colours_alone() -> None:
    """Where a colour is does not matter then; behind a fixed camera it does."""
    pictures, masks = footage(BLUE, BLUE)
    rolled = pictures.copy()
    rolled[BETWEEN] = np.roll(pictures[BETWEEN], 20, axis=1)
    for fixed in (False, True):
        here, there = (ratios(p, masks, fixed)[BETWEEN] for p in (pictures, rolled))
        same = np.array_equal(np.roll(here, 20, axis=1), there)
        assert same == (not fixed)


def test_where_no_key_frame_shows_the_background_colours_decide() -> None:
    pictures, masks = footage(BLUE, BLUE)
    hidden, seen = ~away(masks, 2), away(masks, 5)
    fixed, moving = (ratios(pictures, masks, f)[BETWEEN] for f in (True, False))
    assert hidden.sum() > 300
    np.testing.assert_array_equal(fixed[hidden], moving[hidden])
    assert np.abs(fixed[seen] - moving[seen]).mean() > 0.5


def test_colours_that_no_key_frame_shows_are_neutral() -> None:
    pictures, masks = footage(RED, BLUE)
    pictures[BETWEEN, :40, :40] = (20, 240, 20)
    np.testing.assert_allclose(ratios(pictures, masks, False)[BETWEEN, :40, :40], 0, atol=0.02)


def test_a_bystander_is_not_the_background_of_a_fixed_camera() -> None:
    """Before a known background a new colour is something else, if not surely a performer."""
    pictures, masks = footage(RED, BLUE)
    corner = (BETWEEN, slice(0, 20), slice(0, 20))
    assert (ratios(pictures, masks, True)[corner] < -1).all()
    pictures[corner] = (20, 240, 20)
    assert (ratios(pictures, masks, True)[corner] > 0).all()


def test_one_key_frame_is_enough() -> None:
    pictures, masks = footage(RED, BLUE)
    found = ratios(pictures, masks, True, keys=(0,))[BETWEEN]
    assert (found[inner(masks[BETWEEN])] > 1).mean() > 0.98 and (found[outer(masks[BETWEEN])] < -1).mean() > 0.98


def test_ratios_are_kept_to_a_step_and_cut() -> None:
    steps = np.arange(256, dtype=np.uint8)
    back = np.round(128 + LEVELS_PER_UNIT * log_ratio(steps))
    np.testing.assert_array_equal(back, steps)
    assert log_ratio(np.uint8([128]))[0] == 0
    images = foreground_images(*_args(footage(RED, BLUE)))
    assert images.dtype == np.uint8 and images.shape == (LENGTH, HEIGHT, WIDTH)
    assert np.abs(log_ratio(images)).max() <= MAX_LOG_RATIO + 1e-6


def _args(made: tuple[Array, Array]) -> tuple[Array, dict[int, Array], float, bool]:
    pictures, masks = made
    return pictures, {k: masks[k] for k in KEYS}, SCALE_AT_BODY, True


FLOOR = np.array([70.0, 110, 150])
TROUSERS = np.array([0.6, 0.58, 0.55]) * FLOOR
"""Of a colour that the floor has in the shadow, or nearly."""


def shadowed(frame: int) -> Array:
    """Where the figure's shadow falls: beside it, and lower."""
    mask = (shown(frame)[0] >= 0).astype(np.uint8)
    return np.roll(cv2.warpAffine(mask, np.array([[1.0, 0, 22], [0, 1, 0]]), (WIDTH, HEIGHT)), 4, axis=0) > 0


def shadow_footage() -> tuple[Array, Array, Array]:
    """The figure before a floor dimmed beside it, in a colour that the floor has there; its masks, and where."""
    rng, still = np.random.default_rng(0), FLOOR + 0.5 * CONTRAST * blotches(1)
    pictures, masks, shadows = [], [], []
    for frame in range(LENGTH):
        part, pattern = shown(frame)
        shadow = shadowed(frame) & (part < 0)
        floor = np.where(shadow[..., None], 0.58, 1) * still
        image = np.where(part[..., None] >= 0, TROUSERS + 0.5 * CONTRAST * pattern, floor)
        pictures.append(np.clip(image + rng.normal(0, 1.5, image.shape), 0, 255).round().astype(np.uint8))
        masks.append(part >= 0)
        shadows.append(shadow)
    return np.stack(pictures), np.stack(masks), np.stack(shadows)


def test_the_background_in_shadow_is_not_taken_for_clothes_of_that_colour() -> None:
    """It may be either; the figure itself is still found, and so is the floor that only a key frame has in shadow."""
    pictures, masks, shadows = shadow_footage()
    found = ratios(pictures, masks, True)[BETWEEN]
    before, floor = shadows[list(KEYS)].any(axis=0), outer(masks[BETWEEN]) & away(masks, 5)
    moved, lit = (found[mask & floor] for mask in (shadows[BETWEEN] & ~before, before & ~shadows[BETWEEN]))
    assert min(len(moved), len(lit)) > 300
    assert (moved < 1).mean() > 0.9
    assert (lit < -1).mean() > 0.98
    assert found[inner(masks[BETWEEN])].mean() > 2.5


def test_shadows_fall_near_where_some_frame_shows_them() -> None:
    """What has such a colour elsewhere, half a metre away or more, is not the background in shadow."""
    pictures, masks, shadows = shadow_footage()
    still = ratios(pictures, masks, True)[BETWEEN]
    beside = cv2.distanceTransform((~shadows[list(KEYS)].any(axis=0)).astype(np.uint8), cv2.DIST_L2, 5)
    elsewhere = (beside > 0.5 * SCALE_AT_BODY) & away(masks, 5) & outer(masks[BETWEEN]) & ~shadows[BETWEEN]
    assert elsewhere.sum() > 300
    pictures[BETWEEN][elsewhere] = np.round(0.58 * pictures[BETWEEN][elsewhere])
    assert (still[elsewhere] < -1).mean() > 0.98
    assert (ratios(pictures, masks, True)[BETWEEN][elsewhere] > 1).mean() > 0.9


def test_shadows_are_learned_from_an_area_whatever_the_number_of_its_pixels() -> None:
    """From near, as many pixels are a spot of a few square centimetres, which says nothing of shadows."""
    pictures, masks, _ = shadow_footage()
    behind = {frame: ~masks[frame] for frame in KEYS}
    plate = pictures[list(KEYS)].mean(axis=0).astype(np.uint8)
    far, near = (CastShadows.learned(pictures, behind, plate, 2.0, scale) for scale in (SCALE_AT_BODY, 1500.0))
    assert far is not None and near is None


def test_factors_and_tint_of_shadows_are_learned() -> None:
    rng = np.random.default_rng(0)
    lit = rng.uniform(80, 250, (4000, 3))
    factors = rng.uniform(0.5, 0.6, (len(lit), 1))
    dark = lit * factors ** np.array([0.8, 1.0, 1.2])
    samples = [np.round(colours + rng.normal(0, 1, lit.shape)).astype(np.uint8) for colours in (dark, lit)]
    found = ShadowModel.of(*samples, seen=40000, sigma=4.0, least=200)
    assert found is not None
    np.testing.assert_allclose(found.dimmed[32], 0.5 ** np.array([0.8, 1.0, 1.2]), atol=0.02)
    assert found.explains(*samples).mean() > 0.98
    plate = np.full((1, 3), 200, np.uint8)
    tinted = [np.round(plate * k ** np.array([[0.8, 1.0, 1.2]])).astype(np.uint8) for k in (0.55, 0.3)]
    assert found.distances(tinted[0], plate) < found.distances(tinted[1], plate) - 2
    np.testing.assert_array_equal(found.distances(tinted[0], plate), found.distances(plate, tinted[0]))


def test_what_is_darker_in_many_different_tints_is_not_a_shadow() -> None:
    rng = np.random.default_rng(0)
    lit = rng.uniform(120, 250, (4000, 3))
    dark = lit * rng.uniform(0.2, 1, lit.shape)
    assert ShadowModel.of(dark.astype(np.uint8), lit.astype(np.uint8), seen=40000, sigma=4.0, least=200) is None


def test_what_is_darker_but_brighter_in_one_colour_is_not_a_shadow() -> None:
    """Somebody in red who passes before a grey wall: a factor of 0 would have no brightness in that colour."""
    rng = np.random.default_rng(0)
    lit = rng.uniform(150, 180, (4000, 3))
    passing = lit * rng.uniform(0.5, 0.6, (len(lit), 1)) ** np.array([1.6, 1.6, -0.2])
    with np.errstate(all="raise"):
        found = ShadowModel.of(passing.astype(np.uint8), lit.astype(np.uint8), seen=40000, sigma=4.0, least=200)
    assert found is None
