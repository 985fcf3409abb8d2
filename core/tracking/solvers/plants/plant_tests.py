"""Whether a point of the soles stands, and from when to when, by what is known of its plants."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, islice
from operator import itemgetter

import numpy as np
from scipy.special import chdtri

from ....body.foot_plants import MIN_DURATION
from ....evidence.standing_points import RADIUS
from ....numerics.arrays import Bools
from ....numerics.frame_ranges import runs
from .apparent_plants import ApparentPlants, Plant, joined, overlapping
from .plant_evidence import JOINING_SIGNIFICANCE, SIGNIFICANCE, PlantEvidence, most_by_chance

PICTURES_ODDS = 10.0
"""How many times likelier the pictures around a point must be if it stands than if it moves as it was tracked, for a
plant to pass though the normal equations say otherwise, as far as these may be wrong."""
FLICKER = 0.2
"""For how long the evidence may be against a plant that goes on, seconds, as long as it is for it over all."""
MAX_OVERHANG = 0.035
"""By how much a plant may seem longer than it is, seconds: the point has left, or has not landed, but is still slow."""
OVERHANG_SIGNIFICANCE = 0.001
"""Significance level at which a step at an end of a plant that does not pass is taken for one on which it moves."""


@dataclass(frozen=True, eq=False)
class PlantTests:
    """Tests of the plants of a point of the soles.

    Attributes
    ----------
    evidence : PlantEvidence
    ratio : float
        Of squared errors of the point to those that the normal equations predict.
    movable : ndarray of bool, shape (F - 1,)
        Steps that key poses do not fix.
    """

    evidence: PlantEvidence
    ratio: float
    movable: Bools

    def plants_of(
        self, apparent: ApparentPlants, earlier: ApparentPlants | None, performer: int, point: int, heel: Bools
    ) -> list[Plant]:
        """Return the plants of a point that pass the tests, with the frames beside them that do.

        Parameters
        ----------
        apparent, earlier : ApparentPlants
            As found now, and before the refinement.
        performer, point : int
        heel : ndarray of bool, shape (F - 1,)
            Steps on which the heel of a ball's foot has passed: more of them than seem still where two of its plants
            became one.
        """
        longer = [] if earlier is None else runs(earlier.plants.steps[:, point] & self.movable)
        beside = runs((apparent.beside(point, earlier) | heel) & self.movable)
        now = runs(apparent.plants.steps[:, point] & self.movable)
        gone = [run for run in longer if not overlapping(run, now)]
        plant_on = partial(Plant, apparent.plants, performer, point)
        passed: list[Plant] = []
        for run in sorted([*now, *gone]):
            lengths = list(dict.fromkeys([joined(run, longer), run])) if run in now else []
            before = [steps for steps in overlapping(run, longer) if steps not in lengths]
            one = self._first_that_passes([plant_on(steps) for steps in lengths], map(plant_on, before))
            if one is not None:
                one = self._trimmed(one)
                both = replace(one, steps=joined(one.steps, beside))
                one = both if self._goes_on(one, both) else one
                passed = self._with_next(passed, self._lengthened(one))
        return passed

    def _first_that_passes(self, now: Sequence[Plant], earlier: Iterable[Plant]) -> Plant | None:
        """Return the first plant of a point that passes; None if there is none.

        Parameters
        ----------
        now : sequence of Plant
            On the steps on which it seems planted now, also with those on which it did earlier. If none passes, without
            the steps at their ends on which it clearly moves, where pictures have nothing against that.
        earlier : iterable of Plant
            On steps on which it seemed planted before the refinement alone: the refined motion has it move on them, or
            on others beside as slowly, so that the pictures must rather show it standing.
        """
        shown = (one for one in earlier if self.evidence.log_odds(one) > 0 and self._agrees(one))
        shorter = (one for whole in now for one in self._without_overhang(whole) if self._agrees(one))
        return next(chain(filter(self._agrees, now), shown, shorter), None)

    def _without_overhang(self, plant: Plant) -> Iterator[Plant]:
        """Give a plant that does not pass `_shorter` wherever no drift explains its pictures better than it would by
        chance every other time. Key poses within the plant must have the point in one place: it drifts to those at its
        ends, too.
        """
        if self.evidence.key_poses_agree(plant):
            for shorter in islice(self._shorter(plant), max(round(MAX_OVERHANG * self.evidence.problem.fps), 1)):
                if 2 * self.evidence.log_odds(shorter) > -chdtri(3, 0.5):
                    yield shorter

    def _trimmed(self, plant: Plant) -> Plant:
        """Return a plant that passes without the steps at its ends on which the point moves by the evidence and the
        pictures together, if the pictures are for it: a long plant may pass as a whole though the point leaves at its
        end. Both are independent, so what a step costs by the two of them adds up.
        """
        cost, odds = self._cost(plant), self.evidence.log_odds(plant)
        while len(plant) > 2:
            found = [
                (cost - less + 2 * (likelier - odds), less, likelier, shorter)
                for less, shorter in self._shortened(plant)
                if (likelier := self.evidence.log_odds(shorter)) > odds
            ]
            gain, less, likelier, shorter = max(found, key=itemgetter(0), default=(0.0, cost, odds, plant))
            if gain < chdtri(3, OVERHANG_SIGNIFICANCE):
                break
            cost, odds, plant = less, likelier, shorter
        return plant

    def _shorter(self, plant: Plant) -> Iterator[Plant]:
        """Leave out steps at the ends of a plant that raise its cost by more than chance does, the costliest first."""
        cost = self._cost(plant)
        while len(plant) > 2:
            less, plant = min(self._shortened(plant), key=itemgetter(0))
            if cost - less < chdtri(3, OVERHANG_SIGNIFICANCE):
                return
            cost = less
            yield plant

    def _shortened(self, plant: Plant) -> Iterator[tuple[float, Plant]]:
        """Give a plant without its first and without its last step, each with its cost."""
        first, last = plant.steps
        for steps in ((first + 1, last), (first, last - 1)):
            shorter = replace(plant, steps=steps)
            yield self._cost(shorter), shorter

    def _agrees(self, plant: Plant) -> bool:
        """Test a plant against key poses, pictures, and the evidence, whose covariance is multiplied by a ratio.

        Whoever moves may do so on every step along three axes, and explains the pictures better by chance. As the ratio
        is known from a few errors only, a plant that it refuses passes as long as the pictures have nothing against it:
        no drift, along three axes, explains them better than it would by chance. One that they show
        to stand may cost more.
        """
        if not self.evidence.key_poses_agree(plant):
            return False
        axes, odds = 3 * len(plant), self.evidence.log_odds(plant)
        if 2 * odds < -chdtri(axes, SIGNIFICANCE):
            return False
        cost = self._cost(plant)
        if odds > np.log(PICTURES_ODDS):
            return cost < most_by_chance(axes, SIGNIFICANCE)
        within = chdtri(axes, SIGNIFICANCE)
        if 2 * odds > -chdtri(3, SIGNIFICANCE):
            within = max(within, most_by_chance(axes))
        return cost < within

    def _goes_on(self, plant: Plant, longer: Plant) -> bool:
        """Test whether a point stands on more frames than those of a plant that passed, by what these add. Pictures
        further from where it stands than what is compared do not say so.
        """
        if longer.steps == plant.steps or not self.evidence.key_poses_agree(longer):
            return False
        within = chdtri(3 * (len(longer) - len(plant)), SIGNIFICANCE)
        odds = self.evidence.log_odds(longer) - self.evidence.log_odds(plant)
        if 2 * odds < -within:
            return False
        if odds > np.log(PICTURES_ODDS) and self.evidence.way(longer) < RADIUS:
            return True
        return self._cost(longer) - self._cost(plant) < within

    def _lengthened(self, plant: Plant) -> Plant:
        """Return a plant that passed with the frames beside it on which the point may stand, too: one after the other,
        or several at once, over which a flicker of the evidence is no more.
        """
        cost = self._cost(plant)
        most = max(round(FLICKER * self.evidence.problem.fps), 1)
        for before, after in ((1, 0), (0, 1)):
            steps = 1
            while steps <= most and (longer := plant.longer(steps * before, steps * after, self.movable)) is not None:
                more = self._cost(longer) - cost
                beyond = more >= most_by_chance(3 * most)
                if beyond and self.evidence.way(longer) >= RADIUS:
                    break
                stands = more < chdtri(3 * steps, JOINING_SIGNIFICANCE)
                if not stands:  # ask the pictures, which takes longer
                    gain = self.evidence.log_odds(longer) - self.evidence.log_odds(plant)
                    stands = (gain > 0 and more < most_by_chance(3 * steps)) or (
                        gain > np.log(PICTURES_ODDS) and self.evidence.stays(plant, longer)
                    )
                if stands and self.evidence.key_poses_agree(longer):
                    plant, cost, steps = longer, cost + more, 1
                else:
                    steps += 1
        return plant

    def _with_next(self, plants: Sequence[Plant], following: Plant) -> list[Plant]:
        """Return plants of a point with the one that follows, if there is time for a step between it and the last of
        them. If not, as a foot that stands does not jump aside and stand again, they are one plant where the evidence
        agrees; else the longer one is kept.
        """
        if not plants:
            return [following]
        *before, last = plants
        between = slice(last.steps[1] + 1, following.steps[0])
        if (
            between.stop - between.start > round(MIN_DURATION * self.evidence.problem.fps)
            or not self.movable[between].all()
        ):
            return [*plants, following]
        whole = replace(last, steps=(last.steps[0], max(last.steps[1], following.steps[1])))
        if not self._agrees(whole):
            whole = max(last, following, key=len)
        return [*before, whole]

    def _cost(self, plant: Plant) -> float:
        return self.evidence.cost(plant, self.ratio)
