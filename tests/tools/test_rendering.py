"""The parts of the footage renderer that need no Blender."""

from __future__ import annotations

import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.core.body import human, landmark_positions, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.shot.footage import frames_at
from kfmocap.core.shot.shot import View
from render.camera_lens import padded_pinhole, through_lens
from render.figure import Figure, make_figure, stance
from render.figure_pose import posed_rotations, turn
from render.footwork import Foot, reaching_legs, stepping
from render.isosurface import mesh_isosurface
from render.takes import BESIDE_THE_WALK, MOMENTS, PLANS, Take, is_written, make_take, write_shot
from render_footage import woven


@pytest.fixture(scope="module")
def figure() -> Figure:
    return make_figure(human(1.75), voxel=0.03)


def test_the_mesh_of_a_sphere_is_closed_and_faces_outwards() -> None:
    vertices, triangles = mesh_isosurface(
        lambda p: np.linalg.norm(p, axis=1) - 0.5, np.full(3, -0.7), np.full(3, 0.7), 0.05
    )
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 0.5, atol=1e-3)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    assert (np.sum(np.cross(b - a, c - a) * a, axis=1) > 0).all()
    edges = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_skin_rests_unchanged_in_its_own_stance(figure: Figure) -> None:
    np.testing.assert_allclose(figure.posed(stance(figure.body))[0], figure.vertices, atol=1e-12)


def test_skin_moves_with_a_body_that_moves_as_a_whole(figure: Figure) -> None:
    rest = stance(figure.body)
    moved = Motion(rest.translations + [1.0, 2.0, 3.0], rest.rotations)
    np.testing.assert_allclose(figure.posed(moved)[0], figure.vertices + [1.0, 2.0, 3.0], atol=1e-12)


def test_skin_encloses_every_joint(figure: Figure) -> None:
    _, T = part_poses(figure.body, stance(figure.body))
    for name, joint in zip(figure.body.names, T[0], strict=True):
        rays = figure.vertices - joint
        near = rays[np.argsort(np.linalg.norm(rays, axis=1))[:40]]
        assert 0.01 < np.linalg.norm(near[0]) < 0.15, name


def test_lens_puts_a_rendered_point_where_the_camera_projects_it() -> None:
    camera = BESIDE_THE_WALK[2]
    pinhole = padded_pinhole(camera)
    rays = np.array([[-0.3, -0.2, 1.0], [0.35, 0.2, 1.0], [0.1, -0.15, 1.0]])
    R, t = camera.pose(0)
    for point in (rays * 5 - t) @ R:
        u, v = pinhole.project(point)
        rows, columns = np.indices(pinhole.size[::-1])
        spot = 250 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2 * 2.5**2))
        seen = through_lens(spot.round().astype(np.uint8), pinhole, camera).astype(float)
        rows, columns = np.indices(seen.shape)
        centre = [np.sum(columns * seen) / seen.sum(), np.sum(rows * seen) / seen.sum()]
        np.testing.assert_allclose(centre, camera.project(point), atol=0.1)


TAKES = [make_take(name) for name in PLANS]
takes = pytest.mark.parametrize("take", TAKES, ids=lambda take: take.name)


def test_a_person_is_exposed_around_each_frame() -> None:
    take = make_take("throw")
    np.testing.assert_array_equal(take.between.translations[::MOMENTS], take.motion.translations)
    moving = take.exposed(30)
    assert len(moving) == MOMENTS // 2
    middle = moving[[len(moving) // 2]]
    assert np.abs(middle.difference(take.motion[[30]])).max() < 1e-9
    np.testing.assert_array_equal(take.exposed(0).translations[0], take.motion.translations[0])


def test_a_persons_shoulders_rise_as_the_trackers_body_cannot() -> None:
    take = make_take("throw")
    rigid = landmark_positions(take.body, take.motion, take.landmarks)
    shoulder, hip = (take.landmarks.index(name) for name in ("RShoulder", "RHip"))
    assert np.linalg.norm(take.truth() - rigid, axis=2)[:, shoulder].max() > 0.02
    np.testing.assert_allclose(take.truth()[:, hip], rigid[:, hip], atol=1e-12)


def test_no_board_is_painted_before_a_person() -> None:
    with pytest.raises(ValueError, match="no board is painted before the person of 'throw'"):
        make_take("throw", board=True)


@takes
def test_the_performer_is_in_every_picture(take: Take) -> None:
    for camera in take.cameras:
        uv = camera.project(take.truth())
        assert (uv > 3).all(), camera.name
        assert (uv < np.array(camera.size) - 4).all(), camera.name


@takes
def test_no_foot_goes_through_the_floor(take: Take) -> None:
    feet = landmark_positions(take.body, take.motion, ["RHeel", "RBigToe", "LHeel", "LBigToe"])
    assert feet[..., 2].min() > 0.0
    assert feet[..., 2].min(axis=1).max() < 0.05


def test_the_crossing_goes_from_right_to_left_with_the_right_side_away() -> None:
    take = make_take("crossing")
    [camera] = take.cameras
    hip = [take.landmarks.index(name) for name in ("RHip", "LHip")]
    u = camera.project(take.truth()[:, hip[0]])[:, 0]
    assert len(u) == 97
    assert (np.diff(u) < 0).all()
    assert u[0] > 0.7 * camera.size[0]
    assert u[-1] < 0.3 * camera.size[0]
    right, left = np.linalg.norm(take.truth()[:, hip] - camera.centre_world(), axis=2).mean(axis=0)
    assert right > left + 0.1


@pytest.mark.parametrize(("name", "least"), [("throw", 500), ("whirl", 360)])
def test_the_performer_turns_round(name: str, least: float) -> None:
    truth = make_take(name).truth()
    names = make_take(name).landmarks
    across = truth[:, names.index("LHip")] - truth[:, names.index("RHip")]
    heading = np.degrees(np.unwrap(np.arctan2(across[:, 1], across[:, 0])))
    assert (np.diff(heading) > 0).all()
    assert heading[-1] - heading[0] > least


def test_legs_put_the_feet_where_they_are_to_be() -> None:
    body = human(1.75)
    t = np.linspace(0, 1, 9)
    heading = np.radians(80 * t)
    pelvis = Motion(np.tile([0.1, -0.05, 0.85], (9, 1)), posed_rotations(body, {"pelvis": turn("y", heading)}, 9))
    feet = {side: stepping(heading, side, np.radians(40), 0.12, 0.04) for side in "LR"}
    turns = reaching_legs(body, pelvis, feet)
    Q = posed_rotations(body, {"pelvis": turn("y", heading), **turns}, 9)
    for side, foot in feet.items():
        ankle, toe, knee, hip = np.moveaxis(
            landmark_positions(
                body, Motion(pelvis.translations, Q), [f"{side}{n}" for n in ("Ankle", "BigToe", "Knee", "Hip")]
            ),
            1,
            0,
        )
        np.testing.assert_allclose(ankle[:, :2], foot.place, atol=1e-9)
        flat = foot.lift < 1e-9
        np.testing.assert_allclose(np.ptp(ankle[flat, 2]), 0, atol=1e-9)
        front = np.column_stack([np.cos(foot.heading), np.sin(foot.heading)])
        assert (np.sum((toe - ankle)[:, :2] * front, axis=1) > 0.1).all()
        assert (np.sum((knee - (hip + ankle) / 2)[:, :2] * front, axis=1) > 0).all()


def test_a_foot_out_of_reach_is_refused() -> None:
    body = human(1.75)
    pelvis = Motion(np.array([[0.0, 0.0, 1.5]]), np.tile(np.eye(3), (1, len(body), 1, 1)))
    foot = Foot(np.array([[0.1, 0.0]]), np.zeros(1), np.zeros(1))
    with pytest.raises(ValueError, match="the leg is"):
        reaching_legs(body, pelvis, {"L": foot})


@pytest.mark.parametrize("fields", ["top-first", "bottom-first"])
def test_fields_are_woven_as_they_are_read(tmp_path: Path, fields: str) -> None:
    take = make_take("throw")
    pictures = [tmp_path / f"{k}.png" for k in range(4)]
    width, height = take.cameras[0].size
    for k, path in enumerate(pictures):
        cv2.imwrite(str(path), np.full((height, width, 3), 50 * k + 20, np.uint8))
    woven(pictures, fields, tmp_path)
    view = View(take.cameras[0], tmp_path / "woven_%04d.png", fields=fields)
    seen = [image.mean() for image in frames_at(view, range(4), 1.0)]
    np.testing.assert_allclose(seen, [20, 70, 120, 170], atol=1)


def test_footage_is_known_by_its_take(tmp_path: Path) -> None:
    walk, shorter = make_take("walk"), make_take("walk", 30)
    assert not is_written(walk, tmp_path)
    write_shot(walk, tmp_path)
    assert is_written(walk, tmp_path)
    assert not is_written(shorter, tmp_path)


def test_the_throw_is_a_shot_of_fields(tmp_path: Path) -> None:
    take = make_take("throw")
    write_shot(take, tmp_path)
    document = tomllib.loads((tmp_path / "shot.toml").read_text())
    assert document["view"] == [{"camera": "cam01", "footage": "cam01.mp4", "fields": "top-first"}]
    assert document["shot"]["fps"] == 60
    assert document["shot"]["frames"] == [0, 71]
    assert document["performer"][0]["keyframes"] == [0, 15, 26, 41, 52, 61, 66, 71]
