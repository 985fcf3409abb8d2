"""The report and the joint error say what happened."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.smoothness_estimate import ROOT_GROUPS
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.cameras.world_axes import AXES, upward_axis_warning
from kfmocap.core.errors import LandmarkError
from kfmocap.core.fitting.checks.view_findings import CameraFit, FootageMatch
from kfmocap.core.formats import Landmarks
from kfmocap.core.keypoints.observations import ShotKeypoints
from kfmocap.core.review.report_text import rate_text, report_lines
from kfmocap.core.review.scoring import joint_error
from kfmocap.core.review.track_report import report
from kfmocap.core.runtime.output_files.files import write_json
from kfmocap.core.shot.footage_faults.footage_damage import FootageDamage
from kfmocap.core.shot.footage_faults.footage_times import FootageRate
from kfmocap.core.shot.footage_faults.frame_pattern import FramePattern
from kfmocap.core.shot.shot import Gap, KeyPoses, Performer, Shot, View
from kfmocap.core.tracking.expected_errors.uncertainty import JointErrors
from kfmocap.core.tracking.results.late_views import LateView
from synthetic import look_at


@dataclass
class Segment:
    first: int
    last: int
    iterations: int
    energy: tuple[float, ...]
    accelerations: tuple[np.ndarray, ...] = ()


@pytest.fixture
def tracked() -> tuple[Shot, type]:
    """A shot that begins at frame 100, two views, and what the tracker would hand back of it."""
    body, F = human(), 24
    motion = Motion(np.zeros((F, 3)), np.tile(np.eye(3), (F, len(body), 1, 1)))
    upright = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    cameras = [
        Camera.create(name, (64, 48), [[60, 0, 31], [0, 60, 23], [0, 0, 1]], upright, np.zeros(3))
        for name in ("cam01", "cam02")
    ]
    performer = Performer("man", body, KeyPoses.whole([0, 23], motion[[0, 23]]))
    views = tuple(View(camera, Path("a.mp4")) for camera in cameras)
    visible = np.ones((2, F, len(body)))
    visible[0, 2:5, body.index("forearm.R")] = 0.1
    visible[:, 8:15, body.index("hand.R")] = 0.1
    visible[0, 10:12, body.index("shin.L")] = visible[1, 11:14, body.index("shin.L")] = 0.2
    values = np.zeros(F)
    values[6], values[0] = 0.2, np.nan

    class Result:
        observed = ShotKeypoints()
        seconds = {"footage": 1.0, "solve": 3.0}
        camera_frames = 8
        footage_offset = 0.0
        unknown = ((),)
        planted = (None,)
        torn = ()
        late = ()
        gaps = ()
        damage = ()
        rates = ()
        patterns = ()
        segments = (Segment(0, 23, 3, (5.0, 2.0, 1.5)),)

    deviation = np.full((F, len(body)), 0.004) * np.sin(np.pi * np.arange(F) / (F - 1))[:, None]
    deviation[13:18, body.index("forearm.L")] = 0.2
    lost = np.zeros_like(deviation)
    lost[14:17, body.index("forearm.L")] = 0.8
    Result.visible, Result.residual = (visible,), (values,)
    Result.errors = (JointErrors(deviation, 1.5 * deviation, lost),)
    return Shot("jump", 25.0, (100, 123), views, (performer,)), Result


def test_the_report_counts_frames_as_the_footage_does(tracked: tuple[Shot, type], tmp_path: Path) -> None:
    shot, result = tracked
    values = report(shot, result(), {"overlay": 0.5})
    assert values["camera_frames_per_second"] == 2.0
    assert values["seconds_total"] == 4.5
    assert values["segments"] == [{"frames": [100, 123], "iterations": 3, "energy": [5.0, 2.0, 1.5]}]
    (man,) = values["performers"]
    assert man["keyframes"] == [100, 123]
    assert man["worst_frames"][0] == {"frame": 106, "residual": 0.2}
    assert 100 not in [w["frame"] for w in man["worst_frames"]]
    write_json(tmp_path / "report.json", values)
    assert json.loads((tmp_path / "report.json").read_text()) == values


def test_the_report_has_what_each_camera_and_what_no_camera_saw(tracked: tuple[Shot, type]) -> None:
    (man,) = report(*tracked)["performers"]
    assert man["occluded"] == {
        "cam01": {"forearm.R": [[102, 104]], "hand.R": [[108, 114]], "shin.L": [[110, 111]]},
        "cam02": {"hand.R": [[108, 114]], "shin.L": [[111, 113]]},
    }
    assert man["unseen"] == {"hand.R": [[108, 114]], "shin.L": [[111, 111]]}


def test_the_report_suggests_key_frames_beside_what_no_camera_saw(tracked: tuple[Shot, type]) -> None:
    (man,) = report(*tracked)["performers"]
    assert man["suggested_keyframes"] == [
        {"frame": 107, "parts": ["hand.R"], "hidden": [108, 114]},
        {"frame": 115, "parts": ["hand.R"], "hidden": [108, 114]},
    ]


def test_the_report_has_the_plants_that_were_held(tracked: tuple[Shot, type]) -> None:
    shot, result = tracked
    assert "plants" not in report(shot, result)["performers"][0]
    result.planted = (np.zeros((24, 4), bool),)
    result.planted[0][3:9, 0] = result.planted[0][12:, 3] = True
    (man,) = report(shot, result)["performers"]
    assert man["plants"] == {"heel.L": [[103, 108]], "ball.L": [], "heel.R": [], "ball.R": [[112, 123]]}


def test_the_report_has_how_far_off_the_parts_may_be_and_where_one_more_key_pose_would_help(
    tracked: tuple[Shot, type],
) -> None:
    (man,) = report(*tracked)["performers"]
    assert man["expected_error_90"] == pytest.approx(1.5 * np.array(man["expected_error"]), abs=0.13)
    assert man["joint_errors_90"]["forearm.L"][15] == 300.0 and "hand.L" not in man["joint_errors_90"]
    assert man["may_be_lost"] == {"forearm.L": [[114, 116]]}
    assert len(man["expected_error"]) == 24 and man["expected_error"][0] == man["expected_error"][-1] == 0
    first, *others = man["helpful_keyframes"]
    assert 114 <= first["frame"] <= 116 and first["parts"] == ["forearm.L"]
    assert first["expected_error"] == man["expected_error"][first["frame"] - 100]
    assert first["worst_error"] == pytest.approx(
        man["joint_errors_90"]["forearm.L"][first["frame"] - 100] / 1.5, abs=0.1
    )
    assert all(first["gain"] >= other["gain"] > 0 for other in others)


def test_a_whole_body_that_may_be_lost_is_named_once_before_the_parts(tracked: tuple[Shot, type]) -> None:
    shot, result = tracked
    errors = result.errors[0]
    lost = errors.lost.copy()
    lost[5:8] = 0.9
    result.errors = (replace(errors, lost=lost),)
    found = report(shot, result)
    (man,) = found["performers"]
    assert man["body_may_be_lost"] == [[105, 107]]
    assert man["may_be_lost"] == {"forearm.L": [[114, 116]]}
    assert any(line.endswith("they are: the whole body 105-107; forearm.L 114-116") for line in report_lines(found))


def test_blind_spots_are_reported_in_one_line_each(tracked: tuple[Shot, type]) -> None:
    shot, result = tracked
    unseen, lost, helpful, suggested = report_lines(report(shot, result))
    assert lost == (
        "man: may be lost, or hidden by something, as the footage does not show them where they are: forearm.L 114-116"
    )
    (man,) = report(shot, result)["performers"]
    assert man["body_may_be_lost"] == []
    assert unseen == "man: frames on which no camera sees a part: shin.L 1, hand.R 7"
    assert suggested == "man: key poses would help at 107 (hand.R hidden 108-114), 115 (hand.R hidden 108-114)"
    assert helpful.startswith("man: where one more key pose would help most: ") and "(forearm.L some 200 mm)" in helpful
    result.visible = tuple(np.ones_like(visible) for visible in result.visible)
    nothing = np.zeros_like(result.errors[0].lost)
    result.errors = (JointErrors(nothing, nothing, nothing),)
    assert not report_lines(report(shot, result))


def test_cameras_that_another_axis_than_z_is_upright_for_are_reported(tracked: tuple[Shot, type]) -> None:
    shot, result = tracked
    for up in ("z", "y"):
        cameras = [look_at("cam01", (3, -4, 1.5)), look_at("cam02", (-4, -2, 2))]
        filed = [replace(camera, R_cam_world=camera.R_cam_world @ np.array(AXES[up], float)) for camera in cameras]
        views = tuple(replace(view, camera=camera) for view, camera in zip(shot.views, filed, strict=True))
        lines = report_lines(report(replace(shot, views=views), result))
        said = [line for line in lines if "world's" in line]
        assert [line.split(":")[0] for line in said] == ([] if up == "z" else [upward_axis_warning(filed)])


def test_keypoint_files_that_show_nobody_are_reported(tracked: tuple[Shot, type]) -> None:
    """As those whose numbers are others than the footage's frames."""
    shot, result = tracked
    values = report(shot, result, ())
    for view in values["views"]:
        view["keypoints"] = f"{view['camera']}_json"
    assert not [line for line in report_lines(values) if "keypoint" in line], "the solver does not use any"
    values["performers"][0]["keypoints"] = {
        camera: {"frames": frames, "agreement": 0.9, "sides_changed": []}
        for camera, frames in (("cam01", 20), ("cam02", 0))
    }
    [said] = [line for line in report_lines(values) if "keypoint" in line]
    assert said.startswith("cam02: its keypoint files show no performer")


def test_keypoints_of_other_frames_are_reported(tracked: tuple[Shot, type]) -> None:
    shot, result = tracked
    late = type("Late", (result,), {"observed": ShotKeypoints(frames_off=(None, -1.04))})
    lines = [line for line in report_lines(report(shot, late, ())) if "keypoints" in line]
    assert len(lines) == 1
    assert lines[0].startswith("cam02: ") and "1.0 frames before" in lines[0] and "too high by 1" in lines[0]


def test_a_footage_offset_is_reported_unless_it_was_given(tracked: tuple[Shot, type]) -> None:
    shot, result = tracked
    result.footage_offset = 0.38
    values = report(shot, result)
    assert values["footage_offset"] == 0.38
    assert any("0.38 frames later" in line and "nothing needs to be done" in line for line in report_lines(values))
    assert not any("frames later" in line for line in report_lines(report(shot.with_footage_offset(0.38), result)))
    result.footage_offset = 0.46  # as was measured of key poses that were a whole frame off
    assert any(
        "0.46 frames later" in line and "move all of them" in line for line in report_lines(report(shot, result))
    )
    result.footage_offset = -0.5  # or more: that is as much as is allowed for
    assert any("move them" in line and "one frame earlier" in line for line in report_lines(report(shot, result)))


def test_the_report_has_the_accelerations_that_were_found(tracked: tuple[Shot, type]) -> None:
    shot, result = tracked
    assert "accelerations" not in report(shot, result)["performers"][0]
    found = np.full(ROOT_GROUPS + len(shot.performers[0].body), 20.0)
    found[:ROOT_GROUPS] = 1.5, 3.0  # across and up: sqrt((2 * 1.5**2 + 3**2) / 3)
    found[ROOT_GROUPS + shot.performers[0].body.index("forearm.R")] = 60.0
    result.segments = (Segment(0, 23, 3, (5.0, 2.0, 1.5), (found,)),)
    values = report(shot, result)
    accelerations = values["performers"][0]["accelerations"]
    assert accelerations["root"] == 2.12 and accelerations["joints"]["forearm.R"] == 60.0
    assert any("root 2.1 m/s^2" in line and "60 rad/s^2 (forearm.R)" in line for line in report_lines(values))


def landmarks(names: list[str], points: np.ndarray) -> Landmarks:
    return Landmarks(tuple(names), points, 30.0)


def test_joint_error_leaves_out_key_frames_and_landmarks_that_are_not_joints() -> None:
    names = ["Hip", "RHip", "LKnee", "Nose"]
    truth = np.zeros((5, 4, 3))
    found = truth.copy()
    found[:, 1, 0] = 0.010
    found[:, 2, 1] = 0.030
    found[:, [0, 3]] = 9.0
    found[[0, 4]] = 5.0
    score = joint_error(landmarks(names, found), landmarks(names, truth), [0, 4])
    assert score.frames == 3
    assert score.mean == pytest.approx(20.0)
    assert score.per_landmark == pytest.approx({"RHip": 10.0, "LKnee": 30.0})


def test_nothing_to_compare_is_an_error() -> None:
    with pytest.raises(LandmarkError, match="share no joint"):
        joint_error(landmarks(["Nose"], np.zeros((3, 1, 3))), landmarks(["Nose"], np.zeros((3, 1, 3))), [])


def test_repeated_frames_are_reported_once_and_not_one_by_one(tracked: tuple[Shot, type]) -> None:
    shot, result = tracked
    result.torn = ((3, 5, 7), (4,))
    result.patterns = (FramePattern(every=2), FramePattern(interlaced=True))
    lines = [line for line in report_lines(report(shot, result())) if line.startswith("cam0")]
    assert [line.split(":")[0] for line in lines] == ["cam01", "cam02", "cam02"]
    assert "every second frame" in lines[0] and "interlaced" in lines[1] and "104" in lines[2]


def test_problems_of_the_footage_are_reported(
    tracked: tuple[Shot, type], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shot, result = tracked
    result.torn = ((), (3, 4))
    result.late = (LateView(17, 0.6, 14.2), None)
    result.gaps = ((), (Gap(shot.frames[0] + 4, 1),))
    result.damage = (None, FootageDamage((61, 64), "error while decoding MB 10 74"))
    monkeypatch.setattr("kfmocap.core.review.track_report.container_rate", lambda view: 30.07)
    result.rates = (FootageRate(29.97, 0.1, 5), FootageRate(25.0, 2.3, 117))
    lines = report_lines(report(shot, result()))
    assert (
        "cam01: its footage has 29.97 frames per second, the shot 25; if its own is right, write it as fps under [shot]"
        in lines
    )
    assert [line for line in lines if line.startswith(f"cam02: frame {shot.frames[0] + 4} is missing")]
    assert [line for line in lines if line.startswith("cam02: its frame rate varies: frame 117 of the file")]
    assert [line for line in lines if "frames 61, 64 of the file (error while decoding MB 10 74)" in line]
    assert [line for line in lines if line.startswith("cam02: pictures that") and "frames 103, 104" in line]
    assert [line for line in lines if line.startswith("cam01: early from about frame 117 on: a frame seems to be miss")]


@pytest.mark.parametrize(("offset", "doubted"), [(-5.0, True), (None, False)])
def test_a_gap_is_doubted_where_some_offset_is_wrong(
    tracked: tuple[Shot, type], offset: float | None, doubted: bool
) -> None:
    """What shows another moment all along looks early or late from some frame on, too, in it or in another view."""
    shot, result = tracked
    result.gaps = ((Gap(shot.frames[0] + 4, 1),), ())
    fits = (FootageMatch("cam02", 0.99, offset),)
    [line] = [line for line in report_lines(report(shot, result(), fits=fits)) if "is missing" in line]
    assert line.startswith("cam01: frame") and ("an offset is wrong" in line) == doubted


def test_frame_rates_that_unsteady_times_explain_are_not_reported() -> None:
    for astray, frames, text in ((0.3, 60, ""), (0.3, 600, "29.97"), (0.001, 60, "29.97")):
        assert text in (said := rate_text(30.07, FootageRate(29.97, astray, 5), 1, 30.0, frames))
        assert bool(said) == bool(text)


@pytest.mark.parametrize(("height", "factor"), [(0.5, "by 3.3"), (1.2, ""), (2.0, ""), (2.9, "by 0.59")])
def test_a_performer_by_keypoints_of_no_person_s_size_questions_the_unit(
    tracked: tuple[Shot, type], height: float, factor: str
) -> None:
    shot, result = tracked
    whole = shot.performers[0]
    for fixed, said in ((False, bool(factor)), (True, False)):
        keys = replace(whole.key_poses, fixed=np.full_like(whole.key_poses.fixed, fixed))
        performer = replace(whole, body=human(height), key_poses=keys)
        values = report(replace(shot, performers=(performer, *shot.performers[1:])), result())
        lines = [line for line in report_lines(values) if "state the calibration's unit" in line]
        assert len(lines) == said
        assert all(line.endswith(f"its translations {factor}") for line in lines)


@pytest.mark.parametrize(("given", "factor"), [(None, ""), (1.6, ""), (2.0, ""), (1.4, "1.2"), (0.35, "5")])
def test_a_height_that_the_limbs_contradict_is_questioned(
    tracked: tuple[Shot, type], given: float | None, factor: str
) -> None:
    shot, result = tracked
    performer = replace(shot.performers[0], body=human(1.75), given_height=given)
    values = report(replace(shot, performers=(performer, *shot.performers[1:])), result())
    lines = [line for line in report_lines(values) if "m was given, but its limbs are those of" in line]
    assert len(lines) == bool(factor)
    assert all("a person of 1.75 m" in line and f"by a factor of {factor}," in line for line in lines)


@pytest.mark.parametrize(("rows", "first", "said"), [(0, 4, 0), (9, 0, 0), (5, 4, 0), (6, 4, 1)])
def test_a_file_of_more_rows_than_a_shot_that_begins_later_is_asked_about(
    tracked: tuple[Shot, type], rows: int, first: int, said: int
) -> None:
    shot, result = tracked
    performer = replace(shot.performers[0], file_rows=rows)
    values = report(replace(shot, performers=(performer, *shot.performers[1:])), result())
    lines = report_lines({**values, "frames": [first, first + 4]})
    assert len([line for line in lines if f"taken for frame {first}: if" in line and "first_row = 0" in line]) == said


def test_key_poses_of_another_frame_rate_are_reported(tracked: tuple[Shot, type]) -> None:
    shot, result = tracked
    for rate, said in ((0.0, 0), (25.1, 0), (50.0, 1)):
        performers = tuple(replace(performer, file_fps=rate) for performer in shot.performers)
        lines = report_lines(report(replace(shot, performers=performers), result()))
        assert len([line for line in lines if "its key poses has 50 frames per second, the shot 25" in line]) == (
            said * len(performers)
        )


@pytest.mark.parametrize(
    ("rate", "frames", "said"), [(25.0, 1000, 0), (25.025, 400, 0), (25.025, 1001, 1), (50, 99, 0)]
)
def test_views_that_drift_apart_are_named(tracked: tuple[Shot, type], rate: float, frames: int, said: int) -> None:
    """Twice the rate is only read where the shot file says that the frames belong together."""
    shot, result = tracked
    result.rates = (FootageRate(25.0, 0.1, 5), FootageRate(rate, 0.1, 5))
    values = {**report(shot, result()), "frames": [0, frames - 1]}
    lines = [line for line in report_lines(values) if "frames apart at the end" in line]
    assert len(lines) == said
    assert all(
        "cam01 has 25 frames per second and cam02 25.025: " in line and "1.0 frames apart" in line for line in lines
    )


@pytest.mark.parametrize(("shift", "doubted"), [(3.0, False), (12.0, True)])
def test_gaps_in_a_view_whose_camera_is_off_are_doubted(
    tracked: tuple[Shot, type], shift: float, doubted: bool
) -> None:
    """Its pictures lie beside the motion with or without a gap."""
    shot, result = tracked
    result.gaps, result.late = ((), (Gap(shot.frames[0] + 4, 1),)), (None, LateView(17, 0.6, 14.2))
    fits = [CameraFit(shift, 1.0, 5.0, "cam02", "key poses")]
    said = [
        line for line in report_lines(report(shot, result(), fits=fits)) if "from about" in line or "missing" in line
    ]
    assert len(said) == 2
    assert all(("this camera is off" in line) == doubted for line in said)


def test_gaps_that_the_shot_file_states_are_no_news(tracked: tuple[Shot, type]) -> None:
    shot, result = tracked
    gaps = (Gap(shot.frames[0] + 4, 1),)
    shot = replace(shot, views=(shot.views[0], replace(shot.views[1], gaps=gaps)))
    result.torn, result.gaps = ((), (4, 5)), ((), gaps)
    values = report(shot, result())
    assert values["views"][1]["gaps"][0]["given"]
    assert not [line for line in report_lines(values) if line.startswith("cam02")]


def test_gaps_that_the_times_of_a_file_show_are_reported_once(tracked: tuple[Shot, type]) -> None:
    shot, result = tracked
    result.torn = ((), (3, 4, 5))
    result.gaps = ((), (Gap(shot.frames[0] + 4, 1, timed=True),))
    result.rates = (None, FootageRate(25.0, 0.6, 4, missing=((shot.frames[0] + 4, 1),)))
    said = [line for line in report_lines(report(shot, result())) if line.startswith("cam02: ")]
    assert [line for line in said if "by the times in its file, frames are missing: 1 before frame 104" in line]
    assert [line for line in said if line.startswith("cam02: pictures that") and "on or before frames 103;" in line]
    assert not [line for line in said if "frame 104 is missing" in line]


def test_keypoints_of_other_footage_are_reported(tracked: tuple[Shot, type]) -> None:
    shot, result = tracked
    values = report(shot, result())
    agreements = {"cam01": 0.21, "cam02": 0.65}
    values["performers"][0]["keypoints"] = {
        camera: {"frames": 30, "agreement": agreement, "sides_changed": []} for camera, agreement in agreements.items()
    }
    said = [line for line in report_lines(values) if "keypoints" in line]
    assert len(said) == 1 and "of its keypoints in cam01, 79% contradict the other views" in said[0]
    for own in values["performers"][0]["keypoints"].values():
        own["frames"] = 0  # none was found: that is said elsewhere
    assert not [line for line in report_lines(values) if "keypoints" in line]


@pytest.mark.parametrize(
    ("offsets", "together"), [((-20.0, -19.0), True), ((-20.0, 5.0), False), ((-20.0, None), False)]
)
def test_views_that_are_all_off_by_the_same_frames_point_to_the_key_poses(
    tracked: tuple[Shot, type], offsets: tuple[float | None, ...], together: bool
) -> None:
    shot, result = tracked
    values = report(shot, result())
    for view, offset in zip(values["views"], offsets, strict=True):
        view["fits"] = [{"off": True, "by": "movement", "summary": "off", "offset": offset}]
    said = [line for line in report_lines(values) if "rather than the offsets, check the key poses" in line]
    assert len(said) == together
    assert all("by about 20 frames" in line and "first_row" in line for line in said)
