"""What the normal equations and the pictures of a segment say about plants: points of the soles that stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import chdtri, fdtri

from ....body.kinematics import Poses, part_poses, twist_jacobian
from ....body.motion import Motion
from ....body.smoothness import limited
from ....evidence.standing_points import RADIUS, log_gain_by_displacement, log_odds_of_standing
from ....numerics import rotations
from ....numerics.arrays import Array
from ....numerics.banded import BandedFactor
from ....numerics.banded_blocks import BandedBlocks
from ..approach import increments_of, moved_by
from ..descent_stages import MIN_JOINT_MOVE
from ..equations.hold_factor import TiedSystems, tied_systems
from ..equations.plant_factor import PlantFactor
from ..equations.problem import SegmentProblem
from ..joint_moves import farthest_joint
from .apparent_plants import Plant, SolePoint
from .place_covariance import PlaceCovariance, TwistCovariance

SIGNIFICANCE = 0.01
"""Significance level of the test: share of true plants that it rejects if the covariance is right."""
JOINING_SIGNIFICANCE = 0.1
"""Significance level at which a frame beside a plant that passed is refused: the step to it is tested by itself."""
RATIO_COUNT = 12.0
"""Number of squared errors from which the ratio of errors to the covariance is known: those of a part at two key poses,
along three axes, and as many of the whole body."""
SHOE_HEIGHT = 0.02
"""Height above the sole of what is looked at in the pictures, metres: the side of a shoe."""
NEWTON_STEPS = 4
"""Gauss-Newton steps, all on the same normal equations."""
UNTESTED_SHARE = 0.5
"""Share of what is left to the least cost of the evidence without plants that is made when plants are held, if it moves
no joint by more than `MIN_JOINT_MOVE`. Such a step leads away from the true motion as often as to it, and no pictures
are evaluated on the way. As errors are convex along it, half of it is never worse than the mean of none and all."""


@dataclass(frozen=True, eq=False)
class PlantEvidence:
    """The normal equations of performers that holds tie to each other, the members, linearised at motions of all.

    Attributes
    ----------
    odds : dict
        Results of `log_odds` by the plant's point and its steps: several tests ask for the same.
    tracked : dict
        World poses of the parts of each performer in its motion.
    places : dict
        The `PlaceCovariance` of each point.
    twists : dict
        The `TwistCovariance` of each part by the performer and the part.
    """

    problem: SegmentProblem
    members: Sequence[int]
    systems: Sequence[BandedBlocks]
    motions: tuple[Motion, ...]
    odds: dict[tuple[SolePoint, tuple[int, int]], float] = field(default_factory=dict)
    tracked: dict[int, Poses] = field(default_factory=dict)
    places: dict[SolePoint, PlaceCovariance] = field(default_factory=dict)
    twists: dict[tuple[int, int], TwistCovariance] = field(default_factory=dict)

    def with_plants_held(self, plants: Mapping[int, PlantFactor]) -> tuple[Motion, ...]:
        """Solve for the motions with the planted points of members at rest, see `UNTESTED_SHARE`."""
        _, step, places = self._without_plants
        least = moved_by(self.motions, {i: limited(step[:, own]) for i, own in places.items()})
        share = 1.0 if farthest_joint(self.problem, self.motions, least) > MIN_JOINT_MOVE else UNTESTED_SHARE
        nearer = replace(self, systems=[replace(own, gradient=share * own.gradient) for own in self.systems])
        motions = self.motions
        for _ in range(NEWTON_STEPS):
            tied = nearer._with_plants(plants, motions)
            motions = moved_by(motions, increments_of(tied, [system.solve(0.0) for system in tied.systems]))
        return motions

    def key_poses_agree(self, plant: Plant) -> bool:
        """Test whether key poses, which are exact, have the point of a plant in one place: a steady drift between them
        would hide among the many steps.
        """
        first, last = plant.steps
        keyed = np.flatnonzero(self.problem.fixed[plant.performer].all(axis=1)[first : last + 2])
        if len(keyed) < 2:
            return True
        drift = np.diff(self.path(plant)[keyed[[0, -1]]], axis=0)
        return bool(np.sum(drift**2) < np.ptp(keyed) * plant.apparent.sigma**2 * chdtri(3, SIGNIFICANCE))

    def path(self, plant: Plant) -> Array:
        """Where a plant's point was tracked, shape (F, 3)."""
        first, last = plant.steps
        return self._tracked(plant.sole_point)[first : last + 2]

    def _tracked(self, point: SolePoint) -> Array:
        """Where a point was tracked on all frames, shape (F, 3)."""
        performer, part, local = point
        R, T = self._poses(performer)
        return R[:, part] @ np.array(local) + T[:, part]

    def _poses(self, performer: int) -> Poses:
        if performer not in self.tracked:
            self.tracked[performer] = part_poses(self.problem.bodies[performer], self.motions[performer])
        return self.tracked[performer]

    def way(self, plant: Plant) -> float:
        """How far a plant's point was tracked from its mean place at most, metres."""
        path = self.path(plant)
        return float(np.linalg.norm(path - path.mean(axis=0), axis=1).max())

    def log_odds(self, plant: Plant) -> float:
        """Logarithm of how much likelier the pictures are if a plant's point stands than if it moves as tracked."""
        problem, asked = self.problem, (plant.sole_point, plant.steps)
        if asked not in self.odds:
            first, path = problem.first + plant.steps[0], self.path(plant) + [0.0, 0.0, SHOE_HEIGHT]
            self.odds[asked] = sum(log_odds_of_standing(view, first, path) for view in problem.views)
        return self.odds[asked]

    def stays(self, plant: Plant, longer: Plant) -> bool:
        """Test whether the pictures show a plant's point in its place on the frames that a longer one adds: none of
        them is explained better by a displacement, of two axes in each view, than it would be by chance every other
        time. Only nearby displacements are compared.
        """
        if self.way(longer) >= RADIUS:
            return False
        place = self.path(plant).mean(axis=0) + [0.0, 0.0, SHOE_HEIGHT]
        first, last = longer.steps[0], longer.steps[1] + 1
        frames = np.arange(first, last + 1)
        stood = (frames >= plant.steps[0]) & (frames <= plant.steps[1] + 1)
        start, views = self.problem.first + first, self.problem.views
        gains = np.stack([log_gain_by_displacement(view, start, place, stood) for view in views])[:, ~stood]
        shown = np.isfinite(gains).sum(axis=0)
        return bool(shown.all() and (2 * np.nansum(gains, axis=0) < chdtri(2 * shown, 0.5)).all())

    def cost(self, plant: Plant, ratio: float) -> float:
        """Increase of the least cost of the evidence, whose covariance is multiplied by a ratio, by a plant.

        The normal equations are factorised once for all plants: what a plant adds depends on the covariance of its
        point's steps alone.
        """
        steps, covariance = self._place(plant).steps(*plant.steps)
        covariance = ratio * covariance + plant.apparent.sigma**2 * np.eye(len(steps))
        return float(steps @ cho_solve(cho_factor(covariance, check_finite=False), steps, check_finite=False))

    def ratio_of_errors(self, performer: int, part: int, ratios: Array) -> float:
        """Return the ratio of squared errors of a foot's sole to those that the normal equations predict, from those of
        the tips of all parts, shape (P,): a sole lies between the tips of foot and shin.
        """
        return float(ratios[[part, max(self.problem.bodies[performer].parents[part], 0)]].mean())

    def _place(self, plant: Plant) -> PlaceCovariance:
        performer, part, _ = asked = plant.sole_point
        if asked not in self.places:
            points = self._tracked(asked)
            arms = points - self._poses(performer)[1][:, part]
            self.places[asked] = PlaceCovariance.of(self._twists(performer, part), points, arms)
        return self.places[asked]

    def _twists(self, performer: int, part: int) -> TwistCovariance:
        if (performer, part) not in self.twists:
            R, T = self._poses(performer)
            jacobian = twist_jacobian(self.problem.bodies[performer], R, T)[:, part]
            jacobian[:, :3] -= rotations.skew(T[:, part]) @ jacobian[:, 3:]  # about the part's origin, not the world's
            factor, step, places = self._without_plants
            own = places[performer]
            move = np.einsum("fid,fd->fi", jacobian, step[:, own])
            self.twists[performer, part] = TwistCovariance(factor, own, jacobian, move)
        return self.twists[performer, part]

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


def most_by_chance(axes: int, significance: float = JOINING_SIGNIFICANCE) -> float:
    """Largest cost of a plant, along so many axes, that is left to chance as the ratio is known from a few errors."""
    return float(axes * fdtri(axes, RATIO_COUNT, 1 - significance))
