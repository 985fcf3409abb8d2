"""Cameras that are held in the hand are followed where poses or cameras are to be found before tracking, too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from keypoint_shots import cameras, joint_errors, person, seen_places, strolling, write_openpose
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.fitting.camera_fits.resection import adjusted
from kfmocap.core.fitting.shot_cameras import refine_shot_cameras
from kfmocap.core.shot.performer_request import PerformerRequest
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot, View
from kfmocap.core.tracking.footage_reading.turned_cameras import turns_since, with_early_turns
from kfmocap.core.tracking.prepare import pose_by_keypoint_files
from scipy.spatial.transform import Rotation

PERSON, LENGTH = person(), 24
WALK = strolling(PERSON, LENGTH)
WAYS = np.sin(np.arange(LENGTH)[:, None] * [0.4, 0.5, 0.3]) * [1.2, 1.5, 0.8]


def turns_of(number: int) -> np.ndarray:
    """How a camera is turned by hand, shape (F, 3, 3), each in its own way; on the first frame not at all."""
    return Rotation.from_rotvec(np.radians(WAYS * (-1) ** number)).as_matrix()


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> Shot:
    """A walk before three cameras; detected in pictures that show but the walls."""
    home, views = tmp_path_factory.mktemp("held"), []
    for number, camera in enumerate(cameras()):
        turns, folder = turns_of(number), home / camera.name
        folder.mkdir()
        rough = np.random.default_rng(number).uniform(40, 215, camera.size[::-1])
        wall = cv2.normalize(cv2.GaussianBlur(rough, (0, 0), 1.5), None, 30, 225, cv2.NORM_MINMAX)
        for f, turn in enumerate(turns):
            there = camera.matrix @ turn @ np.linalg.inv(camera.matrix)
            shown = cv2.warpPerspective(wall, there, camera.size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
            cv2.imwrite(str(folder / f"{f:03d}.png"), np.clip(shown, 0, 255))
        write_openpose(folder / "pose", camera.turned(turns), [seen_places(PERSON, WALK)], 0.5)
        views.append(View(camera, folder / "%03d.png", keypoints=folder / "pose"))
    nobody = PerformerRequest("woman", 1.75).placeholder()
    return Shot("held", 30.0, (0, LENGTH - 1), tuple(views), (nobody,))


def posed(shot: Shot, frames: Sequence[int]) -> Shot:
    keys = KeyPoses.whole(list(frames), WALK[list(frames)])
    return replace(shot, performers=(Performer("woman", PERSON, keys),))


def ways(camera: Camera, turns: np.ndarray, true: np.ndarray) -> np.ndarray:
    return camera.displacements(turns @ np.swapaxes(true, 1, 2))


def test_turns_are_found_before_anybody_is_posed(held: Shot) -> None:
    found = turns_since(with_early_turns(held), held)
    for number, (view, own) in enumerate(zip(held.views, found, strict=True)):
        assert own is not None and ways(view.camera, own, turns_of(number)).max() < 0.3
    unwanted = replace(held, settings=Settings(stabilise=False))
    assert with_early_turns(unwanted) is unwanted


def test_turns_count_from_the_first_key_pose_but_not_from_a_proposal(held: Shot) -> None:
    view, true = held.views[0], turns_of(0)
    own = turns_since(with_early_turns(posed(held, [7, 20])), held)[0]
    assert own is not None and ways(view.camera, own, true @ true[7].T).max() < 0.4
    proposed = replace(held.performers[0], body=PERSON, key_poses=KeyPoses.proposed([7], WALK[[7]]))
    own = turns_since(with_early_turns(replace(held, performers=(proposed,))), held)[0]
    assert own is not None and ways(view.camera, own, true).max() < 0.3


def test_cameras_that_stand_still_and_footage_that_is_missing_are_left_alone(held: Shot, tmp_path: Path) -> None:
    first = held.views[0]
    cv2.imwrite(str(tmp_path / "000.png"), cv2.imread(str(first.footage) % 0))
    for f in range(1, LENGTH):
        (tmp_path / f"{f:03d}.png").write_bytes((tmp_path / "000.png").read_bytes())
    still = replace(held, views=(replace(first, footage=tmp_path / "%03d.png"),))
    assert with_early_turns(still) is still
    gone = replace(held, views=(replace(first, footage=tmp_path / "none.mp4"),))
    assert with_early_turns(gone) is gone


def test_poses_from_keypoints_are_where_the_performer_is(held: Shot) -> None:
    known = replace(held, performers=(Performer("woman", PERSON, held.performers[0].key_poses),))
    unmeasured = replace(known, settings=Settings(stabilise=False))

    def error(shot: Shot, frames: Sequence[int] | None = None) -> float:
        motion: Motion = pose_by_keypoint_files(shot, frames)[0].motion
        return 1000 * float(joint_errors(PERSON, motion, PERSON, WALK).mean())

    assert error(known) < 15 < 30 < error(unmeasured)


def test_refined_is_the_pose_of_the_frame_on_which_cameras_are_as_calibrated(held: Shot) -> None:
    """Not the mean of the poses of a camera that is held in the hand."""
    true, number = held.views[1].camera, 1
    wrong = adjusted(true, np.radians([0, 0, 0, 1.0, -1.0, 0.2, 0]))
    views = [replace(view, camera=wrong) if v == number else view for v, view in enumerate(held.views)]
    keys = KeyPoses.proposed([0], WALK[[0]])
    shot = replace(held, views=tuple(views), performers=(Performer("woman", PERSON, keys),))
    refined = refine_shot_cameras(shot).views[number].camera
    assert refined.stands_still and not refined.moving
    points = seen_places(PERSON, WALK)[::5]
    before, after = (np.linalg.norm(c.project(points) - true.project(points), axis=-1).mean() for c in (wrong, refined))
    assert after < 0.25 * before
