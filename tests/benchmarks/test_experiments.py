"""The experiments track and measure what they say; nothing is rendered here, and a stand-in tracks for most."""

from __future__ import annotations

import itertools
import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import render_footage
from conftest import ROOT
from kfmocap.benchmarks import experiments, experiments_runs, footage_renderer
from kfmocap.benchmarks.experiments import EXPERIMENTS
from kfmocap.benchmarks.experiments_pictures import Panels, part_of, stacked_rows, write_jpeg
from kfmocap.benchmarks.experiments_runs import (
    ARM,
    DRIFTED,
    LEG,
    SEEDS,
    SHOWN_FIELD,
    SHOWN_SWEEPS,
    SWEEPS,
    SWITCHES,
    SWITCHES_AT_KEYS,
    ExperimentResult,
    RenderedShot,
    excerpt,
    limb,
    track_switched,
)
from kfmocap.benchmarks.studies import prediction_study
from kfmocap.core.body import landmark_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.errors import FootageError
from kfmocap.core.formats import Landmarks
from kfmocap.core.shot.keypose_spline import spline
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot, View
from render.takes import PLANS, make_take
from synthetic import CAMERAS, figure, film, shot_of, swing

DOCUMENT = (ROOT / "docs" / "experiments.md").read_text(encoding="utf-8")


def footage_of(take_name: str, folder: Path) -> RenderedShot:
    """A take with a grey picture instead of its footage."""
    take = make_take(take_name)
    width, height = take.cameras[0].size
    cv2.imwrite(str(folder / "grey.png"), np.full((height, width, 3), 90, np.uint8))
    for k in range(len(take.motion)):
        (folder / f"{k:03d}.png").symlink_to("grey.png")
    views = tuple(View(camera, folder / "%03d.png") for camera in take.cameras)
    person = Performer("person", take.body, KeyPoses.whole(list(take.keys), take.motion[list(take.keys)]))
    truth = Landmarks(tuple(take.landmarks), landmark_positions(take.body, take.motion, take.landmarks), take.fps)
    return RenderedShot(Shot(take.name, take.fps, (0, len(take.motion) - 1), views, (person,)), truth)


@pytest.fixture
def tracked(monkeypatch: pytest.MonkeyPatch) -> list[Shot]:
    """Shots that were tracked, by curves through the key poses."""
    shots: list[Shot] = []

    def stand_in(shot: Shot, observe: Any = None) -> SimpleNamespace:
        shots.append(shot)
        motion = spline(shot.performers[0].key_poses, shot.length)
        if observe is not None:
            observe((0, shot.length - 1), 0, [motion])
        iterations = shot.settings.sweeps if shot.settings.solver == "relaxation" else 1
        return SimpleNamespace(motions=[motion], segments=[SimpleNamespace(iterations=iterations)])

    monkeypatch.setattr(experiments_runs, "track", stand_in)
    return shots


def keys_of(shot: Shot) -> list[int]:
    return (shot.frames[0] + shot.performers[0].key_poses.frames).tolist()


def table(text: str) -> list[list[str]]:
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in [lines[0], *lines[2:]]]


def test_the_walk_is_tracked_with_and_without_each_part_by_both_solvers(tracked: list[Shot], tmp_path: Path) -> None:
    footage = footage_of("crossing", tmp_path)
    outcome = experiments_runs.walk(footage)
    ways = [(s.settings.solver, keys_of(s), s.settings.prediction, s.settings.limb_search) for s in tracked]
    published = [("relaxation", keys, on, False) for keys in ([0], [0, 96]) for on in (False, True)]
    own = [("gauss-newton", keys, on, False) for keys in ([0], [0, 96]) for on in (False, True)]
    searched = [("gauss-newton", [0, 96], on, True) for on in (False, True) for _ in range(SEEDS)]
    assert ways == published + own + searched
    assert [s.settings.search_seed for s in tracked[8:]] == 2 * list(range(SEEDS))
    heads, *rows = table(outcome.text)
    assert [row[:4] for row in rows[:2]] == [["relaxation", "no", "no", "no"], ["relaxation", "no", "yes", "no"]]
    assert rows[-1][:4] == ["gauss-newton", "yes", "yes", "yes"]
    for shot, row in ((tracked[4], rows[4]), (tracked[-1], rows[-1])):
        found = landmark_positions(
            shot.performers[0].body, spline(shot.performers[0].key_poses, 97), list(footage.truth.names)
        )
        apart = 1000 * np.linalg.norm(found - footage.truth.points_world, axis=2)[1:96]
        for head, joints in (
            ("hidden leg", ("RHip", "RKnee", "RAnkle")),
            ("near arm", ("LShoulder", "LElbow", "LWrist")),
        ):
            mean = apart[:, [footage.truth.names.index(j) for j in joints]].mean()
            assert row[heads.index(head)] == f"{mean:.0f}"
    hidden = [float(row[heads.index("hidden leg")]) for row in rows]
    said = float(re.search(r"all three is ([0-9.]+) of", outcome.text)[1])
    assert said == pytest.approx(hidden[-1] / hidden[4], abs=0.01)
    assert set(outcome.pictures) == {"walk_without", "walk_with"}


def test_the_throw_is_solved_both_ways(tracked: list[Shot], tmp_path: Path) -> None:
    outcome = experiments_runs.throw(footage_of("throw", tmp_path))
    solved = [(s.settings.solver, s.settings.sweeps) for s in tracked]
    assert solved[0][0] == "gauss-newton"
    assert solved[1:] == [("relaxation", sweeps) for sweeps in SWEEPS]
    assert all(keys_of(s) == [0, 15, 26, 41, 52, 61, 66, 71] for s in tracked)
    assert [row[2] for row in table(outcome.text.split("\n\n")[0])[1:]] == ["0", *map(str, SWEEPS)]
    assert [row[0] for row in table(outcome.text.split("\n\n")[1])[1:]] == ["the curves", "1000 sweeps", "Gauss-Newton"]
    assert f"On field {SHOWN_FIELD} alone: " in outcome.text and "mm after 1000 sweeps; " in outcome.text
    assert set(outcome.pictures) == {"throw", "throw_convergence"}


def test_errors_are_split_into_those_that_the_camera_sees_and_depth(tmp_path: Path) -> None:
    footage = footage_of("throw", tmp_path)
    true = make_take("throw").motion
    R, t = footage.shot.views[0].camera.poses(0, 1)
    centre = -R[0].T @ t[0]
    farther = Motion(true.translations + 0.1 * R[0][2], true.rotations)
    aside = Motion(true.translations + 0.1 * R[0][1], true.rotations)
    assert np.linalg.norm(centre - true.translations[0]) > 3
    np.testing.assert_allclose(footage.sight_errors(true), 0.0, atol=1e-6)
    across, along = footage.sight_errors(farther)
    assert across < 25 and 95 < along < 100
    across, along = footage.sight_errors(aside)
    assert along < 25 and 95 < across <= 100


def test_the_turn_is_tracked_with_one_camera_a_switched_one_and_all(tracked: list[Shot], tmp_path: Path) -> None:
    outcome = experiments_runs.whirl(footage_of("whirl", tmp_path))
    half = len(tracked) // 2
    assert [s.settings.solver for s in tracked] == half * ["gauss-newton"] + half * ["relaxation"]
    assert [s.views for s in tracked[:half]] == [s.views for s in tracked[half:]]
    cameras = [[view.camera.name for view in s.views] for s in tracked[:half]]
    assert cameras == [
        views
        for switches in (SWITCHES, SWITCHES_AT_KEYS)
        for views in (["cam01"], *([camera] for _, _, camera in switches), ["cam01", "cam02", "cam03"])
    ]
    assert [s.frames for s in tracked[1:5]] == [(first, last) for first, last, _ in SWITCHES]
    assert keys_of(tracked[0]) == [0] and keys_of(tracked[6]) == [0, 24, 48, 72, 96]
    assert [keys_of(s) for s in tracked[1:5]] == [[first] for first, _, _ in SWITCHES]
    assert [keys_of(s) for s in tracked[7:11]] == [[0, 24], [24, 48], [48, 72], [72, 96]]
    assert [row[1:3] for row in table(outcome.text)[1:3]] == [["cam01", "0"], ["switched", "0"]]


def test_a_switched_camera_goes_on_from_the_last_pose(tmp_path: Path) -> None:
    body, length = figure(), 7
    truth = swing(body, length, size=0.2)
    # The figure is quick: at 30 frames a second its root would be accelerated by three g, against all likelihood.
    shot = shot_of(film(tmp_path, [body], [truth], CAMERAS), [body], [truth], [0], fps=12)
    seen: list[Shot] = []
    follow = experiments_runs.track

    def noted(part: Shot) -> Any:
        seen.append(part)
        return follow(part)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiments_runs, "track", noted)
        motion = track_switched(shot, ((0, 3, "front"), (3, 6, "side")))
    assert [[v.camera.name for v in s.views] for s in seen] == [["front"], ["side"]]
    assert [s.frames for s in seen] == [(0, 3), (3, 6)] and len(motion) == length
    np.testing.assert_array_equal(motion[[3]].rotations, seen[1].performers[0].key_poses.poses.rotations)
    still = np.abs(truth[[0] * length].difference(truth)).mean()
    assert np.abs(motion.difference(truth)).mean() < still


def test_an_excerpt_keeps_its_key_poses_and_begins_with_a_pose() -> None:
    body = figure()
    truth = swing(body, 9)
    shot = shot_of([], [body], [truth], [0, 4, 8])
    begun = excerpt(shot, 2, 8, truth[[2]]).performers[0].key_poses
    assert begun.frames.tolist() == [0, 2, 6] and begun.fixed.all()
    np.testing.assert_array_equal(begun.poses.translations, truth.translations[[2, 4, 8]])
    keyed = excerpt(shot, 4, 6, truth[[3]]).performers[0].key_poses
    assert keyed.frames.tolist() == [0]
    np.testing.assert_array_equal(keyed.poses.translations, truth.translations[[4]])


def test_errors_leave_out_every_key_frame_whichever_were_used(tmp_path: Path) -> None:
    footage = footage_of("whirl", tmp_path)
    motion = make_take("whirl").motion
    wrong = Motion(motion.translations.copy(), motion.rotations)
    wrong.translations[[0, 24, 48, 72, 96]] += 1.0
    assert footage.score(wrong).mean == pytest.approx(0, abs=1e-9)
    wrong.translations[30:33] += [0, 0, 0.1]
    assert footage.score(wrong, range(30, 33)).mean == pytest.approx(100)
    assert footage.score(wrong, range(24, 49)).frames == 23
    assert limb(footage.score(wrong, range(30, 33)), "R", (*LEG, *ARM)) == pytest.approx(100)


def test_the_schedules_fit_the_takes() -> None:
    assert {experiment.take for experiment in EXPERIMENTS.values()} <= set(PLANS)
    turn = PLANS["whirl"]
    for switches in (SWITCHES, SWITCHES_AT_KEYS):
        assert switches[0][0] == 0 and switches[-1][1] == turn.frames - 1
        assert all(a[1] == b[0] and a[2] != b[2] for a, b in itertools.pairwise(switches))
        assert {camera for _, _, camera in switches} == {camera.name for camera in turn.cameras}
    assert {first for first, _, _ in SWITCHES_AT_KEYS} <= set(turn.keys)
    assert max(DRIFTED) == PLANS["crossing"].frames - 1
    assert SHOWN_FIELD not in PLANS["throw"].keys and set(SHOWN_SWEEPS) <= set(SWEEPS)


@pytest.mark.parametrize("whole", [False, True])
def test_outlines_lie_on_the_performer(tmp_path: Path, whole: bool) -> None:
    footage = footage_of("whirl", tmp_path)
    panels = Panels(footage.shot, footage.truth, "cam02")
    motion = make_take("whirl").motion
    row = panels.row([(40, None, ""), (40, motion, ""), (41, motion, "")], 240, whole)
    width = (row.shape[1] - 8) // 3
    assert row.shape[0] == 240
    bare, drawn = row[:, :width], row[:, width + 4 : 2 * width + 4]
    assert (bare[30:-30, 30:-30] == 90).all()
    v, u = np.nonzero(drawn.min(axis=2) > 130)
    corner, size = panels._box(40, whole)
    camera = part_of(footage.shot.views[1].camera, corner, size, 240 / size[1])
    joints = camera.project(footage.truth.points_world[40])
    np.testing.assert_allclose([u.min(), v.min()], joints.min(axis=0), atol=12)
    np.testing.assert_allclose([u.max(), v.max()], joints.max(axis=0), atol=12)


def test_a_part_of_a_picture_has_its_camera() -> None:
    camera = make_take("whirl").cameras[0]
    part = part_of(camera, np.array([100.0, 40.0]), np.array([200.0, 300.0]), 0.5)
    point = [0.1, 0.2, 1.0]
    assert part.size == (100, 150)
    np.testing.assert_allclose(part.project(point), 0.5 * (camera.project(point) - [100, 40]))


def test_rows_are_filled_up() -> None:
    sheet = stacked_rows([np.zeros((10, 30, 3), np.uint8), np.zeros((10, 20, 3), np.uint8)])
    assert sheet.shape == (24, 30, 3)


@dataclass
class Stub:
    text: str = "| a |"

    def __call__(self, _footage: Any) -> ExperimentResult:
        return ExperimentResult(self.text, {"shown": np.zeros((8, 8, 3), np.uint8)}, {"score": 1.5})


def test_tables_pictures_and_scores_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stubs = {name: experiments.Experiment("walk", Stub(f"| {name} |")) for name in EXPERIMENTS}
    monkeypatch.setattr(experiments, "EXPERIMENTS", stubs)
    monkeypatch.setattr(experiments, "rendered", lambda take: ROOT / "examples" / take)
    assert experiments.main(["all", "--out", str(tmp_path / "out")]) == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "shown.jpg", *(f"{name}.{kind}" for name in stubs for kind in ("md", "json")),
    }  # fmt: skip
    assert (tmp_path / "out" / "throw.md").read_text() == "| throw |\n"
    assert "| whirl |" in capsys.readouterr().out


def test_a_page_gets_the_new_table_in_the_place_of_the_old(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# a\n\n<!-- one -->\n\nold\n\n<!-- end -->\n\nbetween\n\n<!-- two -->\n\nkept\n\n<!-- end -->\n")
    for text in ("| new |", "| newer |"):
        experiments.publish(page, "one", Stub(text)(None))
    assert page.read_text() == (
        "# a\n\n<!-- one -->\n\n| newer |\n\n<!-- end -->\n\nbetween\n\n<!-- two -->\n\nkept\n\n<!-- end -->\n"
    )
    assert (tmp_path / "page_shown.jpg").exists()
    assert all(f"<!-- {name} -->\n" in DOCUMENT for name in EXPERIMENTS)


def test_footage_that_cannot_be_rendered_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(footage_renderer, "ROOT", tmp_path)
    monkeypatch.setattr(experiments, "CACHE", tmp_path / "cache")
    assert experiments.main(["walk", "--out", str(tmp_path / "out")]) == 1
    assert "the renderer is not installed" in capsys.readouterr().err
    (tmp_path / "tools").mkdir()
    (tmp_path / "tools" / "render_footage.py").write_text("raise SystemExit('no light')")
    with pytest.raises(FootageError, match="no light"):
        experiments.rendered("crossing")


def test_a_picture_is_written_small(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 255, (200, 300, 3)).astype(np.uint8)
    write_jpeg(tmp_path / "noise.jpg", image)
    assert cv2.imread(str(tmp_path / "noise.jpg")).shape == image.shape


PARSERS = {
    "kfmocap.benchmarks.experiments": experiments.parser,
    "kfmocap.benchmarks.studies.prediction_study": prediction_study.parser,
    "tools/render_footage.py": render_footage.arguments,
}
COMMANDS = re.findall(r"^ {4}\.venv/bin/python (.+)$", DOCUMENT, re.MULTILINE)


def test_the_page_names_every_experiment() -> None:
    named = [command.split()[2] for command in COMMANDS if command.startswith("-m kfmocap.benchmarks.experiments")]
    assert set(named) == {*EXPERIMENTS, "all"}


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_of_the_page_are_understood(command: str) -> None:
    script, *arguments = shlex.split(command.removeprefix("-m "), comments=True)
    PARSERS[script]().parse_args(arguments)


def test_the_pages_pictures_are_there_and_small() -> None:
    shown = re.findall(r"!\[[^]]*\]\(([^)]+)\)", DOCUMENT)
    assert len(shown) >= 5
    assert all((ROOT / "docs" / picture).stat().st_size < 200_000 for picture in shown)
