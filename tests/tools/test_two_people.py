"""The shot of two people who walk past each other: who hides whom, and the files that describe it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import render_two_people as two
from kfmocap.core.evidence.label_images import Geometry, render_labels
from kfmocap.core.formats.shot_toml import read_shot_spec
from render.people import posed_parts, true_landmarks


def test_one_hides_more_than_half_of_the_other_in_every_view_for_some_frames() -> None:
    cast = two.people(equal=True)
    bodies, seconds = [person.body() for person, _ in cast], np.arange(two.FRAMES) / two.FPS
    posed = [posed_parts(body, route.motion(body, seconds)) for (_, route), body in zip(cast, bodies, strict=True)]
    R, T = (np.concatenate([own[k] for own in posed], axis=1) for k in range(2))
    hidden = []
    for camera in two.CAMERAS:
        seen, alone = render_labels(Geometry.of(bodies), camera.subsampled(6), 0, R, T).areas()
        hidden.append((seen < 0.5 * alone).any(axis=0))
    assert (np.sum(hidden, axis=1) >= 3).all()


def test_a_route_turns_a_movement_as_it_is() -> None:
    person, route = two.people(equal=False)[1]
    body, t = person.body(), np.linspace(0, 1, 3)
    plain = two.Route.of(route, 0.0, (0.0, 0.0, 0.0))
    straight, turned = (true_landmarks(body, way.motion(body, t)) for way in (plain, route))
    np.testing.assert_allclose(turned, straight * [-1, -1, 1] + route.place, atol=1e-9)


@pytest.mark.parametrize("equal", [True, False])
def test_only_the_second_ones_clothes_differ(equal: bool) -> None:
    (man, _), (woman, _) = two.people(equal)
    assert (man.wardrobe == woman.wardrobe) == equal


def test_the_shot_files_are_shots(tmp_path: Path) -> None:
    for keys in ({"A": two.KEYS, "B": two.STAGGERED}, {"B": two.KEYS}):
        file = tmp_path / "shot.toml"
        file.write_text(two.shot_file(keys), encoding="utf-8")
        spec = read_shot_spec(file)
        assert {p.name: p.keyframes for p in spec.performers} == keys
