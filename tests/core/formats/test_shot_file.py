"""The shot file: what it says is what is tracked, and what it says wrongly is named."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from bvh_files import bvh_text, wild
from kfmocap.core.body import human, landmark_positions, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.prop import body_of_prop
from kfmocap.core.body.skeleton_motion import RestSkeleton
from kfmocap.core.cameras.camera import Camera, same_proportions
from kfmocap.core.cameras.world_axes import AXES
from kfmocap.core.errors import KFMocapError
from kfmocap.core.formats import load_cameras, save_cameras, shot_toml, write_trc
from kfmocap.core.formats.shot_toml import read_shot_spec
from kfmocap.core.formats.wand_toml import load_wand
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.shot import Gap
from kfmocap.core.tracking.prepare import load_shot, prepare_shot
from kfmocap.core.tracking.selection import selected
from kfmocap.core.tracking.tracker import track

FIRST, LAST, KEYS = 2, 9, (3, 6, 9)
SIZE = (64, 48)

TEXT = """
[shot]
name = "walk"
fps = 30.0
frames = [2, 9]

[calibration]
file = "calibration.toml"

[[view]]
camera = "cam01"
footage = "cam01_%04d.png"

[[view]]
camera = "cam02"
footage = "cam02_%04d.png"
offset = 1.0

[[performer]]
name = "man"
landmarks = "landmarks.trc"
keyframes = [9, 3, 6]

[track]
solver = "relaxation"
"""


def walking(frames: int) -> tuple[list[str], np.ndarray]:
    body = human(1.8)
    T = np.linspace([0, 0, 1], [0.5, 0, 1], frames)
    Q = np.tile(np.eye(3), (frames, len(body), 1, 1))
    Q[:, body.index("upper_arm.L")] = rotations.exp(np.linspace([0, 0, 0], [0.4, 0.2, 0.9], frames))
    names = list(body.landmarks)
    return names, landmark_positions(body, Motion(T, Q), names)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A shot folder with tiny footage: two cameras, frames 2 to 9."""
    names, points = walking(LAST - FIRST + 1)
    write_trc(tmp_path / "landmarks.trc", names, points, 30)
    K = [[60, 0, 31.5], [0, 60, 23.5], [0, 0, 1]]
    cameras = [
        Camera.create(n, SIZE, K, rotations.exp(np.array([np.pi / 2, 0, 0])), [0, 1, 4]) for n in ("cam01", "cam02")
    ]
    save_cameras(tmp_path / "calibration.toml", cameras)
    for camera in ("cam01", "cam02"):
        for f in range(LAST + 2):
            image = np.full((SIZE[1], SIZE[0], 3), 10 * f, np.uint8)
            cv2.imwrite(str(tmp_path / f"{camera}_{f:04d}.png"), image)
    (tmp_path / "shot.toml").write_text(TEXT)
    return tmp_path


def test_the_shot_is_what_the_file_says(folder: Path) -> None:
    shot = load_shot(folder / "shot.toml")
    assert (shot.name, shot.fps, shot.frames, shot.length) == ("walk", 30.0, (2, 9), 8)
    assert [view.camera.name for view in shot.views] == ["cam01", "cam02"]
    assert shot.views[0].footage == folder / "cam01_%04d.png"
    assert [view.offset for view in shot.views] == [0.0, 1.0]
    assert shot.settings.solver == "relaxation"
    (performer,) = shot.performers
    assert performer.name == "man"
    assert performer.key_poses.frames.tolist() == [1, 4, 7]  # counted from the shot's first frame
    assert performer.key_poses.fixed.all()


def test_reading_a_shot_file_opens_no_other_file(folder: Path) -> None:
    """What is said is kept as it is said; only preparing the shot needs the files."""
    for file in folder.iterdir():
        if file.name != "shot.toml":
            file.unlink()
    spec = read_shot_spec(folder / "shot.toml")
    assert [(view.camera, view.offset) for view in spec.views] == [("cam01", 0.0), ("cam02", 1.0)]
    assert spec.calibration == folder / "calibration.toml"
    (performer,) = spec.performers
    assert (performer.keyframes, performer.landmarks) == (KEYS, folder / "landmarks.trc")
    assert spec.selected(keyframes="auto").performers[0].keyframes == "auto"
    with pytest.raises(KFMocapError, match=r"\[calibration\] file: .*calibration\.toml"):
        prepare_shot(spec)


def test_key_poses_and_body_fit_the_landmarks(folder: Path) -> None:
    (performer,) = load_shot(folder / "shot.toml").performers
    names, points = walking(LAST - FIRST + 1)
    joints = [n for n in names if n.endswith(("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle"))]
    fitted = landmark_positions(performer.body, performer.key_poses.poses, joints)
    wanted = points[performer.key_poses.frames][:, [names.index(n) for n in joints]]
    assert np.linalg.norm(fitted - wanted, axis=2).mean() < 0.02


def test_landmarks_between_the_key_frames_are_never_seen(folder: Path) -> None:
    """The same body and key poses come out when all other rows hold nonsense."""
    before = load_shot(folder / "shot.toml").performers[0]
    names, points = walking(LAST - FIRST + 1)
    others = np.setdiff1d(np.arange(len(points)), np.array(KEYS) - FIRST)
    points[others] = np.random.default_rng(0).normal(size=points[others].shape)
    write_trc(folder / "landmarks.trc", names, points, 30)
    after = load_shot(folder / "shot.toml").performers[0]
    assert np.array_equal(before.key_poses.poses.rotations, after.key_poses.poses.rotations)
    assert np.array_equal(before.body.offsets, after.body.offsets)


def test_choices_that_fit_nothing_are_refused(folder: Path) -> None:
    with pytest.raises(KFMocapError, match=r"key frame 3\.5 is not a whole number"):
        load_shot(folder / "shot.toml", keyframes=[2, 3.5])
    cameras = load_cameras(folder / "calibration.toml")
    with pytest.raises(KFMocapError, match=r"no camera 'side' to be replaced \(it has cam01, cam02\)"):
        load_shot(folder / "shot.toml", cameras={"side": cameras["cam02"]})


def test_arguments_override_the_file(folder: Path) -> None:
    shot = load_shot(folder / "shot.toml", views=["cam02"], keyframes=[2, 5], solver="gauss-newton")
    assert [view.camera.name for view in shot.views] == ["cam02"]
    assert shot.performers[0].key_poses.frames.tolist() == [0, 3]
    assert shot.settings.solver == "gauss-newton"
    moved = selected(load_shot(folder / "shot.toml"), offsets={"cam02": 1.5})
    assert [view.offset for view in moved.views] == [0.0, 1.5]


def test_frames_that_footage_lacks_or_has_twice_are_listed(folder: Path) -> None:
    (folder / "shot.toml").write_text(TEXT.replace("offset = 1.0", "missing = [8, 4, 4]\ntwice = [6]"))
    shot = load_shot(folder / "shot.toml")
    assert [view.gaps for view in shot.views] == [(), (Gap(4, 2), Gap(6, -1), Gap(8, 1))]


def test_rates_must_be_the_same_unless_the_file_says_how_many_frames_there_are_for_each_of_the_shot(
    folder: Path,
) -> None:
    for name, fps, count in (("cam01", 30, 12), ("cam02", 60, 20)):
        film = cv2.VideoWriter(str(folder / f"{name}.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), fps, SIZE)
        for f in range(count):
            film.write(np.full((SIZE[1], SIZE[0], 3), 10 * f, np.uint8))
        film.release()
    text = TEXT.replace("_%04d.png", ".mp4").replace("offset = 1.0", "")
    path = folder / "shot.toml"
    path.write_text(text)
    with pytest.raises(KFMocapError, match=r"footage: .*cam02.mp4 .*60 frames per second.*write every = 2 in"):
        load_shot(path)
    for every in (1, 2):
        path.write_text(text.replace('"cam02.mp4"', f'"cam02.mp4"\nevery = {every}'))
        assert [view.every for view in load_shot(path).views] == [1, every]


@pytest.mark.parametrize("up", ["z", "y"])
def test_a_calibration_is_of_the_world_that_is_stated(folder: Path, up: str) -> None:
    views = load_shot(folder / "shot.toml").views
    places = np.array([[[0.3, 1.0, 4.0]], [[-0.3, 1.0, 4.0]]])
    apart = [replace(view.camera, t_cam_world=place) for view, place in zip(views, places, strict=True)]
    axes = np.array(AXES[up], float)
    filed = [
        replace(camera, R_cam_world=camera.R_cam_world @ axes, t_cam_world=1000 * camera.t_cam_world)
        for camera in apart
    ]
    save_cameras(folder / "calibration.toml", filed)
    path, asked = folder / "shot.toml", []
    for stated, said in (
        ("", r"\[calibration\] file: .*calibration.toml: its cameras are up to 600 m apart.*write unit = \"mm\""),
        (f'unit = "mm"\nup = "{up}"', ""),
    ):
        path.write_text(TEXT.replace("[calibration]\n", f"[calibration]\n{stated}\n"))
        if said:
            with pytest.raises(KFMocapError, match=said):
                load_shot(path)
        else:
            asked.append(load_shot(path).views)
    for views in asked:
        for view, camera in zip(views, apart, strict=True):
            np.testing.assert_allclose(view.camera.R_cam_world, camera.R_cam_world, atol=1e-9)
            np.testing.assert_allclose(view.camera.t_cam_world, camera.t_cam_world, atol=1e-9)


def test_key_poses_that_no_camera_sees_are_refused(folder: Path) -> None:
    names, points = walking(LAST - FIRST + 1)
    write_trc(folder / "landmarks.trc", names, points + [0.0, 0.0, 40.0], 30)
    with pytest.raises(KFMocapError, match=r"\[\[performer\]\] 'man': its key poses are in no camera's picture"):
        load_shot(folder / "shot.toml")


def test_fields_of_interlaced_footage_are_frames(folder: Path) -> None:
    (folder / "shot.toml").write_text(TEXT.replace("offset = 1.0", 'offset = 12\nfields = "bottom-first"'))
    shot = load_shot(folder / "shot.toml")
    assert [(view.fields, view.offset) for view in shot.views] == [("progressive", 0.0), ("bottom-first", 12.0)]


def test_one_view_by_its_name_and_key_frames_in_an_array_are_as_lists_of_them(folder: Path) -> None:
    read = load_shot(folder / "shot.toml", views="cam02", keyframes=np.array([3.0, 9.0]))
    cut = selected(load_shot(folder / "shot.toml"), "cam02", np.array([3, 9]))
    for shot in (read, cut):
        assert [view.camera.name for view in shot.views] == ["cam02"]
        assert shot.performers[0].key_poses.frames.tolist() == [1, 7]


def test_a_part_of_a_shot_can_be_selected(folder: Path) -> None:
    shot = selected(load_shot(folder / "shot.toml"), ["cam02"], [3, 9], "gauss-newton")
    assert [view.camera.name for view in shot.views] == ["cam02"]
    assert shot.performers[0].key_poses.frames.tolist() == [1, 7]
    assert len(shot.performers[0].key_poses.poses) == 2
    assert shot.settings.solver == "gauss-newton"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"views": ["cam09"]}, "--views: no view has the camera 'cam09'"),
        ({"offsets": {"cam09": 1.0}}, "--offset: no view has the camera 'cam09'"),
        ({"keyframes": [4]}, "--keyframes: man has no key pose at frame 4"),
        ({"keyframes": []}, "--keyframes: at least one"),
        ({"keyframes": "3,9"}, "--keyframes: key frames are '3,9'.*\"auto\""),
        ({"keyframes": ["3", "9"]}, "--keyframes: key frame 3 is not a whole number"),
        ({"keyframes": np.arange(9) == 3}, "--keyframes: key frame False is not a whole number"),
        ({"solver": "magic"}, "unknown solver 'magic'"),
    ],
)
def test_what_cannot_be_selected_is_named(folder: Path, arguments: dict, message: str) -> None:
    shot = load_shot(folder / "shot.toml")
    with pytest.raises(KFMocapError, match=message):
        selected(shot, **arguments)


def test_several_performers_have_their_own_bodies_and_key_frames(folder: Path) -> None:
    more = '[[performer]]\nname = "child"\nheight = 1.2\nlandmarks = "landmarks.trc"\nkeyframes = [5]\n'
    (folder / "shot.toml").write_text(TEXT.replace("[track]", more + "[track]"))
    shot = load_shot(folder / "shot.toml")
    assert [p.name for p in shot.performers] == ["man", "child"]
    assert shot.performers[1].key_poses.frames.tolist() == [3]


BAD = [
    # (old, new, what the message says of the file and field)
    ('camera = "cam01"', 'camrea = "cam01"', r"\[\[view\]\] 1: unknown key 'camrea'.*'camera'"),
    ("[track]\nsolver", "[track]\nsolvr", r"\[track\]: unknown key 'solvr'.*'solver'"),
    ("[track]", "[tracking]", "unknown key 'tracking'.*'track'"),
    ('solver = "relaxation"', 'solver = "magic"', r"\[track\] solver: unknown solver 'magic'"),
    ('solver = "relaxation"', "solver = 3", r"\[track\] solver: must be a text"),
    ('name = "walk"', "", r"\[shot\]: 'name' is missing"),
    ('name = "walk"', 'name = "a/b"', r"\[shot\] name: 'a/b' cannot be a file's name"),
    ('name = "walk"', 'name = ".."', r"\[shot\] name"),
    ('name = "walk"', 'name = "con"', r"\[shot\] name: 'con' .*Windows keeps it"),
    ('name = "walk"', 'name = "LPT1.take2"', r"\[shot\] name: 'LPT1.take2' .*Windows keeps it"),
    ("fps = 30.0", "fps = 0", r"\[shot\] fps: must be greater than 0"),
    ("fps = 30.0", 'fps = "fast"', r"\[shot\] fps: must be a number, not 'fast'"),
    ("fps = 30.0", "fps = nan", r"\[shot\] fps: must be a number"),
    ("frames = [2, 9]", "frames = [9, 2]", r"\[shot\] frames: must be \[first, last\]"),
    ("frames = [2, 9]", "frames = [2, 9.5]", r"\[shot\] frames: must be a list of whole numbers"),
    ("frames = [2, 9]", "frames = [2, 10]", r"'cam02' footage.*only 11 frames"),
    ('file = "calibration.toml"', 'file = "none.toml"', r"\[calibration\] file.*none\.toml.*cannot be read"),
    ('camera = "cam01"', 'camera = "cam09"', r"\[\[view\]\] 1 camera: .*no camera 'cam09'.*cam01, cam02"),
    ('camera = "cam01"', 'camera = "cam02"', r"\[\[view\]\] camera: 'cam02' is there twice"),
    ('"cam01_%04d.png"', '"cam01.mp4"', r"'cam01' footage: .*cam01\.mp4: there is no such footage"),
    ('"cam01_%04d.png"', '"calibration.toml"', r"'cam01' footage: .*cannot be read as a video"),
    ("offset = 1.0", "offset = -3.0", r"'cam02' footage.*begins before the footage"),
    ("offset = 1.0", 'offset = "one"', r"\[\[view\]\] 2 offset: must be a number"),
    ("[calibration]", '[calibration]\nunit = "feet"', r"\[calibration\] unit: unknown value 'feet' \(use m, cm, mm\)"),
    ("[calibration]", '[calibration]\nup = "up"', r"\[calibration\] up: unknown value 'up' \(use z, -z, y"),
    ("offset = 1.0", "every = 0", r"\[\[view\]\] 2 every: 0 is not a whole number from 1"),
    ("offset = 1.0", "every = 2.0", r"\[\[view\]\] 2 every: 2.0 is not a whole number from 1"),
    ("offset = 1.0", "every = true", r"\[\[view\]\] 2 every: True is not a whole number from 1"),
    ("offset = 1.0", 'fields = "top"', r"\[\[view\]\] 2 fields: unknown value 'top'.*top-first"),
    (
        "offset = 1.0",
        'offset = 15\nfields = "top-first"',
        "'cam02' footage.*only 22 fields, 0 to 21: .*its fields 17 to 24",
    ),
    ("offset = 1.0", "missing = [0]", r"\[\[view\]\] 2 missing: 0 cannot be one of them"),
    ("offset = 1.0", "missing = [5]\ntwice = [5]", r"\[\[view\]\] 2 twice: 5 cannot be one of them"),
    ("offset = 1.0", "twice = 5", r"\[\[view\]\] 2 twice: must be a list of whole numbers"),
    ("offset = 1.0", f"missing = {[5] * 1001}", r"\[\[view\]\] 2 missing: 1001 frames are more than 1000"),
    ("offset = 1.0", 'keypoints = "pose"', r"\[\[view\]\] 2 keypoints: there is no such"),
    ("keyframes = [9, 3, 6]", "keyframes = []", r"\[\[performer\]\] 1 keyframes: at least one key frame"),
    ("keyframes = [9, 3, 6]", "keyframes = [1, 3]", r"1 keyframes: key frame 1 lies outside .* 2 to 9"),
    (
        "keyframes = [9, 3, 6]",
        'keyframes = "auto"',
        r"\[\[performer\]\] 1: there is nothing to take the key poses from",
    ),
    ("keyframes = [9, 3, 6]", 'keyframes = "some"', "1 keyframes: must be a list of whole numbers"),
    ("keyframes = [9, 3, 6]", "keyframes = [true]", "1 keyframes: must be a list of whole numbers"),
    ('landmarks = "landmarks.trc"', "", r"\[\[performer\]\] 1: .*key poses"),
    ('landmarks = "landmarks.trc"', 'landmarks = "no.trc"', r"1 landmarks: .*no\.trc: .*cannot be read"),
    ('landmarks = "landmarks.trc"', 'landmarks = ""', r"1 landmarks: must be a text"),
    ('name = "man"', 'name = "man"\nheight = 30.0', r"\[\[performer\]\] 1: a height of 30"),
    (TEXT[TEXT.index("[[performer]]") : TEXT.index("[track]")], "", r"at least one \[\[performer\]\]"),
    ('name = "walk"', f'name = "{"w" * 101}"', r"\[shot\] name: 'w+\.\.\.' is too long"),
    ("[track]", '[[performer]]\nname = "a:b"\n[track]', r"\[\[performer\]\] name: 'a:b' cannot be a file's name"),
    ("[track]", '[[performer]]\nname = "Man"\n[track]', "'Man' and 'man' differ in capitals alone"),
    ('solver = "relaxation"', 'broken_keypoints = "keep"', r"\[track\] broken_keypoints: unknown value 'keep'.*skip"),
    ('solver = "relaxation"', "threads = 0", r"\[track\] threads: it is 0"),
    ('solver = "relaxation"', "threads = 100000", r"\[track\] threads: it is 100000 .*1 to 256"),
    ("[calibration]", "[calibration", r"shot\.toml: is not a TOML file.*line"),
    ('"cam01_%04d.png"', r'"C:\Users\me\cam01.mp4"', r"not a TOML file.*\(write paths with /.*single quotes"),
    ('"cam01_%04d.png"', r'"C:\takes\cam01.mp4"', r"not a TOML file.*\(write paths with /.*single quotes"),
    ("fps = 30.0", "fps = 30000/1001", r"not a TOML file.*line 4.*\(write a number, such as 29\.97"),
    ('camera = "cam01"', "camera = cam01", r"not a TOML file.*\(write texts between straight quotes"),
    ('camera = "cam01"', "camera = True", r"not a TOML file.*\(write true or false in small letters"),
    ("fps = 30.0", "fps = 29,97", r"not a TOML file.*\(write numbers with a point"),
    ("fps = 30.0", "fps: 30.0", r"not a TOML file.*\(write names and values with ="),
    ('camera = "cam01"', "camera = \u201ccam01\u201d", r"not a TOML file.*\(write texts between straight quotes"),
    ('[[view]]\ncamera = "cam01"', '[view]\ncamera = "cam01"', r"not a TOML file.*have two brackets each time"),
    ("[[performer]]", "[performer]", r"at least one \[\[performer\]\] \(write two brackets"),
    ("cam02_%04d.png", "cam01_%04d.png", r"\[\[view\]\] footage: '.*cam01_%04d\.png' is there twice"),
    ("cam01_%04d.png", "cam01_0003.png", r"only one frame \(this is a single image: .* as .*/cam01_####\.png"),
    ("keyframes = [9, 3, 6]", "keyframes = [4, 7, 10]", "key frame 10 lies outside .*counted from 0"),
    ('"cam01_%04d.png"', r'"walk\take1.mp4"', r"1 footage: .* a backslash began an escape \(write paths with /"),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD)
def test_bad_input_is_one_message_with_file_and_field(folder: Path, old: str, new: str, message: str) -> None:
    assert old in TEXT
    path = folder / "shot.toml"
    path.write_text(TEXT.replace(old, new))
    with pytest.raises(KFMocapError, match=message) as caught:
        load_shot(path)
    assert "\n" not in str(caught.value)


CAPTURE = '[wand]\nlength = 0.5\n[[view]]\ncamera = "cam01"\nwand = "a.mp4"\nmatrix = [[9,0,4],[0,9,3],[0,0,1]]\n'


def test_a_file_of_another_kind_is_called_by_its_name_with_the_command_that_it_is_for(folder: Path) -> None:
    shot, capture, cameras = folder / "shot.toml", folder / "wand.toml", folder / "calibration.toml"
    capture.write_text(CAPTURE)
    for file, read, message in [
        (capture, read_shot_spec, "is a capture file of a wand, not a shot file .*kfmocap calibrate"),
        (cameras, read_shot_spec, r"is a calibration, not a shot file .*\[calibration\]"),
        (shot, load_wand, "is a shot file, not a capture file of a wand .*kfmocap track.*--performer"),
        (cameras, load_wand, "is a calibration, not a capture file"),
        (shot, load_cameras, "is a shot file, not a calibration"),
        (capture, load_cameras, "is a capture file of a wand, not a calibration"),
    ]:
        with pytest.raises(KFMocapError, match=message):
            read(file)


def test_footage_may_be_the_folder_of_an_image_sequence(folder: Path) -> None:
    own = folder / "cam01"
    own.mkdir()
    for file in sorted(folder.glob("cam01_*.png")):
        file.rename(own / file.name)
    path = folder / "shot.toml"
    path.write_text(TEXT.replace("cam01_%04d.png", "cam01"))
    assert load_shot(path).views[0].footage == own / "cam01_####.png"
    (own / "thumbnail.jpg").touch()
    with pytest.raises(KFMocapError, match=r"1 footage: .*several image sequences: cam01_####\.png, thumbnail\.jpg"):
        load_shot(path)


def test_paths_may_be_written_with_backslashes(folder: Path) -> None:
    own = folder / "cam01"
    own.mkdir()
    for file in sorted(folder.glob("cam01_*.png")):
        file.rename(own / file.name)
    path = folder / "shot.toml"
    path.write_text(TEXT.replace('"cam01_%04d.png"', r"'cam01\cam01_%04d.png'"))
    assert load_shot(path).views[0].footage == own / "cam01_%04d.png"


@pytest.mark.parametrize(("name", "frame"), [("RKnee", None), ("LWrist", 6)])
def test_a_key_pose_is_made_of_the_landmarks_that_there_are(folder: Path, name: str, frame: int | None) -> None:
    names, points = walking(LAST - FIRST + 1)
    if frame is None:
        points = np.delete(points, names.index(name), axis=1)
        names.remove(name)
    else:
        points[frame - FIRST, names.index(name)] = np.nan
    write_trc(folder / "landmarks.trc", names, points, 30)
    [performer] = load_shot(folder / "shot.toml").performers
    assert len(performer.key_poses.frames) and np.isfinite(performer.key_poses.poses.translations).all()


def test_landmarks_of_the_whole_footage_say_which_frame_their_first_row_shows(folder: Path) -> None:
    names, points = walking(LAST - FIRST + 1)
    known = load_shot(folder / "shot.toml").performers[0].key_poses
    whole = np.concatenate([np.full((FIRST, *points.shape[1:]), np.nan), points])
    write_trc(folder / "landmarks.trc", names, whole, 60)
    for row, difference in ((0, 0.0), (1, 0.5 / (LAST - FIRST))):
        text = TEXT.replace('name = "man"', f'name = "man"\nfirst_row = {row}')
        (folder / "shot.toml").write_text(text)
        performer = load_shot(folder / "shot.toml").performers[0]
        assert performer.file_fps == 60, "rows are frames all the same, but it is said"
        found = performer.key_poses
        assert found.frames.tolist() == known.frames.tolist()
        moved = known.poses.translations - found.poses.translations
        np.testing.assert_allclose(moved[:, 0], difference, atol=2e-3)
    (folder / "shot.toml").write_text(TEXT.replace('name = "man"', 'name = "man"\nfirst_row = -1'))
    with pytest.raises(KFMocapError, match="first_row: must be the number of a frame, from 0, not -1"):
        load_shot(folder / "shot.toml")


def test_a_key_frame_with_too_few_landmarks_is_named(folder: Path) -> None:
    names, points = walking(LAST - FIRST + 1)
    points[6 - FIRST, 3:] = np.nan
    write_trc(folder / "landmarks.trc", names, points, 30)
    with pytest.raises(KFMocapError, match=r"landmarks\.trc.*frame 6"):
        load_shot(folder / "shot.toml")


def test_landmarks_that_end_before_a_key_frame_are_named(folder: Path) -> None:
    names, points = walking(5)
    write_trc(folder / "landmarks.trc", names, points, 30)
    with pytest.raises(KFMocapError, match="key frame 9 has no row: rows show frames 2 to 6"):
        load_shot(folder / "shot.toml")


def test_a_missing_shot_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(KFMocapError, match=r"none\.toml: the shot file cannot be read"):
        load_shot(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"views": ["cam09"]}, "--views: no view has the camera 'cam09'.*cam01, cam02"),
        ({"views": []}, "--views: no view is named"),
        ({"views": "cam09"}, "--views: no view has the camera 'cam09'.*cam01, cam02"),
        ({"keyframes": [100]}, "--keyframes: key frame 100 lies outside"),
        ({"keyframes": []}, "--keyframes: at least one"),
        ({"keyframes": np.array([2, 2.5])}, "--keyframes: key frame 2.5 is not a whole number"),
        ({"keyframes": "3,9"}, "--keyframes: key frames are '3,9'.*\"auto\""),
        ({"keyframes": ["3", "9"]}, "--keyframes: key frame 3 is not a whole number"),
        ({"keyframes": np.arange(9) == 3}, "--keyframes: key frame False is not a whole number"),
        ({"solver": "magic"}, "--solver: unknown solver 'magic'"),
    ],
)
def test_bad_overrides_are_named(folder: Path, arguments: dict, message: str) -> None:
    with pytest.raises(KFMocapError, match=message):
        load_shot(folder / "shot.toml", **arguments)


def test_key_poses_can_come_from_a_bvh(folder: Path) -> None:
    body = human(1.7)
    motion = wild(body, LAST - FIRST + 1)
    (folder / "poses.bvh").write_text(bvh_text(body, motion))
    text = TEXT.replace('landmarks = "landmarks.trc"', 'height = 1.7\nkeyposes = "poses.bvh"')
    (folder / "shot.toml").write_text(text)
    (performer,) = load_shot(folder / "shot.toml").performers
    assert performer.key_poses.frames.tolist() == [1, 4, 7]
    assert np.abs(performer.key_poses.poses.difference(motion[[1, 4, 7]])).max() < 1e-6


@dataclass(frozen=True)
class ManySettings:
    solver: str = "relaxation"
    smoothness: float = 1.0
    sweeps: int = 5
    robust: bool = True
    limit: float | None = None


@pytest.mark.parametrize(
    ("line", "key", "value"),
    [
        ("smoothness = 2", "smoothness", 2.0),
        ("sweeps = 7", "sweeps", 7),
        ("robust = false", "robust", False),
        ("limit = 0.5", "limit", 0.5),
    ],
)
def test_every_setting_is_a_key_of_its_own_type(folder: Path, monkeypatch, line: str, key: str, value) -> None:
    monkeypatch.setattr(shot_toml, "Settings", ManySettings)
    (folder / "shot.toml").write_text(TEXT + line)
    assert getattr(read_shot_spec(folder / "shot.toml").settings, key) == value


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("smoothness = true", "a number"),
        ("sweeps = 7.5", "a whole number"),
        ("robust = 1", "true or false"),
        ('limit = "far"', "a number"),
    ],
)
def test_a_setting_of_another_type_is_refused(folder: Path, monkeypatch, line: str, meant: str) -> None:
    monkeypatch.setattr(shot_toml, "Settings", ManySettings)
    (folder / "shot.toml").write_text(TEXT + line)
    with pytest.raises(KFMocapError, match=rf"\[track\] {line.split(maxsplit=1)[0]}: must be {meant}"):
        load_shot(folder / "shot.toml")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('keyposes = "no.bvh"', r"\[\[performer\]\] 1 keyposes: .*no\.bvh"),
        ('keyposes = "poses.bvh"', r"1 keyposes: .*poses\.bvh: key frame 6 has no row: rows show frames 2 to 5"),
        (
            'keyposes = "other.bvh"',
            r"1 keyposes: .*other\.bvh: its joints are not the default body's: LeftLeg",
        ),
        ('keyposes = "poses.bvh"\nlandmarks = "landmarks.trc"', "not from both"),
    ],
)
def test_bad_key_poses_are_named(folder: Path, line: str, message: str) -> None:
    short = bvh_text(human(), wild(human(), 4))
    (folder / "poses.bvh").write_text(short)
    (folder / "other.bvh").write_text(bvh_text(human(), wild(human(), 8)).replace("shin.L", "LeftLeg"))
    (folder / "shot.toml").write_text(TEXT.replace('landmarks = "landmarks.trc"', line))
    with pytest.raises(KFMocapError, match=message):
        load_shot(folder / "shot.toml")


PROP = """
[[performer]]
name = "stick"
mesh = "stick.obj"
keyposes = "stick.bvh"
keyframes = [3, 9]

[[hold]]
prop = "stick"
holder = "man"
part = "hand.R"
frames = [4, 9]
"""
CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 0.1) for y in (0, 0.4) for z in (0, 0.1)) + "f 1 2 3\n"


@pytest.fixture
def with_prop(folder: Path) -> Path:
    """The shot with a stick that lies still, 2 m beside the origin and upright."""
    joint = RestSkeleton(("stick",), (-1,), np.array([[2.0, 0, 1]]), np.full((1, 3), np.nan))
    body = body_of_prop(joint, np.array([[x, y, z] for x in (0, 0.1) for y in (0, 0.4) for z in (0, 0.1)]))
    turn = rotations.exp(np.array([np.pi / 2, 0, 0]))
    (folder / "stick.bvh").write_text(bvh_text(body, Motion(np.tile([2.0, 0, 1], (8, 1)), np.tile(turn, (8, 1, 1, 1)))))
    (folder / "stick.obj").write_text(CUBE)
    (folder / "shot.toml").write_text(TEXT.replace("relaxation", "gauss-newton") + PROP)
    return folder


def test_a_prop_is_held_as_the_file_says(with_prop: Path) -> None:
    shot = load_shot(with_prop / "shot.toml")
    stick = shot.performers[1]
    R, T = part_poses(stick.body, stick.key_poses.poses)
    corners = stick.body.parts[0].vertices @ R[0, 0].T + T[0, 0]
    assert corners.min(axis=0) == pytest.approx([2.0, -0.1, 1.0], abs=1e-4)
    assert corners.max(axis=0) == pytest.approx([2.1, 0.0, 1.4], abs=1e-4)
    [hold] = shot.holds
    assert (hold.prop, hold.holder, hold.part, hold.frames) == ("stick", "man", "hand.R", (2, 7))
    assert hold.grip is not None
    assert hold.grip.frames.tolist() == [7]  # of the key poses of both, that within the range
    assert read_shot_spec(with_prop / "shot.toml").holds[0].frames == (4, 9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'prop = "stick"',
            'prop = "sword"',
            r"\[\[hold\]\] 1 prop: there is no performer 'sword' \(there are man",
        ),
        ('holder = "man"', 'holder = "stick"', r"prop: 'stick' cannot hold itself"),
        ('part = "hand.R"', 'part = "paw"', r"\[\[hold\]\] 1: man has no part 'paw' \(its parts are .*hand\.R"),
        ("frames = [4, 9]", "frames = [4, 10]", r"frames: must be \[first, last\] within the shot's frames 2 to 9"),
        ("frames = [4, 9]", "frames = [5, 4]", r"frames: must be"),
        ("frames = [4, 9]", "frames = [4, 8]", r"1: no frame from 4 to 8 has a key pose of both stick and man"),
        ("frames = [4, 9]", "frame = [4, 9]", r"unknown key 'frame'.*did you mean 'frames'"),
        ("[[hold]]", "[hold]", r"there must be at least one \[\[hold\]\]|must be a list"),
        ('mesh = "stick.obj"', 'mesh = "shot.toml"', r"mesh: .*is not an OBJ file.*0 vertices"),
        ('mesh = "stick.obj"', 'mesh = "none.obj"', r"none\.obj"),
        ('keyposes = "stick.bvh"\n', "", r"key poses of a prop come from a BVH"),
        ("keyframes = [3, 9]", 'keyframes = "auto"', r"key poses of a prop come from a BVH"),
        ('keyposes = "stick.bvh"', 'keyposes = "person.bvh"', r"it has \d+ joints.*a prop is one rigid part"),
    ],
)
def test_props_and_holds_that_cannot_be_are_named(with_prop: Path, old: str, new: str, message: str) -> None:
    (with_prop / "person.bvh").write_text(bvh_text(human(), wild(human(), 8)))
    file = with_prop / "shot.toml"
    text = file.read_text()
    head, tail = text[: text.index('name = "stick"')], text[text.index('name = "stick"') :]
    assert old in tail
    file.write_text(head + tail.replace(old, new, 1))
    with pytest.raises(KFMocapError, match=message):
        load_shot(file)


def test_the_relaxation_refuses_a_hold(with_prop: Path) -> None:
    shot = load_shot(with_prop / "shot.toml", solver="relaxation")
    with pytest.raises(KFMocapError, match="the solver relaxation does not support holds"):
        track(shot)


def test_fingers_need_keypoints_of_two_views(folder: Path) -> None:
    assert not load_shot(folder / "shot.toml").performers[0].fingers
    (folder / "shot.toml").write_text(TEXT.replace('name = "man"', 'name = "man"\nfingers = true'))
    with pytest.raises(KFMocapError, match=r"\[\[performer\]\] 1 fingers: fingers are found in keypoints"):
        load_shot(folder / "shot.toml")
    (folder / "shot.toml").write_text(TEXT.replace('name = "man"', 'name = "man"\nfingers = "yes"'))
    with pytest.raises(KFMocapError, match=r"fingers: must be true or false, not 'yes'"):
        load_shot(folder / "shot.toml")


def test_cameras_are_scaled_to_footage_that_was_resized_after_calibrating(folder: Path) -> None:
    """A camera of twice the footage's size sees every point where the resized footage shows it."""
    shot = load_shot(folder / "shot.toml")
    own = [view.camera for view in shot.views]
    save_cameras(folder / "calibration.toml", [camera.resized((2 * SIZE[0], 2 * SIZE[1])) for camera in own])
    with pytest.raises(KFMocapError, match=r"'cam01' footage: .*64x48.*128x96.*resized = true"):
        load_shot(folder / "shot.toml")
    (folder / "shot.toml").write_text(TEXT.replace("[[view]]", "resized = true\n\n[[view]]", 1))
    points = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    for camera, view in zip(own, load_shot(folder / "shot.toml").views, strict=True):
        assert view.camera.size == SIZE
        np.testing.assert_allclose(view.camera.project(points), camera.project(points), rtol=0, atol=1e-6)


def test_footage_that_was_cropped_is_not_taken_for_resized(folder: Path) -> None:
    own = [view.camera for view in load_shot(folder / "shot.toml").views]
    save_cameras(folder / "calibration.toml", [camera.resized((128, 128)) for camera in own])
    (folder / "shot.toml").write_text(TEXT.replace("[[view]]", "resized = true\n\n[[view]]", 1))
    with pytest.raises(KFMocapError, match=r"'cam01' footage: .*64x48.*128x128.*cropped"):
        load_shot(folder / "shot.toml")


@pytest.mark.parametrize(
    ("size", "other", "same"),
    [((960, 540), (1920, 1080), True), ((854, 480), (1920, 1080), True), ((960, 544), (1920, 1080), False),
     ((480, 640), (640, 480), False)],
)  # fmt: skip
def test_proportions_are_the_same_where_one_side_was_rounded(
    size: tuple[int, int], other: tuple[int, int], same: bool
) -> None:
    assert same_proportions(size, other) is same
    assert same_proportions(other, size) is same
