"""Whatever a file holds, reading it gives its content or an error of ours that names it, soon and in little memory."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import pytest
from conftest import ROOT
from damaged_files import (
    BVH,
    DLTDV,
    EASYMOCAP,
    POINTS,
    damaged,
    keypoint_documents,
    read_view_keypoints,
    read_wand_points,
    samples,
)
from hypothesis import given
from hypothesis import strategies as st
from kfmocap.core.errors import KeypointError, KFMocapError
from kfmocap.core.formats.bone_map_files import read_bone_map
from kfmocap.core.formats.bvh import read_bvh
from kfmocap.core.formats.calibrations.calibration_files import load_cameras
from kfmocap.core.formats.keypoint_files import read_keypoints
from kfmocap.core.formats.marker_points import read_marker_points
from kfmocap.core.formats.shot_toml import read_shot_spec
from kfmocap.core.formats.toml_tables import read_toml
from kfmocap.core.formats.trc import read_trc

SECONDS, MEGABYTES = 2.0, 300
SHOT = (ROOT / "examples" / "walk" / "shot.toml").read_text()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damaged")


@pytest.fixture(scope="module")
def good(folder: Path):
    return samples(folder)


def peak_megabytes() -> float:
    if sys.platform == "win32":
        return 0.0
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024 if sys.platform == "linux" else 1024**2)


def read(path: Path, data: bytes, reader) -> str:
    """Read a file that holds this; returns the message of the error, or nothing."""
    path.write_bytes(data)
    memory, begun = peak_megabytes(), time.process_time()
    try:
        reader(path)
        message = ""
    except KFMocapError as error:
        message = str(error)
        assert path.name in message
        assert len(message) < 1300
    assert time.process_time() - begun < SECONDS
    assert peak_megabytes() - memory < MEGABYTES
    return message


def test_every_sample_can_be_read(folder: Path, good) -> None:
    messages = {name: read(folder / s.name, s.data, s.read) for name, s in good.items()}
    assert {name: text for name, text in messages.items() if text} == {}


def test_damaged_files_are_read_or_refused(folder: Path, good, pytestconfig: pytest.Config) -> None:
    """Ten of every kind; `--damaged N` for N."""
    for name, sample in good.items():
        for seed in range(pytestconfig.getoption("damaged")):
            try:
                read(folder / sample.name, damaged(sample.data, seed), sample.read)
            except BaseException as error:
                error.add_note(f"{name}, seed {seed}")
                raise


def toml(value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    return json.dumps(value) if isinstance(value, str) else repr(value)


ANYTHING = st.recursive(
    st.booleans() | st.integers(-(10**500), 10**500) | st.floats() | st.text(max_size=40), st.lists, max_leaves=4
)
FIELDS = [line.split(" = ")[0] for line in SHOT.splitlines() if " = " in line]


@given(st.sampled_from(FIELDS), ANYTHING)
def test_a_field_of_a_shot_may_hold_anything(folder: Path, field: str, value) -> None:
    lines = [f"{field} = {toml(value)}" if line.startswith(f"{field} =") else line for line in SHOT.splitlines()]
    read(folder / "shot.toml", "\n".join(lines).encode(errors="replace"), read_shot_spec)


JSON_KEYS = [
    *(
        "people",
        "pose_keypoints_2d",
        "person_id",
        "keypoints",
        "keypoint_scores",
        "instances",
        "instance_info",
        "frame_id",
    ),
    *("image_id", "track_id", "bodies", "joints", "annotations", "images", "id", "file_name"),
    *("landmarks", "x", "y", "visible", "visibility", "meta_info", "keypoint_id2name", "frame"),
]
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**400), 10**400) | st.floats() | st.text(max_size=20),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(JSON_KEYS),
            inner,
            max_size=4,
        )
    ),
    max_leaves=25,
)


@given(JSON)
def test_a_keypoint_file_may_hold_any_document(folder: Path, document) -> None:
    read(folder / "any_1.json", json.dumps(document).encode(), read_view_keypoints)


def changed(text: str, old: str, new: str) -> bytes:
    assert old in text
    return text.replace(old, new, 1).encode("latin-1")


CALIBRATION = EASYMOCAP
HOSTILE = {
    "toml nested 3000 deep": ("a.toml", f"a = {'[' * 3000}".encode(), read_shot_spec),
    "toml with 5000 digits": ("a.toml", f"a = {'9' * 5000}".encode(), read_shot_spec),
    "toml with a key of 250000 parts": ("a.toml", ("a." * 250000 + "a = 1").encode(), read_shot_spec),
    "fps of 400 digits": ("a.toml", changed(SHOT, "fps = 30.0", f"fps = {'9' * 400}"), read_shot_spec),
    "working size of 400 digits": ("a.toml", f"{SHOT}\n[track]\nworking_size = {'9' * 400}".encode(), read_shot_spec),
    "footage of 5000 letters": ("a.toml", changed(SHOT, "cam01.mp4", "x" * 5000), read_shot_spec),
    "footage with NUL": ("a.toml", changed(SHOT, "cam01.mp4", "\\u0000"), read_shot_spec),
    "opencv with a Latin-1 byte": ("a.yml", changed(CALIBRATION, '"01"', '"\xe9"'), load_cameras),
    "opencv with a number for names": ("a.yml", changed(CALIBRATION, 'names:\n  - "01"', "names: 5"), load_cameras),
    "opencv with a width in letters": ("a.yml", changed(CALIBRATION, "W_01: 640", "W_01: x"), load_cameras),
    "opencv with a key without a value": ("a.yml", changed(CALIBRATION, "W_01: 640", "W_01: "), load_cameras),
    "opencv with a width of 60 digits": ("a.yml", changed(CALIBRATION, "W_01: 640", f"W_01:{'9' * 60}"), load_cameras),
    "opencv with a matrix of 60 digits": ("a.yml", f"%YAML:1.0\n---\nK_01:{'9' * 60}".encode(), load_cameras),
    "opencv with a long hexadecimal number": ("a.yml", b"%YAML:1.0\n---\nK_01: 0x99999999999", load_cameras),
    "opencv nested 3000 deep": ("a.json", b'{"a": ' + 3000 * b"[" + 3000 * b"]" + b"}", load_cameras),
    "opencv nested 300000 deep": ("a.yml", b"%YAML:1.0\n---\na: " + 300000 * b"[", load_cameras),
    "opencv with 2^31 values": (
        "a.yml",
        changed(CALIBRATION, "rows: 3\n  cols: 3", "rows: 46341\n  cols: 46341"),
        load_cameras,
    ),
    "opencv with a long list": ("a.json", b'{"a": [' + b"1," * 300000 + b"1]}", load_cameras),
    "qualisys in an unknown encoding": ("a.qca.txt", b'<?xml version="1.0" encoding="x-klingon"?><a/>', load_cameras),
    "qualisys that grows": (
        "a.qca.txt",
        b'<!DOCTYPE a [<!ENTITY b "' + b"b" * 90000 + b'"><!ENTITY c "' + b"&b;" * 9000 + b'">]><a>&c;</a>',
        load_cameras,
    ),
    "points on frame 1e300": ("a.csv", changed(POINTS, "lframe,0,", "lframe,1e300,"), read_marker_points),
    "points with 60000 columns": ("a.csv", POINTS.replace("\n", ",x" * 60000 + "\n", 1).encode(), read_marker_points),
    "digitised points of 8000 cameras, 200000 rows": (
        "a.csv",
        (
            ",".join(f"pt{p}_cam{c}_{a}" for c in range(8000) for p in (1, 2) for a in "XY") + "\n" + "1\n" * 200000
        ).encode(),
        read_wand_points,
    ),
    "digitised points with a camera of 5000 digits": (
        "a.csv",
        changed(DLTDV, "pt1_cam1_X", f"pt1_cam{'9' * 5000}_X"),
        read_wand_points,
    ),
    "bone map nested 5000 deep": ("a.json", b'{"bones": ' + b"[" * 5000, read_bone_map),
    "bvh of 10^9 frames without channels": (
        "a.bvh",
        b"HIERARCHY ROOT a { OFFSET 0 0 0 CHANNELS 0 } MOTION Frames: 1000000000 Frame Time: 0.1",
        read_bvh,
    ),
    "bvh with infinity": ("a.bvh", changed(BVH, "0 0.95 0 0", "0 inf 0 0"), read_bvh),
    "trc of 20000 names": (
        "a.trc",
        ("PathFileType\nUnits\nm\n\t\t" + "\t".join(f"{k:x}" for k in range(20000)) + "\n\n" + "1\n" * 9000).encode(),
        read_trc,
    ),
    "trc with 200000 names twice": (
        "a.trc",
        ("PathFileType\nUnits\nm\n\t\t" + "\t".join(f"{k:x}" for k in [*range(160000), 1]) + "\n\n").encode(),
        read_trc,
    ),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_files_that_are_made_to_do_harm_are_refused(folder: Path, case: str) -> None:
    name, data, reader = HOSTILE[case]
    assert len(data) < 1_000_000
    assert read(folder / name, data, reader)


BROKEN = {
    "a number for a list": 5,
    "a huge coordinate": 1e300,
    "an infinite coordinate": float("inf"),
    "a coordinate of 400 digits": 10**400,
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_keypoints_are_refused_or_skipped(tmp_path: Path, case: str) -> None:
    person = keypoint_documents()["openpose"]["people"][0]
    value = BROKEN[case]
    broken = value if isinstance(value, int) and value == 5 else [value, *person["pose_keypoints_2d"][1:]]
    for frame, points in ((1, person["pose_keypoints_2d"]), (2, broken)):
        document = {"people": [{**person, "pose_keypoints_2d": points}]}
        (tmp_path / f"pose_{frame}.json").write_text(json.dumps(document))
    with pytest.raises(KeypointError, match=r"pose_2\.json"):
        read_keypoints(tmp_path)
    found = read_keypoints(tmp_path, skip_broken=True)
    assert found.frames.tolist() == [1]
    assert len(found.skipped) == 1


@pytest.mark.parametrize(
    ("field", "value"), [("image_id", 10**30), ("image_id", 1e300), ("image_id", "9" * 60), ("track_id", 10**30)]
)
def test_frames_and_tracks_beyond_all_counting_are_refused(tmp_path: Path, field: str, value) -> None:
    document = [{**keypoint_documents()["coco"][0], field: value}]
    (tmp_path / "a.json").write_text(json.dumps(document))
    with pytest.raises(KeypointError, match=r"a\.json: a .* has \d+ digits"):
        read_keypoints(tmp_path / "a.json")


def test_a_path_that_is_not_a_file_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "folder.toml").mkdir()
    for path in (tmp_path / "folder.toml", Path("/dev/zero"), tmp_path / "none.toml", Path("a\0b")):
        with pytest.raises(KFMocapError, match="cannot be read"):
            read_toml(path, "the file", KFMocapError)
