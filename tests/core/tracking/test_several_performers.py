"""Several performers: each is learned from its own key frames, and doubted by itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.core.body import landmark_positions
from kfmocap.core.body.limbs import limbs
from kfmocap.core.body.motion import Motion, with_motion
from kfmocap.core.errors import ShotError
from kfmocap.core.evidence.foreground_images.foreground import log_ratio
from kfmocap.core.evidence.misfit import measured_misfit
from kfmocap.core.evidence.rendering.label_images import render_labels
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.shot.segments import MAX_LENGTH, PosedFrames, posed_frames, segments
from kfmocap.core.shot.shot import KeyPoses, Shot, View
from kfmocap.core.tracking.footage_reading.appearance import frames_with_foreground, key_frame_shape
from kfmocap.core.tracking.footage_reading.picture_store import PictureStore, StoredView
from kfmocap.core.tracking.footage_reading.reader import ColourFrames
from kfmocap.core.tracking.retracking import Excerpt, track_excerpts
from kfmocap.core.tracking.solvers import gauss_newton, multi_start
from kfmocap.core.tracking.solvers.approach import Approach
from kfmocap.core.tracking.solvers.assessment import settled_solutions, solution_doubts, solution_ranking
from kfmocap.core.tracking.solvers.descent_stages import (
    FINE_STAGES,
    FREE_STAGES,
    POLISHED_AT_ONCE,
    STAGES,
    DescentStage,
)
from kfmocap.core.tracking.solvers.equations import segment_equations
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.limb_corrections import limb_exchange, search_rounds
from kfmocap.core.tracking.solvers.limb_corrections.swapped_limbs import Exchange
from kfmocap.core.tracking.tracker import track
from made_evidence import no_evidence
from synthetic import at_rest, ends_held, figure, film, look_at, poses_of, shot_of, silhouette, swing

Array = np.ndarray
BODY = figure()
P = len(BODY)
FRAMES = 7
SIZE = (240, 130)
CAMERAS = tuple(look_at(f"cam{i}", eye, size=SIZE, focal=200) for i, eye in enumerate(((0.3, -4, 1.6), (-1, -3.6, 1))))
LEFT, RIGHT = np.array([-0.7, 0.2, 0]), np.array([0.8, -0.2, 0])
RED, GREEN, GREY = (40, 50, 200), (60, 170, 60), (120, 120, 120)
"""Blue, green, red."""


def moved(motion: Motion, by: Array) -> Motion:
    return replace(motion, translations=motion.translations + by)


TRUTHS = [moved(swing(BODY, FRAMES, 0.3, seed), by) for seed, by in ((1, LEFT), (2, RIGHT))]


def pictures(colours: tuple[tuple[int, int, int], ...], motions: list[Motion]) -> ColourFrames:
    """One view of performers in plain clothes before a grey wall."""
    labels = render_labels(Geometry.of([BODY] * 2), CAMERAS[0], 0, *poses_of([BODY] * 2, motions)).part
    image = np.full((*labels.shape, 3), GREY, float)
    for m, colour in enumerate(colours):
        image[(labels >= 0) & (labels // P == m)] = colour
    noise = np.random.default_rng(0).normal(0, 3, image.shape)
    return ColourFrames(CAMERAS[0], np.clip(image + noise, 0, 255).astype(np.uint8), 0, 0.0)


def coloured_views(motions: list[Motion]) -> tuple[ViewFrames, ...]:
    """Views that tell the performers from all else, and show nothing else; neither hides the other."""
    views = []
    for camera in CAMERAS:
        poses = [poses_of([BODY], [motion]) for motion in motions]
        each = [np.stack([silhouette([BODY], own, f, camera, samples=1) for f in range(FRAMES)]) for own in poses]
        views.append(ViewFrames(camera, np.zeros_like(each[0]), 0, np.stack(each)))
    return tuple(views)


def posed(first: list[int], second: list[int]) -> PosedFrames:
    return PosedFrames.of([np.array(first), np.array(second)], 0, FRAMES - 1)


def shown_on(keys: PosedFrames) -> list[Motion]:
    return [motion[keys.frames] for motion in TRUTHS]


def ratios(colours: tuple[tuple[int, int, int], ...], keys: PosedFrames) -> tuple[Array, Array]:
    """Log likelihood ratios of both performers on all frames (2, F, h, w), and whose the pixels are."""
    view = frames_with_foreground(pictures(colours, TRUTHS), [BODY] * 2, shown_on(keys), keys, fps=30)
    assert view.foreground is not None
    labels = render_labels(Geometry.of([BODY] * 2), CAMERAS[0], 0, *poses_of([BODY] * 2, TRUTHS)).part
    return log_ratio(view.foreground), np.where(labels >= 0, labels // P, -1)


def test_pictures_in_files_are_those_in_memory(tmp_path: Path) -> None:
    frames, keys = pictures((RED, GREEN), TRUTHS), posed([0, 6], [0, 6])
    held, filed = (
        frames_with_foreground(frames, [BODY] * 2, shown_on(keys), keys, fps=30, store=store)
        for store in (None, PictureStore(tmp_path, "front"))
    )
    stored = PictureStore(tmp_path, "front").stored(filed)
    assert isinstance(stored, StoredView)
    for view in (filed, stored.opened()):
        assert view.foreground is not None and held.foreground is not None
        np.testing.assert_array_equal(view.grey, held.grey)
        np.testing.assert_array_equal(view.foreground, held.foreground)
        np.testing.assert_array_equal(view.foreground_at(2, 3, 2), held.foreground_at(2, 3, 2))
    stored.remove()
    assert not list(tmp_path.iterdir())


def test_in_different_clothes_a_pixel_is_the_one_performers_and_not_the_others() -> None:
    ratio, whose = ratios((RED, GREEN), posed([0, 6], [0, 6]))
    for m in range(2):
        assert (ratio[m][whose == m] > 1).mean() > 0.95
        assert (ratio[m][whose == 1 - m] < -1).mean() > 0.95
        assert (ratio[m][whose == -1] < -1).mean() > 0.95


def test_in_equal_clothes_a_pixel_may_be_anybodys_as_surely_as_a_lone_performers() -> None:
    ratio, whose = ratios((RED, RED), posed([0, 6], [0, 6]))
    assert (ratio[:, whose >= 0] > 3).mean() > 0.95
    assert (ratio[:, whose == -1] < -1).mean() > 0.95


@pytest.mark.parametrize("colours", [(RED, GREEN), (RED, RED)])
def test_each_performers_colours_are_learned_from_its_own_key_frames(colours: tuple[tuple[int, int, int], ...]) -> None:
    ratio, whose = ratios(colours, posed([0, 6], [3]))
    for m in range(2):
        assert (ratio[m][whose == m] > 1).mean() > 0.9
        assert (ratio[m][whose == -1] < -1).mean() > 0.9


def test_nothing_is_learned_where_a_performer_who_is_not_posed_may_be() -> None:
    """The second performer is only roughly where its motion says: what is background there is not learned as such, nor
    is anything behind it learned as the first one's.
    """
    wrong = [TRUTHS[0], moved(TRUTHS[1], np.array([0.1, 0, 0]))]
    keys = posed([0, 6], [])
    shown = [motion[keys.frames] for motion in wrong]
    view = frames_with_foreground(pictures((RED, GREEN), TRUTHS), [BODY] * 2, shown, keys, fps=30)
    assert view.foreground is not None
    ratio, (_, whose) = log_ratio(view.foreground), ratios((RED, GREEN), posed([0, 6], [0, 6]))
    assert (ratio[0][whose == 0] > 1).mean() > 0.95
    assert (ratio[1][whose == 1] > 0).mean() > 0.95, "of any colour that the background does not have"
    assert (ratio[1][whose == 0] < 0).mean() > 0.95


def test_shapes_are_fitted_to_each_performers_own_key_frames() -> None:
    """Where the second performer is not posed it is beside its place: that bends nobody's shape."""
    loose = [TRUTHS[0], TRUTHS[1].replaced(0, moved(TRUTHS[1][[0]], np.array([0.08, 0, 0.05])))]
    images = coloured_views(TRUTHS)
    own = key_frame_shape(images, [BODY] * 2, loose, posed([0, 6], [3, 6]), 0.0)
    common = key_frame_shape(images, [BODY] * 2, loose, posed([0, 6], [0, 3, 6]), 0.0)
    assert own is not None and common is not None
    straight = Geometry.of([BODY] * 2).vertices
    bent = np.abs(common.geometry.vertices - straight).max()
    assert np.abs(own.geometry.vertices - straight).max() < 0.5 * bent


def test_performers_need_no_common_key_frame() -> None:
    s = shot_of([], [BODY] * 2, [at_rest(BODY, 300)] * 2, [0])
    keys = [np.arange(0, 300, 40), np.arange(20, 300, 40)]
    people = [
        replace(p, key_poses=KeyPoses.whole(own, at_rest(BODY, len(own))))
        for p, own in zip(s.performers, keys, strict=True)
    ]
    s = replace(s, performers=tuple(people))
    found = posed_frames(s, 0, 299)
    assert found.frames.tolist() == sorted([*keys[0], *keys[1]])
    assert (found.posed.sum(axis=1) == 1).all() and (found.apart == np.where(found.posed, 0, 20)).all()
    assert segments(s) == [(0, 140), (140, 280), (280, 299)], f"no segment is longer than {MAX_LENGTH} frames"


def landmarks_of(motions: Sequence[Motion]) -> Array:
    return np.stack([landmark_positions(BODY, motion, list(BODY.landmarks)) for motion in motions])


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> list[View]:
    return film(tmp_path_factory.mktemp("filmed"), [BODY] * 2, TRUTHS, CAMERAS)


def with_second_keyed(shot: Shot, frames: list[int]) -> Shot:
    first, second = shot.performers
    return replace(shot, performers=(first, replace(second, key_poses=KeyPoses.whole(frames, TRUTHS[1][frames]))))


def test_an_excerpt_without_a_key_pose_of_one_performer_is_tracked_as_in_the_whole_shot(
    filmed: list[View], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Corrections are excerpts, and segments of performers with different key frames may hold none of one of them."""
    monkeypatch.setattr("kfmocap.core.shot.segments.MAX_LENGTH", 2)
    shot = with_second_keyed(shot_of(filmed, [BODY] * 2, TRUTHS, (0, 2, 4, 6), fps=12), [0, 6])
    assert segments(shot) == [(0, 2), (2, 4), (4, 6)]
    whole = track(shot)
    here = slice(2, 5)
    beside = tuple(tuple(motion[[frame]] for motion in whole.motions) for frame in (1, 5))
    earlier = tuple(motion[here] for motion in whole.motions)

    def errors(motions: Sequence[Motion]) -> Array:
        off = landmarks_of(list(motions)) - landmarks_of([truth[here] for truth in TRUTHS])
        return np.asarray(np.linalg.norm(off, axis=-1).max(axis=(1, 2)))

    for excerpt in (
        Excerpt(2, 4, (beside[0], beside[1]), footage_offset=0.0),
        Excerpt(2, 4, (beside[0], beside[1]), footage_offset=0.0, earlier=earlier),
    ):
        [found] = track_excerpts(shot, [excerpt])
        assert (errors(found.motions) < 1.2 * errors(earlier)).all()
        np.testing.assert_array_equal(found.motions[0].rotations[[0, 2]], TRUTHS[0].rotations[[2, 4]])
    with pytest.raises(ShotError, match="no key pose"):
        track_excerpts(shot, [Excerpt(2, 4, footage_offset=0.0)])


def test_staggered_key_frames_are_as_good_as_common_ones(filmed: list[View]) -> None:
    common = shot_of(filmed, [BODY] * 2, TRUTHS, (0, 6), fps=12)
    errors = []
    for s in (common, with_second_keyed(common, [1, 5])):
        result = track(s)
        assert all(np.isfinite(d).all() for d in result.deviation)
        errors.append(np.linalg.norm(landmarks_of(result.motions) - landmarks_of(TRUTHS), axis=-1).mean())
        for person, motion in zip(s.performers, result.motions, strict=True):
            keys = person.key_poses
            np.testing.assert_array_equal(motion.rotations[keys.frames], keys.poses.rotations)
    assert errors[1] < 1.2 * errors[0] < 0.004


HELD = (ends_held(BODY, FRAMES), ends_held(BODY, FRAMES))


def solution(problem: SegmentProblem, motions: list[Motion]) -> SegmentSolution:
    """Motions as if they had been found."""
    measured = Workspace().measure(problem, motions, Sampling(1.0, 1.0, 2, 0.07)).evidence
    return SegmentSolution.of(motions, measured, iterations=1, energy=[0.0])


def test_a_performer_is_doubted_by_what_it_explains_itself() -> None:
    problem = SegmentProblem(coloured_views(TRUTHS), (BODY, BODY), 0, 30.0, HELD)
    beside = np.zeros((FRAMES, BODY.dof))
    beside[3, 0] = 0.1
    wrong = solution(problem, [TRUTHS[0], TRUTHS[1].moved(beside)])
    pooled, keys = wrong.explained.sum(axis=0), [0, FRAMES - 1]
    assert pooled[3] > solution_doubts.MIN_EXPLAINED_RATIO * np.interp(3, keys, pooled[keys]), (
        "both together cover nearly all"
    )
    assert [solution_doubts.is_doubtful(problem.alone(i), wrong) for i in range(2)] == [False, True]
    assert not solution_doubts.is_doubtful(problem, solution(problem, TRUTHS))


def test_what_others_hide_of_a_performer_is_not_expected_of_it() -> None:
    """The second performer walks through between the first one and both cameras."""
    across = at_rest(BODY, FRAMES)
    paths = [np.zeros((FRAMES, 3)), np.linspace([-0.9, -1.0, 0], [0.9, -1.0, 0], FRAMES)]
    motions = [replace(across, translations=across.translations + path) for path in paths]
    views = tuple(
        replace(v, foreground=np.where(hides, v.foreground, np.uint8(4)))
        for v, hides in zip(coloured_views(motions), seen_whose(motions), strict=True)
    )
    problem = SegmentProblem(views, (BODY, BODY), 0, 30.0, HELD)
    true = solution(problem, motions)
    assert true.unhidden[0].min() < 0.4 and true.unhidden[1].min() == 1
    assert true.explained[0].min() < solution_doubts.MIN_EXPLAINED_RATIO * true.explained[0][[0, -1]].min()
    assert not solution_doubts.is_doubtful(problem, true)


def test_views_that_tell_nothing_do_not_count_for_what_others_leave_in_sight() -> None:
    """The second performer hides the first one in the second view alone, whose foreground images are grey."""
    rest = at_rest(BODY, FRAMES)
    between = 0.5 * CAMERAS[1].centre_world() * [1, 1, 0]
    motions = [rest, moved(rest, between)]
    views = coloured_views(motions)
    assert views[1].foreground is not None
    grey = replace(views[1], foreground=np.full_like(views[1].foreground, 128))
    problem = SegmentProblem((views[0], grey), (BODY, BODY), 0, 30.0, HELD)
    hidden = solution(replace(problem, views=views), motions).unhidden[0]
    np.testing.assert_allclose(
        solution(problem, motions).unhidden, solution(replace(problem, views=views[:1]), motions).unhidden
    )
    assert (hidden < 0.9 * solution(problem, motions).unhidden[0]).all()


def test_parts_that_tell_nothing_do_not_count_for_what_others_leave_in_sight() -> None:
    """The second performer hides the lower half of the first one for a while; only one half looks like the first."""
    path = np.full((FRAMES, 3), 0.5 * CAMERAS[0].centre_world() * [1, 1, 0] - [0, 0, 0.1])
    path[[0, -1]] += [5, 0, 0]
    rest = at_rest(BODY, FRAMES)
    motions = [rest, moved(rest, path)]
    view = coloured_views(motions)[0]
    assert view.foreground is not None
    middle = int(np.flatnonzero(log_ratio(view.foreground[0, 0]).max(axis=1) > 1).mean())
    hidden = []
    for half in (slice(0, middle), slice(middle, None)):
        foreground = np.full_like(view.foreground, 128)
        foreground[..., half, :] = view.foreground[..., half, :]
        problem = SegmentProblem((replace(view, foreground=foreground),), (BODY, BODY), 0, 30.0, HELD)
        hidden.append(solution(problem, motions).unhidden[0])
    assert (hidden[0] > 1.4 * hidden[1])[1:-1].all()


@pytest.mark.parametrize(("likes", "astray"), [(1, False), (None, True)])
def test_a_limb_where_a_view_shows_somebody_else_is_not_on_the_background(likes: int | None, astray: bool) -> None:
    """Hair and clothes of who stands before a limb are not in the model, and hide more of it than that knows."""
    motions = [at_rest(BODY, FRAMES), moved(at_rest(BODY, FRAMES), np.array([2.0, 0, 0]))]
    views = coloured_views(motions)
    labels = render_labels(Geometry.of([BODY] * 2), CAMERAS[0], 0, *poses_of([BODY] * 2, motions)).part
    assert views[0].foreground is not None
    colours = views[0].foreground.copy()
    arm = np.isin(labels[2:5], limbs(BODY)[0])
    colours[0, 2:5][arm] = 4
    if likes is not None:
        colours[likes, 2:5][arm] = 252
    problem = SegmentProblem((replace(views[0], foreground=colours), views[1]), (BODY, BODY), 0, 30.0, HELD)
    measured = Workspace().measure(problem, motions, Sampling(1.0, 1.0, 2, 0.07)).evidence
    found = replace(solution(problem, motions), evidence=measured)
    assert solution_doubts.limb_on_background(problem.alone(0), found) == astray


def test_what_exceeds_the_outline_of_one_performer_is_not_a_lost_limb_of_another() -> None:
    """In equal clothes it looks like the other one; beside a performer who is not in the model it may be a limb."""
    camera = look_at("near", (0.3, -4, 1.6), size=(960, 520), focal=800)
    motions = [moved(at_rest(BODY, 1), np.array([x, 0.0, 0])) for x in (-0.25, 0.25)]
    poses = poses_of([BODY] * 2, motions)
    labels = render_labels(Geometry.of([BODY] * 2), camera, 0, *poses).part
    rim = cv2.dilate((labels[0] >= P).astype(np.uint8), np.ones((13, 13))) > 0  # 3 cm
    seen = np.where((labels >= 0) | rim, np.uint8(252), np.uint8(4))

    def area(known: int) -> float:
        view = ViewFrames(camera, seen, 0, foreground=np.stack([seen] * known))
        at, spans = {0.0: poses_of([BODY] * known, motions[:known])}, [slice(P * m, P * m + P) for m in range(known)]
        return float(measured_misfit([view], Geometry.of([BODY] * known), at, first=0, spans=spans).areas[0, 0, 0])

    assert area(known=2) < 0.005 and area(known=1) > 0.05


def seen_whose(motions: list[Motion]) -> list[Array]:
    """Per view: whether a pixel of a performer's image (2, F, h, w) is not hidden by the other."""
    poses = poses_of([BODY] * 2, motions)
    labels = [render_labels(Geometry.of([BODY] * 2), camera, 0, *poses).part for camera in CAMERAS]
    return [np.stack([(part < 0) | (part // P == m) for m in range(2)]) for part in labels]


def test_only_the_performer_that_is_sought_moves_and_only_its_evidence_is_gathered() -> None:
    start = [motion.replaced(1, moved(motion[1:-1], np.array([0.03, 0, 0]))) for motion in TRUTHS]
    problem = SegmentProblem(coloured_views(TRUTHS), (BODY, BODY), 0, 30.0, HELD)
    for i in range(2):
        alone = gauss_newton.descend(problem.alone(i), start, Workspace())
        assert alone.evidence is not None
        other = 1 - i
        np.testing.assert_allclose(alone.motions[other].difference(start[other]), 0, atol=1e-12)
        assert np.abs(alone.motions[i].difference(start[i])).max() > 1e-3
        own = slice(i * P, i * P + P)
        rest = slice(other * P, other * P + P)
        assert alone.evidence.outlines.H[:, :, own].any() and not alone.evidence.outlines.H[:, :, rest].any()
        assert not alone.evidence.gradients.H[:, :, rest].any()
        assert (alone.evidence.explained[:, other] > 0).all(), "what others cover is needed to compare solutions"


def test_evidence_for_one_performer_is_the_same_whether_the_others_were_rendered_before_or_not() -> None:
    """Others who have moved since they were drawn are drawn anew."""
    start = [moved(TRUTHS[0], np.array([1.4, 0.1, 0])), TRUTHS[1]]
    aside = [moved(TRUTHS[0], np.array([1.3, 0.1, 0])), moved(TRUTHS[1], np.array([0.1, 0, 0]))]
    problem, workspace = SegmentProblem(coloured_views(start), (BODY, BODY), 0, 30.0, HELD), Workspace()
    alone, sampling = problem.alone(0), Sampling(1.0, 1.0, 2, 0.07)
    for motions in (start, aside, [start[0], aside[1]], start, start):
        both = workspace.measure(problem, motions, sampling).evidence
        found = workspace.measure(alone, motions, sampling).evidence
        np.testing.assert_allclose(found.explained, both.explained, rtol=1e-9)
        np.testing.assert_allclose(found.unhidden[0], both.unhidden[0])
        np.testing.assert_array_equal(found.share, both.share)
        noise = both.gradients.noise
        every, one = (workspace.measure(p, motions, sampling, noise).evidence.gradients.gain for p in (problem, alone))
        np.testing.assert_allclose(one, every, rtol=1e-3, atol=1e-3 * np.abs(every).max())
        np.testing.assert_array_equal(found.agreeing[..., :P], both.agreeing[..., :P])
        np.testing.assert_allclose(found.outlines.H[:, :, :P], both.outlines.H[:, :, :P])
    assert both.unhidden.min() < 0.9, "one hides the other"


def test_the_noise_under_which_one_of_several_is_judged_is_of_its_own_pixels() -> None:
    """That of all has more pixels: beside what is shown, gradients would count the more, the more others there are."""
    problem, workspace = SegmentProblem(coloured_views(TRUTHS), (BODY, BODY), 0, 30.0, HELD), Workspace()
    both = gauss_newton.descend(problem, TRUTHS, workspace)
    for i in range(2):
        alone = problem.alone(i)
        own = workspace.measure(alone, both.motions, both.evidence.sampling).evidence
        noise = solution_ranking.noise_at(alone, replace(both, only=i), workspace)
        count = own.gradients.count.sum()
        assert count < 0.7 * both.evidence.gradients.count.sum()
        np.testing.assert_allclose(noise.weight, segment_equations.SegmentNoise.of(own, problem.settings).weight)
    np.testing.assert_array_equal(
        solution_ranking.noise_at(problem, both, workspace).weight,
        segment_equations.SegmentNoise.of(both.evidence, problem.settings).weight,
    )


@dataclass
class Told:
    """A solver that tells how far motions are from the truth, and for whom it was asked."""

    solved: list[int | None] = field(default_factory=list)

    def found(self, problem: SegmentProblem, motions: Sequence[Motion], *_: object, **__: object) -> SegmentSolution:
        self.solved.append(problem.only)
        off = np.array([np.abs(m.difference(t)).sum(axis=1) for m, t in zip(motions, TRUTHS, strict=True)])
        none = np.zeros(FRAMES)
        evidence = no_evidence(1, FRAMES, 2 * P)
        share, seen = np.ones((1, FRAMES, 2 * P)), np.ones((2, FRAMES))
        return SegmentSolution(
            tuple(list(motions)), 1, (float(off.sum()),), share, -off, seen, none, {}, evidence, (), problem.only
        )


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> Told:
    """What takes the place of the solver; each performer has one exchange, which is right."""

    def exchanged(problem: SegmentProblem, motions: Sequence[Motion]) -> Iterator[Exchange]:
        for i in problem.sought:
            yield Exchange(tuple(TRUTHS[i] if j == i else motion for j, motion in enumerate(motions)))

    made = Told()
    for solver in (multi_start, search_rounds, limb_exchange, settled_solutions):
        monkeypatch.setattr(solver, "descend", made.found)
    for solver in (search_rounds, limb_exchange, settled_solutions):
        monkeypatch.setattr(solver, "noise_at", lambda *_: None)
    for solver in (search_rounds, limb_exchange):
        monkeypatch.setattr(solver, "approach", lambda problem, motions, *_: Approach.start(problem, motions))
    monkeypatch.setattr(limb_exchange, "exchanges", exchanged)
    return made


WRONG = [moved(truth, np.array([0.1, 0.0, 0.0])) for truth in TRUTHS]
BOTH = SegmentProblem(tuple(coloured_views(TRUTHS)), (BODY, BODY), 0, 30.0, (ends_held(BODY, FRAMES),) * 2)
ENDS = ends_held(BODY, FRAMES)
ONE_HELD = replace(BOTH, fixed=(ENDS, ENDS | (np.arange(ENDS.shape[1]) < ENDS.shape[1] - 3)))
"""The second is held, but for its last part between the key poses."""


def test_limbs_are_exchanged_by_solving_their_own_performer_and_all_settle_at_last(
    monkeypatch: pytest.MonkeyPatch, told: Told
) -> None:
    """What is tried for one of many does not cost as much as solving all of them."""
    best = told.found(BOTH, WRONG)
    monkeypatch.setattr(limb_exchange, "likelihood", lambda _problem, _noise, found: 1e3 * found.cover)
    found = limb_exchange.with_crossed_limbs_exchanged(BOTH, best, Workspace())
    assert found.motions == tuple(TRUTHS)
    assert found.only is None
    assert told.solved == [None, 0, 0, 1, 1, None]


def test_exchanges_that_are_no_likelier_leave_the_solution_as_it_was(
    monkeypatch: pytest.MonkeyPatch, told: Told
) -> None:
    """It is compared with them once it has settled as they have; all performers are not solved again for that."""
    best = told.found(BOTH, WRONG)
    monkeypatch.setattr(limb_exchange, "likelihood", lambda *_: 0.0)
    assert limb_exchange.with_crossed_limbs_exchanged(BOTH, best, Workspace()) is best
    assert told.solved == [None, 0, 0, 1, 1]


def test_limbs_in_each_others_places_are_not_led_away_again_by_coarse_steps(
    monkeypatch: pytest.MonkeyPatch, told: Told
) -> None:
    def astray(problem: SegmentProblem, motions: Sequence[Motion], *_: object) -> Approach:
        return Approach.start(problem, [moved(motion, np.array([1.0, 0.0, 0.0])) for motion in motions])

    def exchanged(problem: SegmentProblem, motions: Sequence[Motion]) -> Iterator[Exchange]:
        for i in problem.sought:
            exchanged_motions = tuple(TRUTHS[i] if j == i else motion for j, motion in enumerate(motions))
            yield Exchange(exchanged_motions, places=places)

    monkeypatch.setattr(limb_exchange, "approach", astray)
    monkeypatch.setattr(limb_exchange, "exchanges", exchanged)
    monkeypatch.setattr(limb_exchange, "likelihood", lambda _problem, _noise, found: 1e3 * found.cover)
    best = told.found(BOTH, WRONG)
    for places in (False, True):
        found = limb_exchange.with_crossed_limbs_exchanged(BOTH, best, Workspace())
        assert found.motions == tuple(TRUTHS if places else WRONG)


def searched_for(monkeypatch: pytest.MonkeyPatch, doubts: list[list[int]]) -> list[int | None]:
    """Whom limbs are looked for where the performers are doubted one time after the other as given.

    Whoever was in doubt at first stays so.
    """
    looked: list[int | None] = []
    expected = tuple(doubts[0])

    def own(problem: SegmentProblem, _start: object, before: SegmentSolution, *_: object) -> SegmentSolution:
        looked.append(problem.only)
        return before

    monkeypatch.setattr(multi_start, "doubted_performers", lambda *_: doubts.pop(0))
    monkeypatch.setattr(multi_start, "turned_and_searched", own)
    assert multi_start.best_of_starts(BOTH, WRONG, Workspace()).doubted == expected
    return looked


def test_the_performer_who_is_explained_least_is_searched_first(monkeypatch: pytest.MonkeyPatch, told: Told) -> None:
    shares = [np.array([1.0, 0.7, np.nan]), np.array([1.0, 0.4, 0.9])]
    monkeypatch.setattr(solution_doubts, "explained_share", lambda _problem, _solution, i: shares[i])
    assert searched_for(monkeypatch, [[0, 1], [0]]) == [1, 0]


def test_a_performer_no_longer_doubtful_once_others_are_found_is_not_searched_for(
    monkeypatch: pytest.MonkeyPatch, told: Told
) -> None:
    monkeypatch.setattr(solution_doubts, "explained_share", lambda *_: np.ones(FRAMES))
    assert searched_for(monkeypatch, [[0, 1], []]) == [0]


def test_what_is_found_for_one_of_several_is_not_solved_for_all_of_them(
    monkeypatch: pytest.MonkeyPatch, told: Told
) -> None:
    """The refinement does that, by more pixels; the solution tells how likely what was found is."""

    def right(problem: SegmentProblem, _: object, before: SegmentSolution, *__: object) -> SegmentSolution:
        assert problem.only is not None
        return replace(before, motions=with_motion(before.motions, problem.only, TRUTHS[problem.only]))

    measured: list[Sequence[Motion]] = []

    def at(problem: SegmentProblem, motions: Sequence[Motion], *_: object) -> SegmentSolution:
        measured.append(motions)
        return Told().found(problem, motions)

    monkeypatch.setattr(solution_doubts, "explained_share", lambda *_: np.ones(FRAMES))
    monkeypatch.setattr(multi_start, "doubted_performers", lambda *_: [0, 1])
    monkeypatch.setattr(multi_start, "turned_and_searched", right)
    monkeypatch.setattr(multi_start, "solution_at", at)
    found = multi_start.best_of_starts(BOTH, WRONG, Workspace())
    assert list(found.motions) == list(TRUTHS) == list(measured[-1])
    assert found.cover == 0 and found.only is None and found.doubted == (0, 1)
    assert told.solved == [None, 1]  # the second once the first is found


def test_where_nothing_is_found_for_one_of_several_its_motion_stays_as_all_pixels_have_shown_it(
    monkeypatch: pytest.MonkeyPatch, told: Told
) -> None:
    """For a search it is solved further by fewer of them."""

    def nothing_new(problem: SegmentProblem, motions: Sequence[Motion], *_: object) -> SegmentSolution:
        far = tuple(moved(motion, np.array([0.02, 0.0, 0.0])) for motion in motions)
        return told.found(problem, motions if problem.only is None else far)

    monkeypatch.setattr(multi_start, "descend", nothing_new)
    monkeypatch.setattr(solution_doubts, "explained_share", lambda *_: np.ones(FRAMES))
    monkeypatch.setattr(multi_start, "doubted_performers", lambda *_: [0, 1])
    monkeypatch.setattr(multi_start, "turned_and_searched", lambda _problem, _start, before, *_: before)
    assert list(multi_start.best_of_starts(BOTH, WRONG, Workspace()).motions) == WRONG


@pytest.mark.parametrize(("unhidden", "expected"), [(0.8, POLISHED_AT_ONCE), (1.0, FINE_STAGES)])
def test_turns_are_solved_as_far_as_the_first_solution_even_if_that_was_settled_since(
    monkeypatch: pytest.MonkeyPatch, told: Told, unhidden: float, expected: Sequence[DescentStage]
) -> None:
    """What is solved further covers more. How its images were last sampled does not tell how far it was solved."""
    stages: list[Sequence[DescentStage]] = []

    def own(_: object, __: object, before: SegmentSolution, ___: object, of: Sequence[DescentStage]) -> SegmentSolution:
        stages.append(of)
        return before

    monkeypatch.setattr(multi_start, "doubted_performers", lambda *_: [1])
    monkeypatch.setattr(multi_start, "turned_and_searched", own)
    first = replace(told.found(BOTH, WRONG), unhidden=np.full((2, FRAMES), unhidden))
    multi_start.best_of_starts(BOTH, WRONG, Workspace(), first)
    assert stages == [expected]


def test_several_performers_are_solved_by_all_pixels_before_anybody_is_doubted(
    monkeypatch: pytest.MonkeyPatch, told: Told
) -> None:
    """Those whom others hide are seen by few views. Where nobody hides another, each is solved as if alone."""
    stages: list[Sequence[DescentStage]] = []
    monkeypatch.setattr(multi_start, "others_hide", lambda _: True)

    def descend(
        problem: SegmentProblem,
        begun: Sequence[Motion] | Approach,
        _: Workspace,
        of: Sequence[DescentStage],
    ) -> SegmentSolution:
        stages.append(of)
        return told.found(problem, begun.motions if isinstance(begun, Approach) else begun)

    monkeypatch.setattr(multi_start, "descend", descend)
    assert searched_for(monkeypatch, [[]]) == []
    assert [each[-1] for each in stages] == [POLISHED_AT_ONCE[-1]]
    assert multi_start.first_solution(BOTH, WRONG, Workspace()).polished
    monkeypatch.setattr(multi_start, "doubted_performers", lambda *_: [])
    keyed = replace(BOTH, fixed=(BOTH.fixed[0], np.ones_like(BOTH.fixed[1])))
    for others, expected in (
        (keyed, FREE_STAGES),
        (ONE_HELD, FREE_STAGES),
        (replace(BOTH, views=BOTH.views[:1]), STAGES),
    ):
        multi_start.first_solution(others, WRONG, Workspace())
        assert stages[-1] is expected
    monkeypatch.setattr(multi_start, "others_hide", lambda unhidden: bool(unhidden.min() < 0))
    assert not multi_start.first_solution(BOTH, WRONG, Workspace()).polished
    assert stages[-1] is STAGES


def test_a_performer_who_is_held_is_not_doubted(monkeypatch: pytest.MonkeyPatch, told: Told) -> None:
    """All but the last part of it, that is: so it is held in Blender while another is tracked."""
    monkeypatch.setattr(solution_doubts, "is_doubtful", lambda *_: True)
    monkeypatch.setattr(solution_doubts, "limb_hidden_for_long", lambda *_: True)
    solution = told.found(BOTH, WRONG)
    assert solution_doubts.doubted_performers(BOTH, WRONG, solution) == [0, 1]
    assert solution_doubts.doubted_performers(ONE_HELD, WRONG, solution) == [0]


def test_the_motion_of_one_of_several_performers_is_not_followed(monkeypatch: pytest.MonkeyPatch, told: Told) -> None:
    searches: list[SegmentSolution] = []
    monkeypatch.setattr(multi_start, "searched_among_others", lambda _, best, *__: searches.append(best) or best)
    for doubt in ("images_contradict", "is_doubtful"):
        monkeypatch.setattr(multi_start, doubt, lambda *_: True)
    alone = BOTH.alone(1)
    first = told.found(alone, WRONG)
    monkeypatch.setattr(multi_start, "with_whole_turn", lambda _problem, start, first, *_: (start, first))
    found = multi_start.turned_and_searched(alone, WRONG, first, Workspace())
    assert searches == [first] and found.motions is first.motions


@pytest.mark.parametrize(
    ("finds", "doubted", "rounds"), [(0, 9, 1), (2, 9, 3), (9, 1, 2), (9, 9, multi_start.MAX_SEARCH_ROUNDS)]
)
def test_one_of_several_performers_is_searched_as_long_as_limbs_are_found_and_the_images_contradict(
    monkeypatch: pytest.MonkeyPatch, told: Told, finds: int, doubted: int, rounds: int
) -> None:
    """A fast arm may be found in one round and its other in the next, by other random poses."""
    seeds: list[int] = []
    doubts = iter([[1]] * doubted + [[]] * 9)

    def search(_: object, best: SegmentSolution, seed: int, *__: object) -> SegmentSolution:
        seeds.append(seed)
        return replace(best)  # solved further, at least

    def elsewhere(*_: object) -> bool:
        return seeds[-1] < finds

    monkeypatch.setattr(multi_start, "searched_among_others", search)
    monkeypatch.setattr(multi_start, "limbs_elsewhere", elsewhere)
    monkeypatch.setattr(multi_start, "doubted_performers", lambda *_: next(doubts))
    monkeypatch.setattr(multi_start, "with_whole_turn", lambda _problem, start, first, *_: (start, first))
    alone = BOTH.alone(1)
    multi_start.turned_and_searched(alone, WRONG, told.found(alone, WRONG), Workspace())
    assert seeds == list(range(rounds))


@pytest.mark.parametrize("right", ["turned", "straight"])
def test_a_turn_of_one_of_several_performers_is_taken_only_if_it_is_likelier_once_limbs_are_searched_for(
    monkeypatch: pytest.MonkeyPatch, told: Told, right: str
) -> None:
    """As long as limbs are lost, a wrong turn may cover more than none."""
    alone, far = BOTH.alone(1), [moved(truth, np.array([0.3, 0.0, 0.0])) for truth in TRUTHS]
    first, turned = told.found(alone, far), told.found(alone, WRONG)
    found = {"straight": first, "turned": turned}[right]

    def search(_: object, best: SegmentSolution, *__: object) -> SegmentSolution:
        return told.found(alone, TRUTHS) if best is found else best

    def likeliest(_: object, __: object, *solutions: SegmentSolution, workspace: Workspace) -> SegmentSolution:
        return max(solutions, key=lambda one: one.cover)

    monkeypatch.setattr(multi_start, "with_whole_turn", lambda _problem, start, *_: (start, turned))
    monkeypatch.setattr(multi_start, "searched_among_others", search)
    monkeypatch.setattr(multi_start, "doubted_performers", lambda *_: [])
    monkeypatch.setattr(multi_start, "noise_at", lambda *_: None)
    monkeypatch.setattr(multi_start, "likeliest_at_rest", likeliest)
    best = multi_start.turned_and_searched(alone, far, first, Workspace())
    assert list(best.motions) == list(TRUTHS)


@pytest.mark.parametrize(("contradicted", "rounds"), [(True, multi_start.MAX_SEARCH_ROUNDS), (False, 1)])
def test_without_a_turn_that_the_images_agree_with_limbs_are_searched_for_only_once(
    monkeypatch: pytest.MonkeyPatch, told: Told, contradicted: bool, rounds: int
) -> None:
    """Where the right turn is missed, search after search finds limbs somewhere, and all in vain."""
    alone = BOTH.alone(1)
    first, turned = told.found(alone, WRONG), told.found(alone, TRUTHS)
    searches: list[SegmentSolution] = []

    def search(_: object, best: SegmentSolution, *__: object) -> SegmentSolution:
        if best is not turned:
            searches.append(best)
        return best

    def doubted(_: object, __: object, solution: SegmentSolution) -> list[int]:
        return [1] if contradicted or solution is not turned else []

    monkeypatch.setattr(multi_start, "with_whole_turn", lambda _problem, start, *_: (start, turned))
    monkeypatch.setattr(multi_start, "searched_among_others", search)
    monkeypatch.setattr(multi_start, "limbs_elsewhere", lambda *_: True)
    monkeypatch.setattr(multi_start, "doubted_performers", doubted)
    monkeypatch.setattr(multi_start, "noise_at", lambda *_: None)
    monkeypatch.setattr(multi_start, "likeliest_at_rest", lambda _problem, _noise, *both, workspace: both[0])
    assert list(multi_start.turned_and_searched(alone, WRONG, first, Workspace()).motions) == list(TRUTHS)
    assert len(searches) == rounds
