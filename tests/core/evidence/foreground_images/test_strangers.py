"""People who move beside the performers are not taken for them."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.evidence.foreground_images.foreground import log_ratio, performer_foregrounds
from kfmocap.core.evidence.foreground_images.known_pixels import KnownPixels
from kfmocap.core.evidence.foreground_images.masks import interior, outside
from kfmocap.core.evidence.foreground_images.strangers import strangers_on

Array = np.ndarray
Colour = tuple[int, int, int]
HEIGHT, WIDTH, FRAMES, SCALE = 120, 240, 9, 50.0
KEYS = (0, 4, 8)
TALL, WIDE = 80, 24
RED, BLUE = (40, 50, 200), (190, 80, 50)


def box(column: int) -> Array:
    """Where somebody is who stands at a column."""
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[HEIGHT - TALL :, column : column + WIDE] = True
    return mask


PERFORMER = [box(60 + 10 * f) for f in range(FRAMES)]
STRANGER = [box(180 - 20 * f) for f in range(FRAMES)]
"""Who covers most of the performer on the second key frame."""


def footage(performer: Colour, stranger: Colour | None, *, brighter: float = 0.0) -> Array:
    """A performer before a wall, with a stranger before both; half of the wall gets brighter."""
    rng = np.random.default_rng(0)
    wall = 130 + rng.normal(0, 6, (HEIGHT, WIDTH, 1)) + np.zeros(3)
    images = []
    for f in range(FRAMES):
        image = wall.copy()
        image[: HEIGHT // 2] += brighter * f / (FRAMES - 1)
        image[PERFORMER[f]] = performer
        if stranger is not None:
            image[STRANGER[f]] = stranger
        images.append(np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8))
    return np.stack(images)


def known() -> KnownPixels:
    shown = {f: interior(PERFORMER[f]) for f in KEYS}
    return KnownPixels((shown,), {f: outside(PERFORMER[f], 3) for f in KEYS}, SCALE)


def ratios(colour: Array) -> Array:
    return np.stack([log_ratio(each[0]) for each in performer_foregrounds(colour, known(), True)])


def found(colour: Array, keys: tuple[int, ...] = KEYS) -> dict[int, Array]:
    behind = {f: outside(PERFORMER[f], 3) for f in keys}
    plate = np.mean([colour[f] for f in keys], axis=0).round().astype(np.uint8)
    return strangers_on(colour, behind, plate, np.ones((HEIGHT, WIDTH), bool), unlike=20.0, scale=SCALE)


BETWEEN = [f for f in range(FRAMES) if f not in KEYS]


def test_who_stands_before_the_performer_on_a_key_frame_is_not_learned_as_the_performer() -> None:
    ratio = ratios(footage(RED, BLUE))
    for f in BETWEEN:
        stranger, performer = STRANGER[f], PERFORMER[f] & ~STRANGER[f]
        assert (ratio[f][stranger] < -1).mean() > 0.95
        assert (ratio[f][performer] > 2).mean() > 0.95


def test_a_stranger_in_equal_clothes_takes_nothing_from_the_performer() -> None:
    ratio = ratios(footage(RED, RED))
    for f in BETWEEN:
        assert (ratio[f][PERFORMER[f]] > 2).mean() > 0.95


@pytest.mark.parametrize("keys", [KEYS, (0, 8)])
def test_strangers_are_found_beside_the_performer(keys: tuple[int, ...]) -> None:
    pictures = found(footage(RED, BLUE), keys)
    for f in keys:
        beside = STRANGER[f] & outside(PERFORMER[f], 3)
        assert (pictures[f] & ~beside).sum() == 0
        assert pictures[f].sum() >= 0.9 * beside.sum()


def test_where_nobody_passes_there_are_no_strangers_even_if_the_light_changes() -> None:
    assert found(footage(RED, None)) == {}
    assert found(footage(RED, None, brighter=40.0), (0, 8)) == {}
