"""Footage and cameras are paired by their names, and files are put together to footage."""

from __future__ import annotations

from pathlib import Path

import pytest
from kfmocap.core.shot.footage_files.image_sequences import footage_of
from kfmocap.core.shot.name_matching import footage_name, paired


@pytest.mark.parametrize(
    ("footage", "cameras", "expected"),
    [
        (["cam01", "cam02"], ["cam02", "cam01"], ["cam01", "cam02"]),
        (["CAM 01", "Cam-02"], ["cam01", "cam02"], ["cam01", "cam02"]),
        (["walk_cam01", "walk_cam02"], ["cam01", "cam02"], ["cam01", "cam02"]),
        (["GoPro 1 take", "GoPro 2 take"], ["camera_01", "camera_02"], ["camera_01", "camera_02"]),
        (["left.001", "right"], ["left", "right"], ["left", "right"]),
        (["interview"], ["cam01"], ["cam01"]),
        (["interview", "cam02"], ["cam01", "cam02"], [None, "cam02"]),
        (["a", "b"], ["c", "d"], [None, None]),
        (["cam01 a", "cam01 b"], ["cam01"], [None, None]),
        (["cam1", "cam11"], ["cam11", "cam1"], ["cam1", "cam11"]),
    ],
)
def test_names_go_together_only_where_nothing_is_left_to_guess(footage, cameras, expected):
    found = paired(footage, cameras)
    assert [found.get(name) for name in footage] == expected
    assert len(set(found.values())) == len(found)


def test_images_of_a_sequence_are_one_piece_of_footage():
    folder = Path("take")
    files = [folder / f"cam01_{i:04d}.png" for i in (3, 1, 2)] + [folder / "b.mp4", folder / "still.jpg"]
    assert footage_of(files) == [folder / "b.mp4", folder / "cam01_####.png", folder / "still.jpg"]


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("take/cam01.mp4", "cam01"),
        ("take/cam01_####.png", "cam01"),
        ("cam02/####.png", "cam02"),
        ("a2/x%04d.jpg", "x"),
        ("cam01/frame_####.png", "cam01"),
        ("cam02/IMG####.jpg", "cam02"),
        ("####.png", ""),
        ("frame.mp4", "frame"),
    ],
)
def test_a_view_is_named_after_its_footage(path, name):
    assert footage_name(Path(path)) == name
