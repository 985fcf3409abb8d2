"""The made shots of the benchmark show what their truth says, and their detector errs as it is said to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.body import Body
from kfmocap.core.formats import read_trc
from kfmocap.core.formats.keypoint_files import read_keypoints
from kfmocap.core.formats.shot_toml import read_shot_spec
from render.benchmark_movements import BOW, FRONT_KICK, LEAP
from render.benchmark_shots import PLANS, SHOTS, ShotPlan, is_current, write_description
from render.detector_errors import Errors
from render.movement_phrases import PROFILES
from render.painted_scene import Floor, PaintedView, Surface, box, lit
from render.people import Person, posed_parts, true_landmarks
from render_benchmark import main, seen_landmarks

JOINTS = [f"{side}{joint}" for joint in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle") for side in "LR"]
BOW_SHOT = PLANS["bow"]


@pytest.fixture(scope="module")
def body() -> Body:
    return BOW_SHOT.person.body()


def joints(plan: ShotPlan) -> np.ndarray:
    """True joints in the world, (F, J, 3)."""
    body = plan.person.body()
    truth = true_landmarks(body, plan.movement.motion(body, plan.seconds))
    return truth[:, [list(body.landmarks).index(name) for name in JOINTS]]


def test_the_set_is_as_varied_as_it_is_said_to_be() -> None:
    halves = [plan.half for plan in SHOTS]
    assert halves[::2] == ["deciding"] * 8 and halves[1::2] == ["reporting"] * 8
    for half in ("deciding", "reporting"):
        plans = [plan for plan in SHOTS if plan.half == half]
        fastest = [np.linalg.norm(np.diff(joints(p), axis=0), axis=-1).max() * p.fps for p in plans]
        assert min(fastest) < 4 and 8 < max(fastest) < 15, fastest
        assert min(p.fps for p in plans) <= 25 and max(p.fps for p in plans) >= 100
        assert min(len(p.cameras) for p in plans) == 1 and max(len(p.cameras) for p in plans) >= 6
        assert any(p.boxes for p in plans) and any(p.misaligned for p in plans)
        assert len({p.person.height for p in plans}) == len(plans)


@pytest.mark.parametrize("plan", SHOTS, ids=lambda plan: plan.name)
def test_the_person_is_in_every_picture_and_on_the_floor(plan: ShotPlan) -> None:
    places = joints(plan)
    for camera in plan.cameras:
        uv = camera.project(places.reshape(-1, 3))
        assert (uv >= 0).all() and (uv <= np.array(camera.size) - 1).all(), camera.name
    assert -0.02 < places[..., 2].min() < 0.15


def test_movements_rest_and_leap_in_speed() -> None:
    """A strike ends, and a flight begins and ends, within one frame at any frame rate."""
    for name, reached in (("strike", 1.0), ("swing", 1.0), ("settle", 1.0), ("flight", 0.0), ("there and back", 0.0)):
        assert PROFILES[name](np.array([0.0]))[0] == pytest.approx(0, abs=1e-12)
        assert PROFILES[name](np.array([1.0]))[0] == pytest.approx(reached, abs=1e-12)
    fps = 1000.0
    still = replace(LEAP, tremor=0.0)
    lift = np.diff(still.channel("lift.L", np.arange(0, 0.8, 1 / fps))) * fps
    assert np.abs(np.diff(lift)).max() > 1.5  # metres a second, from one millisecond to the next
    rest = replace(BOW, tremor=0.0).channel("tilt", np.linspace(0, 0.25, 10))
    assert np.ptp(rest) == 0


def test_standing_feet_stay_where_they_are(body: Body) -> None:
    t = np.linspace(0, 2, 40)
    ankles = true_landmarks(body, BOW.motion(body, t))[:, [list(body.landmarks).index(f"{s}Ankle") for s in "LR"]]
    assert np.ptp(ankles, axis=0).max() < 1e-9
    kicker = Person(1.7, PLANS["front_kick"].person.wardrobe).body()
    feet = true_landmarks(kicker, FRONT_KICK.motion(kicker, t))
    index = list(kicker.landmarks).index
    assert np.ptp(feet[:, index("LAnkle")], axis=0).max() < 1e-9 < 0.8 < np.ptp(feet[:, index("RAnkle"), 2])


def test_shoulders_move_on_the_chest_and_bones_keep_their_lengths() -> None:
    plan = PLANS["stretching"]
    body = plan.person.body()
    truth = true_landmarks(body, plan.movement.motion(body, plan.seconds))
    place = {name: truth[:, k] for k, name in enumerate(body.landmarks)}
    across = np.linalg.norm(place["LShoulder"] - place["RShoulder"], axis=1)
    assert 0.01 < np.ptp(across) < 0.08
    assert np.ptp(np.linalg.norm(place["LElbow"] - place["LShoulder"], axis=1)) < 1e-9
    assert np.ptp(np.linalg.norm(place["RKnee"] - place["RHip"], axis=1)) < 1e-9


def test_what_is_painted_is_where_the_camera_projects_it() -> None:
    """A white ball, exposed while it moves by half a metre, in front of and behind a box."""
    camera = PLANS["waving_far"].cameras[0]
    empty = np.full((*camera.size[::-1], 3), 0.2, np.float32)
    at = np.array([[0.1, -1.0, 0.9]])
    around = np.random.default_rng(0).normal(size=(300, 3))
    ball = at + 0.08 * around / np.linalg.norm(around, axis=1, keepdims=True)
    triangles = _hull(ball)
    view = PaintedView(camera, None, empty)
    surface = Surface(ball, triangles, np.full((300, 3), 5.0))
    still = view.exposed([surface], np.full((300, 3), 5.0), Floor(ball))
    rows, columns = np.nonzero(still.light[..., 0] > 2.5)
    np.testing.assert_allclose([columns.mean(), rows.mean()], camera.project(at)[0], atol=0.3)
    moved = [Surface(ball + [x, 0, 0], triangles, surface.colours) for x in (-0.25, 0.0, 0.25)]
    spread = view.exposed(moved, np.full((300, 3), 5.0), Floor(ball))
    lit_columns = np.nonzero((spread.light[..., 0] > 1.2).any(axis=0))[0]
    ends = camera.project(at + np.array([[-0.25, 0, 0], [0.25, 0, 0]]))[:, 0]
    assert lit_columns.min() == pytest.approx(ends.min(), abs=9) and lit_columns.max() == pytest.approx(
        ends.max(), abs=9
    )
    hiding = PaintedView(camera, box((-0.5, -1.6, 0.0), (0.6, -1.4, 1.3), (0.1, 0.1, 0.1)), empty)
    assert (hiding.exposed([surface], np.full((300, 3), 5.0), Floor(ball)).light < 2).all()
    own, near = np.zeros(len(triangles), int), np.ones((1, 1), bool)
    uv = camera.project(at)
    assert seen_landmarks(uv, still, own, near)[0]
    assert not seen_landmarks(uv, hiding.exposed([surface], surface.colours, Floor(ball)), own, near)[0]


def _hull(points: np.ndarray) -> np.ndarray:
    """Triangles of the convex hull, counter-clockwise seen from outside."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    a, b, c = (points[hull.simplices[:, k]] for k in range(3))
    inwards = np.einsum("na,na->n", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    triangles = hull.simplices.copy()
    triangles[inwards] = triangles[inwards][:, ::-1]
    return triangles


def test_light_is_brighter_towards_the_sun_and_dark_in_shadow() -> None:
    roof = box((-1, -1, 2), (1, 1, 2.1), (0.5, 0.5, 0.5))
    floor = box((-0.2, -0.1, 0), (0.2, 0.1, 0.1), (0.5, 0.5, 0.5))
    alone = lit(floor)
    top, bottom = (alone[floor.vertices[:, 2] == z].mean() for z in (0.1, 0.0))
    assert top > 1.5 * bottom
    assert Floor(roof.vertices).sun.max() > 0.3


@pytest.fixture(scope="module")
def written(body: Body, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shot with everything but its footage: one picture stands for all."""
    folder = tmp_path_factory.mktemp("made") / "bow"
    for camera in BOW_SHOT.cameras:
        (folder / camera.name).mkdir(parents=True)
        for f in range(BOW_SHOT.frames):
            (folder / camera.name / f"{f:04d}.jpg").touch()
    seen = np.ones((len(BOW_SHOT.cameras), BOW_SHOT.frames, len(body.landmarks)), bool)
    seen[1, :, list(body.landmarks).index("LWrist")] = False
    write_description(BOW_SHOT, body, seen, folder)
    return folder


def test_a_written_shot_is_current_until_anything_of_it_changes(
    written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert (
        is_current(BOW_SHOT, written) and not is_current(PLANS["dance"], written) and not is_current(BOW_SHOT, tmp_path)
    )
    monkeypatch.setattr("render_benchmark.pictures", lambda *_: pytest.fail("it was rendered again"))
    monkeypatch.setattr("sys.argv", ["render_benchmark.py", "bow", "--out", str(written.parent)])
    main()


def test_the_detector_errs_as_it_is_said_to(body: Body, written: Path) -> None:
    found = read_keypoints(written / "cam01_keypoints.json")
    hidden = read_keypoints(written / "cam02_keypoints.json")
    camera = BOW_SHOT.cameras[0]
    places = joints(BOW_SHOT)
    true = np.stack([camera.project(frame) for frame in places])
    error = found.points[:, [found.names.index(name) for name in JOINTS]] - true
    metres = np.linalg.norm(error, axis=-1) / camera.matrix[0, 0] * 4.0
    assert 0.012 < np.nanmedian(metres) < 0.05
    columns = [found.names.index(name) for name in JOINTS]
    gone = np.isnan(found.points[:, columns]).any(axis=-1) | (found.confidence[:, columns] == 0)
    assert 0 < gone.mean() < 0.1
    wrist = hidden.names.index("LWrist")
    lost = np.isnan(hidden.points[:, wrist]).any(axis=-1) | (hidden.confidence[:, wrist] == 0)
    assert 0.2 < lost.mean() < 0.9


def test_the_calibration_of_a_shot_may_be_out(body: Body) -> None:
    exact, out = BOW_SHOT.written_cameras(), replace(BOW_SHOT, misaligned=0.2).written_cameras()
    for camera in BOW_SHOT.cameras:
        middle = np.array([[0.0, 0.0, 1.0]])
        np.testing.assert_array_equal(exact[camera.name].project(middle), camera.project(middle))
        assert 0.2 < np.linalg.norm(out[camera.name].project(middle) - camera.project(middle)) < 8
        np.testing.assert_allclose(out[camera.name].centre_world(), camera.centre_world(), atol=1e-9)


def test_errors_are_the_same_whenever_they_are_drawn(body: Body) -> None:
    motion = BOW_SHOT.movement.motion(body, BOW_SHOT.seconds)
    seen = np.ones((2, BOW_SHOT.frames, len(body.landmarks)), bool)
    draws = [Errors(3, 25.0).detected(body, *posed_parts(body, motion), BOW_SHOT.cameras, seen) for _ in range(2)]
    assert draws[0] == draws[1]


def test_the_written_shot_is_read_with_its_key_frames(written: Path) -> None:
    spec = read_shot_spec(written / "shot_keypoints.toml")
    assert list(spec.performers[0].keyframes) == list(BOW_SHOT.keys)
    assert spec.frames == (0, BOW_SHOT.frames - 1) and len(spec.views) == 2
    truth = read_trc(written / "landmarks.trc")
    np.testing.assert_allclose(
        truth.points_world[:, [truth.names.index(n) for n in JOINTS]], joints(BOW_SHOT), atol=1e-5
    )
