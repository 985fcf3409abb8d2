"""The set of shots: halves that stay apart, ratios to what needs no tracker, settings tried beside the defaults."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kfmocap.__main__ import main
from kfmocap.benchmarks import bench, shot_set
from kfmocap.benchmarks.rows import Case
from kfmocap.benchmarks.shot_scores import interval_cover, low_passed, plants_found, plants_moved
from kfmocap.benchmarks.shot_set import DECIDING, MADE, REPORTING, JudgedShot, judged_shots
from kfmocap.core.body import human, landmark_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.errors import FootageError
from kfmocap.core.formats import Landmarks
from render.benchmark_shots import PLANS, ShotPlan
from scipy.special import chdtri


def write_shot_file(folder: Path, keys: str = "[0, 9, 20]", cameras: int = 2) -> Path:
    """A shot file with the names of what it needs."""
    folder.mkdir(parents=True)
    views = "".join(f'[[view]]\ncamera = "cam0{k + 1}"\nfootage = "cam0{k + 1}.mp4"\n' for k in range(cameras))
    (folder / "shot.toml").write_text(
        f'[shot]\nname = "{folder.name}"\nfps = 30.0\nframes = [0, 20]\n[calibration]\nfile = "calibration.toml"\n'
        f'{views}[[performer]]\nname = "person"\nlandmarks = "landmarks.trc"\nkeyframes = {keys}\n'
    )
    for name in ("shot_keypoints.toml", "landmarks.trc"):
        (folder / name).touch()
    return folder


@pytest.fixture
def rendered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Shots are not rendered, only written down; gives the arguments of the renderer."""
    calls: list[list[str]] = []

    def render(script: str, arguments: list[str], *, what: str) -> None:
        assert (script, arguments[-2:]) == ("render_benchmark.py", ["--out", str(tmp_path / "cache")]) and what
        calls.append(arguments[:-2])
        for name in arguments[:-2]:
            if not (tmp_path / "cache" / name).exists():
                write_shot_file(tmp_path / "cache" / name, cameras=1 if name == "waving_far" else 2)

    monkeypatch.setattr(shot_set, "CACHE", tmp_path / "cache")
    monkeypatch.setattr(shot_set, "render", render)
    return calls


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> list[Case]:
    """Cases are noted instead of tracked: twice as good on the half that decides, and 10 mm with changed settings."""
    seen: list[Case] = []

    def alone(case: Case, _folder: Path) -> dict[str, Any]:
        seen.append(case)
        mean = 10.0 if case.settings else 12.0 if MADE.get(case.row.shot, DECIDING) == DECIDING else 24.0
        return {
            "fps": 30.0,
            "score": {"mean": mean, "per_landmark": {"LWrist": 2 * mean, "RHip": mean / 2}},
            "spline": 48.0,
            "triangulated": 36.0 if case.row.keypoints else None,
            "cover": 0.88,
            "plants": 0.96,
            "seconds": {"total": 1.0},
            "memory": None,
        }

    monkeypatch.setattr(bench, "measured_alone", alone)
    return seen


def test_every_rendered_shot_belongs_to_the_half_it_was_made_for() -> None:
    def half(plan: ShotPlan) -> str:
        return plan.half

    assert {name: half(plan) for name, plan in PLANS.items()} == dict(MADE)
    assert sorted(MADE.values()) == [DECIDING] * 8 + [REPORTING] * 8


def test_shots_are_rendered_when_they_are_wanted_and_ones_own_decide(rendered: list[list[str]], tmp_path: Path) -> None:
    write_shot_file(tmp_path / "mine" / "fencing")
    (write_shot_file(tmp_path / "mine" / "pair") / "landmarks.trc").unlink()
    found = {shot.name: shot.half for shot in judged_shots(data=tmp_path / "mine")}
    assert found == {**MADE, "fencing": DECIDING} and rendered == [[*MADE]]
    assert [shot.name for shot in judged_shots("bow")] == ["bow"] and rendered[1:] == [["bow"]]
    assert [shot.name for shot in judged_shots("fencing", tmp_path / "mine")] == ["fencing"] and len(rendered) == 2
    with pytest.raises(FootageError, match="no such folder"):
        judged_shots(data=tmp_path / "nowhere")


def test_a_shot_is_measured_with_key_poses_with_keypoints_and_with_both(
    rendered: list[list[str]], tmp_path: Path
) -> None:
    many, one = (JudgedShot(n, DECIDING, write_shot_file(tmp_path / n, cameras=c)) for n, c in (("a", 3), ("b", 1)))
    rows = [(case.row.keyframes, case.row.keypoints) for case in many.cases()]
    assert rows == [((0, 9, 20), False), ((0, 20), True), ((), True)]
    assert [case.row.keyframes for case in one.cases()] == [(0, 9, 20), (0, 20)]
    assert len(many.cases(quick=True)) == 1


def test_the_tables_tell_the_halves_apart(
    rendered: list[list[str]], stand_in: list[Case], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed = ["--set", "estimate_smoothness = true", "--set", "joint_acceleration=100.0"]
    assert main(["bench", "--shots", *changed, "--out", str(tmp_path / "out")]) == 0
    assert len(stand_in) == 2 * (15 * 3 + 2)
    assert stand_in[1].settings == (("estimate_smoothness", True), ("joint_acceleration", 100.0))
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in capsys.readouterr().out.splitlines()]
    assert ["deciding", "bow", "cam01+cam02", "30", "0 9 20",
            "12.0", "LWrist 24", "48.0", "-", "88", "96.0", "10.0"] in lines  # fmt: skip
    assert ["reporting", "lunges", "cam01+cam02", "30", "none, keypoints",
            "24.0", "LWrist 48", "-", "36.0", "88", "96.0", "10.0"] in lines  # fmt: skip
    assert ["reporting", "key poses", "default", "8", "24.0", "0.50", "-", "88"] in lines
    assert ["deciding", "key poses, keypoints", "changed", "8", "10.0", "0.21", "0.28", "88"] in lines
    assert (tmp_path / "out" / "bench.json").is_file()


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (["--set", "sweeps=3"], "--set"),
        (["--data", "."], "--data"),
        (["--shots", "--set", "swoops=3"], "no setting 'swoops'"),
        (["--shots", "--set", "sweeps=many"], "'many' is no value"),
        (["--shots", "--shot", "beam"], "there is no 'beam'"),
    ],
)
def test_wrong_options_of_the_set_are_named(
    rendered: list[list[str]], wrong: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", *wrong]) == 1
    assert named in capsys.readouterr().err


def test_the_filter_passes_slow_movement_closes_gaps_and_stops_jitter() -> None:
    t = np.arange(120) / 60
    slow = np.stack([np.sin(2 * np.pi * t), t, 0 * t], axis=1)[:, None]
    jittery, gaps = slow + 0.1 * np.sin(2 * np.pi * 25 * t)[:, None, None], slow.copy()
    gaps[40:44] = np.nan
    for points in (jittery, gaps):
        assert np.abs(low_passed(points, 60.0) - slow)[12:-12].max() < 0.02


def test_nine_tenths_of_errors_as_large_as_expected_are_covered() -> None:
    body, F, rng = human(solid=False), 400, np.random.default_rng(0)
    motion = Motion(np.tile(body.offsets[0], (F, 1)), np.tile(np.eye(3), (F, len(body), 1, 1)))
    names = tuple(body.landmarks)
    places = landmark_positions(body, motion, list(names))
    interval = np.full((F, len(body)), 0.02 * np.sqrt(chdtri(3, 0.1) / 3))
    truth = Landmarks(names, places + rng.normal(0, 0.02 / np.sqrt(3), places.shape), 30.0)
    assert interval_cover(body, motion, interval, truth, [0]) == pytest.approx(0.9, abs=0.02)
    assert interval_cover(body, motion, 3 * interval, truth, [0]) > 0.99


def test_plants_are_right_where_the_true_foot_stands() -> None:
    body, F = human(solid=False), 60
    walked = np.where(np.arange(F) < 20, 0.0, np.minimum(np.arange(F) - 20, 20) * 1.5 / 30)
    motion = Motion(body.offsets[0] + walked[:, None] * [1, 0, 0], np.tile(np.eye(3), (F, len(body), 1, 1)))
    names = tuple(body.landmarks)
    truth = Landmarks(names, landmark_positions(body, motion, list(names)), 30.0)
    stands = np.tile(((np.arange(F) <= 20) | (np.arange(F) >= 40))[:, None], (1, 4))
    assert plants_found(body, stands, truth) == 1.0
    assert plants_found(body, ~stands, truth) == 0.0
    assert plants_found(body, None, truth) is None
    steps = 1000 * np.diff(walked)
    late = np.tile((np.arange(F) < 24)[:, None], (1, 4))
    assert plants_moved(body, motion, stands) == (0.0, 0.0)
    assert plants_moved(body, motion, late) == pytest.approx((steps.max(), 1000 * walked[23]))
    assert plants_moved(body, motion, None) is None


def test_standing_that_the_ends_of_a_shot_cut_short_counts_neither_way() -> None:
    """The feet stand on the first two frames, on two in the middle, which is too briefly, and on the last four."""
    body, F, stands = human(solid=False), 30, [1, 12, *range(27, 30)]
    walked = np.cumsum(np.where(np.isin(np.arange(F), stands), 0.0, 0.05))
    motion = Motion(body.offsets[0] + walked[:, None] * [1, 0, 0], np.tile(np.eye(3), (F, len(body), 1, 1)))
    names = tuple(body.landmarks)
    truth = Landmarks(names, landmark_positions(body, motion, list(names)), 30.0)
    planted = np.tile((np.arange(F) > 25)[:, None], (1, 4))
    for said, right in (([], 28), ([0, 1], 28), ([11, 12], 26)):
        found = planted.copy()
        found[said] = True
        assert plants_found(body, found, truth) == pytest.approx(right / 28)
