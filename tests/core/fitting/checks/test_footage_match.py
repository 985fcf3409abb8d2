"""Footage that is not the key poses' is named, and that of dim or changing light is not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.evidence.movement_match import movement_match
from kfmocap.core.fitting.checks.footage_match import better_shift, footage_matches
from kfmocap.core.fitting.checks.misfit_causes import attributed_findings
from kfmocap.core.fitting.checks.posed_views import PosedView, posed_views
from kfmocap.core.fitting.checks.view_findings import CameraFit, FootageMatch
from kfmocap.core.fitting.key_frame_views import KeyFrameView, pictured_key_frames, read_key_frames
from kfmocap.core.fitting.shot_cameras import checked_frames, fit_by_key_poses
from kfmocap.core.shot.footage import frames_at
from kfmocap.core.shot.shot import Shot, View
from synthetic import figure, film, look_at, shot_of, swing

BODY = figure()
TRUTH = swing(BODY, 16, size=0.9)[::4]
FRONT, SIDE = look_at("front", (0.5, -2.8, 1.5)), look_at("side", (-2.4, -1.4, 1.3))
FRAMES = np.arange(len(TRUTH))


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Shot:
    views = film(tmp_path_factory.mktemp("film"), [BODY], [TRUTH], [FRONT, SIDE])
    return shot_of(views, [BODY], [TRUTH], range(len(TRUTH)))


@pytest.fixture(scope="module")
def pictured(shot: Shot) -> list[KeyFrameView]:
    return read_key_frames(shot, FRAMES, None)


def swapped(shot: Shot) -> Shot:
    a, b = shot.views
    return replace(shot, views=(replace(a, footage=b.footage), replace(b, footage=a.footage)))


def lit(view: KeyFrameView, gains: Sequence[float], noise: float) -> KeyFrameView:
    rng = np.random.default_rng(1)
    bright = np.array(gains)[:, None, None, None] * view.pictures + rng.normal(0, noise, view.pictures.shape)
    return replace(view, pictures=np.clip(bright, 0, 255).astype(np.uint8))


def test_the_right_footage_matches_its_key_poses_in_any_light(shot: Shot, pictured: list[KeyFrameView]) -> None:
    for gains, noise in (((1, 1, 1, 1), 0.0), ((0.5, 0.7, 0.9, 1.1), 2.0), ((0.2, 0.2, 0.2, 0.2), 3.0)):
        matches = footage_matches(posed_views(shot, [lit(view, gains, noise) for view in pictured], FRAMES))
        assert [(own.camera, own.off) for own in matches] == [("front", False), ("side", False)]
        assert min(own.match for own in matches) > 0.93


def test_the_footage_of_another_camera_is_named_and_the_camera_is_not_blamed(shot: Shot) -> None:
    assert all(isinstance(fit, CameraFit) for fit in fit_by_key_poses(shot))
    fits = fit_by_key_poses(swapped(shot))
    assert {fit.camera: fit.shows for fit in fits if isinstance(fit, FootageMatch)} == {
        "front": "side",
        "side": "front",
    }
    assert "front: its footage seems to be that of side" in fits[0].summary and len(fits) == 2
    unknown = FootageMatch("front", 0.84).summary
    assert "check that this is the footage of front, that its offset is right" in unknown


def test_footage_that_is_mirrored_is_named_and_its_camera_is_not_blamed(
    shot: Shot, pictured: list[KeyFrameView]
) -> None:
    front, side = pictured
    flipped = replace(side, pictures=np.ascontiguousarray(side.pictures[:, :, ::-1]))
    posed = posed_views(shot, [front, flipped], FRAMES)
    matches = footage_matches(posed)
    assert [own.mirrored is not None for own in matches] == [False, True]
    off = CameraFit(9.0, 1.0, 5.0, "side", "key poses")
    [said] = attributed_findings(shot.views, posed, matches, [off])
    assert said.camera == "side" and said.off and "mirrored" in said.brief
    assert "side: its pictures seem to be mirrored" in said.summary and "hflip" in said.summary


def test_a_match_that_cannot_reach_the_least_is_said_to_be_at_most_so_much(
    shot: Shot, pictured: list[KeyFrameView]
) -> None:
    view = posed_views(shot, pictured, FRAMES)[1]

    def match(pictures: np.ndarray, least: float) -> float:
        found = movement_match(pictures, view.camera, view.geometry, view.poses, least=least)
        assert found is not None
        return found

    other = np.roll(view.pictures, 1, axis=0)
    assert match(other, 0.0) < match(other, 0.99) < 0.99
    assert match(other, match(other, 0.0)) == match(other, 0.0)
    assert match(view.pictures, 0.9) == match(view.pictures, 0.0) > 0.9


@pytest.mark.parametrize("every", [1, 2])
def test_an_offset_that_is_wrong_by_some_frames_is_found(tmp_path: Path, every: int) -> None:
    truth, keys = swing(BODY, 40, size=0.9), np.array([6, 12, 18, 24])
    [right] = film(tmp_path, [BODY], [truth], [SIDE])
    shot = shot_of([right], [BODY], [truth[:32:every]], (keys // every).tolist())
    right = replace(right, every=every)

    def posed(view: View) -> PosedView:
        own, frames = replace(shot, views=(view,)), keys // every
        pictures = [dict(zip(frames.tolist(), frames_at(view, frames.tolist(), 1.0, grey=False), strict=True))]
        return posed_views(own, pictured_key_frames(own, frames, pictures), frames)[0]

    assert better_shift(right, posed(right)) is None
    for wrong in (-6.0, 8.0):
        late = replace(right, offset=wrong)
        shift = better_shift(late, posed(late))
        assert shift is not None
        offset = wrong + every * shift
        assert offset == pytest.approx(0.0, abs=2.0)
        assert better_shift(late, posed(late), least_lack=0.9) is None
        off = CameraFit(9.0, 1.0, 5.0, "side", "key poses")
        found, *others = attributed_findings([late], [posed(late)], [FootageMatch("side", 0.95)], [off])
        assert isinstance(found, FootageMatch) and found.off and others == [off]  # a camera that was turned may be it
        assert f"side: its pictures fit the key poses better with an offset of about {offset:g}" in found.summary


@pytest.mark.parametrize(("found", "kept"), [((21, 19), True), ((21, -8), False), ((21, None), False)])
def test_offsets_of_all_views_are_named_only_if_they_agree(
    shot: Shot,
    pictured: list[KeyFrameView],
    monkeypatch: pytest.MonkeyPatch,
    found: tuple[int | None, ...],
    kept: bool,
) -> None:
    """A body that was moved is nowhere where the footage shows it: in each view, some other offset fits better.

    Views agree by how many frames theirs are late, whatever the offsets that they already have.
    """
    shifts = dict(zip(("front", "side"), found, strict=True))
    monkeypatch.setattr(
        "kfmocap.core.fitting.checks.misfit_causes.better_shift",
        lambda view, _posed, *, least_lack: shifts[view.camera.name],
    )
    front, side = shot.views
    matches = [FootageMatch(name, 0.6) for name in shifts]
    said = attributed_findings([front, replace(side, offset=12.0)], posed_views(shot, pictured, FRAMES), matches, [])
    assert [own.off for own in said] == [True, True]
    assert [own.offset for own in said if isinstance(own, FootageMatch)] == ([21.0, 31.0] if kept else [None, None])


@pytest.mark.parametrize(("match_of_front", "least"), [(0.999, 0.001), (0.6, 0.0)])
def test_no_offset_is_expected_to_match_better_than_another_view_that_matches_well(
    shot: Shot,
    pictured: list[KeyFrameView],
    monkeypatch: pytest.MonkeyPatch,
    match_of_front: float,
    least: float,
) -> None:
    asked: dict[str, float] = {}

    def recorded(view: View, _posed: PosedView, *, least_lack: float) -> None:
        asked[view.camera.name] = least_lack

    monkeypatch.setattr("kfmocap.core.fitting.checks.misfit_causes.better_shift", recorded)
    matches = [FootageMatch("front", match_of_front), FootageMatch("side", 0.9)]
    attributed_findings(shot.views, posed_views(shot, pictured, FRAMES), matches, [])
    assert asked["side"] == pytest.approx(least)


def test_cameras_that_move_and_poses_that_hardly_differ_are_not_judged(
    shot: Shot, pictured: list[KeyFrameView]
) -> None:
    turning = replace(
        FRONT,
        R_cam_world=np.repeat(FRONT.R_cam_world, len(TRUTH), axis=0),
        t_cam_world=FRONT.t_cam_world + 0.01 * FRAMES[:, None],
    )
    moving = replace(shot, views=(View(turning, shot.views[0].footage), shot.views[1]))
    assert [own.camera for own in footage_matches(posed_views(moving, pictured, FRAMES))] == ["side"]
    single = [replace(v, pictures=v.pictures[:1], frames=FRAMES[:1]) for v in pictured]
    assert footage_matches(posed_views(shot, single, FRAMES[:1])) == []


def test_key_frames_are_those_that_are_checked(shot: Shot) -> None:
    assert checked_frames(shot) == FRAMES.tolist()
