"""Limbs that may be lost are searched for, one or a pair at once, for as long as that makes the images likelier."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.limbs import limb_pairs
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.solvers.assessment.settled_solutions import SettledSolution, SettledSolutions
from kfmocap.core.tracking.solvers.assessment.solution_ranking import RESTING_GAIN
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.equations.segment_equations import SegmentNoise
from kfmocap.core.tracking.solvers.gauss_newton import VainTest
from kfmocap.core.tracking.solvers.limb_corrections import limb_gains, limb_groups, limb_proposals
from kfmocap.core.tracking.solvers.limb_corrections.limb_gains import LEAST_GAIN, is_promising
from kfmocap.core.tracking.solvers.limb_corrections.limb_groups import (
    likeliest_found,
    with_limbs_found,
    with_limbs_moved,
)
from kfmocap.core.tracking.solvers.limb_corrections.limb_proposals import SEARCH_RATE, LimbGroup, frames_searched
from kfmocap.core.tracking.solvers.limb_corrections.limb_search import LimbSearch
from kfmocap.core.tracking.solvers.limb_corrections.local_trials import ADAPTATION_TIME, HELD_FRAMES
from kfmocap.core.tracking.solvers.limb_corrections.search_rounds import MAX_SEARCH_ROUNDS, MAX_VAIN_ROUNDS
from kfmocap.core.tracking.solvers.thinned_frames import ThinnedProblem
from made_evidence import Landscape
from synthetic import CAMERAS, at_rest, dark, ends_held

BODY, FPS = human(), 30.0
PAIR = limb_pairs(BODY)[0]


def seen_by(cameras: int, frames: int = 16, performers: int = 1) -> SegmentProblem:
    views = tuple(view for camera in CAMERAS[:cameras] for view in dark(camera, frames))
    return SegmentProblem(views, (BODY,) * performers, 0, FPS, (ends_held(BODY, frames),) * performers)


def turned(motion: Motion, chain: Sequence[int], frames: slice = slice(1, -1), angle: float = 0.9) -> Motion:
    """A limb elsewhere on some frames between the key poses."""
    turns = np.zeros((len(motion), 3))
    turns[frames, 0] = angle
    Q = motion.rotations.copy()
    Q[:, chain[0]] = Q[:, chain[0]] @ rotations.exp(turns)
    return Motion(motion.translations, Q)


def angles(motion: Motion) -> tuple[int, int]:
    """How far the limbs of the pair have turned at most, in tenths of a radian."""
    each = [np.linalg.norm(rotations.log(motion.rotations[:, chain[0]]), axis=-1).max() for chain in PAIR]
    return round(10 * each[0]), round(10 * each[1])


@dataclass
class World:
    """A search that turns some limbs on some frames, and how likely images are by where limbs are."""

    likelihood: dict[tuple[int, int], float]
    found: Sequence[Sequence[int]] = ()
    angle: float = 0.9
    frames: slice = field(default_factory=lambda: slice(1, -1))
    back: float = 0.0
    """By how much the first limb turns when it is solved for."""
    leaps: bool = False
    """Whether limbs leap to where they are found."""
    promising: bool = True
    """Whether pixels gain where limbs are found."""
    drawn: int = 0
    settled: int = 0
    solved: list[tuple[int, int]] = field(default_factory=list)
    """First frame and length of what was solved."""
    tried: list[tuple[int, int]] = field(default_factory=list)
    """Where the limbs were in it."""

    further: list[SegmentSolution] = field(default_factory=list)
    """What was solved further."""

    def settled_further(self, *given: SegmentSolution, **_: object) -> SegmentSolution:
        self.further.append(given[2])
        return given[2]

    def search(
        self, _problem: object, motions: Sequence[Motion], place: tuple[int, Sequence[int]], *_: object, **__: object
    ) -> Motion:
        i, chain = place
        self.drawn += 1
        return turned(motions[i], chain, self.frames, self.angle) if chain in self.found else motions[i]

    def after(self, monkeypatch: pytest.MonkeyPatch, problem: SegmentProblem, group: LimbGroup) -> SegmentSolution:
        """Search for a group of limbs, from a solution at rest."""
        begin = self.begun(monkeypatch, problem)
        return with_limbs_found(problem, begin, group, SettledSolutions(), Workspace())

    def begun(self, monkeypatch: pytest.MonkeyPatch, problem: SegmentProblem) -> SegmentSolution:
        """Put this world in the place of the images, and return a solution at rest."""
        rest = [at_rest(BODY, problem.length)] * len(problem.bodies)
        begin = Landscape(truth=rest[0]).solution(seen_by(2, problem.length), rest[0])
        begin = replace(begin, motions=tuple(rest))
        noise = SegmentNoise(*(np.ones((2, problem.length - 1, *more)) for more in ((1,), ())), np.ones(2))

        def solved(some: SegmentProblem, motions: Sequence[Motion], *_: object, **__: object) -> SegmentSolution:
            self.solved.append((some.first, some.length))
            self.tried.append(angles(motions[0]))
            return replace(begin, motions=(turned(motions[0], PAIR[0], angle=self.back), *motions[1:]))

        def settled(*_: object) -> SettledSolution:
            self.settled += 1
            return SettledSolution(begin, noise, begin)

        monkeypatch.setattr(limb_proposals, "freed_limb", self.search)
        monkeypatch.setattr(limb_groups, "solved_from", solved)
        monkeypatch.setattr(limb_proposals, "views_of", lambda *_: [])
        monkeypatch.setattr(limb_proposals, "is_promising", lambda *_, **__: self.promising)
        monkeypatch.setattr(SettledSolutions, "noise", lambda *_: noise)
        monkeypatch.setattr(ThinnedProblem, "at_rate", lambda *_: None)
        monkeypatch.setattr(limb_groups, "settled_further", self.settled_further)
        monkeypatch.setattr(limb_groups, "leaps_farther", lambda *_: self.leaps)
        monkeypatch.setattr(limb_groups, "likelihood", lambda _p, _n, one: self.likelihood[angles(one.motions[0])])
        monkeypatch.setattr(SettledSolutions, "after", settled)
        monkeypatch.setattr(SettledSolution, "after", settled)
        return begin


ONE, BOTH = LimbGroup(0, (PAIR[0],)), LimbGroup(0, PAIR)
MUCH = 2 * LEAST_GAIN


def test_both_limbs_are_moved_where_the_images_are_less_likely_with_only_one_of_them_moved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gains = {(0, 0): 0.0, (9, 0): -MUCH, (0, 9): -MUCH, (9, 9): MUCH, (18, 18): 0.0}
    found = World(gains, PAIR).after(monkeypatch, seen_by(2), BOTH)
    assert angles(found.motions[0]) == (9, 9)


def test_a_limb_is_searched_for_around_where_it_was_found_until_that_is_in_vain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One that moves fast is not reached in one round."""
    world = World({(0, 0): 0.0, (9, 0): MUCH, (18, 0): 2 * MUCH, (27, 0): MUCH}, PAIR[:1])
    assert angles(world.after(monkeypatch, seen_by(2), ONE).motions[0]) == (18, 0)
    assert world.tried == [(9, 0), (18, 0), *[(27, 0)] * MAX_VAIN_ROUNDS]


@pytest.mark.parametrize(("performers", "rounds"), [(1, MAX_VAIN_ROUNDS), (2, 1)])
@pytest.mark.parametrize("found", [True, False])
def test_the_search_ends_after_rounds_in_vain(
    monkeypatch: pytest.MonkeyPatch, performers: int, rounds: int, found: bool
) -> None:
    """Limbs that are found where they were cost no solving; of one of several performers, one round is enough."""
    world = World({(0, 0): 0.0, (9, 0): -MUCH}, PAIR[:1] if found else ())
    solution = world.after(monkeypatch, seen_by(2, performers=performers), ONE)
    assert angles(solution.motions[0]) == (0, 0)
    assert world.tried == [(9, 0)] * rounds * found and world.settled == found


def test_where_frames_follow_each_other_closely_a_limb_is_drawn_on_some_of_them_and_judged_on_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On a third of the frames a limb that is lost gains a third of what it must gain."""
    problem, kept, drawn_on = seen_by(2), np.array([0, 3, 6, 9, 12, 15]), []
    world = World(defaultdict(float, {(10, 0): MUCH}), PAIR[:1])  # a spline goes beyond 9

    def search(some: SegmentProblem, motions: Sequence[Motion], *given: object, **how: object) -> Motion:
        drawn_on.append((some.length, len(motions[0])))
        return World.search(world, some, motions, *given, **how)  # type: ignore[arg-type]

    monkeypatch.setattr(world, "search", search)
    monkeypatch.setattr(ThinnedProblem, "of", lambda whole, _: ThinnedProblem.at(whole, kept, 3))
    [found] = world.after(monkeypatch, problem, ONE).motions
    assert angles(found) == (10, 0)
    assert set(drawn_on) == {(len(kept), len(kept))} and {length for _, length in world.solved} == {problem.length}
    turned_by = np.linalg.norm(rotations.log(found.rotations[:, PAIR[0][0]]), axis=-1)
    np.testing.assert_allclose(turned_by[3:13], 0.9, atol=0.1)
    others = np.setdiff1d(np.arange(len(BODY)), PAIR[0][0])
    np.testing.assert_array_equal(found.rotations[:, others], at_rest(BODY, problem.length).rotations[:, others])


@pytest.mark.parametrize(
    ("views", "performers", "found", "promising", "drawn"),
    [
        (2, 1, False, True, ["rough"]),
        (2, 1, True, False, ["rough"]),
        (2, 1, True, True, ["rough", *["fine"] * MAX_VAIN_ROUNDS]),
        (1, 1, True, False, ["fine"] * MAX_VAIN_ROUNDS),
        (2, 2, True, True, ["thinned"]),
    ],
)
def test_limbs_of_a_single_performer_in_several_views_are_searched_for_only_where_a_rough_search_promises_something(
    monkeypatch: pytest.MonkeyPatch, views: int, performers: int, found: bool, promising: bool, drawn: list[str]
) -> None:
    """Most are right where they are. One of several performers is searched for on some of the frames in any case."""
    problem, kept, kinds = seen_by(views, performers=performers), np.arange(0, 16, 3), list[str]()
    world = World(defaultdict(float), PAIR[:1] if found else (), promising=promising)
    begin = world.begun(monkeypatch, problem)
    monkeypatch.setattr(ThinnedProblem, "at_rate", lambda whole, _: ThinnedProblem.at(whole, kept, 3))

    def freed(
        some: SegmentProblem, motions: Sequence[Motion], *given: object, search: LimbSearch, **how: object
    ) -> Motion:
        kinds.append("rough" if search.roughly else "thinned" if some.length == len(kept) else "fine")
        assert (kinds[-1] == "fine") is (some.length == problem.length)
        return world.search(some, motions, *given, **how)  # type: ignore[arg-type]

    monkeypatch.setattr(limb_proposals, "freed_limb", freed)
    with_limbs_found(problem, begin, ONE, SettledSolutions(), Workspace())
    assert kinds == drawn


@pytest.mark.parametrize(("step", "rough"), [(5, [4]), (2, [])])
def test_where_frames_are_left_out_a_rough_search_comes_first_if_it_leaves_out_more(
    monkeypatch: pytest.MonkeyPatch, step: int, rough: list[int]
) -> None:
    problem, kept, drawn_on = seen_by(2), np.append(np.arange(0, 15, 2), 15), list[int]()
    world = World(defaultdict(float), PAIR[:1])
    begin = world.begun(monkeypatch, problem)
    few = kept if step == 2 else np.arange(0, 16, step)
    monkeypatch.setattr(ThinnedProblem, "of", lambda whole, _: ThinnedProblem.at(whole, kept, 2))
    monkeypatch.setattr(ThinnedProblem, "at_rate", lambda whole, _: ThinnedProblem.at(whole, few, step))

    def freed(
        some: SegmentProblem, motions: Sequence[Motion], *given: object, search: LimbSearch, **how: object
    ) -> Motion:
        drawn_on.append(some.length)
        assert search.roughly is (some.length < len(kept))
        return world.search(some, motions, *given, **how)  # type: ignore[arg-type]

    monkeypatch.setattr(limb_proposals, "freed_limb", freed)
    with_limbs_found(problem, begin, ONE, SettledSolutions(), Workspace())
    assert drawn_on == [*rough, *[len(kept)] * MAX_VAIN_ROUNDS]


def test_limbs_of_a_pair_are_promising_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each may have been found where the other one was, so that none gains alone."""
    thinned, rest = ThinnedProblem.with_all(seen_by(2)), at_rest(BODY, 16)
    both = turned(turned(rest, PAIR[0]), PAIR[1])

    def gain(_problem: object, motions: Sequence[Motion], *_: object) -> float:
        return {(0, 0): -LEAST_GAIN, (9, 0): 1.7 * LEAST_GAIN}[angles(motions[0])]

    monkeypatch.setattr(limb_gains, "_gain_elsewhere", gain)
    assert is_promising(thinned, [rest], (0, PAIR), both, [], share=0.5)
    assert not is_promising(thinned, [rest], (0, PAIR), both, [])
    assert not is_promising(thinned, [rest], (0, PAIR[:1]), both, [], share=0.5)


@pytest.mark.parametrize("gain", [-MUCH, 2 * RESTING_GAIN, MUCH])
def test_the_likeliest_limb_is_returned_however_little_it_gains(monkeypatch: pytest.MonkeyPatch, gain: float) -> None:
    world, problem = World({(0, 0): 0.0, (9, 0): gain, (18, 0): -MUCH}, PAIR[:1]), seen_by(2)
    found = likeliest_found(problem, world.begun(monkeypatch, problem), ONE, SettledSolutions(), Workspace())
    assert (None if found is None else angles(found.motions[0])) == (None if gain < 0 else (9, 0))


def test_the_likeliest_limb_is_sought_until_a_round_leads_back(monkeypatch: pytest.MonkeyPatch) -> None:
    world, problem = World(defaultdict(lambda: MUCH, {(0, 0): 0.0}), PAIR[:1], back=-0.85), seen_by(2)
    assert likeliest_found(problem, world.begun(monkeypatch, problem), ONE, SettledSolutions(), Workspace()) is None
    assert len(world.tried) == 1 and not world.further


def test_limbs_are_not_solved_for_where_that_promises_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The round counts as one in vain."""
    world = World({(0, 0): 0.0, (9, 0): MUCH}, PAIR[:1], promising=False)
    assert angles(world.after(monkeypatch, seen_by(2), ONE).motions[0]) == (0, 0)
    assert not world.tried and not world.settled and world.drawn == MAX_VAIN_ROUNDS


@pytest.mark.parametrize("gain", [LEAST_GAIN / 2, MUCH])
def test_a_limb_that_was_found_on_some_frames_is_moved_by_what_it_gains_on_all(
    monkeypatch: pytest.MonkeyPatch, gain: float
) -> None:
    world, problem = World({(0, 0): 0.0, (9, 0): gain}), seen_by(2)
    begin = world.begun(monkeypatch, problem)
    elsewhere = [turned(begin.motions[0], PAIR[0], angle=0.9)]
    found = with_limbs_moved(problem, begin, ONE, elsewhere, Workspace())
    assert angles(found.motions[0]) == ((9, 0) if gain > LEAST_GAIN else (0, 0))
    assert world.tried == [(9, 0)] and world.further


def test_the_search_ends_after_some_rounds_though_each_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World({(3 * k, 0): MUCH * k for k in range(2 + MAX_SEARCH_ROUNDS)}, PAIR[:1], angle=0.3)
    world.after(monkeypatch, seen_by(2), ONE)
    assert len(world.tried) == 1 + MAX_SEARCH_ROUNDS


@pytest.mark.parametrize(
    ("gain", "back", "doubted", "performers", "moved"),
    [
        (MUCH, 0.0, (), 1, True),
        (LEAST_GAIN / 2, 0.0, (), 1, False),
        (MUCH, -0.85, (), 1, False),
        (LEAST_GAIN / 2, -0.85, (0,), 1, True),
        (LEAST_GAIN / 2, 0.0, (0,), 2, False),
    ],
)
def test_limbs_stay_where_they_were_unless_the_images_are_clearly_likelier_with_them_elsewhere(
    monkeypatch: pytest.MonkeyPatch, gain: float, back: float, doubted: tuple[int, ...], performers: int, moved: bool
) -> None:
    """What is likelier with limbs where they were, as near as a descent reaches, is chance, unless the images
    contradicted the motion of a single performer."""
    there = (round(10 * (0.9 + back)), 0)
    world = World({(0, 0): 0.0, there: gain, (2 * there[0], 0): 0.0}, PAIR[:1], back=back)
    problem = replace(seen_by(2, performers=performers), doubted=doubted)
    found = world.after(monkeypatch, problem, ONE)
    assert angles(found.motions[0]) == (there if moved else (0, 0))
    assert len(world.tried) > 0


@pytest.mark.parametrize(("doubted", "performers", "moved"), [((), 1, False), ((0,), 1, True), ((0,), 2, True)])
def test_limbs_that_the_images_do_not_contradict_do_not_leap_away(
    monkeypatch: pytest.MonkeyPatch, doubted: tuple[int, ...], performers: int, moved: bool
) -> None:
    world = World({(0, 0): 0.0, (9, 0): MUCH, (18, 0): 0.0}, PAIR[:1], leaps=True)
    found = world.after(monkeypatch, replace(seen_by(2, performers=performers), doubted=doubted), ONE)
    assert angles(found.motions[0]) == ((9, 0) if moved else (0, 0))


@pytest.mark.parametrize(("views", "moved"), [(1, True), (2, False)])
def test_a_single_view_moves_limbs_for_a_small_gain(monkeypatch: pytest.MonkeyPatch, views: int, moved: bool) -> None:
    """It hardly shows how far they point towards it."""
    world = World({(0, 0): 0.0, (9, 0): 1.0, (18, 0): 2.0, (27, 0): 0.0}, PAIR[:1])
    assert angles(world.after(monkeypatch, seen_by(views), ONE).motions[0]) == ((18, 0) if moved else (0, 0))


def test_each_round_of_a_search_is_reported_without_motions(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search may take most of the time; motions are those before an iteration."""
    world, problem, told = World({(0, 0): 0.0, (9, 0): MUCH, (18, 0): 0.0}, PAIR[:1]), seen_by(2), []
    workspace = Workspace(on_step=lambda done, motions: told.append((done, len(motions))))
    with_limbs_found(problem, world.begun(monkeypatch, problem), ONE, SettledSolutions(), workspace)
    assert told == [(turn / (1 + MAX_SEARCH_ROUNDS), 0) for turn in range(len(told))] and len(told) > 1


@pytest.mark.parametrize(("performers", "further"), [(1, True), (2, False)])
def test_a_limb_of_one_of_several_performers_that_is_led_back_is_solved_no_further(
    monkeypatch: pytest.MonkeyPatch, performers: int, further: bool
) -> None:
    """It would stay where it was, however likely that is, so that nothing is compared with it."""
    gains = {(0, 0): 0.0, (round(10 * (0.9 - 0.85)), 0): MUCH, (1, 0): MUCH}
    world = World(gains, PAIR[:1], back=-0.85)
    solution = world.after(monkeypatch, seen_by(2, performers=performers), ONE)
    assert angles(solution.motions[0]) == (0, 0)
    assert bool(world.further) is further and bool(world.settled) is further


@pytest.mark.parametrize("back", [False, True])
def test_a_limb_of_one_of_several_performers_is_solved_for_until_it_is_led_back(
    monkeypatch: pytest.MonkeyPatch, back: bool
) -> None:
    world, problem, asked = World(defaultdict(float), PAIR[:1]), seen_by(2, performers=2), list[bool]()
    begin = world.begun(monkeypatch, problem)

    def solved(_: object, motions: Sequence[Motion], *__: object, vain: VainTest) -> SegmentSolution:
        led = turned(motions[0], PAIR[0], angle=-0.85 if back else -0.1)
        asked.extend(vain(own) for own in (motions, [led, *motions[1:]]))
        return begin

    monkeypatch.setattr(limb_groups, "solved_from", solved)
    with_limbs_found(problem, begin, ONE, SettledSolutions(), Workspace())
    assert asked == [False, back]


@pytest.mark.parametrize(("fps", "every"), [(10.0, 1), (20.0, 1), (25.0, 2), (30.0, 2), (60.0, 4)])
def test_limbs_of_one_of_several_are_drawn_on_at_least_twelve_frames_per_second(fps: float, every: int) -> None:
    """Or on all, if there are fewer. Key poses of the others do not matter for them."""
    problem = replace(seen_by(2, 41, performers=2), fps=fps)
    keyed = replace(problem, fixed=(problem.fixed[0], np.ones_like(problem.fixed[1])))
    for each in (problem, keyed):
        with np.errstate(all="raise"):
            frames = frames_searched(each.alone(0), [at_rest(BODY, 41)] * 2).frames
        assert np.diff(frames).max() == every and (fps / every >= SEARCH_RATE or every == 1)


LONG, AWAY = 80, slice(40, 46)
BESIDE = HELD_FRAMES + round(ADAPTATION_TIME * FPS)


@pytest.mark.parametrize("gain", [-MUCH, MUCH])
def test_a_limb_that_is_elsewhere_on_few_frames_is_tried_on_these_first(
    monkeypatch: pytest.MonkeyPatch, gain: float
) -> None:
    world = World({(0, 0): 0.0, (9, 0): gain, (18, 0): 0.0}, PAIR[:1], frames=AWAY)
    found = world.after(monkeypatch, seen_by(2, LONG), ONE)
    few = (AWAY.start - BESIDE, AWAY.stop - AWAY.start + 2 * BESIDE)
    assert world.solved[:3] == [few, few, (0, LONG) if gain > 0 else few]
    assert angles(found.motions[0]) == ((9, 0) if gain > 0 else (0, 0))
