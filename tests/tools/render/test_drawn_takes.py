"""Wand takes that are drawn at random are takes like the one that tools/render_wand.py renders, each another one."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from render.drawn_takes import HARDSHIPS, drawn_take, vga_take
from render.waving import lframe_pictures


def grey(take: object, camera: int) -> np.ndarray:
    return next(iter(lframe_pictures(take, camera))).mean(axis=2)  # type: ignore[arg-type]


def test_a_seed_gives_one_take_and_another_seed_another() -> None:
    one, again, other = (drawn_take(seed, HARDSHIPS["usual"]) for seed in (1, 1, 2))
    assert one.offsets == again.offsets != other.offsets
    assert np.array_equal(one.cameras[3].matrix, again.cameras[3].matrix)
    assert not np.array_equal(one.cameras[3].matrix, other.cameras[3].matrix)
    assert {f.name for f in fields(one)} == {f.name for f in fields(vga_take())}


def test_every_camera_of_a_drawn_take_sees_the_whole_lframe() -> None:
    for seed in range(4):
        take = drawn_take(seed, HARDSHIPS["usual"])
        for camera in take.cameras:
            uv = camera.project(take.lframe_points)
            assert ((uv >= 0) & (uv < camera.size)).all()


def test_dim_light_makes_the_same_room_darker() -> None:
    usual, dim = (drawn_take(3, HARDSHIPS[name]) for name in ("usual", "dim"))
    assert np.mean(grey(dim, 0)) < 0.85 * np.mean(grey(usual, 0))


def test_a_covered_ball_is_hidden_from_one_camera_alone() -> None:
    covered = replace(drawn_take(5, HARDSHIPS["fast"]), noise=0.0)
    assert covered.covered is not None
    hidden_from, ball = covered.covered
    for k, camera in enumerate(covered.cameras):
        change = np.abs(grey(covered, k) - grey(replace(covered, covered=None), k))
        u, v = np.rint(camera.project(covered.lframe_points[ball])).astype(int)
        assert (change[v, u] > 5) == (k == hidden_from)
