"""Colours of balls: what a capture file may name, and what one click learns."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from kfmocap.core.capture.colours import Colour, learned, parsed, to_hsv
from kfmocap.core.errors import CalibrationError


def matches(colour: Colour, red: int, green: int, blue: int) -> bool:
    return bool(colour.mask(to_hsv(np.array([[[blue, green, red]]], np.uint8)))[0, 0])


@pytest.mark.parametrize(
    ("name", "inside", "outside"),
    [
        ("red", (200, 20, 30), (30, 200, 20)),
        ("Red", (200, 30, 20), (200, 180, 170)),
        ("green", (30, 160, 40), (30, 60, 200)),
        ("blue", (30, 60, 200), (120, 120, 130)),
        ("yellow", (210, 200, 30), (220, 40, 20)),
        ("#20a040", (20, 110, 50), (160, 160, 30)),
        ("#c01020", (120, 12, 10), (10, 12, 120)),
    ],
)
def test_a_named_or_picked_colour_takes_its_shades_alone(name, inside, outside):
    colour = parsed(name, "here")
    assert matches(colour, *inside) and not matches(colour, *outside)


def test_a_range_of_hue_goes_through_red():
    colour = parsed({"hue": [340, 20], "saturation": [0.5, 1.0]}, "here")
    assert matches(colour, 200, 10, 40) and matches(colour, 200, 40, 10) and not matches(colour, 200, 120, 10)
    assert not matches(colour, 200, 150, 150)


def test_the_pure_colour_is_that_of_the_middle_hue():
    """Blue, green and red, 0 to 1; a range of hues may go through red."""
    np.testing.assert_allclose(Colour(hue=(100.0, 140.0)).pure(), [0, 1, 0], atol=0.02)
    np.testing.assert_allclose(Colour(hue=(340.0, 20.0)).pure(), [0, 0, 1], atol=0.02)
    assert Colour(hue=(300.0, 140.0)).pure() is None, "it is nearly of any hue"
    assert Colour().pure() is None


def test_paler_and_darker_pixels_are_of_small_things_of_a_colour():
    colour = Colour((340.0, 20.0), (0.6, 1.0), (0.3, 1.0))
    for pixel in ((200, 110, 110), (60, 10, 10)):  # mixed with grey, in the dark
        assert matches(colour.paler(), *pixel) and not matches(colour, *pixel)
    assert not matches(colour.paler(), 200, 160, 160)


def test_a_colour_may_be_given_by_its_ranges():
    ranges = {"hue": [350.0, 12.5], "saturation": [0.45, 1.0], "value": [0.1, 0.9]}
    assert parsed(ranges, "here") == Colour((350.0, 12.5), (0.45, 1.0), (0.1, 0.9))


@pytest.mark.parametrize("wrong", ["crimsonish", "#12345", 7, {"hue": [1]}, {"shade": [0, 1]}, {"value": [0.5, 3]}])
def test_an_invalid_colour_is_refused_with_its_place(wrong):
    with pytest.raises(CalibrationError, match=r"wand\.toml \[wand\]"):
        parsed(wrong, "wand.toml [wand]")


def test_one_click_learns_a_shaded_ball_and_not_its_surroundings():
    rows, columns = np.indices((80, 80))
    light = np.clip(0.35 + 0.65 * (columns - 20) / 40, 0.3, 1)[..., None]
    ball = np.hypot(columns - 40, rows - 40) < 18
    other = np.hypot(columns - 10, rows - 10) < 6
    image = np.where(ball[..., None], light * [30, 40, 210], [110, 120, 125])
    image = np.where(other[..., None], light * [40, 150, 200], image)  # orange beside red
    image = np.clip(image + np.random.default_rng(0).normal(0, 2, image.shape), 0, 255).astype(np.uint8)
    found = learned(image, (44, 38)).mask(to_hsv(image)) > 0
    inner = cv2.erode(ball.astype(np.uint8), np.ones((3, 3))) > 0
    assert found[inner].mean() > 0.97 and found[~ball].mean() < 0.01


def test_a_click_on_grey_or_outside_is_refused():
    grey = np.full((20, 20, 3), 128, np.uint8)
    with pytest.raises(CalibrationError, match="no colour"):
        learned(grey, (5, 5))
    with pytest.raises(CalibrationError, match="outside"):
        learned(grey, (25, 5))
