"""The contact sheet shows the model where the camera sees it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.errors import OutputError
from kfmocap.core.numerics import rotations
from kfmocap.core.review.overlay import SHEET_WIDTH, contact_sheet, sheet_frames, write_contact_sheet
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot, View

SIZE = (200, 300)
FRAMES = 13


def standing(x: float = 0.0) -> Motion:
    body = human()
    Q = np.tile(np.eye(3), (FRAMES, len(body), 1, 1))
    return Motion(np.tile([x, 0.0, body.offsets[0, 2]], (FRAMES, 1)), Q)


def shot(
    folder: Path,
    motion: Motion,
    keys: tuple[int, ...] = (0, 6, 12),
    cameras: int = 2,
    size: tuple[int, int] = SIZE,
) -> Shot:
    for f in range(FRAMES + 3):
        cv2.imwrite(str(folder / f"f{f:02d}.png"), np.zeros((size[1], size[0], 3), np.uint8))
    K = [[300, 0, (size[0] - 1) / 2], [0, 300, (size[1] - 1) / 2], [0, 0, 1]]
    R = rotations.exp(np.array([np.pi / 2, 0, 0]))
    views = tuple(View(Camera.create(f"cam{v}", size, K, R, [0, 1, 4]), folder / "f%02d.png") for v in range(cameras))
    poses = KeyPoses.whole(list(keys), motion[list(keys)])
    return Shot("sheet", 30, (2, FRAMES + 1), views, (Performer("man", human(), poses),))


def test_key_frames_and_the_middles_between_them_are_shown(tmp_path: Path) -> None:
    assert sheet_frames(shot(tmp_path, standing())) == [0, 3, 6, 9, 12]
    assert len(sheet_frames(shot(tmp_path, standing(), tuple(range(13))))) == 7
    assert sheet_frames(shot(tmp_path, standing(), (4,))) == [0, 2, 4, 8, 12]


def drawn(sheet: np.ndarray) -> tuple[int, int]:
    """Width and height of what is drawn below the label, pixels."""
    bright = (sheet[24:] > 120).all(axis=2)
    return np.ptp(np.flatnonzero(bright.any(axis=0))), np.ptp(np.flatnonzero(bright.any(axis=1)))


def test_the_outline_has_the_shape_of_the_projected_body(tmp_path: Path) -> None:
    one = shot(tmp_path, standing(), cameras=1)
    body, camera = one.performers[0].body, one.views[0].camera
    points = np.concatenate([part.vertices @ part.R_world_rest.T + part.head_world for part in body.parts])
    width, height = np.ptp(camera.project(points), axis=0)
    found = drawn(contact_sheet(one, [standing()], frames=[6]))
    assert found[0] / found[1] == pytest.approx(width / height, rel=0.03)


def test_a_performer_far_from_the_middle_of_a_wide_picture_is_cropped_to(tmp_path: Path) -> None:
    heights = []
    for x in (0.0, 5.0):
        one = shot(tmp_path, standing(x), cameras=1, size=(1200, 300))
        heights.append(drawn(contact_sheet(one, [standing(x)], frames=[6]))[1])
    assert heights[1] == pytest.approx(heights[0], abs=2)


def test_the_sheet_has_a_row_per_view_and_is_no_wider_than_asked(tmp_path: Path) -> None:
    one = contact_sheet(shot(tmp_path, standing(), cameras=1), [standing()])
    three = contact_sheet(shot(tmp_path, standing(), cameras=3), [standing()])
    assert one.shape[1] == three.shape[1] <= SHEET_WIDTH
    assert three.shape[0] == pytest.approx(3 * one.shape[0], abs=10)


def test_a_performer_out_of_sight_leaves_the_whole_picture(tmp_path: Path) -> None:
    sheet = contact_sheet(shot(tmp_path, standing(50.0)), [standing(50.0)])
    assert sheet.shape[1] <= SHEET_WIDTH


def test_what_another_body_hides_is_not_drawn_white(tmp_path: Path) -> None:
    """Behind a far wider body the narrow one's outlines are grey."""
    wide = human()
    wide = replace(wide, parts=tuple(replace(part, vertices=part.vertices * [4, 1, 4]) for part in wide.parts))
    one = shot(tmp_path, standing(), cameras=1)
    front = replace(one.performers[0], body=wide)
    behind = standing()
    behind.translations[:, 1] += 1.5
    both = replace(one, performers=(front, *one.performers))
    alone = contact_sheet(replace(one, performers=(front,)), [standing()], frames=[6])
    together = contact_sheet(both, [standing(), behind], frames=[6])
    assert alone.shape == together.shape
    added = together[alone.max(axis=2) == 0]
    assert 100 < added.max() < 200


def test_a_sheet_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="none"):
        write_contact_sheet(tmp_path / "none" / "overlay.png", np.zeros((4, 4, 3), np.uint8))
    write_contact_sheet(tmp_path / "overlay.png", np.full((4, 4, 3), 7, np.uint8))
    assert cv2.imread(str(tmp_path / "overlay.png"))[0, 0, 0] == 7
