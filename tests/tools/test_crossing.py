"""Shots of people who walk past each other: who hides whom, and the files that describe them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from kfmocap.benchmarks import speed
from kfmocap.core.evidence.rendering.label_images import render_labels
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from kfmocap.core.formats.shot_toml import read_shot_spec
from render.people import posed_parts, true_landmarks
from render_crossing import SHOTS, Crossing, Route, four_people, shot_file, shot_files, two_people


def hidden_frames(shot: Crossing) -> np.ndarray:
    """On how many frames each view sees less than half of some person because of the others, shape (V,)."""
    bodies, seconds = [p.body() for p, _ in shot.cast.values()], np.arange(shot.frames) / shot.fps
    posed = [
        posed_parts(body, route.motion(body, seconds))
        for (_, route), body in zip(shot.cast.values(), bodies, strict=True)
    ]
    R, T = (np.concatenate([own[k] for own in posed], axis=1) for k in range(2))
    hidden = []
    for camera in shot.cameras:
        labels = render_labels(Geometry.of(bodies), camera.subsampled(6), 0, R, T)
        seen, alone = np.add.reduceat(labels.areas(), np.cumsum([0, *map(len, bodies[:-1])]), axis=1)
        hidden.append((seen < 0.5 * alone).any(axis=0).sum())
    return np.array(hidden)


@pytest.mark.parametrize("count", SHOTS)
def test_somebody_is_more_than_half_hidden_in_every_view_for_some_frames(count: int) -> None:
    assert (hidden_frames(SHOTS[count](True)) >= 3).all()


def test_a_route_turns_a_movement_as_it_is() -> None:
    person, route = two_people(equal=False).cast["B"]
    body, t = person.body(), np.linspace(0, 1, 3)
    plain = Route.of(route, 0.0, (0.0, 0.0, 0.0))
    straight, turned = (true_landmarks(body, way.motion(body, t)) for way in (plain, route))
    np.testing.assert_allclose(turned, straight * [-1, -1, 1] + route.place, atol=1e-9)


@pytest.mark.parametrize("count", SHOTS)
def test_clothes_are_equal_or_everybody_has_others(count: int) -> None:
    worn = {equal: {person.wardrobe for person, _ in SHOTS[count](equal).cast.values()} for equal in (True, False)}
    assert {equal: len(different) for equal, different in worn.items()} == {True: 1, False: count}


@pytest.mark.parametrize("shot", [two_people(False), four_people(False), four_people(False).only(["C"])])
def test_the_shot_files_are_shots(shot: Crossing, tmp_path: Path) -> None:
    for name, keys in shot_files(shot).items():
        file = tmp_path / f"{name}.toml"
        file.write_text(shot_file(shot, keys), encoding="utf-8")
        assert {p.name: p.keyframes for p in read_shot_spec(file).performers} == keys
    assert all((tmp_path / f"shot_{name}.toml").exists() for name in shot.cast)


def test_the_times_by_performers_are_those_of_this_shot() -> None:
    shot = four_people(False)
    assert (speed.CROSSING_LENGTH, len(shot.cameras)) == (shot.frames, 4)
    assert set(np.diff(shot.keys)) == {speed.CROSSING_KEYS}
    assert all(set(people) <= shot.cast.keys() and len(people) == count for count, people in speed.CROSSING.items())
