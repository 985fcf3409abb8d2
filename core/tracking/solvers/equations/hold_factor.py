"""Holds as evidence: while a prop is held, images of the prop show where the hand is, and the other way round.

The residuals are the differences in position and orientation between the prop and where the holding part has it by the
grip (`core.shot.holds`). They are stiff compared with the images, so bodies that are tied to each other are solved in
one system: solved one after the other, each would stay where the other is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....body import Body
from ....body.kinematics import part_poses, twist_jacobian
from ....body.motion import Motion
from ....numerics import rotations
from ....numerics.arrays import Array, Bools, Ints, slices_of
from ....numerics.banded_blocks import BandedBlocks
from ....numerics.normal_equations import BandedEquations
from ....shot.holds import Hold
from ....shot.shot import Performer

GRIP_POSITION_SIGMA, GRIP_ROTATION_SIGMA = 0.005, 0.05
"""Standard deviations of the prop's position in the hand along each axis, metres, and of its rotation about each,
radians: fingers give way a little, and the model's hand is a single rigid part."""


@dataclass(frozen=True, eq=False)
class HoldFactor:
    """A prop in the hand of a performer on K frames of a segment.

    Attributes
    ----------
    prop, holder : int
        Indices of the performers.
    part : int
        Index of the part of the holder's body that holds the prop.
    frames : ndarray of int, shape (K,)
        Frames of the segment on which the prop is held.
    turns, places : ndarray, shape (K, 3, 3) and (K, 3)
        The grip on these frames, see `core.shot.holds.Grip`.
    """

    prop: int
    holder: int
    part: int
    frames: Ints
    turns: Array
    places: Array

    @classmethod
    def of(cls, hold: Hold, performers: Sequence[Performer], first: int, last: int) -> HoldFactor | None:
        """Build the factor of a hold with a grip on shot frames first to last; None if it is on none of them."""
        begin, end = max(hold.frames[0], first), min(hold.frames[1], last)
        if begin > end or hold.grip is None:
            return None
        names = [performer.name for performer in performers]
        prop, holder = names.index(hold.prop), names.index(hold.holder)
        frames = np.arange(begin, end + 1)
        part = performers[holder].body.index(hold.part)
        return cls(prop, holder, part, frames - first, *hold.grip.at(frames))

    def on_frames(self, first: int, stop: int) -> HoldFactor:
        """Restrict the hold to frames first to stop - 1 of the segment, and count from the first of these."""
        inside = (self.frames >= first) & (self.frames < stop)
        return replace(self, frames=self.frames[inside] - first, turns=self.turns[inside], places=self.places[inside])

    def among(self, frames: Ints) -> HoldFactor:
        """Restrict the hold to some increasing frames of the segment, which become its frames 0, 1, 2, ..."""
        inside = np.isin(self.frames, frames)
        place = np.searchsorted(frames, self.frames[inside])
        return replace(self, frames=place, turns=self.turns[inside], places=self.places[inside])

    def residuals(self, bodies: Sequence[Body], motions: Sequence[Motion]) -> tuple[Array, Array, Array]:
        """Return residuals (K, 6) in standard deviations, and their Jacobians (K, 6, D) by the degrees of freedom of
        the prop and of the holder.
        """
        own = [motions[i][self.frames] for i in (self.prop, self.holder)]
        (R_prop, T_prop), (R, T) = poses = [part_poses(bodies[i], m) for i, m in zip(self._tied, own, strict=True)]
        wanted = T[:, self.part] + (R[:, self.part] @ self.places[..., None])[..., 0]
        away = T_prop[:, 0] - wanted
        turned = rotations.log(R_prop[:, 0] @ np.swapaxes(R[:, self.part] @ self.turns, -1, -2))
        jacobians = []
        for i, part, point, sign, pose in zip(
            self._tied, (0, self.part), (T_prop[:, 0], wanted), (1.0, -1.0), poses, strict=True
        ):
            twist = twist_jacobian(bodies[i], *pose)[:, part]
            move = twist[:, :3] - rotations.skew(point) @ twist[:, 3:]
            jacobians.append(
                sign * np.concatenate([move / GRIP_POSITION_SIGMA, twist[:, 3:] / GRIP_ROTATION_SIGMA], axis=1)
            )
        return (
            np.concatenate([away / GRIP_POSITION_SIGMA, turned / GRIP_ROTATION_SIGMA], axis=1),
            jacobians[0],
            jacobians[1],
        )

    @property
    def _tied(self) -> tuple[int, int]:
        return self.prop, self.holder


def hold_factors(
    holds: Sequence[Hold], performers: Sequence[Performer], first: int, last: int
) -> tuple[HoldFactor, ...]:
    """Build the factors of all holds on shot frames first to last."""
    found = (HoldFactor.of(hold, performers, first, last) for hold in holds)
    return tuple(factor for factor in found if factor is not None)


@dataclass(frozen=True, eq=False)
class TiedSystems:
    """Normal equations of all performers, with one system for every group of performers that holds tie to each other.

    Attributes
    ----------
    places : tuple of dict of int to slice
        Per system: the slice of its degrees of freedom that belongs to each of its performers.
    systems : tuple of BandedEquations
    """

    places: tuple[dict[int, slice], ...]
    systems: tuple[BandedEquations, ...]

    @property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Indices of the performers of each system, in the order of their degrees of freedom."""
        return tuple(map(tuple, self.places))

    @property
    def cost(self) -> float:
        """Sum of the costs of all systems."""
        return sum(system.cost for system in self.systems)

    def by_performer(self, values: Sequence[Array]) -> dict[int, Array]:
        """Split arrays given per system by performer.

        Parameters
        ----------
        values : sequence of ndarray, shape (F, D) or (F, D, D)
            Per system: steps, or covariances, of which the diagonal block of each performer is returned.
        """
        return {
            i: value[:, own, own] if value.ndim == 3 else value[:, own]
            for where, value in zip(self.places, values, strict=True)
            for i, own in where.items()
        }


def tied_systems(
    systems: Sequence[BandedBlocks],
    holds: Sequence[HoldFactor],
    bodies: Sequence[Body],
    motions: Sequence[Motion],
    *,
    fixed: Sequence[Bools],
    sought: Sequence[int],
) -> TiedSystems:
    """Add holds to the normal equations of the performers that are solved for, and join those of tied performers.

    A performer whose motion is given acts on those that it holds or that hold it as a fixed target.

    Parameters
    ----------
    systems : sequence of BandedBlocks
        One per performer.
    holds : sequence of HoldFactor
    bodies : sequence of Body
    motions : sequence of Motion
        F poses per performer.
    fixed : sequence of ndarray of bool, shape (F, D)
    sought : sequence of int
    """
    places, found = [], []
    for members in _groups(sought, holds):
        where = dict(zip(members, slices_of(bodies[i].dof for i in members), strict=True))
        places.append(where)
        ties = [hold for hold in holds if where.keys() & {hold.prop, hold.holder}]
        if not ties:
            (i,) = members
            found.append(BandedEquations(systems[i], fixed[i]))
            continue
        joined = _side_by_side([systems[i] for i in members], list(where.values()))
        energy = joined.energy + sum(_add(joined, hold, where, hold.residuals(bodies, motions)) for hold in ties)
        held = np.concatenate([fixed[i] for i in members], axis=1)
        found.append(BandedEquations(replace(joined, energy=energy), held))
    return TiedSystems(tuple(places), tuple(found))


def _groups(sought: Sequence[int], holds: Sequence[HoldFactor]) -> tuple[tuple[int, ...], ...]:
    """Group the performers that are solved for by which of them holds tie to each other."""
    group = {i: {i} for i in sought}
    for hold in holds:
        if hold.prop in group and hold.holder in group:
            both = group[hold.prop] | group[hold.holder]
            group.update(dict.fromkeys(both, both))
    return tuple(tuple(sorted(members)) for i, members in group.items() if i == min(members))


def _side_by_side(systems: Sequence[BandedBlocks], where: Sequence[slice]) -> BandedBlocks:
    """Join several systems into one without coupling terms."""
    joined = BandedBlocks.zeros(len(systems[0].gradient), where[-1].stop)
    for system, own in zip(systems, where, strict=True):
        joined.diagonal[:, own, own], joined.gradient[:, own] = system.diagonal, system.gradient
        joined.first[:, own, own], joined.second[:, own, own] = system.first, system.second
    return replace(joined, energy=sum(system.energy for system in systems))


def _add(
    system: BandedBlocks, hold: HoldFactor, where: Mapping[int, slice], linearised: tuple[Array, Array, Array]
) -> float:
    """Add the residuals and Jacobians of a hold to a system, in place; returns the cost of the hold."""
    r, J_prop, J_holder = linearised
    jacobians = [(where[i], J) for i, J in ((hold.prop, J_prop), (hold.holder, J_holder)) if i in where]
    for own, J in jacobians:
        system.gradient[hold.frames, own] += np.einsum("fra,fr->fa", J, r)
        for other, K in jacobians:
            system.diagonal[hold.frames, own, other] += np.swapaxes(J, 1, 2) @ K
    return float(np.sum(r**2))


def touching_parts(holds: Sequence[HoldFactor], bodies: Sequence[Body]) -> frozenset[tuple[int, int]]:
    """Return the pairs of parts, in both orders, that may penetrate each other because a prop is held: the prop's parts
    with the holding part, its parent and all its descendants. Indices are those of all bodies' parts.
    """
    spans, found = slices_of(len(body) for body in bodies), set()
    for hold in holds:
        body, begin = bodies[hold.holder], spans[hold.holder].start
        near = {hold.part, max(body.parents[hold.part], 0), *np.flatnonzero(body.ancestry[:, hold.part]).tolist()}
        for part in range(spans[hold.prop].start, spans[hold.prop].stop):
            found |= {(part, begin + own) for own in near} | {(begin + own, part) for own in near}
    return frozenset(found)
