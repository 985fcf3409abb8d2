"""Somebody else's human body gets the landmarks that the default body has, and no other body does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import Body, human
from kfmocap.core.body.soles import Soles
from kfmocap.core.keypoints.keypoint_offsets import KeypointOffsets
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.arrays import Array
from kfmocap.core.retargeting.human_landmarks import human_landmarks

OWN = human(1.75)
ROLES = {"pelvis": "hips", "spine": "spine"}
PARTS = {ROLES.get(name, name): i for i, name in enumerate(OWN.names) if name != "chest"}


def turned(body: Body, seed: int = 0) -> Body:
    """The same body with bones that point anywhere, as other programs have them."""
    rng = np.random.default_rng(seed)
    parts = []
    for part in body.parts:
        G = rotations.exp(rng.normal(size=3))
        parts.append(
            replace(part, name=f"b{len(parts)}", R_world_rest=part.R_world_rest @ G, vertices=part.vertices @ G)
        )
    return Body(tuple(parts), {})


def rotated(body: Body, G: Array) -> Body:
    parts = (
        replace(
            part, head_world=G @ part.head_world, tail_world=G @ part.tail_world, R_world_rest=G @ part.R_world_rest
        )
        for part in body.parts
    )
    return Body(tuple(parts), body.landmarks)


def places(body: Body) -> dict[str, Array]:
    return {
        name: body.parts[i].head_world + body.parts[i].R_world_rest @ point
        for name, (i, point) in body.landmarks.items()
    }


@pytest.mark.parametrize("facing", [0.0, 1.9])
def test_landmarks_are_where_the_default_body_has_them(facing: float) -> None:
    own = rotated(OWN, rotations.exp(np.array([0.0, 0.0, facing])))
    other = turned(own)
    found = places(replace(other, landmarks=human_landmarks(other, PARTS)))
    expected = {name: place for name, place in places(own).items() if name[1:] != "Hand"}
    assert set(expected) <= set(found)
    for name, place in expected.items():
        from_skin = name.endswith(("Head", "Nose", "BigToe", "Heel"))
        assert np.linalg.norm(found[name] - place) < (0.015 if from_skin else 1e-9)


def test_soles_and_keypoints_of_the_face_are_those_of_the_default_body() -> None:
    other = turned(OWN)
    other = replace(other, landmarks=human_landmarks(other, PARTS))
    soles, own = Soles.of(other), Soles.of(OWN)
    assert soles is not None
    assert own is not None
    assert soles.names == own.names
    assert soles.leg == pytest.approx(own.leg)
    names = ["LEye", "REye", "LEar", "REar"]
    for body in (other, OWN):
        assert set(KeypointOffsets.on(body, names).parts) == {OWN.index("head")}
    found, expected = (
        [body.parts[i].head_world + body.parts[i].R_world_rest @ p for i, p in zip(on.parts, on.local, strict=True)]
        for body in (other, OWN)
        for on in [KeypointOffsets.on(body, names)]
    )
    np.testing.assert_allclose(found, expected, atol=0.01)


def test_joints_without_a_name_of_their_own_keep_that_of_their_bone() -> None:
    other = turned(OWN)
    found = human_landmarks(other, PARTS)
    assert {f"b{OWN.index(name)}" for name in ("spine", "chest", "shoulder.L", "shoulder.R")} <= set(found)
    assert f"b{OWN.index('forearm.L')}" not in found


@pytest.mark.parametrize("missing", ["hips", "thigh.L", "foot.R"])
def test_a_body_without_legs_has_none(missing: str) -> None:
    assert not human_landmarks(OWN, {role: i for role, i in PARTS.items() if role != missing})


def test_a_body_that_does_not_stand_has_none() -> None:
    lying = rotated(OWN, rotations.exp(np.array([-np.pi / 2, 0.0, 0.0])))
    assert not human_landmarks(lying, PARTS)
