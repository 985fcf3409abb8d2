"""Gradient images: derivatives of smoothed pictures, read between pixels, and kept while they are needed."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from kfmocap.core.evidence.smoothed_images import SmoothedImages
from kfmocap.core.evidence.view_frames import GradientImageCache, ViewFrames
from synthetic import look_at

Array = np.ndarray
CAMERA = look_at("cam", (0.8, -2.2, 1.6))


def ramp(u: Array, v: Array) -> Array:
    return 0.2 + 0.003 * u + 0.002 * v


def test_sampling_reads_between_pixels_and_in_the_window_that_was_asked_for() -> None:
    grey = np.random.default_rng(0).integers(0, 255, (3, 40, 50)).astype(np.uint8)
    view = ViewFrames(CAMERA, grey, 10)
    images = GradientImageCache().images(view, range(11, 13), 1.0, (20, 15, 35, 30))
    whole = GradientImageCache().images(view, range(11, 13), 1.0, (0, 0, 50, 40))
    frame, uv = np.array([0, 1, 1]), np.array([[20, 15], [27, 22], [34, 29]])
    np.testing.assert_allclose(images.at(frame, uv), whole.at(frame, uv), atol=1e-6)
    np.testing.assert_allclose(images.sample(frame, np.float32(uv)), whole.at(frame, uv), atol=1e-6)
    half = images.sample(frame, np.float32(uv) + np.float32([0.5, 0]))
    np.testing.assert_allclose(half, (whole.at(frame, uv) + whole.at(frame, uv + [1, 0])) / 2, atol=1e-6)


def test_gradient_images_are_cached_while_they_cover_what_is_needed() -> None:
    grey = np.random.default_rng(0).integers(0, 255, (4, 90, 120)).astype(np.uint8)
    view, box, cache = ViewFrames(CAMERA, grey, 10), (40, 30, 70, 50), GradientImageCache()
    kept = cache.images(view, range(10, 13), 1.0, box)
    assert cache.images(view, range(10, 13), 1.0, (36, 33, 73, 54)) is kept
    assert cache.images(view, range(12, 14), 1.0, box) is not kept
    assert cache.images(view, range(10, 13), 1.0, box) is kept, "the frame where two runs meet is no reason to forget"
    assert cache.images(ViewFrames(CAMERA, grey, 10), range(10, 13), 1.0, box) is not kept, "another view's are its own"
    for first, sigma, other in ((10, 2.0, box), (10, 1.0, (20, 30, 70, 50)), (11, 1.0, box)):
        frames = range(first, first + 3)
        images, fresh = (c.images(view, frames, sigma, other) for c in (cache, GradientImageCache()))
        np.testing.assert_array_equal(images.values, fresh.values)


def test_no_more_gradient_images_are_kept_than_the_bound_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    view, box, cache = ViewFrames(CAMERA, np.zeros((12, 90, 120), np.uint8), 0), (0, 0, 120, 90), GradientImageCache()
    one = cache.images(view, range(2), 1.0, box).values.nbytes
    monkeypatch.setattr("kfmocap.core.evidence.view_frames.MAX_CACHED_BYTES", 3 * one)
    for order in (range(10), reversed(range(10))):  # as threads come
        runs = {f: cache.images(view, range(f, f + 2), 1.0, box) for f in order}
        kept = [f for f, run in sorted(runs.items()) if cache.images(view, range(f, f + 2), 1.0, box) is run]
        assert kept == [0, 1, 2]


def test_no_gradient_images_are_kept_of_a_view_of_which_few_would_be(monkeypatch: pytest.MonkeyPatch) -> None:
    grey, box = np.zeros((30, 90, 120), np.uint8), (0, 0, 120, 90)
    one = GradientImageCache().images(ViewFrames(CAMERA, grey, 0), range(2), 1.0, box).values.nbytes
    monkeypatch.setattr("kfmocap.core.evidence.view_frames.MAX_CACHED_BYTES", 3 * one)
    for count, kept in ((13, True), (14, False)):  # of 12 and of 13 windows
        view, cache = ViewFrames(CAMERA, grey[:count], 0), GradientImageCache()
        first, again = (cache.images(view, range(2), 1.0, box) for _ in range(2))
        assert (first is again) == kept


def test_gradient_images_are_derivatives_of_the_smoothed_picture() -> None:
    u, v = np.meshgrid(np.arange(60.0), np.arange(40.0))
    ramp = np.uint8(np.stack([2 * u + 3 * v, 4 * u]))
    b, du, dv = (
        c.reshape(2, 40, 60)[:, 8:-8, 8:-8] for c in cv2.split(SmoothedImages.with_gradients(ramp, 1.0).values)
    )
    np.testing.assert_allclose(b, ramp[:, 8:-8, 8:-8] / 255, atol=1e-5)
    np.testing.assert_allclose(du, np.full(b.shape, 1) * np.array([2, 4])[:, None, None] / 255, atol=1e-5)
    np.testing.assert_allclose(dv, np.full(b.shape, 1) * np.array([3, 0])[:, None, None] / 255, atol=1e-5)


def test_a_part_of_a_view_shows_what_the_whole_view_does_there_and_is_evidence_where_it_is() -> None:
    grey = np.arange(12, dtype=np.uint8)[:, None, None] * np.ones((1, 6, 8), np.uint8)
    torn = np.isin(np.arange(11), (3, 6, 7))
    damaged = np.isin(np.arange(12), 9)
    view = ViewFrames(CAMERA, grey, 10, grey[None], torn=torn, damaged=damaged, palette=grey)
    part = view.between(13, 19)
    assert np.array_equal(part.grey[:, 0, 0], np.arange(3, 10)) and part.first == 13
    assert np.array_equal(part.foreground_at(15, 3), view.foreground_at(15, 3))
    assert part.palette is not None and np.array_equal(part.palette, part.grey)
    for own, whole in zip(part.sound(13, 7), view.sound(13, 7), strict=True):
        assert np.array_equal(own, whole)
    assert not part.sound(13, 7)[0].all() and part.sound(13, 7)[0].any()
