"""A knee that lies aside, between a hip and an ankle that are right, is turned about the line through both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from kfmocap.core.body import human, part_poses
from kfmocap.core.body.limbs import limbs
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.solvers.assessment.settled_solutions import SettledSolution, SettledSolutions
from kfmocap.core.tracking.solvers.descent_stages import OUTLINE_REACH
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.equations.segment_equations import SegmentNoise
from kfmocap.core.tracking.solvers.limb_corrections import limb_groups, regained_limbs, swivelled_limbs
from kfmocap.core.tracking.solvers.limb_corrections.swivelled_limbs import swivelled, with_limbs_swivelled
from made_evidence import Landscape
from synthetic import CAMERAS, at_rest, dark, ends_held

BODY, FRAMES, FPS = human(), 24, 30.0
LEG = next(chain for chain in limbs(BODY) if BODY.names[chain[-1]] == "foot.R")
THIGH, SHIN, FOOT = LEG


def seen_by(cameras: int) -> SegmentProblem:
    views = tuple(view for camera in CAMERAS[:cameras] for view in dark(camera, FRAMES))
    return SegmentProblem(views, (BODY,), 0, FPS, (ends_held(BODY, FRAMES),), doubted=(0,))


def crouching() -> Motion:
    """The knee is bent by 80 degrees, and lies 0.26 m before the line from hip to ankle."""
    motion = at_rest(BODY, FRAMES)
    for part, angle in ((THIGH, 40.0), (SHIN, -80.0)):
        motion.rotations[:, part] = rotations.exp(np.radians([angle, 0.0, 0.0]))
    return motion


def knee(motion: Motion) -> np.ndarray:
    return part_poses(BODY, motion)[1][:, SHIN]


def test_only_the_middle_joint_of_a_limb_moves_and_key_poses_stay() -> None:
    before, fixed = crouching(), ends_held(BODY, FRAMES)
    after = swivelled(BODY, before, LEG, np.ones(FRAMES), fixed)
    (R, T), (R_after, T_after) = part_poses(BODY, before), part_poses(BODY, after)
    others = np.setdiff1d(np.arange(len(BODY)), [SHIN])
    np.testing.assert_allclose(T_after[:, others], T[:, others], atol=1e-9)
    np.testing.assert_allclose(R_after[:, FOOT], R[:, FOOT], atol=1e-9)
    moved = np.linalg.norm(knee(after) - knee(before), axis=1)
    np.testing.assert_allclose(moved[1:-1], OUTLINE_REACH, rtol=0.01)
    np.testing.assert_array_equal(moved[[0, -1]], 0.0)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("gain", [5.0, 50.0])
def test_the_way_that_makes_the_images_likelier_is_kept(
    monkeypatch: pytest.MonkeyPatch, way: float, gain: float
) -> None:
    problem, begin = seen_by(2), crouching()
    truth = swivelled(BODY, begin, LEG, way * np.ones(FRAMES), problem.fixed[0])
    one = replace(Landscape(truth=begin).solution(problem, begin), motions=(begin,))
    noise = SegmentNoise(*(np.ones((2, FRAMES - 1, *more)) for more in ((1,), ())), np.ones(2))

    def likelihood(_problem: object, _noise: object, solution: SegmentSolution) -> float:
        return gain * (1 - np.linalg.norm(knee(solution.motions[0])[12] - knee(truth)[12]) / OUTLINE_REACH)

    def solved(_problem: object, motions: Sequence[Motion], *_: object) -> SegmentSolution:
        return replace(one, motions=tuple(motions))

    monkeypatch.setattr(SettledSolutions, "after", lambda _s, _p, at, _w: SettledSolution(at, noise, at))
    monkeypatch.setattr(swivelled_limbs, "solved_from", solved)
    monkeypatch.setattr(limb_groups, "settled_further", lambda *given, **_: given[2])
    monkeypatch.setattr(limb_groups, "likelihood", likelihood)
    found = with_limbs_swivelled(problem, one, SettledSolutions(), Workspace())
    if gain < 10:
        assert found is one
    else:
        np.testing.assert_allclose(knee(found.motions[0])[12], knee(truth)[12], atol=1e-6)


@pytest.mark.parametrize(("cameras", "doubted", "tried"), [(2, (0,), True), (2, (), False), (1, (0,), False)])
def test_limbs_are_swivelled_where_several_views_contradict_a_performer(
    monkeypatch: pytest.MonkeyPatch, cameras: int, doubted: tuple[int, ...], tried: bool
) -> None:
    asked = []

    def swivelled(*given: object) -> object:
        asked.append(given)
        return given[1]

    monkeypatch.setattr(regained_limbs, "with_limbs_swivelled", swivelled)
    monkeypatch.setattr(regained_limbs, "with_limbs_found", lambda _p, found, *_, **__: found)
    monkeypatch.setattr(regained_limbs, "_stirred", lambda _p, found, *_: found)
    problem, groups = replace(seen_by(cameras), doubted=doubted), [SimpleNamespace(performer=0)]
    regained_limbs._searched(problem, SimpleNamespace(), groups, SettledSolutions(), Workspace())  # type: ignore[arg-type]
    assert bool(asked) == tried
