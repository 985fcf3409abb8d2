"""The body: a tree that is what its measures say, and kinematics whose Jacobians are derivatives."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kfmocap.core.body import (
    Body,
    default_measures,
    human,
    landmark_positions,
    part_poses,
    point_jacobian,
    twist_jacobian,
)
from kfmocap.core.body.body import Part
from kfmocap.core.body.human import FRACTIONS, SHIFTS, measure_names
from kfmocap.core.body.joint_limits import posture_prior
from kfmocap.core.body.motion import Motion
from kfmocap.core.errors import BodyError
from kfmocap.core.numerics import rotations
from synthetic import at_rest, figure, numeric_jacobian, random_motion, rigidly_moved

BODIES = {"figure": figure(), "human": human(1.8)}
MIRROR = np.diag([-1.0, 1.0, 1.0])
bodies = pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)


def at(body: Body, name: str) -> np.ndarray:
    return landmark_positions(body, at_rest(body), [name])[0, 0]


def distance(body: Body, a: str, b: str) -> float:
    return float(np.linalg.norm(at(body, a) - at(body, b)))


class Meanwhile(str):
    """A name during whose pickling another value of a body is cached, as by another thread."""

    body: Body

    def __reduce__(self) -> tuple[type[str], tuple[str]]:
        _ = self.body.ancestry
        return str, (str(self),)


def test_a_body_is_pickled_while_its_cached_properties_are_stored() -> None:
    name = Meanwhile("point")
    name.body = Body(figure().parts, {name: (0, np.zeros(3))})
    copy = pickle.loads(pickle.dumps(name.body))
    assert copy.names == figure().names and list(copy.landmarks) == ["point"]


def test_the_default_body_is_a_tree_of_the_named_parts() -> None:
    body = human()
    assert body.parents[0] == -1 and all(0 <= p < i for i, p in enumerate(body.parents) if i)
    sides = ("shoulder", "upper_arm", "forearm", "hand", "thigh", "shin", "foot")
    expected = {"pelvis", "spine", "chest", "head"} | {f"{name}.{side}" for name in sides for side in "LR"}
    assert set(body.names) == expected and len(body) == len(expected)
    assert body.names[body.parents[body.index("shin.L")]] == "thigh.L"
    assert body.dof == 3 + 3 * len(body)


def test_ancestry_lists_the_chain_to_the_root() -> None:
    body = human()
    chain = {body.names[k] for k in np.flatnonzero(body.ancestry[body.index("hand.R")])}
    assert chain == {"pelvis", "spine", "chest", "shoulder.R", "upper_arm.R", "forearm.R", "hand.R"}


def test_without_collar_bones_arms_hang_on_the_chest_with_all_joints_where_they_were() -> None:
    with_them, without = human(), human(collar_bones=False)
    assert set(with_them.names) - set(without.names) == {"shoulder.L", "shoulder.R"}
    assert without.names[without.parents[without.index("upper_arm.L")]] == "chest"
    for name in without.landmarks:
        np.testing.assert_allclose(at(without, name), at(with_them, name), atol=1e-12)


@pytest.mark.parametrize("parents", [(-1, 1), (-1, -1), (0, 0), (-1, 2, 0)])
def test_parts_that_do_not_form_a_tree_are_refused(parents: tuple[int, ...]) -> None:
    solid = figure().parts[0]
    parts = tuple(
        Part(f"p{i}", p, solid.head_world, solid.tail_world, solid.R_world_rest, solid.vertices)
        for i, p in enumerate(parents)
    )
    with pytest.raises(BodyError, match="tree"):
        Body(parts, {})


@given(st.floats(0.5, 2.3))
def test_rest_pose_stands_on_the_ground_at_its_height(height: float) -> None:
    body = human(height)
    assert at(body, "Head")[2] == pytest.approx(height, abs=0.02 + 0.01 * height)  # the soles are 2 cm thick
    assert at(body, "Hip")[2] == pytest.approx(0.53 * height, abs=0.02 + 0.01 * height)
    lowest = min((p.vertices @ p.R_world_rest.T + p.head_world)[:, 2].min() for p in body.parts)
    assert lowest == pytest.approx(0, abs=0.02)
    for name in ("LKnee", "RAnkle", "Neck", "Nose", "LWrist"):
        assert 0 < at(body, name)[2] < height


@bodies
def test_rest_pose_is_what_the_parts_say(body: Body) -> None:
    R, T = part_poses(body, at_rest(body))
    np.testing.assert_allclose(R[0], [p.R_world_rest for p in body.parts], atol=1e-12)
    np.testing.assert_allclose(T[0], [p.head_world for p in body.parts], atol=1e-12)
    for p in body.parts:  # the bone lies along y
        length = np.linalg.norm(p.tail_world - p.head_world)
        np.testing.assert_allclose(p.R_world_rest.T @ (p.tail_world - p.head_world), [0, length, 0], atol=1e-12)
        np.testing.assert_allclose(p.R_world_rest @ p.R_world_rest.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(p.R_world_rest) == pytest.approx(1)


def test_left_and_right_are_mirror_images() -> None:
    body = human()
    for name in (n for n in body.landmarks if n.startswith("L")):
        np.testing.assert_allclose(at(body, "R" + name[1:]), MIRROR @ at(body, name), atol=1e-12)
        assert at(body, name)[0] > 0
    for left in (p for p in body.parts if p.name.endswith(".L")):
        right = body.parts[body.index(left.name[:-1] + "R")]
        outline = [p.vertices @ p.R_world_rest.T + p.head_world for p in (left, right)]
        outline[0] = outline[0] @ MIRROR
        distances = np.linalg.norm(outline[0][:, None] - outline[1][None], axis=-1)
        assert distances.min(axis=1).max() < 1e-9 and distances.min(axis=0).max() < 1e-9


def test_limits_mirror_with_the_turns_that_they_limit() -> None:
    """A turn on the left and its mirror image on the right are both allowed, or neither is."""
    body = human()
    rng = np.random.default_rng(0)
    for left in (p for p in body.parts if p.name.endswith(".L")):
        right = body.parts[body.index(left.name[:-1] + "R")]
        to_right = right.R_world_rest.T @ MIRROR @ left.R_world_rest
        for v in rng.uniform(-2, 2, (50, 3)):
            mirrored = -to_right @ v  # a rotation vector is axial
            inside = [
                ((w >= p.limits[:, 0] - 1e-9) & (w <= p.limits[:, 1] + 1e-9)).all()
                for w, p in ((v, left), (mirrored, right))
            ]
            assert inside[0] == inside[1]
    assert (body.limits[..., 0] <= 0).all() and (body.limits[..., 1] >= 0).all()


def test_measures_are_honoured() -> None:
    wanted = {"thigh": 0.41, "shin.L": 0.39, "upper_arm": 0.28, "forearm.R": 0.24, "hip_width": 0.2}
    wanted |= {"shoulder_width": 0.37, "head": 0.3, "foot_down": 0.06}
    body, average = human(1.7, wanted), default_measures(1.7)
    assert distance(body, "LHip", "LKnee") == pytest.approx(0.41)
    assert distance(body, "RHip", "RKnee") == pytest.approx(0.41)
    assert distance(body, "LKnee", "LAnkle") == pytest.approx(0.39)
    assert distance(body, "RKnee", "RAnkle") == pytest.approx(average["shin.R"])
    assert distance(body, "LShoulder", "LElbow") == pytest.approx(0.28)
    assert distance(body, "RElbow", "RWrist") == pytest.approx(0.24)
    assert distance(body, "LHip", "RHip") == pytest.approx(0.2)
    assert distance(body, "LShoulder", "RShoulder") == pytest.approx(0.37)
    assert distance(body, "Neck", "Head") == pytest.approx(0.3)
    assert at(body, "LAnkle")[2] - at(body, "LBigToe")[2] == pytest.approx(0.06)


def test_every_measure_moves_a_landmark() -> None:
    """The fit of a body to landmarks depends on it."""
    average = default_measures(1.75)
    assert set(average) == {key for name in FRACTIONS for key in measure_names(name)}
    names = list(human().landmarks)
    before = landmark_positions(human(), at_rest(human()), names) - at(human(), "Hip")
    for key, value in average.items():
        body = human(1.75, {key: value + 0.02})
        moved = landmark_positions(body, at_rest(body), names) - at(body, "Hip") - before
        assert np.abs(moved).max() > 0.005, key


@pytest.mark.parametrize(
    ("height", "measures"),
    [
        (0.1, {}),
        (np.nan, {}),
        ("1.7", {}),
        (1.7, {"thigh": -0.1}),
        (1.7, {"elbow": 0.1}),
        (1.7, {"shin.L": np.nan}),
        (1.7, {"shin": 43.0}),
    ],
)
def test_impossible_bodies_are_refused(height: Any, measures: dict[str, float]) -> None:
    with pytest.raises(BodyError):
        human(height, measures)


def test_shifts_may_be_negative() -> None:
    for name in SHIFTS:
        assert human(1.7, {name: -0.01})


def test_unknown_part_is_named_in_the_error() -> None:
    with pytest.raises(BodyError, match="tail"):
        human().index("tail")


@bodies
def test_faces_close_the_hull_and_look_outwards(body: Body) -> None:
    for p in body.parts:
        centre = p.vertices.mean(axis=0)
        a, b, c = (p.vertices[p.faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        assert (np.einsum("nk,nk->n", normals, a - centre) > 0).all()
        np.testing.assert_allclose(normals.sum(axis=0), 0, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(p.planes[:, :3], axis=1), 1)
        assert (p.vertices @ p.planes[:, :3].T + p.planes[:, 3]).max() < 1e-9


@bodies
def test_forward_kinematics_is_the_product_along_the_chain(body: Body) -> None:
    motion = random_motion(body, 4)
    R, T = part_poses(body, motion)
    for f in range(4):
        for i, p in enumerate(body.parents):
            parent = np.eye(3) if p < 0 else R[f, p]
            np.testing.assert_allclose(R[f, i], parent @ body.R_parent_rest[i] @ motion.rotations[f, i], atol=1e-12)
            joint = motion.translations[f] if p < 0 else T[f, p] + R[f, p] @ body.offsets[i]
            np.testing.assert_allclose(T[f, i], joint, atol=1e-12)


@bodies
def test_moving_the_root_moves_everything_rigidly(body: Body) -> None:
    motion, names = random_motion(body, 3), list(body.landmarks)
    G, s = random_motion(body, 1, seed=5).rotations[0, 1], np.array([1.0, -2.0, 0.5])
    moved = landmark_positions(body, rigidly_moved(body, motion, G, s), names)
    np.testing.assert_allclose(moved, landmark_positions(body, motion, names) @ G.T + s, atol=1e-12)


@bodies
def test_difference_undoes_moved(body: Body) -> None:
    motion = random_motion(body, 3)
    delta = np.random.default_rng(3).normal(0, 0.5, (3, body.dof))
    np.testing.assert_allclose(motion.difference(motion.moved(delta)), delta, atol=1e-9)


@bodies
def test_point_jacobian_is_the_derivative_on_the_manifold(body: Body) -> None:
    motion, names = random_motion(body, 2), list(body.landmarks)
    parts, _ = body.landmark_arrays(names)
    R, T = part_poses(body, motion)
    J = point_jacobian(body, R, T, parts, landmark_positions(body, motion, names))

    def placed(delta: np.ndarray, f: int) -> np.ndarray:
        return landmark_positions(body, motion[[f]].moved(delta[None]), names)[0]

    for f in range(2):
        numeric = numeric_jacobian(lambda d, f=f: placed(d, f), np.zeros(body.dof))
        assert np.abs(J[f] - numeric).max() < 1e-6 * np.abs(numeric).max()


@bodies
def test_twist_jacobian_is_the_derivative_of_the_part_poses(body: Body) -> None:
    motion = random_motion(body, 1)
    R, T = part_poses(body, motion)
    J = twist_jacobian(body, R, T)[0]

    def twists(delta: np.ndarray) -> np.ndarray:
        """Velocity and turning of every part in the world, read off the pose change itself."""
        R2, T2 = part_poses(body, motion.moved(delta[None]))
        turn = R2[0] @ np.swapaxes(R[0], 1, 2)
        spin = np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]])
        at_origin = T2[0] - np.einsum("pab,pb->pa", turn, T[0])
        return np.concatenate([at_origin, spin.T / 2], axis=1)

    numeric = numeric_jacobian(twists, np.zeros(body.dof))
    assert np.abs(J - numeric).max() < 1e-6 * np.abs(numeric).max()


def test_quaternions_have_no_sign_jumps_and_are_the_rotations() -> None:
    body = figure()
    delta = np.zeros((60, body.dof))
    delta[:, 3:6] = np.linspace(0, 9, 60)[:, None] * np.array([0.6, 0.0, 0.8])
    delta[:, 8] = np.linspace(0, -7, 60)
    motion = at_rest(body, 60).moved(delta)
    w, x, y, z = np.moveaxis(motion.quaternions(), -1, 0)
    assert (np.sum(motion.quaternions()[1:] * motion.quaternions()[:-1], axis=-1) > 0.9).all()
    np.testing.assert_allclose(1 - 2 * (y * y + z * z), motion.rotations[..., 0, 0], atol=1e-12)
    np.testing.assert_allclose(2 * (x * y + w * z), motion.rotations[..., 1, 0], atol=1e-12)
    np.testing.assert_allclose(2 * (x * z - w * y), motion.rotations[..., 2, 0], atol=1e-12)


def test_replaced_leaves_the_original_alone() -> None:
    body = figure()
    motion, other = random_motion(body, 5), random_motion(body, 2, seed=1)
    before = motion.translations.copy()
    new = motion.replaced(2, other)
    assert isinstance(new, Motion)
    np.testing.assert_array_equal(new.translations[2:4], other.translations)
    np.testing.assert_array_equal(new.rotations[[0, 1, 4]], motion.rotations[[0, 1, 4]])
    np.testing.assert_array_equal(motion.translations, before)


def test_trunk_and_collar_bones_are_stiff_and_nothing_else() -> None:
    body = human()
    stiff = {name for name, is_stiff in zip(body.names, body.is_stiff, strict=True) if is_stiff}
    assert stiff == {"spine", "chest", "shoulder.L", "shoulder.R"}
    assert not figure().is_stiff.any()


@pytest.mark.parametrize("rest", [True, False])
def test_the_posture_prior_is_the_departures_share_of_every_turn(rest: bool) -> None:
    body = human()
    motion = random_motion(body, 3, turn=0.02)
    found = posture_prior(body, motion, rest=rest)
    turns = rotations.log(motion.rotations[:, 1:])
    inside = (turns == np.clip(turns, body.limits[1:, :, 0], body.limits[1:, :, 1])).all()
    assert inside and found.energy == pytest.approx(rest * np.sum((turns / body.departures[1:, None]) ** 2) / 3)
    numeric = numeric_jacobian(
        lambda d: posture_prior(body, motion.moved(d.reshape(3, -1)), rest=rest).energy / 2,
        np.zeros(3 * body.dof),
        1e-6,
    )
    np.testing.assert_allclose(found.gradient.ravel(), numeric.ravel(), rtol=1e-5, atol=1e-6)
