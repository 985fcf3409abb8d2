"""Colours of parts: learned on frames where the parts are known, and what they say of limbs in front of the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import Body, human, landmark_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.evidence.foreground_images.foreground import MAX_LOG_RATIO
from kfmocap.core.evidence.foreground_images.part_colours import ColouredFrames, PartColours
from kfmocap.core.evidence.frame_comparison import SegmentInViews
from kfmocap.core.evidence.outline_evidence.outline_lines import Lines, LineSearch, outline_lines
from kfmocap.core.evidence.rendering.label_images import render_labels
from kfmocap.core.evidence.rendering.part_geometry import Geometry, PerformerParts
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.evidence.segment_evidence import accumulate_evidence
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.footage_reading.appearance import parts_apart
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from kfmocap.core.tracking.solvers.limb_corrections.limb_search import found_limbs
from kfmocap.core.tracking.solvers.limb_corrections.regained_limbs import refuted_limbs
from kfmocap.core.tracking.solvers.limb_evidence.limb_model import LimbOfPerformer
from kfmocap.core.tracking.solvers.limb_evidence.limb_support import support_of_limbs
from synthetic import at_rest, ends_held, figure, look_at, part, poses_of, silhouette

Array = np.ndarray
FIGURE = figure()
BODY = Body(
    (
        FIGURE.parts[0],
        part("upper_arm.L", 0, (0.27, 0, 1.35), (0.3, -0.32, 1.2), 0.05, 0.05),
        part("forearm.L", 1, (0.3, -0.32, 1.2), (-0.1, -0.36, 1.1), 0.05, 0.05),
        part("lid", 0, (0, 0, 1.5), (0, 0, 1.6), 0.1, 0.1),
    ),
    {},
)
"""A trunk, an arm of two parts that lies across it in front, and a lid; trunk and forearm may be told apart."""
FOREARM = BODY.index("forearm.L")
CAMERA = look_at("front", (0.1, -2.6, 1.3))
COLOURS = np.array([[60, 60, 60], [60, 60, 60], [70, 100, 190], [60, 60, 60]], np.uint8)
"""Of the parts: the forearm is bare."""
STRIDE, REACH = 1, 10


def painted(
    body: Body, motion: Motion, colours: Array, shift: tuple[int, int] = (0, 0), camera: Camera = CAMERA
) -> Array:
    """Pictures (F, h, w, 3) of parts of one colour each, moved by whole pixels, before a blue wall."""
    labels = render_labels(Geometry.of([body]), camera, 0, *poses_of([body], [motion])).part
    return np.roll(np.concatenate([colours, [[200, 80, 40]]]).astype(np.uint8)[labels], shift[::-1], axis=(1, 2))


def learned(body: Body, motion: Motion, pictures: Array) -> PartColours:
    labels = render_labels(Geometry.of([body]), CAMERA, 0, *poses_of([body], [motion])).part
    found = PartColours.learned(
        pictures, dict(enumerate(labels)), np.zeros(len(body), np.int64), parts_apart([body]), 60.0
    )
    assert found is not None
    return found


def of_frames(colours: PartColours, pictures: Array) -> ColouredFrames:
    return ColouredFrames(colours, np.stack(list(colours.images(pictures))))


MOTION = at_rest(BODY)
KEY = painted(BODY, MOTION, COLOURS)
KNOWN = learned(BODY, MOTION, KEY)


def lines_within(shift: tuple[int, int] = (0, 0), colours: Array = COLOURS) -> Lines:
    """Lines where the body is not told from the background."""
    labels = render_labels(Geometry.of([BODY]), CAMERA, 0, *poses_of([BODY], [MOTION]))
    known = learned(BODY, MOTION, painted(BODY, MOTION, colours))
    coloured = of_frames(known, painted(BODY, MOTION, colours, shift))
    nothing = np.full((1, 1, *CAMERA.size[::-1]), 128, np.uint8)
    search = LineSearch(STRIDE, REACH, tolerance=4.0)
    lines = outline_lines(CAMERA, nothing, labels, search, halo=0.25, coloured=coloured)
    return lines.where(lines.weight > 1e-3)


def test_colours_are_likely_on_the_parts_that_have_them() -> None:
    bare, dressed = (KNOWN.nearest[int(np.array([16 * 16, 16, 1]) @ (COLOURS[p] // 16))] for p in (FOREARM, 0))
    assert KNOWN.ratio[FOREARM, bare] > 1 > 0 > -1 > KNOWN.ratio[FOREARM, dressed]
    assert KNOWN.ratio[0, dressed] > 0 > -1 > KNOWN.ratio[0, bare]
    assert np.abs(KNOWN.ratio).max() <= MAX_LOG_RATIO


def test_parts_that_no_frame_shows_have_no_colours_of_their_own() -> None:
    labels = render_labels(Geometry.of([BODY]), CAMERA, 0, *poses_of([BODY], [MOTION])).part
    whose, apart = np.zeros(len(BODY), np.int64), parts_apart([BODY])
    without = PartColours.learned(KEY, {0: np.where(labels[0] == FOREARM, -1, labels[0])}, whose, apart, 60.0)
    assert without is not None and not without.ratio[FOREARM].any()
    assert PartColours.learned(KEY, {0: np.full_like(labels[0], -1)}, whose, apart, 60.0) is None


def test_the_nearer_the_camera_the_more_pixels_it_takes_to_know_colours_of_a_part() -> None:
    """Those that the performer usually wears count as much as a patch of one size on the part."""
    labels = render_labels(Geometry.of([BODY]), CAMERA, 0, *poses_of([BODY], [MOTION])).part
    whose, apart = np.zeros(len(BODY), np.int64), parts_apart([BODY])
    far, near, nearest = (
        PartColours.learned(KEY, dict(enumerate(labels)), whose, apart, scale) for scale in (60.0, 600.0, 6000.0)
    )
    size = [float(np.abs(found.ratio[FOREARM]).max()) for found in (far, near, nearest)]
    assert size[0] > 2 * size[1] > 4 * size[2] > 0


def test_every_pixel_has_the_colour_of_the_palette_that_is_nearest() -> None:
    other = painted(BODY, MOTION, COLOURS + np.array([0, 0, 17], np.uint8))
    [exact], [near] = (KNOWN.images(pictures) for pictures in (KEY, other))
    labels = render_labels(Geometry.of([BODY]), CAMERA, 0, *poses_of([BODY], [MOTION])).part[0]
    np.testing.assert_array_equal(near[labels >= 0], exact[labels >= 0])


def test_parts_that_are_joined_are_not_separated() -> None:
    apart = parts_apart([BODY, FIGURE])
    assert apart[0, FOREARM] and apart[FOREARM, 0]
    assert not apart[0, BODY.index("upper_arm.L")] and not apart[1, FOREARM] and not apart.diagonal().any()
    assert not apart[: len(BODY), len(BODY) :].any(), "whose a pixel is, the foreground images say"


@pytest.mark.parametrize("shift", [(0, 0), (3, 0), (-2, 4), (0, -5)])
def test_a_limb_before_the_trunk_is_displaced_as_its_colours_are(shift: tuple[int, int]) -> None:
    lines = lines_within(shift)
    assert len(lines.shift) > 30
    assert set(lines.part.tolist()) == {FOREARM}
    # To a pixel: the painted parts are whole pixels, those at their rims among them.
    assert np.median(np.abs(lines.shift - lines.normal @ shift)) < 1.1


def test_parts_of_like_colours_say_nothing_of_where_they_end() -> None:
    assert not len(lines_within(colours=np.full((4, 3), 90, np.uint8)).shift)


def test_lines_before_the_background_and_before_the_body_are_sorted_together() -> None:
    labels = render_labels(Geometry.of([BODY]), CAMERA, 0, *poses_of([BODY], [MOTION]))
    seen = silhouette([BODY], poses_of([BODY], [MOTION]), 0, CAMERA)[None, None]
    both, outer = (
        outline_lines(CAMERA, seen, labels, LineSearch(STRIDE, REACH, tolerance=1.0), coloured=coloured)
        for coloured in (of_frames(KNOWN, KEY), None)
    )
    assert (np.diff(both.frame * len(BODY) + both.part) >= 0).all()
    assert len(both.shift) > len(outer.shift)
    at = (both.uv[:, None] == outer.uv[None]).all(axis=-1).argmax(axis=0)
    np.testing.assert_array_equal(both.shift[at], outer.shift)


def test_what_a_pose_explains_grows_with_the_colours_that_its_parts_lie_on() -> None:
    poses = poses_of([BODY], [MOTION])
    seen = silhouette([BODY], poses, 0, CAMERA)[None].repeat(2, axis=0)[None]
    pictures = KEY.repeat(2, axis=0)
    view = ViewFrames(CAMERA, np.zeros(seen.shape[1:], np.uint8), 0, seen)
    palette = np.stack(list(KNOWN.images(pictures)))
    twice = tuple(a.repeat(2, axis=0) for a in poses)
    right, lifted = twice, (twice[0], twice[1] + 0.12 * np.eye(len(BODY))[FOREARM][:, None] * np.array([0, 0, 1.0]))

    def explained(view: ViewFrames, poses: tuple[Array, Array]) -> float:
        shown = SegmentInViews((view,), 0, {0.0: poses}, Sampling(1.0, 1.0, 1, 0.1))
        evidence = accumulate_evidence(shown, PerformerParts(Geometry.of([BODY])))
        return float(evidence.explained.sum())

    plain = explained(view, right) - explained(view, lifted)
    view = replace(view, colours=KNOWN, palette=palette)
    assert explained(view, right) - explained(view, lifted) > plain + 500


HUMAN = human(1.75)
NEARER = [
    look_at(name, eye, size=(320, 240), focal=330)
    for name, eye in (("front", (0.1, -2.9, 1.3)), ("right", (-1.6, -2.4, 1.4)), ("left", (1.7, -2.3, 1.2)))
]
FRAMES = 11


def crossing() -> tuple[Motion, Motion]:
    """A bare arm that moves before the trunk, and the same motion with the arm elsewhere before the trunk."""
    truth = at_rest(HUMAN, FRAMES)
    t = np.sin(np.linspace(0, np.pi, FRAMES))
    for side, sign in (("L", -1.0), ("R", 1.0)):
        truth.rotations[:, HUMAN.index(f"upper_arm.{side}")] = rotations.exp(np.array([0.0, 0.0, 1.35 * sign]))
    arm = HUMAN.index("upper_arm.R")
    truth.rotations[:, arm] = truth.rotations[:, arm] @ rotations.exp(np.array([0.0, -1.2, 0.0]))
    bend = HUMAN.index("forearm.R")
    still = truth.rotations[0, bend] @ rotations.exp(np.array([1.9, 0.0, 0.0]))
    truth.rotations[:, bend] = still
    lost = Motion(truth.translations, truth.rotations.copy())
    swing = rotations.exp(t[:, None] * np.array([-0.7, 0.0, 0.0]))
    truth.rotations[:, bend] = truth.rotations[:, bend] @ swing
    return truth, lost


def views_of(
    truth: Motion, colours: Array, *, brightness: bool = False, cameras: Sequence[Camera] = NEARER
) -> list[ViewFrames]:
    """Views that tell parts of some colours apart by what the first and the last frame show; all dark but for colours,
    or with their brightness.
    """
    found = []
    for camera in cameras:
        pictures, poses = painted(HUMAN, truth, colours, camera=camera), poses_of([HUMAN], [truth])
        seen = np.stack([silhouette([HUMAN], poses, f, camera, samples=1) for f in range(FRAMES)])
        labels = render_labels(Geometry.of([HUMAN]), camera, 0, *poses).part
        ends = {f: labels[f] for f in (0, FRAMES - 1)}
        known = PartColours.learned(pictures, ends, np.zeros(len(HUMAN), np.int64), parts_apart([HUMAN]), 120.0)
        assert known is not None
        palette = np.stack(list(known.images(pictures)))
        grey = pictures[..., 0] if brightness else np.zeros_like(seen)
        found.append(ViewFrames(camera, grey, 0, seen[None], colours=known, palette=palette))
    return found


def apart(found: Motion, truth: Motion) -> float:
    """How far the right wrist is from where it is in truth, metres."""
    wrist, true = (landmark_positions(HUMAN, motion, ["RWrist"]) for motion in (found, truth))
    return float(np.linalg.norm(wrist - true, axis=-1).mean())


def found_apart(views: Sequence[ViewFrames], lost: Motion, truth: Motion) -> float:
    """The same once limbs were looked for around a motion, on the median of some seeds."""
    problem = SegmentProblem(tuple(views), (HUMAN,), 0, 30.0, (ends_held(HUMAN, FRAMES),))
    return float(np.median([apart(found_limbs(problem, [lost], seed, Workspace())[0], truth) for seed in range(3)]))


def with_bare_arms(skin: tuple[int, int, int]) -> Array:
    """Of the human's parts: all of one colour but for the arms below the elbow."""
    colours = np.full((len(HUMAN), 3), 57, np.uint8)
    colours[[HUMAN.index(f"{name}.{side}") for name in ("forearm", "hand") for side in "LR"]] = skin
    return colours


def test_a_bare_arm_is_found_before_the_shirt() -> None:
    truth, lost = crossing()
    views = views_of(truth, with_bare_arms((70, 100, 190)))
    without = [replace(view, colours=None) for view in views]
    assert apart(lost, truth) > 0.1
    found = found_apart(views, lost, truth)
    assert found < 0.5 * apart(lost, truth)
    assert found_apart(without, lost, truth) > 2 * found, "silhouettes show less of it"


def test_an_arm_of_the_shirts_colour_is_located_by_its_sides() -> None:
    truth, lost = crossing()
    views = views_of(truth, with_bare_arms((63, 57, 57)), brightness=True)  # of the same bin of colours
    problem = SegmentProblem(tuple(views), (HUMAN,), 0, 30.0, (ends_held(HUMAN, FRAMES),))
    arm = HUMAN.index("upper_arm.R")
    right, wrong = (
        next(sides for _, chain, sides, _ in support_of_limbs(problem, [motion]) if chain[0] == arm)
        for motion in (truth, lost)
    )
    assert (right > 0).all() and (wrong[2:-2] < 0).all()
    [(_, chain)] = refuted(problem, lost)
    assert chain[0] == arm
    assert not refuted(problem, truth)
    held = replace(problem, fixed=(np.ones_like(problem.fixed[0]),))
    assert not list(support_of_limbs(held, [lost]))


def refuted(problem: SegmentProblem, motion: Motion) -> list[LimbOfPerformer]:
    return refuted_limbs(problem, support_of_limbs(problem, [motion]))


def with_arm_across(truth: Motion, frames: slice) -> Motion:
    """The right arm turned elsewhere on some frames."""
    arm, motion = HUMAN.index("upper_arm.R"), Motion(truth.translations, truth.rotations.copy())
    motion.rotations[frames, arm] = truth.rotations[frames, arm] @ rotations.exp(np.array([0.0, 0.0, -1.2]))
    return motion


def test_an_arm_without_which_the_pictures_are_likelier_for_long_is_refuted_by_them() -> None:
    truth, _ = crossing()
    views = views_of(truth, with_bare_arms((70, 100, 190)), brightness=True)
    problem = SegmentProblem(tuple(views), (HUMAN,), 0, 30.0, (ends_held(HUMAN, FRAMES),))
    lost = with_arm_across(truth, slice(1, -1))
    assert [chain[0] for _, chain in refuted(problem, lost)] == [HUMAN.index("upper_arm.R")]
    assert not refuted(problem, truth)
    assert not refuted(problem, with_arm_across(truth, slice(4, 6))), "it is elsewhere for two frames alone"


def test_an_arm_that_the_body_hides_from_all_views_is_not_refuted() -> None:
    motion = at_rest(HUMAN, FRAMES)
    for side, sign in (("L", -1.0), ("R", 1.0)):
        motion.rotations[:, HUMAN.index(f"upper_arm.{side}")] = rotations.exp(np.array([0.0, 0.0, 1.35 * sign]))
    left = [look_at("left", (3.0, 0.0, 1.2), size=(320, 240), focal=330)]
    views = views_of(motion, with_bare_arms((70, 100, 190)), cameras=left)
    problem = SegmentProblem(tuple(views), (HUMAN,), 0, 30.0, (ends_held(HUMAN, FRAMES),))
    arm = HUMAN.index("upper_arm.R")
    shown = next(shown for _, chain, _, shown in support_of_limbs(problem, [motion]) if chain[0] == arm)
    assert (shown() == 0).all()
    assert not refuted(problem, motion)
