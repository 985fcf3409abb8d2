"""Standing feet: points of the soles that may be standing, by the evidence, are brought to rest.

Candidate plants are found in a motion that was refined without plants. A foot that creeps slowly is a candidate, too,
but must not be held, so each plant is tested as a whole: the increase of the least cost of the normal equations, if the
point stands still throughout, has a chi-squared distribution with three degrees of freedom per step. It takes the full
covariance of the steps into account, in which a drift over many frames weighs more than jitter. The covariance of the
normal equations is first scaled by the ratio of errors to it that the shot shows for leg and foot: key poses that were
predicted without themselves are missed by more where feet are half hidden. The pictures around the point are asked as
well whether it stands or moves as it was tracked: they do not depend on the shape of the foot, whose errors make it
drift. A plant that passes takes in the frames on which the other point of the foot stands, if the evidence or the
pictures of these agree: a flicker of the evidence seems to end it. Smoothness blurs the moments at which a foot lands
and leaves, so plants also take in the frames beside them on which the point may stand, too: the evidence has nothing
against it, or the pictures show the point in its place. Two plants of a point with no time for a step between them
become one if that passes as well. Those that are brief all the same are left out. Then all are held together, on the
same normal equations.

A single view hardly contradicts any plant. With one view, candidates are kept still during the refinement already, and
nothing is tested here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import chdtri, fdtri

from ...body.foot_plants import MIN_DURATION
from ...body.kinematics import Poses, part_poses, twist_jacobian
from ...body.motion import Motion
from ...body.soles import Soles
from ...evidence.standing_points import RADIUS, log_gain_by_displacement, log_odds_of_standing
from ...numerics import rotations
from ...numerics.arrays import Array, Bools
from ...numerics.banded import BandedFactor
from ...numerics.banded_blocks import BandedBlocks
from ...numerics.frame_ranges import runs
from ...numerics.robust_kernels import Quadratic
from .apparent_plants import Plant, Seeming, joined
from .equations.hold_factor import TiedSystems, tied_systems
from .equations.plant_factor import PlantFactor
from .equations.problem import SegmentProblem, SegmentSolution
from .equations.segment_equations import equations_at
from .gauss_newton import increments_of, moved_by
from .place_covariance import PlaceCovariance
from .protocol import SettledMotions, SolvedFrames

SIGNIFICANCE = 0.01
"""Significance level of the test: share of true plants that it rejects if the covariance is right."""
JOINING_SIGNIFICANCE = 0.1
"""Significance level at which a frame beside a plant that passed is refused: the step to it is tested by itself."""
REST_SPEED_SIGMA = 0.005
"""Standard deviation of the velocity of a standing point along each axis, metres per second."""
PICTURES_ODDS = 10.0
"""How many times likelier the pictures around a point must be if it stands than if it moves as it was tracked, for a
plant to pass though the normal equations say otherwise, as far as these may be wrong."""
SHOE_HEIGHT = 0.02
"""Height above the sole of what is looked at in the pictures, metres: the side of a shoe."""
RATIO_COUNT = 12.0
"""Number of squared errors from which the ratio of errors to the covariance is known: those of a part at two key poses,
along three axes, and as many of the whole body."""
FLICKER = 0.2
"""For how long the evidence may be against a plant that goes on, seconds, as long as it is for it over all."""
NEWTON_STEPS = 4
"""Gauss-Newton steps, all on the same normal equations."""


def with_standing_feet(
    problem: SegmentProblem, solution: SegmentSolution, before: SolvedFrames, ratios: Sequence[Array]
) -> SettledMotions:
    """Correct the motions of a solution so that standing feet are at rest; the `settle` of Gauss-Newton.

    Degrees of freedom that key poses fix do not change, nor do performers whose feet do not stand.

    Parameters
    ----------
    problem : SegmentProblem
        The problem that was solved.
    solution : SegmentSolution
        With its evidence.
    before : SolvedFrames
        The motions before refinement, which were solved with plants: there plants have their full length, while in the
        solution they may be broken up. What the feet do on the segments beside shows how fast a standing one is at
        most, and whether a plant at an end of the segment goes on.
    ratios : sequence of ndarray, shape (P,)
        Per performer: squared errors of the parts' tips over those that the normal equations predict, see
        `core.tracking.expected_errors.held_out_keys`.
    """
    if not problem.settings.plants or not problem.shows_depth:
        return SettledMotions(solution.motions, (None,) * len(solution.motions))
    return with_plants_at_rest(problem, equations_at(problem, solution), solution.motions, before, ratios=ratios)


def with_plants_at_rest(
    problem: SegmentProblem,
    systems: Sequence[BandedBlocks],
    motions: tuple[Motion, ...],
    before: SolvedFrames,
    *,
    ratios: Sequence[Array],
) -> SettledMotions:
    """Correct motions so that standing feet are at rest.

    Parameters
    ----------
    problem : SegmentProblem
    systems : sequence of BandedBlocks
        Normal equations of each performer at the motions, without those of plants and holds.
    motions, before, ratios
        See `with_standing_feet`.
    """
    planted: list[Bools | None] = [None] * len(motions)
    for members in problem.tied(systems, motions).groups:
        evidence = _Evidence(problem, members, systems, motions)
        standing = {}
        for i in members:
            now = before.motions[i].replaced(before.first, motions[i])
            seeming, earlier = (Seeming.of(problem, i, motion, before.first) for motion in (now, before.motions[i]))
            if seeming is not None:
                keyed, fitting = evidence.plants_that_fit(i, seeming, earlier, ratios[i])
                planted[i] = keyed.frames | fitting.frames
                if fitting.steps.any():
                    standing[i] = fitting
            elif (soles := Soles.of(problem.bodies[i])) is not None:
                planted[i] = np.zeros((problem.length, len(soles.names)), bool)
        if standing:
            motions = evidence.with_plants_held(standing)
    return SettledMotions(motions, tuple(planted))


@dataclass(frozen=True, eq=False)
class _Evidence:
    """The normal equations of performers that holds tie to each other, the members, linearised at motions of all.

    Attributes
    ----------
    odds : dict
        Results of `_log_odds` by the performer, the plant's point and its steps: several tests ask for the same.
    tracked : dict
        World poses of the parts of each performer in its motion.
    soles : dict
        Where all points of a performer's soles were tracked, shape (F, C, 3).
    places : dict
        The `PlaceCovariance` of each point by the performer and the point.
    """

    problem: SegmentProblem
    members: Sequence[int]
    systems: Sequence[BandedBlocks]
    motions: tuple[Motion, ...]
    odds: dict[tuple[object, ...], float] = field(default_factory=dict)
    tracked: dict[int, Poses] = field(default_factory=dict)
    soles: dict[int, Array] = field(default_factory=dict)
    places: dict[tuple[int, int], PlaceCovariance] = field(default_factory=dict)

    def plants_that_fit(
        self, performer: int, seeming: Seeming, earlier: Seeming | None, ratios: Array
    ) -> tuple[PlantFactor, PlantFactor]:
        """Return the apparent plants of a member that are held: those between key poses on neighbouring frames, which
        nothing moves, and those that pass the tests, with the frames beside them that do, unless they are brief.

        Parameters
        ----------
        performer : int
        seeming, earlier : Seeming
            As found now, and before the refinement.
        ratios : ndarray, shape (P,)
        """
        problem = self.problem
        body, held = problem.bodies[performer], problem.fixed[performer].all(axis=1)
        movable = ~(held[1:] & held[:-1])
        plants = seeming.plants
        found = np.zeros_like(plants.steps)
        for c, column in enumerate(plants.steps.T):
            part = plants.soles.parts[c]
            ratio = float(ratios[[part, max(body.parents[part], 0)]].mean())  # a sole lies between the tips of both
            longer = [] if earlier is None else runs(earlier.plants.steps[:, c] & movable)
            beside = runs(seeming.beside(c, earlier) & movable)
            fitting: list[Plant] = []
            for run in runs(column & movable):
                tried = [Plant(plants, c, steps) for steps in dict.fromkeys((joined(run, longer), run))]
                one = next((plant for plant in tried if self._agrees(performer, plant, ratio)), None)
                if one is not None:
                    whole = replace(one, steps=joined(one.steps, beside))
                    one = whole if self._goes_on(performer, one, whole, ratio) else one
                    one = self._lengthened(performer, one, ratio, movable)
                    fitting = self._with_next(performer, fitting, one, ratio, movable)
            for plant in fitting:
                if seeming.steps_around(plant) >= MIN_DURATION * problem.fps:
                    found[plant.steps[0] : plant.steps[1] + 1, c] = True
        keyed = replace(plants, steps=plants.steps & ~movable[:, None])
        return keyed, PlantFactor(plants.soles, found, REST_SPEED_SIGMA / problem.fps, Quadratic())

    def with_plants_held(self, plants: Mapping[int, PlantFactor]) -> tuple[Motion, ...]:
        """Solve for the motions with the planted points of members at rest."""
        motions = self.motions
        for _ in range(NEWTON_STEPS):
            tied = self._with_plants(plants, motions)
            motions = moved_by(motions, increments_of(tied, [system.solve(0.0) for system in tied.systems]))
        return motions

    def _key_poses_agree(self, performer: int, plant: PlantFactor) -> bool:
        """Test whether key poses, which are exact, have the point of a plant in one place: a steady drift between them
        would hide among the many steps.
        """
        frames, column = plant.frames.any(axis=1), plant.steps.any(axis=0)
        keyed = np.flatnonzero(frames & self.problem.fixed[performer].all(axis=1))
        if len(keyed) < 2:
            return True
        R, T = self._poses(performer)
        ends = keyed[[0, -1]]
        drift = np.diff(plant.soles.world((R[ends], T[ends]))[:, column], axis=0)
        return bool(np.sum(drift**2) < np.ptp(keyed) * plant.sigma**2 * chdtri(3, SIGNIFICANCE))

    def _agrees(self, performer: int, plant: Plant, ratio: float) -> bool:
        """Test a plant against key poses, pictures, and the evidence, whose covariance is multiplied by a ratio.

        Whoever moves may do so on every step along three axes, and explains the pictures better by chance. As the ratio
        is known from a few errors only, a plant that it refuses passes as long as the pictures have nothing against it:
        no drift, along three axes, explains them better than it would by chance. One that they show
        to stand may cost more.
        """
        if not self._key_poses_agree(performer, plant.factor):
            return False
        axes, odds = 3 * len(plant), self._log_odds(performer, plant)
        if 2 * odds < -chdtri(axes, SIGNIFICANCE):
            return False
        cost = self._cost(performer, plant, ratio)
        if odds > np.log(PICTURES_ODDS):
            return cost < _most_by_chance(axes, SIGNIFICANCE)
        within = chdtri(axes, SIGNIFICANCE)
        if 2 * odds > -chdtri(3, SIGNIFICANCE):
            within = max(within, _most_by_chance(axes))
        return cost < within

    def _goes_on(self, performer: int, plant: Plant, longer: Plant, ratio: float) -> bool:
        """Test whether a point stands on more frames than those of a plant that passed, by what these add. Pictures
        further from where it stands than what is compared do not say so.
        """
        if longer.steps == plant.steps or not self._key_poses_agree(performer, longer.factor):
            return False
        within = chdtri(3 * (len(longer) - len(plant)), SIGNIFICANCE)
        odds = self._log_odds(performer, longer) - self._log_odds(performer, plant)
        if 2 * odds < -within:
            return False
        if odds > np.log(PICTURES_ODDS) and self._way(performer, longer) < RADIUS:
            return True
        return self._cost(performer, longer, ratio) - self._cost(performer, plant, ratio) < within

    def _path(self, performer: int, plant: Plant) -> Array:
        """Where a plant's point was tracked, shape (F, 3)."""
        first, last = plant.steps
        return self._soles(performer, plant)[first : last + 2, plant.point]

    def _soles(self, performer: int, plant: Plant) -> Array:
        if performer not in self.soles:
            self.soles[performer] = plant.seeming.soles.world(self._poses(performer))
        return self.soles[performer]

    def _poses(self, performer: int) -> Poses:
        if performer not in self.tracked:
            self.tracked[performer] = part_poses(self.problem.bodies[performer], self.motions[performer])
        return self.tracked[performer]

    def _way(self, performer: int, plant: Plant) -> float:
        """How far a plant's point was tracked from its mean place at most, metres."""
        path = self._path(performer, plant)
        return float(np.linalg.norm(path - path.mean(axis=0), axis=1).max())

    def _log_odds(self, performer: int, plant: Plant) -> float:
        """Logarithm of how much likelier the pictures are if a plant's point stands than if it moves as tracked."""
        problem, asked = self.problem, (performer, plant.point, plant.steps)
        if asked not in self.odds:
            first, path = problem.first + plant.steps[0], self._path(performer, plant) + [0.0, 0.0, SHOE_HEIGHT]
            self.odds[asked] = sum(log_odds_of_standing(view, first, path) for view in problem.views)
        return self.odds[asked]

    def _lengthened(self, performer: int, plant: Plant, ratio: float, movable: Bools) -> Plant:
        """Return a plant that passed with the frames beside it on which the point may stand, too: one after the other,
        or several at once, over which a flicker of the evidence is no more.
        """
        cost, odds = self._cost(performer, plant, ratio), self._log_odds(performer, plant)
        most = max(round(FLICKER * self.problem.fps), 1)
        for before, after in ((1, 0), (0, 1)):
            steps = 1
            while steps <= most and (longer := plant.longer(steps * before, steps * after, movable)) is not None:
                more = self._cost(performer, longer, ratio) - cost
                beyond = more >= _most_by_chance(3 * most)
                if beyond and self._way(performer, longer) >= RADIUS:
                    break
                gain = self._log_odds(performer, longer) - odds
                stands = more < chdtri(3 * steps, JOINING_SIGNIFICANCE)
                stands = stands or (gain > 0 and more < _most_by_chance(3 * steps))
                stands = stands or (gain > np.log(PICTURES_ODDS) and self._stays(performer, plant, longer))
                if stands and self._key_poses_agree(performer, longer.factor):
                    plant, cost, odds, steps = longer, cost + more, odds + gain, 1
                else:
                    steps += 1
        return plant

    def _stays(self, performer: int, plant: Plant, longer: Plant) -> bool:
        """Test whether the pictures show a plant's point in its place on the frames that a longer one adds: none of
        them is explained better by a displacement, of two axes in each view, than it would be by chance every other
        time. Only nearby displacements are compared.
        """
        if self._way(performer, longer) >= RADIUS:
            return False
        place = self._path(performer, plant).mean(axis=0) + [0.0, 0.0, SHOE_HEIGHT]
        first, last = longer.steps[0], longer.steps[1] + 1
        frames = np.arange(first, last + 1)
        stood = (frames >= plant.steps[0]) & (frames <= plant.steps[1] + 1)
        start, views = self.problem.first + first, self.problem.views
        gains = np.stack([log_gain_by_displacement(view, start, place, stood) for view in views])[:, ~stood]
        shown = np.isfinite(gains).sum(axis=0)
        return bool(shown.all() and (2 * np.nansum(gains, axis=0) < chdtri(2 * shown, 0.5)).all())

    def _with_next(
        self, performer: int, plants: Sequence[Plant], following: Plant, ratio: float, movable: Bools
    ) -> list[Plant]:
        """Return plants of a point with the one that follows, if there is time for a step between it and the last of
        them. If not, as a foot that stands does not jump aside and stand again, they are one plant where the evidence
        agrees; else the longer one is kept.
        """
        if not plants:
            return [following]
        *before, last = plants
        between = slice(last.steps[1] + 1, following.steps[0])
        if between.stop - between.start > round(MIN_DURATION * self.problem.fps) or not movable[between].all():
            return [*plants, following]
        whole = replace(last, steps=(last.steps[0], max(last.steps[1], following.steps[1])))
        if not self._agrees(performer, whole, ratio):
            whole = max(last, following, key=len)
        return [*before, whole]

    def _cost(self, performer: int, plant: Plant, ratio: float) -> float:
        """Increase of the least cost of the evidence, whose covariance is multiplied by a ratio, by a plant.

        The normal equations are factorised once for all plants: what a plant adds depends on the covariance of its
        point's steps alone.
        """
        steps, covariance = self._place(performer, plant).steps(*plant.steps)
        covariance = ratio * covariance + plant.seeming.sigma**2 * np.eye(len(steps))
        return float(steps @ cho_solve(cho_factor(covariance, check_finite=False), steps, check_finite=False))

    def _place(self, performer: int, plant: Plant) -> PlaceCovariance:
        asked = performer, plant.point
        if asked not in self.places:
            (R, T), soles = self._poses(performer), plant.seeming.soles
            part, points = soles.parts[plant.point], self._soles(performer, plant)[:, plant.point]
            twist = twist_jacobian(self.problem.bodies[performer], R, T)[:, part]
            jacobian = twist[:, :3] - rotations.skew(points) @ twist[:, 3:]
            factor, step, places = self._without_plants
            own = places[performer]
            there = points + np.einsum("fid,fd->fi", jacobian, step[:, own])
            self.places[asked] = PlaceCovariance(factor, own, jacobian, there)
        return self.places[asked]

    @cached_property
    def _without_plants(self) -> tuple[BandedFactor, Array, dict[int, slice]]:
        """Factor of the normal equations without plants, the step to their least cost, and the slices of their degrees
        of freedom that belong to each member.
        """
        tied = self._with_plants({}, self.motions)
        [system], [places] = tied.systems, tied.places
        factor = system.factor()
        return factor, -factor.solve(system.blocks.gradient), places

    def _with_plants(self, plants: Mapping[int, PlantFactor], there: tuple[Motion, ...]) -> TiedSystems:
        """Move the normal equations to motions nearby, and add plants."""
        problem, systems = self.problem, list(self.systems)
        for i in self.members:
            increments = self.motions[i].difference(there[i])
            systems[i] = replace(systems[i], gradient=systems[i].gradient_at(increments))
            if i in plants:
                poses = self._poses(i) if there is self.motions else part_poses(problem.bodies[i], there[i])
                systems[i] = plants[i].blocks(problem.bodies[i], poses).add(systems[i])
        return tied_systems(systems, problem.holds, problem.bodies, there, fixed=problem.fixed, sought=self.members)


def _most_by_chance(axes: int, significance: float = JOINING_SIGNIFICANCE) -> float:
    """Largest cost of a plant, along so many axes, that is left to chance as the ratio is known from a few errors."""
    return float(axes * fdtri(axes, RATIO_COUNT, 1 - significance))
