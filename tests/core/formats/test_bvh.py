"""Key poses from BVH files are the poses that were written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bvh_files import bvh_text, wild
from kfmocap.core.body import human, landmark_positions
from kfmocap.core.errors import BodyError, KFMocapError, ShotError
from kfmocap.core.formats.bvh import body_of_bvh, poses_of_bvh, read_bvh

BODY = human()
TEXT = bvh_text(BODY, wild(BODY))


def saved(folder: Path, text: str) -> Path:
    path = folder / "poses.bvh"
    path.write_text(text)
    return path


@pytest.mark.parametrize("order", ["XYZ", "ZXY", "YXZ"])
def test_poses_and_body_are_those_written(tmp_path: Path, order: str) -> None:
    body = human(1.82, {"thigh": 0.48, "upper_arm.L": 0.27, "torso": 0.55, "hip_width": 0.24})
    motion = wild(body)
    skeleton = read_bvh(saved(tmp_path, bvh_text(body, motion, order)))
    found = body_of_bvh(skeleton, 1.82)
    np.testing.assert_allclose(found.offsets, body.offsets, atol=1e-6)
    back = poses_of_bvh(skeleton, found, np.array([3, 1]))
    assert np.abs(back.difference(motion[[3, 1]])).max() < 1e-6


@pytest.mark.parametrize("collar_bones", [True, False])
def test_the_body_of_a_bvh_has_collar_bones_where_the_file_has_them(tmp_path: Path, collar_bones: bool) -> None:
    body = human(1.7, {"shoulder_width": 0.42, "neck_rise": 0.05}, collar_bones=collar_bones)
    motion = wild(body)
    skeleton = read_bvh(saved(tmp_path, bvh_text(body, motion)))
    found = body_of_bvh(skeleton, 1.7)
    assert found.names == body.names
    np.testing.assert_allclose(found.offsets, body.offsets, atol=1e-6)
    assert np.abs(poses_of_bvh(skeleton, found, np.arange(4)).difference(motion)).max() < 1e-6


def test_one_collar_bone_alone_is_refused_by_name(tmp_path: Path) -> None:
    path = saved(tmp_path, TEXT.replace("shoulder.R", "clavicle_r"))
    with pytest.raises(BodyError, match=r"clavicle_r.*shoulder\.R"):
        body_of_bvh(read_bvh(path))


def test_the_height_is_judged_from_the_bones(tmp_path: Path) -> None:
    path = saved(tmp_path, bvh_text(human(1.64), wild(human(1.64))))
    body = body_of_bvh(read_bvh(path))
    vertices = [np.concatenate([p.vertices for p in b.parts]) for b in (body, human(1.64))]
    np.testing.assert_allclose(*vertices, atol=1e-4)


def test_other_skeletons_are_refused_by_name(tmp_path: Path) -> None:
    path = saved(tmp_path, TEXT.replace("shin.L", "LeftLeg"))
    with pytest.raises(BodyError, match="LeftLeg"):
        body_of_bvh(read_bvh(path))
    parts = list(BODY.parts)
    k = BODY.index("shin.R")
    parts[k] = replace(parts[k], head_world=parts[k].head_world + [0.1, 0, 0])
    path.write_text(bvh_text(replace(BODY, parts=tuple(parts)), wild(BODY)))
    with pytest.raises(BodyError, match=r"shin\.R|foot\.R"):
        body_of_bvh(read_bvh(path))


@pytest.mark.parametrize("cut", ["HIERARCHY", "MOTION", "Frames:", "0.04\n"])
def test_a_file_that_is_not_a_bvh_is_refused(tmp_path: Path, cut: str) -> None:
    path = saved(tmp_path, TEXT.replace(cut, ""))
    with pytest.raises(ShotError, match=r"poses\.bvh: is not a BVH file"):
        read_bvh(path)


def test_one_frame_more_than_announced_is_left_out(tmp_path: Path) -> None:
    path = saved(tmp_path, TEXT)
    whole = read_bvh(path)
    path.write_text(TEXT.replace("Frames: 4", "Frames: 3"))
    short = read_bvh(path)
    np.testing.assert_array_equal(short.turns, whole.turns[:3])
    path.write_text(TEXT.rsplit(" ", 1)[0])
    with pytest.raises(ShotError, match=r"poses\.bvh: is not a BVH file, or not whole"):
        read_bvh(path)


def test_names_may_have_spaces_and_words_may_be_in_small_letters(tmp_path: Path) -> None:
    text = TEXT
    for word in ("HIERARCHY", "ROOT", "JOINT", "End", "MOTION"):
        text = text.replace(word, word.lower())
    names = read_bvh(saved(tmp_path, text.replace("thigh.L", "Bip01 L Thigh"))).rest.names
    assert set(names) == {"Bip01 L Thigh", *BODY.names} - {"thigh.L"}


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(KFMocapError, match=r"none\.bvh: the BVH cannot be read"):
        read_bvh(tmp_path / "none.bvh")


@pytest.mark.blender
def test_key_poses_go_through_our_own_exporter(tmp_path: Path) -> None:
    pytest.importorskip("bpy")
    import addon_shots
    from kfmocap.cli.services import OutputRequest
    from kfmocap.kfmocap_addon.batch import BatchSession

    shot = addon_shots.shot(tmp_path)
    (performer,) = shot.performers
    motion = addon_shots.motion(shot.length)
    result = addon_shots.track_result(shot, [motion])
    BatchSession().write_outputs(shot, result, OutputRequest(tmp_path, tmp_path))
    skeleton = read_bvh(tmp_path / "walk.bvh")
    body = body_of_bvh(skeleton, 1.7)
    keys = performer.key_poses.frames
    poses = poses_of_bvh(skeleton, body, keys)
    names = list(body.landmarks)
    joints = landmark_positions(body, poses, names) - landmark_positions(performer.body, motion[keys], names)
    assert np.linalg.norm(joints, axis=2).max() < 1e-4


def test_positions_of_joints_below_the_root_stand_in_place_of_their_offsets(tmp_path: Path) -> None:
    path = tmp_path / "moved.bvh"
    channels = "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
    path.write_text(
        f"HIERARCHY\nROOT root {{ OFFSET 0 0 0\n{channels}\nJOINT hips {{ OFFSET 0 1 0\n{channels}\n"
        "End Site { OFFSET 0 1 0 } } }\n"
        "MOTION\nFrames: 2\nFrame Time: 0.04\n"
        "0 0 0 0 0 0 0 1 0 0 0 0\n5 0 0 0 0 90 0.1 1.2 0.3 0 0 0\n"
    )
    moved = read_bvh(path)  # x, y up, z forward become x, -z, y
    np.testing.assert_allclose(moved.rest.heads[1], [0, 0, 1])
    np.testing.assert_allclose(moved.positions[0], [[0, 0, 0], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(moved.positions[1], [[5, 0, 0], [5.3, 0.1, 1.2]], atol=1e-12)
