"""Bodies of other proportions, and bodies fitted to footage whose true body is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from keypoint_shots import cameras, keypoints_of, seen_places, strolling
from kfmocap.core.body import Body, human, landmark_positions, part_poses
from kfmocap.core.body.measures.shaping import joint_jacobian, mirrored_parts, shaped
from kfmocap.core.body.motion import Motion
from kfmocap.core.errors import BodyError, CancelledError
from kfmocap.core.fitting import body_fit
from kfmocap.core.fitting.body_fit import fit_bodies
from kfmocap.core.fitting.key_frame_views import KeyFrameView
from kfmocap.core.shot.shot import KeyPoses, Shot, View
from synthetic import CAMERAS, figure, film, numeric_jacobian, random_motion, shot_of, swing

Array = np.ndarray
MOTION = swing(figure(), 16, size=0.9)[::4]


def grown(body: Body, size: float, seed: int | None = None) -> Body:
    """A body of another size and, with a seed, of other proportions, its sides alike."""
    stretch = np.full((len(body), 3), size)
    if seed is not None:
        stretch += np.random.default_rng(seed).normal(0, 0.05, stretch.shape)
        for left, right in mirrored_parts(body):
            stretch[right] = stretch[left]
    return shaped(body, stretch, np.zeros_like(stretch))


def lengths(body: Body) -> Array:
    return np.array([np.linalg.norm(part.tail_world - part.head_world) for part in body.parts])


@pytest.mark.parametrize(("collar_bones", "carried"), [(True, "shoulder"), (False, "upper_arm")])
def test_a_stretch_acts_on_all_that_a_part_carries(collar_bones, carried):
    body = human(collar_bones=collar_bones)
    stretch = np.zeros((len(body), 3))
    thigh, chest = body.index("thigh.L"), body.index("chest")
    stretch[thigh, 1], stretch[chest, 0] = 0.2, 0.1
    wide = shaped(body, stretch, np.zeros_like(stretch))
    ratio = lengths(wide) / lengths(body)
    assert np.allclose(ratio, np.where(np.arange(len(body)) == thigh, 1.2, 1.0))
    joints, before = (np.array([b.parts[b.index(f"{carried}.{s}")].head_world[0] for s in "LR"]) for b in (wide, body))
    assert np.allclose(joints, 1.1 * before)
    arms, own = (np.array([b.parts[b.index(f"upper_arm.{s}")].head_world[0] for s in "LR"]) for b in (wide, body))
    assert np.allclose(arms - joints, own - before)  # the collar bones are as long as they were
    assert np.array_equal(wide.parts[0].head_world, body.parts[0].head_world)
    assert np.allclose(wide.parts[thigh].vertices, body.parts[thigh].vertices * [1, 1.2, 1])
    knee, shin = wide.landmarks["LKnee"], wide.parts[wide.index("shin.L")]
    assert np.allclose(shin.head_world, wide.parts[thigh].tail_world) and knee[0] == wide.index("shin.L")


def test_bodies_shaped_alike_have_the_rotations_of_the_first():
    body = human()
    motion = random_motion(body, 2)
    other = grown(body, 0.1)
    R, T = part_poses(body, motion)
    R_other, T_other = part_poses(other, motion)
    assert np.allclose(R, R_other)
    assert np.allclose(T_other - T_other[:, :1], 1.1 * (T - T[:, :1]))
    names = ["LKnee", "Nose", "RBigToe"]
    points = landmark_positions(body, motion, names) - T[:, :1]
    assert np.allclose(landmark_positions(other, motion, names) - T[:, :1], 1.1 * points)


def test_joints_move_with_the_stretches_as_the_jacobian_says():
    body, size = figure(), (len(figure()), 3)
    motion = random_motion(body, 2)

    def joints(stretch: Array) -> Array:
        return part_poses(shaped(body, stretch.reshape(size), np.zeros(size)), motion)[1]

    J = joint_jacobian(body, part_poses(body, motion)[0])
    numeric = numeric_jacobian(joints, np.zeros(np.prod(size)))
    assert np.abs(J.reshape(numeric.shape) - numeric).max() < 1e-8


def filmed(folder: Path, truth: Body) -> list[View]:
    return film(folder, [truth], [MOTION], CAMERAS)


def posed(views: list[View], body: Body, motion: Motion = MOTION) -> Shot:
    return shot_of(views, [body], [motion], range(len(MOTION)))


@pytest.mark.parametrize("size", [-0.08, 0.08])
def test_a_body_of_another_size_is_found_from_its_outlines(tmp_path, size):
    truth = figure()
    start = grown(truth, size)
    fit = fit_bodies(posed(filmed(tmp_path, truth), start))
    before, after = np.abs(lengths(start) / lengths(truth) - 1), np.abs(lengths(fit.bodies[0]) / lengths(truth) - 1)
    assert after.mean() < 0.4 * before.mean() and after.max() < 0.06
    assert fit.growth[0] == pytest.approx(-size, abs=0.04)
    widths = [np.ptp(b.parts[0].vertices, axis=0)[[0, 2]] for b in (fit.bodies[0], truth)]
    assert np.allclose(widths[0], widths[1], rtol=0.05)


def test_a_body_that_fits_stays_as_it_is(tmp_path):
    truth = figure()
    fit = fit_bodies(posed(filmed(tmp_path, truth), truth))
    assert np.abs(lengths(fit.bodies[0]) / lengths(truth) - 1).max() < 0.04
    assert np.abs(fit.poses[0].difference(MOTION)).max() < 0.12
    assert np.array_equal(fit.bodies[0].parts[0].head_world, truth.parts[0].head_world)


def test_keypoints_tell_lengths_that_outlines_leave_open(tmp_path, monkeypatch):
    start = human(1.75)
    truth = grown(start, 0.05, seed=1)
    motion, views = strolling(truth, 40)[[0, 13, 26, 39]], cameras(3)
    seen = keypoints_of(views, seen_places(truth, motion))
    shot = shot_of([View(c, tmp_path) for c in views], [start], [motion], range(4))
    black = [KeyFrameView(np.arange(4), np.zeros((4, 48, 64, 3), np.uint8), 10.0, 0.0) for _ in views]
    monkeypatch.setattr(body_fit, "read_key_frames", lambda *_: black)
    monkeypatch.setattr(body_fit, "read_shot_keypoints", lambda _: [])
    monkeypatch.setattr(body_fit, "performer_keypoints", lambda *_: [seen])
    fit = fit_bodies(shot)
    limbs = [truth.index(f"{bone}.{s}") for bone in ("upper_arm", "forearm", "thigh", "shin") for s in "LR"]
    off = [np.abs(lengths(b) - lengths(truth))[limbs].max() for b in (start, fit.bodies[0])]
    assert off[0] > 0.02 and off[1] < 0.012


def test_without_a_key_pose_of_the_whole_body_there_is_nothing_to_fit_to(tmp_path):
    shot = posed(filmed(tmp_path, figure()), figure())
    partial = np.zeros((1, figure().dof), bool)
    partial[0, :6] = True
    keys = KeyPoses(np.array([0]), MOTION[[0]], partial)
    shot = replace(shot, performers=(replace(shot.performers[0], key_poses=keys),))
    with pytest.raises(BodyError, match="whole body"):
        fit_bodies(shot)


def test_a_fit_can_be_cancelled(tmp_path):
    with pytest.raises(CancelledError):
        fit_bodies(posed(filmed(tmp_path, figure()), figure()), lambda what, _: what == "footage")
