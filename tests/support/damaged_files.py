"""Files as accidents leave them, and as somebody would write them who wants a reader to fail."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from conftest import ROOT
from kfmocap.core.body import human, landmark_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.choices import CALIBRATION_ENDINGS
from kfmocap.core.formats.bone_map_files import read_bone_map
from kfmocap.core.formats.bvh import read_bvh
from kfmocap.core.formats.c3d import read_c3d
from kfmocap.core.formats.calibrations.calibration_files import export_cameras, load_cameras
from kfmocap.core.formats.dltdv_points import read_dltdv_points
from kfmocap.core.formats.file_kind import file_kind
from kfmocap.core.formats.keypoint_files import read_keypoints
from kfmocap.core.formats.marker_points import read_marker_points
from kfmocap.core.formats.obj_vertices import read_obj_vertices
from kfmocap.core.formats.shot_toml import read_shot_spec
from kfmocap.core.formats.trc import read_trc, write_trc
from kfmocap.core.formats.wand_toml import load_wand
from kfmocap.core.shot.footage_files.image_sequences import read_image

NASTY = [
    *("0", "-1", "1e300", "-1e999", "nan", "inf", "9" * 400, "9" * 5000, "2147483648", "1e9", "0x7fffffff", "1_0"),
    *('""', "null", "true", "{}", "[]", "[" * 3000, "{" * 200, "a." * 500, "''", '"' * 7, "\n", "\t\t\t", ",,,,"),
    *(" " * 999, "\0", "\x7f", "..", "%099999999999d", "*a" * 30, "é", "\ufeff", "A" * 5000, "- " * 400, "&#0;"),
    *("<a>" * 300, "%s%n"),
]
"""What is put into a file in place of something else."""
_WORD = re.compile(rb"[-+.\w]+")

CAPTURE = """
[lframe]
colour = "red"
points = [[0, 0, 0], [0.3, 0, 0], [0.6, 0, 0], [0, 0.2, 0]]
[wand]
colours = ["green", "#2040ff"]
length = 0.5
[[view]]
camera = "cam01"
size = [640, 360]
focal = 500.0
fps = 30.0
[points]
file = "points.csv"
"""
STANDING = """[wand]
[floor]
performer = [[0, 1], [2, 3]]
height = 1.78
points = "points.csv"
[[view]]
camera = "cam01"
size = [640, 360]
[points]
file = "points.csv"
"""
POINTS = "camera,take,frame,marker,u,v,sigma\n" + "".join(
    f"cam01,{take},{frame},{marker},{100 + 7 * frame}.5,{50 + 3 * marker}.25,0.5\n"
    for take, markers in (("lframe", 4), ("wand", 2), ("performer", 3))
    for frame in range(4)
    for marker in range(markers)
)
DLTDV = ",".join(f"pt{p}_cam{c}_{a}" for p in (1, 2) for c in (1, 2) for a in "XY") + "\n" + "1.5,2,3,4,5,6,7,NaN\n" * 4
BONE_MAP = '{"preset": "rigify", "bones": {"hips": "torso", "spine": ["spine_fk", "chest"], "head": "head"}}'
EASYMOCAP = """%YAML:1.0
---
names:
  - "01"
K_01: !!opencv-matrix
  rows: 3
  cols: 3
  dt: d
  data: [500., 0., 320., 0., 500., 180., 0., 0., 1.]
dist_01: !!opencv-matrix
  rows: 1
  cols: 5
  dt: d
  data: [0.1, 0., 0., 0., 0.]
W_01: 640
H_01: 360
R_01: !!opencv-matrix
  rows: 3
  cols: 1
  dt: d
  data: [1.5, 0., 0.]
T_01: !!opencv-matrix
  rows: 3
  cols: 1
  dt: d
  data: [0., 1., 4.]
"""
OBJ = b"o box\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1.5\nf 1 2 3\n"
BVH = """HIERARCHY
ROOT pelvis
{
  OFFSET 0.0 0.95 0.0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT spine
  {
    OFFSET 0.0 0.1 0.0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0.0 0.2 0.0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333
0 0.95 0 0 0 0 10 20 30
0 0.96 0 0 5 0 10 20 30
"""


@dataclass(frozen=True)
class Sample:
    """A file that can be read, and what reads it."""

    name: str
    data: bytes
    read: Callable[[Path], Any]


def samples(folder: Path) -> dict[str, Sample]:
    """Make a small file of every kind that is read."""
    K = [[500.0, 0, 320], [0, 500, 180], [0, 0, 1]]
    cameras = [
        Camera.create(f"cam0{i}", (640, 360), K, np.eye(3), [0, 0, 4], distortions=[0.1, 0, 0, 0, 0]) for i in (1, 2)
    ]
    body, found = human(1.8), {}
    names = list(body.landmarks)
    motion = Motion(np.zeros((3, 3)), np.tile(np.eye(3), (3, len(body), 1, 1)))
    write_trc(folder / "a.trc", names, landmark_positions(body, motion, names), 30.0)
    (folder / "points.csv").write_text(POINTS)
    for kind, endings in CALIBRATION_ENDINGS.items():
        for ending in endings:
            export_cameras(folder / f"a{ending}", cameras, kind)
            data = (folder / f"a{ending}").read_bytes()
            found[f"{kind}{ending}"] = Sample(f"b{ending}", data, load_cameras)
    found["easymocap"] = Sample("intri.yml", EASYMOCAP.encode(), load_cameras)
    shot = (ROOT / "examples" / "walk" / "shot.toml").read_bytes()
    found["obj"] = Sample("prop.obj", OBJ, read_obj_vertices)
    found["shot"] = Sample("shot.toml", shot, read_shot_spec)
    found["kind"] = Sample("any.toml", shot, file_kind)
    found["capture"] = Sample("capture.toml", CAPTURE.encode(), load_wand)
    found["capture without L-frame"] = Sample("capture.toml", STANDING.encode(), load_wand)
    found["points"] = Sample("b.csv", POINTS.encode(), read_marker_points)
    found["dltdv"] = Sample("xypts.csv", DLTDV.encode(), read_wand_points)
    found["bone map"] = Sample("map.json", BONE_MAP.encode(), read_bone_map)
    found["trc"] = Sample("b.trc", (folder / "a.trc").read_bytes(), read_trc)
    found["bvh"] = Sample("b.bvh", BVH.encode(), read_bvh)
    c3d = (ROOT / "tests" / "data" / "landmarks" / "three_points.c3d").read_bytes()
    found["c3d"] = Sample("b.c3d", c3d, read_c3d)
    picture = np.random.default_rng(0).integers(0, 255, (24, 40, 3), np.uint8)
    for ending in (".png", ".jpg", ".bmp", ".tif", ".webp"):
        found[ending] = Sample(f"image{ending}", cv2.imencode(ending, picture)[1].tobytes(), read_image)
    for name, document in keypoint_documents().items():
        found[name] = Sample("pose_12.json", json.dumps(document).encode(), read_view_keypoints)
    return found


def read_wand_points(path: Path) -> Any:
    """Read the points of a wand that were digitised."""
    return read_dltdv_points(path, 2)


def read_view_keypoints(path: Path) -> Any:
    """Read keypoints of footage of a known size."""
    return read_keypoints(path, (640, 360))


def keypoint_documents() -> dict[str, Any]:
    """One person in the documents of several detectors."""
    flat = [float(v) for k in range(17) for v in (100 + k, 200 + 2 * k, 0.9)]
    pairs = [[100.0 + k, 200.0 + 2 * k] for k in range(17)]
    return {
        "openpose": {"people": [{"person_id": [3], "pose_keypoints_2d": flat[:51] + 24 * [0.5]}]},
        "coco": [{"image_id": 7, "category_id": 1, "keypoints": flat, "track_id": 2}],
        "annotations": {
            "images": [{"id": 1, "file_name": "a_0007.png"}],
            "annotations": [{"image_id": 1, "keypoints": flat}],
        },
        "mmpose": {
            "meta_info": {"keypoint_id2name": {str(k): f"left_knee_{k}" for k in range(17)}},
            "instance_info": [
                {"frame_id": 1, "instances": [{"keypoints": pairs, "keypoint_scores": 17 * [0.9], "track_id": 1}]}
            ],
        },
        "mediapipe": [{"frame": 3, "landmarks": 33 * [{"x": 0.5, "y": 0.4, "z": 0.0, "visibility": 0.8}]}],
        "yolo": [{"keypoints": {"x": flat[::3], "y": flat[1::3], "visible": 17 * [0.9]}, "track_id": 4}],
        "alphapose": {"12.jpg": {"bodies": [{"joints": flat}]}},
    }


def damaged(data: bytes, seed: int) -> bytes:
    """Damage a file in some of the ways in which files are damaged; the same for the same seed."""
    chance = random.Random(seed)
    for _ in range(chance.choice((1, 1, 1, 2, 3, 6))):
        data = chance.choice(_WAYS)(data, chance)
    return data


def _flip(data: bytes, chance: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(chance.choice((1, 3, 20))):
        if out:
            out[chance.randrange(len(out))] ^= 1 << chance.randrange(8)
    return bytes(out)


def _cut(data: bytes, chance: random.Random) -> bytes:
    return data[: chance.randrange(len(data) + 1)]


def _drop(data: bytes, chance: random.Random) -> bytes:
    begin = chance.randrange(len(data) + 1)
    return data[:begin] + data[begin + chance.choice((1, 4, 60)) :]


def _repeat(data: bytes, chance: random.Random) -> bytes:
    begin = chance.randrange(len(data) + 1)
    piece = data[begin : begin + chance.choice((1, 20, 300))]
    return data[:begin] + piece * chance.choice((2, 5, 100)) + data[begin:]


def _insert(data: bytes, chance: random.Random) -> bytes:
    begin = chance.randrange(len(data) + 1)
    return data[:begin] + chance.choice(NASTY).encode(chance.choice(("utf-8", "latin-1")), "replace") + data[begin:]


def _replace_word(data: bytes, chance: random.Random) -> bytes:
    words = list(_WORD.finditer(data))
    if not words:
        return data
    word = chance.choice(words)
    return data[: word.start()] + chance.choice(NASTY).encode() + data[word.end() :]


def _exchange_words(data: bytes, chance: random.Random) -> bytes:
    words = list(_WORD.finditer(data))
    if not words:
        return data
    one, other = chance.choice(words), chance.choice(words)
    return data[: one.start()] + other[0] + data[one.end() :]


def _exchange_lines(data: bytes, chance: random.Random) -> bytes:
    lines = data.split(b"\n")
    i, k = chance.randrange(len(lines)), chance.randrange(len(lines))
    lines[i], lines[k] = lines[k], lines[i]
    return b"\n".join(lines)


_WAYS = (_flip, _cut, _drop, _repeat, _insert, _replace_word, _replace_word, _exchange_words, _exchange_lines)
