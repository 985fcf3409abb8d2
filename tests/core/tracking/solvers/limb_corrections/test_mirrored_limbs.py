"""One camera hardly shows whether a limb points toward it or away from it; both are solved for and compared."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import part_poses
from kfmocap.core.body.kinematics import tip_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from kfmocap.core.tracking.solvers.limb_corrections.mirrored_limbs import mirror_images, mirrored, with_limbs_mirrored
from made_evidence import Landscape
from synthetic import at_rest, dark, ends_held, figure, look_at

BODY, LENGTH, FPS = figure(), 21, 30.0
ARM = [1, 2]
TURNED = slice(4, -4)
CAMERA = look_at("front", (0.0, -5.0, 1.3), (0.0, 0.0, 1.3))
PROBLEM = SegmentProblem(dark(CAMERA, LENGTH), (BODY,), 0, FPS, (ends_held(BODY, LENGTH),))


def reaching(upper: float, fore: float) -> Motion:
    """An arm that begins and ends at rest; in between its two parts are turned about the vertical, radians."""
    rest = at_rest(BODY, LENGTH)
    share = np.clip(np.minimum(np.arange(LENGTH), LENGTH - 1 - np.arange(LENGTH)) / 4, 0, 1)[:, None]
    Q = rest.rotations.copy()
    for part, angle in zip(ARM, (upper, fore), strict=True):
        axis = part_poses(BODY, rest)[0][0, part].T @ [0.0, 0.0, 1.0]
        Q[:, part] = rotations.exp(share * angle * axis)
    return Motion(rest.translations, Q)


def tip(motion: Motion) -> np.ndarray:
    return tip_positions(BODY, part_poses(BODY, motion))[:, ARM[-1]]


@pytest.mark.parametrize("toward", [-1.0, 1.0])
def test_an_arm_on_the_wrong_side_of_the_picture_plane_is_found(toward: float) -> None:
    truth, other = reaching(0.9 * toward, 0.0), reaching(-0.9 * toward, 0.0)
    landscape = Landscape(truth=truth)
    found = with_limbs_mirrored(PROBLEM, landscape.solution(PROBLEM, other), landscape)
    assert np.linalg.norm(tip(other) - tip(truth), axis=1).max() > 0.9
    assert np.linalg.norm(tip(found.motions[0]) - tip(truth), axis=1)[TURNED].max() < 0.05


def test_a_limb_stays_where_the_images_have_it() -> None:
    truth = reaching(0.9, 0.0)
    landscape = Landscape(truth=truth)
    given = landscape.solution(PROBLEM, truth)
    assert with_limbs_mirrored(PROBLEM, given, landscape) is given and landscape.measured


def test_several_views_show_depth_themselves() -> None:
    both = SegmentProblem(dark(CAMERA, LENGTH) * 2, (BODY,), 0, FPS, (ends_held(BODY, LENGTH),))
    landscape = Landscape(truth=reaching(0.9, 0.0))
    given = landscape.solution(both, reaching(-0.9, 0.0))
    assert with_limbs_mirrored(both, given, landscape) is given and not landscape.measured


@pytest.mark.parametrize("bones", [(1,), (2,), (1, 2)])
def test_from_afar_a_mirrored_limb_looks_the_same(bones: tuple[int, ...]) -> None:
    motion = reaching(0.7, 0.4)
    eye = np.tile([0.0, -500.0, 1.3], (LENGTH, 1))
    other = mirrored(BODY, motion, (ARM, bones), eye, np.ones(LENGTH))
    here, there = (tip_positions(BODY, part_poses(BODY, m))[:, ARM] for m in (motion, other))
    np.testing.assert_allclose(here[..., [0, 2]], there[..., [0, 2]], atol=2e-3)
    assert np.abs(here[10, -1, 1] - there[10, -1, 1]) > 0.3


def test_mirror_images_keep_key_poses_and_limits_and_differ_clearly() -> None:
    motion = reaching(0.9, 0.0)
    images = list(mirror_images(PROBLEM, 0, motion))
    assert images
    for image in images:
        np.testing.assert_allclose(image.rotations[[0, -1]], motion.rotations[[0, -1]])
        assert np.linalg.norm(tip(image) - tip(motion), axis=1).max() > 0.4
    assert not list(mirror_images(PROBLEM, 0, reaching(0.3, 0.0)))  # it reaches less far
