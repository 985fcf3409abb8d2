"""Shots with keypoints: whose they are, performers made of them, and the tracker that uses them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from keypoint_shots import NAMES, SIZE, cameras, joint_errors, keypoints_of, seen_places, strolling, write_openpose
from kfmocap.core.body import Body, Part, human, landmark_positions, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.errors import KFMocapError
from kfmocap.core.fitting.shot_cameras import fit_by_keypoints
from kfmocap.core.formats import save_cameras, write_trc
from kfmocap.core.formats.keypoint_files import read_shot_keypoints
from kfmocap.core.keypoints.association.assignment import PerformerClues, assign_detections
from kfmocap.core.keypoints.association.tracks import ViewDetections, detection_tracks
from kfmocap.core.keypoints.keypoint_rays import Keypoints
from kfmocap.core.keypoints.observations import fit_keypoints, image_rays, performer_keypoints
from kfmocap.core.review.report_text import report_lines
from kfmocap.core.review.track_report import report
from kfmocap.core.shot.fixed_degrees import fixed_degrees
from kfmocap.core.shot.keypose_spline import spline
from kfmocap.core.shot.performer_request import PerformerRequest
from kfmocap.core.shot.segments import segments
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot, View
from kfmocap.core.tracking.prepare import load_shot, pose_by_keypoint_files
from kfmocap.core.tracking.selection import selected
from kfmocap.core.tracking.shot_scale import ShotScale
from kfmocap.core.tracking.tracker import track
from synthetic import at_rest

FRAMES, FPS = 24, 30.0
HALF = (SIZE[0] // 2, SIZE[1] // 2)


def people(count: int) -> list[Motion]:
    """Of one body: beside each other, walking out of step."""
    return [strolling(human(), FRAMES, (0.9 * i, 0.2 * i, 0), phase=1.3 * i) for i in range(count)]


def shot_with(folder: Path, motions: list[Motion], keys: list[int], views: int = 3, noise: float = 1.0) -> Shot:
    """A shot of which there are keypoint files, but no footage; people are listed in another order in every view."""
    body, slots = human(), []
    points = [seen_places(body, motion) for motion in motions]
    for v, camera in enumerate(cameras(views)):
        order = points[v % len(points) :] + points[: v % len(points)]
        write_openpose(folder / camera.name, camera, order, noise)
        slots.append(View(camera, folder / "none.mp4", keypoints=folder / camera.name))
    performers = [
        Performer(f"person {i}", body, KeyPoses.whole(keys, m[keys]))
        if keys
        else PerformerRequest(f"person {i}").placeholder()
        for i, m in enumerate(motions)
    ]
    return Shot("keypoints", FPS, (0, FRAMES - 1), tuple(slots), tuple(performers))


def with_keypoints_in(shot: Shot, count: int) -> Shot:
    """The shot with the keypoints of its first views alone."""
    views = tuple(view if v < count else replace(view, keypoints=None) for v, view in enumerate(shot.views))
    return replace(shot, views=views)


def own_keypoints(shot: Shot) -> list[Keypoints]:
    return performer_keypoints(shot, read_shot_keypoints(shot))


def test_rays_go_through_the_points_that_a_lens_shows() -> None:
    camera = replace(cameras(1)[0], distortions=np.array([-0.2, 0.05, 0.001, -0.002]))
    points = np.random.default_rng(0).uniform(-0.7, 0.7, (20, 3)) + [0, 0, 1]
    rays = image_rays(camera, camera.project(points))
    R, t = camera.pose(0)
    x = points @ R.T + t
    np.testing.assert_allclose(rays, x[:, :2] / x[:, 2:], atol=1e-6)
    assert np.isnan(image_rays(camera, np.full((1, 2), np.nan))).all()


@pytest.mark.parametrize("keys", [[0], []])
def test_people_are_distinguished_in_every_view(tmp_path: Path, keys: list[int]) -> None:
    """With a key pose each, whose keypoints are whose is known; without, everybody's are together at least."""
    motions = people(2)
    found = own_keypoints(shot_with(tmp_path, motions, keys))
    errors = np.zeros((2, 2))
    for i, keypoints in enumerate(found):
        assert (keypoints.confidence > 0).all()
        for j, motion in enumerate(motions):
            errors[i, j] = np.nanmax(np.linalg.norm(keypoints.residuals(seen_places(human(), motion)), axis=-1))
    matches = errors < 0.1
    assert (matches.sum(axis=0) == 1).all() and (matches.sum(axis=1) == 1).all()
    if keys:
        assert matches.trace() == 2


def test_a_bystander_is_nobody(tmp_path: Path) -> None:
    motions = people(2)
    shot = shot_with(tmp_path, motions, [0])
    (keypoints,) = own_keypoints(replace(shot, performers=shot.performers[1:]))
    assert np.nanmax(np.linalg.norm(keypoints.residuals(seen_places(human(), motions[1])), axis=-1)) < 0.1


def test_tracks_go_on_over_gaps_and_crossings() -> None:
    """Two people cross in one view; one is not found for some frames."""
    body = human()
    motions = people(2)
    rays = np.stack([keypoints_of(cameras(1), seen_places(body, m)).rays[0] for m in motions], axis=1)
    present = np.ones((FRAMES, 2), bool)
    present[10:14, 1] = False
    frames, person = np.nonzero(present)
    found = ViewDetections(frames, rays[frames, person], np.ones((len(frames), len(NAMES))), np.full(len(frames), -1))
    tracks = detection_tracks(NAMES, found, 0, FPS)
    assert sorted(len(track.frames) for track in tracks) == [FRAMES - 4, FRAMES]
    assert all(len(set(person[track.rows])) == 1 for track in tracks)


def test_a_detectors_own_numbers_hold_people_apart() -> None:
    body = human()
    rays = keypoints_of(cameras(1), seen_places(body, people(1)[0])).rays[0]
    numbers = np.where(np.arange(FRAMES) < 12, 3, 8)
    found = ViewDetections(np.arange(FRAMES), rays, np.ones((FRAMES, len(NAMES))), numbers)
    assert [len(track.frames) for track in detection_tracks(NAMES, found, 0, FPS)] == [12, 12]


def test_a_view_without_people_gives_nothing() -> None:
    empty = keypoints_of(cameras(1), seen_places(human(), people(1)[0]))
    empty = replace(empty, rays=np.full_like(empty.rays, np.nan), confidence=np.zeros_like(empty.confidence))
    nobody = ViewDetections(np.zeros(0, int), np.zeros((0, len(NAMES), 2)), np.zeros((0, len(NAMES))), np.zeros(0, int))
    for count in (1, 2):
        found, _ = assign_detections([nobody], empty, [PerformerClues("man")] * count, FPS)
        assert len(found) == count and not any(k.confidence.any() for k in found)


def test_first_passes_of_two_people_are_their_motions(tmp_path: Path) -> None:
    motions = people(2)
    shot = shot_with(tmp_path, motions, [0, FRAMES - 1])
    fixed = [fixed_degrees(performer, 0, FRAMES - 1) for performer in shot.performers]
    for sighting, motion in zip(fit_keypoints(shot, read_shot_keypoints(shot), fixed).performers, motions, strict=True):
        assert joint_errors(human(), sighting.motion, human(), motion).mean() < 0.02
        assert sighting.weights.mean() > 0.7 and not sighting.changed.any()


def test_keypoints_between_two_frames_are_on_the_line_between(tmp_path: Path) -> None:
    """A view that is taken a quarter of a frame later than the others still shows the same motion."""
    motion = people(1)[0]
    shot = shot_with(tmp_path, [motion], [0], views=1, noise=0.0)
    (here,) = own_keypoints(shot)
    late = replace(shot.views[0], offset=0.25)  # shot frame f is footage frame f + 0.25
    (between,) = own_keypoints(replace(shot, views=(late,)))
    expected = 0.75 * here.rays[0, :-1] + 0.25 * here.rays[0, 1:]
    np.testing.assert_allclose(between.rays[0, :-1], expected, atol=1e-9)
    assert not between.confidence[0, -1].any()


TEXT = """
[shot]
name = "stroll"
fps = 30.0
frames = [0, 23]

[calibration]
file = "calibration.toml"
{views}
[[performer]]
name = "man"
{keys}
"""


def written(folder: Path, keys: str, count: int = 2) -> Path:
    """A shot file of a stroll with grey footage of two cameras and their keypoints."""
    half = np.diag([0.5, 0.5, 1.0])
    used = [replace(camera, size=HALF, matrix=half @ camera.matrix) for camera in cameras(count)]
    save_cameras(folder / "calibration.toml", used)
    points = seen_places(human(), people(1)[0])
    views = ""
    for camera in used:
        write_openpose(folder / "pose" / camera.name, camera, [points], 0.5)
        for f in range(FRAMES):
            cv2.imwrite(str(folder / f"{camera.name}_{f:04d}.png"), np.full(HALF[::-1], 90, np.uint8))
        name = camera.name
        views += f'[[view]]\ncamera = "{name}"\nfootage = "{name}_%04d.png"\nkeypoints = "pose/{name}"\n\n'
    path = folder / "shot.toml"
    path.write_text(TEXT.format(views=views, keys=keys))
    return path


def test_key_poses_are_proposed_from_keypoints_alone(tmp_path: Path) -> None:
    """Body and poses are those of the person; what is proposed holds nothing. Landmarks are not even looked at.

    The argument "auto" overrides the file, which asks for the same in the test of the report.
    """
    path = written(tmp_path, 'keyframes = [0, 23]\nlandmarks = "there is no such file.trc"')
    shot = load_shot(path, keyframes="auto")
    (performer,) = shot.performers
    keys = performer.key_poses
    assert len(keys.frames) and not keys.fixed.any()
    assert keys.proposals().tolist() == keys.frames.tolist() and not len(keys.full())
    truth = people(1)[0]
    assert joint_errors(performer.body, keys.poses, human(), truth[keys.frames]).mean() < 0.03
    assert segments(shot) == [(0, FRAMES - 1)]


def test_listed_frames_are_posed_by_keypoints_where_there_are_no_landmarks(tmp_path: Path) -> None:
    (performer,) = load_shot(written(tmp_path, "keyframes = [3, 20]\nheight = 1.75")).performers
    assert performer.key_poses.proposals().tolist() == [3, 20]
    truth = people(1)[0][[3, 20]]
    assert joint_errors(performer.body, performer.key_poses.poses, human(), truth).mean() < 0.03


def test_one_view_proposes_what_is_likeliest_and_says_so(tmp_path: Path) -> None:
    shot = load_shot(written(tmp_path, 'keyframes = "auto"\nheight = 1.75'), views=["cam01"])
    (performer,) = shot.performers
    assert len(performer.key_poses.frames) and not performer.key_poses.fixed.any()
    result = track(shot)
    assert joint_errors(performer.body, result.motions[0], human(), people(1)[0]).mean() < 0.2
    values = report(shot, result)
    assert values["performers"][0]["lifted"]
    assert min(values["performers"][0]["expected_error"]) > 100  # mm
    assert any(line.startswith("man: only one camera shows it") for line in report_lines(values))


def test_fewer_people_than_performers_are_named(tmp_path: Path) -> None:
    path = written(tmp_path, 'keyframes = "auto"\n[[performer]]\nname = "ghost"\nkeyframes = "auto"')
    with pytest.raises(KFMocapError, match="performer 'ghost': no keypoints are left"):
        load_shot(path)


def test_broken_files_are_refused_unless_the_shot_says_otherwise(tmp_path: Path) -> None:
    """They are skipped in the test of the report."""
    path = written(tmp_path, 'keyframes = "auto"')
    (tmp_path / "pose" / "cam02" / "cam02_000007.json").write_text("{")
    with pytest.raises(KFMocapError, match=r"camera 'cam02': .*cam02_000007\.json: is not a JSON file"):
        load_shot(path)


def test_the_tracker_follows_keypoints_where_pictures_say_nothing(tmp_path: Path) -> None:
    """Grey footage: with keypoints the motion between two key poses is the true one; key poses stay to the bit. The
    first pass from keypoints is a good part of the progress."""
    path = written(tmp_path, "keyframes = [0, 23]\nlandmarks = 'landmarks.trc'")
    body, truth = human(), people(1)[0]
    names = list(body.landmarks)
    write_trc(tmp_path / "landmarks.trc", names, landmark_positions(body, truth, names), FPS)
    shot = load_shot(path)
    told: list[tuple[str, float]] = []
    result = track(shot, lambda *given: told.append(given) is None)
    performer = shot.performers[0]
    assert joint_errors(performer.body, result.motions[0], body, truth).mean() < 0.02
    assert (result.motions[0].rotations[[0, 23]] == performer.key_poses.poses.rotations).all()
    curve = spline(performer.key_poses, FRAMES)
    assert joint_errors(performer.body, curve, body, truth).mean() > 0.05
    fractions = [fraction for _, fraction in told]
    assert [what for what, _ in told[:2]] == ["keypoints", "tracking"] and fractions[1] > 0.2
    assert fractions == sorted(fractions) and fractions[-1] == 1


def test_a_prop_beside_a_person_with_keypoints_is_tracked_without(tmp_path: Path) -> None:
    path = written(tmp_path, "keyframes = [0, 23]\nlandmarks = 'landmarks.trc'")
    body, truth = human(), people(1)[0]
    names = list(body.landmarks)
    write_trc(tmp_path / "landmarks.trc", names, landmark_positions(body, truth, names), FPS)
    alone = load_shot(path)
    solid = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (0.0, 0.3) for z in (-0.1, 0.1)])
    part = Part("stick", -1, np.zeros(3), np.array([0.0, 0.3, 0.0]), np.eye(3), solid)
    prop = Performer("stick", Body((part,), {}), KeyPoses.whole([0, 23], at_rest(Body((part,), {}), 2)))
    shot = replace(alone, performers=(prop, *alone.performers))
    result = track(shot)
    nothing, own = result.observed.performers
    assert not nothing.factor.keypoints.names
    assert len(own.factor.keypoints.names) > 10
    assert joint_errors(alone.performers[0].body, result.motions[1], body, truth).mean() < 0.02
    assert np.linalg.norm(result.motions[0].translations, axis=1).max() < 0.05
    found = report(shot, result, ())["performers"]
    assert found[0]["identity"]["person"] is None
    assert not found[0]["keypoints"]["cam01"]["frames"]
    together = fit_by_keypoints(shot, [nothing.factor.keypoints, own.factor.keypoints])
    assert [fit.shift for fit in together] == [fit.shift for fit in fit_by_keypoints(alone, [own.factor.keypoints])]
    only = track(replace(alone, performers=(prop,)))
    assert not fit_by_keypoints(alone, [only.observed.performers[0].factor.keypoints])


def test_keypoints_of_a_small_shot_are_in_its_lengths(tmp_path: Path) -> None:
    path = written(tmp_path, "keyframes = [0, 23]\nlandmarks = 'landmarks.trc'")
    body, truth = human(), people(1)[0]
    names = list(body.landmarks)
    write_trc(tmp_path / "landmarks.trc", names, landmark_positions(body, truth, names), FPS)
    shot = ShotScale(0.1).shot(load_shot(path))
    [own] = track(shot).observed.performers
    found = own.factor
    np.testing.assert_allclose(found.keypoints.t_cam_world[:, 0], [v.camera.t_cam_world[0] for v in shot.views])
    off = found.keypoints.residuals(found.places.world(part_poses(shot.performers[0].body, own.motion)))
    assert np.nanmedian(np.abs(off)) < 0.001
    assert found.sigma is not None
    assert found.sigma.max() < 0.003
    np.testing.assert_allclose(own.motion.translations, 0.1 * truth.translations, atol=0.005)


@pytest.mark.parametrize("keys", [(), (0, 23)])
@pytest.mark.parametrize("views", [1, 3])
def test_a_body_of_any_size_is_posed_alike_by_keypoints(tmp_path: Path, views: int, keys: tuple[int, ...]) -> None:
    """Somebody may pose a rig of any size, even one with bones of a kilometre."""
    shot = shot_with(tmp_path, people(1), [0, 23])
    performer = replace(shot.performers[0], key_poses=KeyPoses.whole(keys, people(1)[0][list(keys)]))
    shot = replace(shot, views=shot.views[:views], performers=(performer,))
    large = ShotScale(3000.0).shot(shot)
    [usual], [found] = pose_by_keypoint_files(shot), pose_by_keypoint_files(large)
    assert found.frames.tolist() == usual.frames.tolist()
    assert np.abs(found.motion.translations / 3000 - usual.motion.translations).max() < 0.1
    held = found.motion.translations[list(keys)]
    np.testing.assert_array_equal(held, large.performers[0].key_poses.poses.translations)


def test_keypoints_of_two_views_show_accelerations_that_two_key_poses_do_not(tmp_path: Path) -> None:
    """Pixels count there as they do between many key poses, and accelerations are estimated joint by joint."""
    shot = shot_with(tmp_path, people(1), [0, 23])
    performer, keys = shot.performers[0], np.array([0, 8, 16, 23])
    keyed = replace(performer, key_poses=KeyPoses.whole(keys, people(1)[0][keys]))
    many = replace(shot, performers=(keyed,))
    known = with_keypoints_in(many, 0).with_settings_filled().settings
    assert known.estimate_smoothness
    assert shot.with_settings_filled().settings == known
    for unknown in (with_keypoints_in(shot, 1), with_keypoints_in(shot, 0), replace(shot, views=shot.views[:1])):
        filled = unknown.with_settings_filled().settings
        assert not filled.estimate_smoothness
        assert filled.lengths == Settings().lengths > known.lengths


def test_a_refinement_between_two_key_poses_counts_pixels_of_several_views_as_between_many(tmp_path: Path) -> None:
    """With one view or a single key pose it counts them as before; lengths that are given are kept."""
    two = with_keypoints_in(shot_with(tmp_path, people(1), [0, 23]), 0)
    performer, truth = two.performers[0], people(1)[0]

    def keyed(shot: Shot, *keys: int) -> Shot:
        posed = replace(performer, key_poses=KeyPoses.whole(np.array(keys), truth[list(keys)]))
        return replace(shot, performers=(posed,)).with_settings_filled()

    many, between, one_view = keyed(two, 0, 8, 16, 23), keyed(two, 0, 23), replace(two, views=two.views[:1])
    assert between.settings.lengths == Settings().lengths
    assert between.for_refinement().settings.lengths == many.for_refinement().settings.lengths == many.settings.lengths
    for others in (keyed(two, 0), keyed(one_view, 0, 23), keyed(one_view, 0, 8, 16, 23)):
        assert others.for_refinement().settings == others.settings
    given = keyed(replace(two, settings=Settings(correlation_length=0.3)), 0, 23)
    assert given.for_refinement().settings.lengths == (0.3, many.settings.lengths[1])


def test_a_wanted_performer_has_no_pose_yet() -> None:
    performer = PerformerRequest("man", 1.6).placeholder()
    assert not len(performer.key_poses.frames) and len(performer.body) == len(human())
    assert at_rest(performer.body).translations[0, 2] < at_rest(human(1.75)).translations[0, 2]


def test_long_stretches_are_cut_on_proposals_and_never_between_key_poses() -> None:
    body = human()
    poses = at_rest(body, 40)
    frames = np.arange(0, 400, 10)
    view = View(cameras(1)[0], Path("none.mp4"))

    def shot(keys: KeyPoses) -> Shot:
        return Shot("long", FPS, (0, 399), (view,), (Performer("man", body, keys),))

    assert segments(shot(KeyPoses.proposed(frames, poses))) == [(0, 150), (150, 300), (300, 399)]
    assert segments(shot(KeyPoses.whole([0, 399], poses[[0, 1]]))) == [(0, 399)]


def test_the_report_describes_how_keypoints_were_used(tmp_path: Path) -> None:
    """Of views in the shot's order, whatever their names; proposals and files left out are named."""
    path = written(tmp_path, 'keyframes = "auto"\n[track]\nbroken_keypoints = "skip"')
    (tmp_path / "pose" / "cam02" / "cam02_000007.json").write_text("{")
    shot = load_shot(path)
    shot = replace(shot, views=shot.views[::-1])
    values = report(shot, track(shot))
    (performer,) = values["performers"]
    assert performer["proposed_keyframes"] == performer["keyframes"] != []
    assert {name: view["frames"] for name, view in performer["keypoints"].items()} == {"cam01": 24, "cam02": 23}
    assert all(view["agreement"] > 0.7 and not view["sides_changed"] for view in performer["keypoints"].values())
    (skipped,) = values["views"][0]["skipped"]
    assert "cam02_000007.json" in skipped and not values["views"][1]["skipped"]
    assert any("left out" in line and "cam02_000007.json" in line for line in report_lines(values))


def test_proposals_beside_the_animators_key_poses_leave_these_as_they_are(tmp_path: Path) -> None:
    motion = strolling(human(), 60)
    shot = replace(shot_with(tmp_path, [motion], [0, 30], views=2), frames=(0, 59))
    keys = selected(shot, keyframes="auto").performers[0].key_poses
    assert keys.full().tolist() == [0, 30]
    assert (keys.poses[[0, int(np.flatnonzero(keys.frames == 30)[0])]].rotations == motion[[0, 30]].rotations).all()
    proposed = keys.proposals()
    assert len(proposed) and all(abs(proposed - key).min() > 8 for key in (0, 30))
    places = [int(np.flatnonzero(keys.frames == f)[0]) for f in proposed]
    assert joint_errors(human(), keys.poses[places], human(), motion[proposed]).mean() < 0.03


def test_nothing_is_proposed_without_keypoints(tmp_path: Path) -> None:
    shot = shot_with(tmp_path, people(1), [0])
    with pytest.raises(KFMocapError, match="--keyframes: no view has keypoints"):
        selected(replace(shot, views=tuple(replace(v, keypoints=None) for v in shot.views)), keyframes="auto")
