"""Light that flickers is told from light that changes slowly, and from what moves."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.fitting.checks.dissolve import dissolves
from kfmocap.core.fitting.checks.early_check import early_frames, early_misfits
from kfmocap.core.fitting.checks.flicker import FLICKER_FRAMES, MIN_FLICKER, flicker
from kfmocap.core.shot.shot import View
from synthetic import figure, look_at, shot_of, swing

ROOM = np.random.default_rng(0).integers(40, 170, (90, 160, 3)).astype(np.uint8)
FRAMES = np.arange(FLICKER_FRAMES)


def lit(gains: np.ndarray) -> list[np.ndarray]:
    return [np.clip(gain * ROOM, 0, 255).astype(np.uint8) for gain in gains]


@pytest.mark.parametrize("rate", [1.7, 2.1])
def test_its_amplitude_is_measured(rate: float) -> None:
    found = flicker(lit(1 + 0.15 * np.sin(rate * FRAMES + 0.4)))
    assert found.amplitude == pytest.approx(0.15, abs=0.05) and not found.in_bands


def banded() -> list[np.ndarray]:
    """Two bands in every picture, which run downwards."""
    gain = 1 + 0.15 * np.sin(2.3 * FRAMES[:, None] + 4 * np.pi * np.arange(len(ROOM)) / len(ROOM))
    return [np.clip(own[:, None, None] * ROOM, 0, 255).astype(np.uint8) for own in gain]


def test_bands_are_flicker_though_the_mean_brightness_is_steady() -> None:
    found = flicker(banded())
    assert found.amplitude == pytest.approx(0.15, abs=0.05) and found.in_bands


def test_clouds_and_what_moves_are_no_flicker() -> None:
    assert flicker(lit(1 - 0.06 * FRAMES)).amplitude < MIN_FLICKER
    moving = lit(np.ones(FLICKER_FRAMES))
    for frame, picture in enumerate(moving):
        picture[20:70, 10 + 20 * frame : 50 + 20 * frame] = 250
    assert flicker(moving).amplitude < MIN_FLICKER / 4
    assert flicker(lit(np.array([1.0, 1.5, 1.0]))).amplitude == 0.0  # too few to tell


def test_pictures_that_fade_in_or_out_do_not_flicker_and_are_named() -> None:
    fade = np.arange(1, FLICKER_FRAMES + 1) / 12
    for gains in (fade, fade[::-1]):
        assert flicker(lit(gains)).fades and flicker(lit(gains)).amplitude == 0.0
    assert not flicker(lit(1 + 0.5 * (-1.0) ** FRAMES)).fades
    body = figure()
    shot = shot_of([View(look_at("front", (0.5, -2.8, 1.5)), "front.mp4")], [body], [swing(body, FLICKER_FRAMES)], (0,))
    [said] = early_misfits(shot, [dict(enumerate(lit(fade)))])
    assert said.off and "fade" in said.brief and "frames under [shot]" in said.summary


def test_a_view_whose_light_flickers_is_named_with_what_filters_it() -> None:
    body = figure()
    truth = swing(body, FLICKER_FRAMES)
    camera = look_at("front", (0.5, -2.8, 1.5))
    shot = shot_of([View(camera, "front.mp4")], [body], [truth], (0,))
    assert early_frames(shot) == frozenset(range(FLICKER_FRAMES))
    [said] = early_misfits(shot, [dict(enumerate(lit(1 + 0.2 * (-1.0) ** FRAMES)))])
    assert said.off and "front: its light flickers by" in said.summary and "-vf deflicker=" in said.summary
    [said] = early_misfits(shot, [dict(enumerate(banded()))])
    assert "in bands" in said.summary and "exposure of 1/50" in said.summary and "deflicker" not in said.summary
    assert not early_misfits(shot, [dict(enumerate(lit(np.ones(FLICKER_FRAMES))))])


OTHER_ROOM = np.random.default_rng(1).integers(40, 170, (9, 16, 3)).astype(np.uint8).repeat(10, 0).repeat(10, 1)
THIS_ROOM = np.random.default_rng(2).integers(40, 170, (9, 16, 3)).astype(np.uint8).repeat(10, 0).repeat(10, 1)


@pytest.mark.parametrize("share", [np.linspace(0.1, 0.8, FLICKER_FRAMES), np.linspace(0.5, 1.2, FLICKER_FRAMES)])
def test_pictures_that_dissolve_are_named_and_their_footage_is_not_blamed(share: np.ndarray) -> None:
    mixed = [own * THIS_ROOM + (1 - own) * OTHER_ROOM for own in np.minimum(share, 1.0)]
    pictures = [picture.round().astype(np.uint8) for picture in mixed]
    assert dissolves(pictures)
    body = figure()
    truth = swing(body, FLICKER_FRAMES, size=0.9)
    shot = shot_of([View(look_at("front", (0.5, -2.8, 1.5)), "front.mp4")], [body], [truth], (0, FLICKER_FRAMES - 1))
    [said] = early_misfits(shot, [dict(enumerate(pictures))])
    assert "dissolve" in said.brief and "frames under [shot]" in said.summary


def test_cameras_that_pan_light_that_changes_and_cuts_do_not_dissolve() -> None:
    room = np.tile(THIS_ROOM, (1, 3, 1))
    for speed in (1, 3, 12):
        assert not dissolves([room[:, speed * frame : speed * frame + 160] for frame in FRAMES])
    assert not dissolves(lit(1 - 0.1 * FRAMES)) and not dissolves(lit(np.arange(1, FLICKER_FRAMES + 1) / 12))
    assert not dissolves([THIS_ROOM, THIS_ROOM, OTHER_ROOM, OTHER_ROOM, THIS_ROOM, THIS_ROOM])
    assert not dissolves([*[THIS_ROOM] * 3, *[OTHER_ROOM] * 3])
    assert not dissolves([THIS_ROOM, OTHER_ROOM, OTHER_ROOM])
