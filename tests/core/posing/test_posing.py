"""Posing by clicks: what they show is met, what they do not show stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from keypoint_shots import cameras, person, strolling
from kfmocap.core.body import Body, human, landmark_positions, part_poses
from kfmocap.core.body.body import REST_SIGMA
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.errors import KeypointError
from kfmocap.core.numerics import rotations
from kfmocap.core.posing import clicks as clicks_module
from kfmocap.core.posing.clicks import Click, ClickSolver, click_keypoints, movement, movement_precision, pixel, ray
from kfmocap.core.posing.depth import limb_flipped, moved_in_depth
from kfmocap.core.posing.mirror import mirrored_poses
from kfmocap.core.posing.standing import FLOATING_HEIGHT, lowest_point, steps_to_floor
from synthetic import at_rest, numeric_jacobian, random_motion, rigidly_moved, rigidly_moved_camera

BODY = person()
_PLAIN = human(collar_bones=False)
WITHOUT_STIFF_PARTS = replace(_PLAIN, parts=tuple(replace(part, departure=REST_SIGMA) for part in _PLAIN.parts))
WALK = strolling(BODY, 60)
VIEWS = cameras(3)
LIMBS = [side + joint for side in "LR" for joint in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")]
ANKLES = ["LAnkle", "RAnkle"]
LEVEL = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Rotation from the world to a camera that looks horizontally along y."""
CLICKED = [*LIMBS, "Neck", "Head", "Nose", "LBigToe", "RBigToe"]


def clicks_on(views: list[Camera], pose: Motion, names: list[str] = CLICKED, noise: float = 0.0, seed: int = 0):
    """Clicks on the landmarks of a pose; noise in pixels."""
    rng = np.random.default_rng(seed)
    points = landmark_positions(BODY, pose, names)[0]
    return [
        Click(view, name, tuple(view.rectified().project(point) + rng.normal(0, noise, 2)))
        for view in views
        for name, point in zip(names, points, strict=True)
    ]


def errors(pose: Motion, truth: Motion, names: list[str] = LIMBS) -> np.ndarray:
    """Distances of landmarks, metres."""
    return np.linalg.norm(landmark_positions(BODY, pose, names) - landmark_positions(BODY, truth, names), axis=-1)[0]


@pytest.mark.parametrize("given", [WALK[[20]], at_rest(BODY)], ids=["neighbour", "rest"])
def test_clicks_in_two_views_with_a_pixel_of_noise_give_the_joints_to_15_mm(given):
    """A pixel is 9 mm there; the mean over the joints."""
    truth, found = WALK[[26]], []
    for seed in range(4):
        clicks = click_keypoints(clicks_on(VIEWS[:2], truth, noise=1.0, seed=seed), 0)
        found.append(errors(ClickSolver(BODY, given).fit(clicks).pose, truth))
    assert np.mean(found) < 0.015 and np.max(found) < 0.05


def test_one_view_keeps_the_depth():
    """An arm swings across the picture: it is where the clicks are, and as far from the camera as it was."""
    given = WALK[[20]]
    view, names = VIEWS[0], LIMBS
    R, _ = view.pose(0)
    axis = R[2]
    truth = given.moved(np.zeros((1, BODY.dof)))
    arm = BODY.index("upper_arm.L")
    R_arm = rotations.exp(0.4 * axis)
    Q = truth.rotations.copy()
    parent = world_rotation(given, BODY.parents[arm])
    Q[0, arm] = (parent @ BODY.R_parent_rest[arm]).T @ R_arm @ parent @ BODY.R_parent_rest[arm] @ Q[0, arm]
    truth = Motion(given.translations, Q)
    assert errors(truth, given).max() > 0.15
    for seed in range(4):
        fit = ClickSolver(BODY, given).fit(click_keypoints(clicks_on([view], truth, names, 1.0, seed), 0))
        moved = landmark_positions(BODY, fit.pose, names) - landmark_positions(BODY, given, names)
        assert np.abs(moved @ axis).mean() < 0.05
        assert fit.misfit < 0.012
        assert errors(fit.pose, truth).mean() < 0.055


def world_rotation(pose: Motion, part: int) -> np.ndarray:
    return part_poses(BODY, pose)[0][0, part]


def test_one_click_on_a_wrist_moves_the_arm_and_hardly_the_trunk():
    given = WALK[[20]]
    view = VIEWS[1]
    [click] = clicks_on([view], given, ["LWrist"])
    fit = ClickSolver(BODY, given).fit(
        click_keypoints([replace(click, pixel=(click.pixel[0], click.pixel[1] - 25))], 0)
    )
    assert fit.misfit < 0.01
    assert errors(fit.pose, given, ["LWrist"]) > 0.15
    assert errors(fit.pose, given, ["RShoulder", "LHip", "RHip", "LKnee"]).max() < 0.04


def test_without_clicks_the_pose_is_the_given_one():
    fit = ClickSolver(BODY, WALK[[3]]).fit(click_keypoints([], 0))
    assert errors(fit.pose, WALK[[3]]).max() == 0


def test_held_joints_stay_to_the_last_bit():
    held = np.ones(BODY.dof, bool)
    for part in ("upper_arm.L", "forearm.L"):
        held[3 + 3 * BODY.index(part) : 6 + 3 * BODY.index(part)] = False
    fit = ClickSolver(BODY, WALK[[20]], held).fit(click_keypoints(clicks_on(VIEWS[:2], WALK[[40]]), 0))
    moved = WALK[[20]].difference(fit.pose)[0]
    assert np.abs(moved[held]).max() < 1e-12 < np.abs(moved[~held]).max()


def test_a_body_that_faces_away_is_turned_about():
    given = rigidly_moved(BODY, WALK[[20]], rotations.exp(np.array([0, 0, np.pi])), np.array([0.7, 0.4, 0.0]))
    fit = ClickSolver(BODY, given).fit(click_keypoints(clicks_on(VIEWS[:1], WALK[[20]]), 0))
    assert fit.misfit < 0.02
    facing = [world_rotation(pose, 0)[:, 0] for pose in (fit.pose, WALK[[20]])]
    assert facing[0] @ facing[1] > 0.9


def test_joints_stay_within_their_limits():
    """A wrist clicked above the head, an ankle behind it."""
    clicks = [Click(VIEWS[0], "LWrist", (320.0, 20.0)), Click(VIEWS[0], "RAnkle", (300.0, 40.0))]
    fit = ClickSolver(BODY, at_rest(BODY)).fit(click_keypoints(clicks, 0))
    turns = rotations.log(fit.pose.rotations[0, 1:])
    assert (turns > BODY.limits[1:, :, 0] - 0.1).all() and (turns < BODY.limits[1:, :, 1] + 0.1).all()


def test_few_steps_from_an_earlier_fit_follow_a_click_that_is_dragged():
    given, truth = WALK[[20]], WALK[[26]]
    solver = ClickSolver(BODY, given)
    clicks = clicks_on(VIEWS[:2], truth)
    whole = solver.fit(click_keypoints(clicks, 0))
    for shift in range(1, 6):
        clicks[0] = replace(clicks[0], pixel=(clicks[0].pixel[0] + 2, clicks[0].pixel[1] - shift))
        whole = solver.fit(click_keypoints(clicks, 0), whole, steps=3, search=False)
    afresh = solver.fit(click_keypoints(clicks, 0))
    assert errors(whole.pose, afresh.pose).max() < 0.01


def test_clicks_are_of_the_undistorted_picture():
    bent = replace(VIEWS[0], distortions=np.array([-0.3, 0.1, 0.001, 0.002]))
    truth = WALK[[26]]
    plain, other = ClickSolver(BODY, WALK[[20]]), ClickSolver(BODY, WALK[[20]])
    a = plain.fit(click_keypoints(clicks_on([VIEWS[0], VIEWS[1]], truth), 0))
    b = other.fit(click_keypoints(clicks_on([bent, VIEWS[1]], truth), 0))
    assert errors(a.pose, b.pose).max() < 1e-9


def test_the_rays_of_clicks_go_through_what_was_clicked():
    keypoints = click_keypoints(clicks_on(VIEWS, WALK[[5]]), 0)
    points = landmark_positions(BODY, WALK[[5]], list(keypoints.names))
    np.testing.assert_allclose(keypoints.residuals(points), 0, atol=1e-9)


def test_pixels_and_places_are_each_others_inverse():
    np.testing.assert_allclose(pixel(VIEWS[1].matrix, ray(VIEWS[1].matrix, (12.5, 300.0))), (12.5, 300.0))


def test_moving_the_world_moves_the_fit(monkeypatch):
    monkeypatch.setattr(clicks_module, "MIN_GAIN", 1e-9)  # two descents that end early do not end at the same place
    turn, shift = rotations.exp(np.array([0.3, -0.2, 1.1])), np.array([1.0, -2.0, 0.4])
    truth, given = WALK[[26]], WALK[[20]]
    here = clicks_on(VIEWS[:1], truth)
    there = [replace(click, camera=rigidly_moved_camera(click.camera, turn, shift)) for click in here]
    a = ClickSolver(BODY, given).fit(click_keypoints(here, 0), steps=400, search=False)
    b = ClickSolver(BODY, rigidly_moved(BODY, given, turn, shift)).fit(
        click_keypoints(there, 0), steps=400, search=False
    )
    assert errors(b.pose, rigidly_moved(BODY, a.pose, turn, shift)).max() < 1e-4


def test_a_landmark_that_the_body_lacks_is_named():
    with pytest.raises(KeypointError, match="Tail"):
        ClickSolver(BODY, WALK[[0]]).fit(click_keypoints([Click(VIEWS[0], "Tail", (1.0, 1.0))], 0))


def test_the_gradient_of_movement_is_that_of_its_energy():
    given, pose = (random_motion(BODY, 1, seed) for seed in (0, 1))
    precision = movement_precision(BODY)
    numeric = numeric_jacobian(
        lambda d: movement(given, pose.moved(d[None]), precision).energy / 2, np.zeros(BODY.dof), 1e-6
    )
    np.testing.assert_allclose(movement(given, pose, precision).gradient[0], numeric, rtol=1e-5, atol=1e-4)


def test_the_movement_of_heavy_parts_costs_most():
    turns = dict(zip(BODY.names, movement_precision(BODY)[3::3], strict=True))
    assert turns["pelvis"] == max(turns.values())
    assert turns["upper_arm.L"] > turns["forearm.L"] > turns["hand.L"]
    assert turns["thigh.L"] == pytest.approx(turns["thigh.R"])


PARTNERS = [
    BODY.index(name[:-1] + {"L": "R", "R": "L"}[name[-1]]) if name[-2:] in (".L", ".R") else i
    for i, name in enumerate(BODY.names)
]


def test_a_flipped_limb_looks_the_same_and_points_the_other_way():
    pose, (R, t) = WALK[[20]], VIEWS[1].pose(0)
    flipped = limb_flipped(BODY, pose, "LWrist", R[2])
    before, after = (landmark_positions(BODY, p, ["LElbow", "LWrist"])[0] @ R.T + t for p in (pose, flipped))
    np.testing.assert_allclose(after[0], before[0], atol=1e-9)
    np.testing.assert_allclose(after[1, :2], before[1, :2], atol=1e-9)
    np.testing.assert_allclose(after[1, 2] - after[0, 2], before[0, 2] - before[1, 2], atol=1e-9)
    assert abs(after[1, 2] - after[0, 2]) > 0.05


@pytest.mark.parametrize("body", [BODY, WITHOUT_STIFF_PARTS], ids=["stiff", "no stiff parts"])
@pytest.mark.parametrize("landmark", ["Hip", "LHip", "LShoulder", "Neck"])
def test_only_limbs_are_flipped(body: Body, landmark: str):
    pose = random_motion(body, 1)
    assert (limb_flipped(body, pose, landmark, np.eye(3)[1]).rotations == pose.rotations).all()


def test_moved_in_depth_the_root_stays_where_it_is_seen():
    pose = moved_in_depth(WALK[[20]], VIEWS[1].centre_world(), 0.2)
    places = [VIEWS[1].project(p.translations[0]) for p in (pose, WALK[[20]])]
    np.testing.assert_allclose(*places, atol=1e-6)
    away = [np.linalg.norm(p.translations - VIEWS[1].centre_world()) for p in (pose, WALK[[20]])]
    assert away[0] - away[1] == pytest.approx(0.2)


def test_mirrored_landmarks_lie_across_the_middle():
    pose = random_motion(BODY, 3, turn=0.3)
    points = landmark_positions(BODY, mirrored_poses(BODY, pose, PARTNERS), CLICKED)
    other = [{"L": "R", "R": "L"}[n[0]] + n[1:] if n[1:2].isupper() else n for n in CLICKED]
    np.testing.assert_allclose(points, landmark_positions(BODY, pose, other) * [-1, 1, 1], atol=1e-9)


@pytest.mark.parametrize("root", [True, False])
def test_mirroring_twice_changes_nothing(root: bool):
    pose = random_motion(BODY, 2)
    twice = mirrored_poses(BODY, mirrored_poses(BODY, pose, PARTNERS, root), PARTNERS, root)
    assert np.abs(pose.difference(twice)).max() < 1e-9


def test_a_mirrored_pose_may_stay_in_its_place():
    pose = random_motion(BODY, 1)
    moved = pose.difference(mirrored_poses(BODY, pose, PARTNERS, root=False))[0]
    assert np.abs(moved[:6]).max() == 0 < np.abs(moved[6:]).max()


def standing(bend: float, place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Motion:
    """A pose with bent knees whose lowest point is at a place of the floor, z = 0."""
    turns = np.zeros((1, len(BODY), 3))
    for side in "LR":
        for part, share in (("thigh", 1.0), ("shin", -1.7), ("foot", 0.6)):
            turns[:, BODY.index(f"{part}.{side}"), 0] = share * bend
    pose = Motion(BODY.offsets[:1], rotations.exp(turns))
    return replace(pose, translations=pose.translations + np.array(place) - [0, 0, lowest_point(BODY, pose)[0]])


@pytest.mark.parametrize("place", [(0.0, 2.0, 0.0), (-2.0, 0.0, 0.0)])
def test_a_body_posed_in_one_view_stands_on_the_floor_and_not_far_away_above_it(place):
    """The given pose crouches more: farther away its legs would look as short."""
    given, truth = standing(1.3), standing(0.6, place)
    clicks = click_keypoints(clicks_on(VIEWS[1:2], truth, LIMBS, 1.0), 0)
    floats, stands = (ClickSolver(BODY, given, floor=floor).fit(clicks).pose for floor in (None, 0.0))
    assert lowest_point(BODY, floats)[0] > FLOATING_HEIGHT and errors(floats, truth).mean() > 1.0
    assert abs(lowest_point(BODY, stands)[0]) < 0.05 and errors(stands, truth).mean() < 0.15


@pytest.mark.parametrize("raised", [0.0, 0.4], ids=["soles at zero", "soles above zero"])
def test_steps_to_the_floor_lead_back_to_where_the_body_stands(raised):
    """At rest the ankles are as high above the floor as the soles let them, wherever the rest pose is."""
    parts = [
        replace(p, head_world=p.head_world + [0, 0, raised], tail_world=p.tail_world + [0, 0, raised])
        for p in BODY.parts
    ]
    body = replace(BODY, parts=tuple(parts))
    truth, away = at_rest(body), np.array([0.3, 1.2, 0.5])
    floor = float(lowest_point(body, truth)[0])
    points = landmark_positions(body, truth, ANKLES)[0]
    clicks = [
        Click(VIEWS[0], name, tuple(VIEWS[0].rectified().project(point)))
        for name, point in zip(ANKLES, points, strict=True)
    ]
    moved = replace(truth, translations=truth.translations + away)
    steps = list(steps_to_floor(body, click_keypoints(clicks, 0), moved, floor))
    np.testing.assert_allclose(steps, [-away, -away], atol=1e-6)


def test_a_foot_at_the_horizon_does_not_say_where_the_body_stands():
    """A pixel then moves it by metres."""
    level = Camera.create("low", (640, 480), np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]]), LEVEL, [0, 0.1, 5])
    pose = at_rest(BODY)
    clicks = [Click(level, name, tuple(level.project(landmark_positions(BODY, pose, [name])[0, 0]))) for name in ANKLES]
    assert not list(steps_to_floor(BODY, click_keypoints(clicks, 0), pose, float(lowest_point(BODY, pose)[0])))


def test_a_jump_stays_above_the_floor():
    truth = standing(0.3, (0.0, 0.0, 0.5))
    clicks = click_keypoints(clicks_on(VIEWS[:1], truth, LIMBS, 1.0), 0)
    plain, floored = (ClickSolver(BODY, at_rest(BODY), floor=floor).fit(clicks) for floor in (None, 0.0))
    assert lowest_point(BODY, plain.pose)[0] > FLOATING_HEIGHT
    np.testing.assert_array_equal(floored.pose.translations, plain.pose.translations)


def test_the_floor_decides_nothing_where_two_views_show_the_depth():
    truth = standing(0.6, (0.0, 2.0, 0.3))
    clicks = click_keypoints(clicks_on(VIEWS[:2], truth, LIMBS, 1.0), 0)
    plain, floored = (ClickSolver(BODY, standing(1.3), floor=floor).fit(clicks) for floor in (None, 0.0))
    np.testing.assert_array_equal(floored.pose.rotations, plain.pose.rotations)
