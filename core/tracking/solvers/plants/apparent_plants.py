"""Apparent plants of a segment: points of the soles that seem to stand, which `standing_feet` tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....body.kinematics import part_poses
from ....body.soles import Soles
from ....numerics.arrays import Bools, Ints
from ..equations.plant_factor import PlantFactor
from ..equations.problem import SegmentProblem
from ..protocol import SolvedFrames
from .floor_height import FloorHeight

SolePoint = tuple[int, int, tuple[float, float, float]]


@dataclass(frozen=True, eq=False)
class Plant:
    """A point of the soles that stands for a while.

    Attributes
    ----------
    apparent : PlantFactor
        All apparent plants of the performer.
    performer, point : int
    steps : tuple of int
        First and last step between two frames.
    """

    apparent: PlantFactor
    performer: int
    point: int
    steps: tuple[int, int]

    @property
    def sole_point(self) -> SolePoint:
        """The performer, the part, and the point in the part's frame, metres."""
        soles = self.apparent.soles
        x, y, z = soles.local[self.point].tolist()
        return self.performer, int(soles.parts[self.point]), (x, y, z)

    def __len__(self) -> int:
        return self.steps[1] + 1 - self.steps[0]

    def longer(self, before: int, after: int, movable: Bools) -> Plant | None:
        """Return the plant with steps before and after it; None if they are not among the movable ones, (F - 1,)."""
        first, last = self.steps[0] - before, self.steps[1] + after
        if first < 0 or last >= len(movable) or not movable[first] or not movable[last]:
            return None
        return replace(self, steps=(first, last))


@dataclass(frozen=True, eq=False)
class ApparentPlants:
    """The points that seem planted on a segment.

    Attributes
    ----------
    plants : PlantFactor
    before, after : ndarray of int, shape (C,)
        Number of steps in a row before and after the segment on which each of the points seems planted as well.
    floor : FloorHeight or None
        On which they stand on key poses, on the segment or beside it.
    begins, ends : bool
        Whether the motion that is known begins, and ends, with the segment.
    """

    plants: PlantFactor
    before: Ints
    after: Ints
    floor: FloorHeight | None
    begins: bool
    ends: bool

    @classmethod
    def of(
        cls, problem: SegmentProblem, performer: int, frames: SolvedFrames, soles: Soles | None = None
    ) -> ApparentPlants | None:
        """Find them in a performer's motion on a segment and on those beside it; None if there are none. See
        `PlantFactor.found` for the soles.
        """
        body, motion, first = problem.bodies[performer], frames.motions[performer], frames.first
        found = PlantFactor.found(body, motion, problem.fps, soles)
        last = first + problem.length - 1
        if found is None or not (steps := found.steps[first:last]).any():
            return None
        before, after = (np.cumprod(s, axis=0).sum(axis=0) for s in (found.steps[:first][::-1], found.steps[last:]))
        floor = None
        if frames.keyed and len(keyed := frames.keyed[performer]):
            heights = found.soles.world(part_poses(body, motion[keyed]))[..., 2]
            floor = FloorHeight.of(heights[found.frames[keyed]])
        return cls(replace(found, steps=steps), before, after, floor, begins=first == 0, ends=last == len(motion) - 1)

    def beside(self, point: int, earlier: ApparentPlants | None) -> Bools:
        """Return the steps, (F - 1,), on which the heel of the foot seems planted as well, now or earlier, if the point
        is a ball. A ball that is planted says nothing of the heel, which rises first.
        """
        if self.plants.soles.names[point].startswith("heel"):
            return np.zeros(len(self.plants.steps), bool)
        steps = self.plants.steps if earlier is None else self.plants.steps | earlier.plants.steps
        others = self.plants.soles.parts == self.plants.soles.parts[point]
        others[point] = False
        return np.asarray(steps[:, others].any(axis=1))

    def steps_around(self, plant: Plant) -> int:
        """Return the length of a plant with what it has on the segments beside."""
        before = self.before[plant.point] if plant.steps[0] == 0 else 0
        after = self.after[plant.point] if plant.steps[1] == len(self.plants.steps) - 1 else 0
        return int(before + len(plant) + after)

    def is_cut_off(self, plant: Plant) -> bool:
        """Return whether a plant reaches to an end of the motion that is known, so that it may last longer."""
        first, last = plant.steps
        return (self.begins and first == 0) or (self.ends and last == len(self.plants.steps) - 1)


def overlapping(run: tuple[int, int], others: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return those other runs of frames that a run overlaps."""
    return [other for other in others if other[0] <= run[1] and other[1] >= run[0]]


def joined(run: tuple[int, int], others: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Return the union of a run of frames with those others that it overlaps."""
    over = [run, *overlapping(run, others)]
    return min(first for first, _ in over), max(last for _, last in over)
