"""Plants as evidence: planted soles come to rest, and feet that swing are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.soles import Soles
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.banded import BandedFactor
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.tracking.solvers.equations.plant_factor import PlantFactor
from render.motions import MOTIONS

BODY, FPS, FRAMES = human(1.75), 30.0, 40
TRUTH = MOTIONS["whirl"](BODY, FRAMES, FPS)


@pytest.fixture(scope="module")
def tracked() -> Motion:
    """A dance with an error of its joints."""
    dice = np.random.default_rng(0)
    error = dice.normal(0, 0.002, (FRAMES, len(BODY), 3))
    return Motion(TRUTH.translations, TRUTH.rotations @ rotations.exp(error))


@pytest.fixture(scope="module")
def factor(tracked: Motion) -> PlantFactor:
    found = PlantFactor.found(BODY, tracked, FPS)
    assert found is not None
    return found


def soles_at(motion: Motion) -> np.ndarray:
    soles = Soles.of(BODY)
    assert soles is not None
    return soles.world(part_poses(BODY, motion))


def steps(motion: Motion) -> np.ndarray:
    return np.linalg.norm(np.diff(soles_at(motion), axis=0), axis=2)


def test_planted_soles_come_to_rest_and_nearer_to_the_truth(tracked: Motion, factor: PlantFactor) -> None:
    """Against a prior on the poses as they were tracked."""
    precision = np.broadcast_to(np.eye(BODY.dof) / 0.002**2, (FRAMES, BODY.dof, BODY.dof))
    motion = tracked
    for _ in range(3):
        pull = tracked.difference(motion) / 0.002**2
        prior = replace(BandedBlocks.zeros(FRAMES, BODY.dof), diagonal=precision, gradient=pull)
        system = prior + factor.blocks(BODY, part_poses(BODY, motion))
        motion = motion.moved(-BandedFactor(system, np.zeros((FRAMES, BODY.dof), bool)).solve(system.gradient))
    planted = factor.steps & (steps(TRUTH) < 1e-3)
    assert np.median(steps(motion)[planted]) < 0.3 * np.median(steps(tracked)[planted])
    errors = [np.linalg.norm(soles_at(m) - soles_at(TRUTH), axis=2)[1:][planted].mean() for m in (tracked, motion)]
    assert errors[1] < 0.8 * errors[0]


@pytest.mark.parametrize("on_floor", [False, True])
def test_its_gradient_is_the_slope_of_its_energy(tracked: Motion, factor: PlantFactor, on_floor: bool) -> None:
    if on_floor:
        factor = replace(factor, level=0.01, level_precision=factor.steps / 0.003**2)
    dice = np.random.default_rng(1)
    way = dice.normal(0, 1, (FRAMES, BODY.dof))
    step = 1e-6

    def energy(size: float) -> float:
        return factor.blocks(BODY, part_poses(BODY, tracked.moved(size * way))).energy

    slope = (energy(step) - energy(-step)) / (2 * step)
    gradient = factor.blocks(BODY, part_poses(BODY, tracked)).gradient
    assert slope == pytest.approx(2 * float(np.sum(gradient * way)), rel=1e-4)


def test_the_equations_of_plants_are_the_sum_of_those_of_each_step(tracked: Motion, factor: PlantFactor) -> None:
    """Wherever in the motion it is: a step is about two frames alone."""
    factor = replace(factor, level=0.01, level_precision=factor.steps / 0.003**2)
    poses = part_poses(BODY, tracked)
    together, total = factor.blocks(BODY, poses), BandedBlocks.zeros(FRAMES, BODY.dof)
    for step in np.flatnonzero(factor.steps.any(axis=1)):
        alone = np.zeros_like(factor.steps)
        alone[step] = factor.steps[step]
        own = replace(factor, steps=alone, level_precision=alone / 0.003**2).blocks(BODY, poses)
        assert {*np.flatnonzero(own.gradient.any(axis=1))} <= {step, step + 1}
        total += own
    for name in ("diagonal", "first", "second", "gradient"):
        np.testing.assert_allclose(getattr(total, name), getattr(together, name), rtol=1e-9, atol=1e-6)
    assert total.energy == pytest.approx(together.energy)
    nothing = replace(factor, steps=np.zeros_like(factor.steps)).blocks(BODY, poses)
    assert not nothing.diagonal.any() and nothing.energy == 0


def test_a_foot_that_swings_after_all_is_let_go(factor: PlantFactor) -> None:
    path = TRUTH.translations + 0.1 * np.arange(FRAMES)[:, None] * [1.0, 0.0, 0.0]
    slow, fast = (
        np.abs(factor.blocks(BODY, part_poses(BODY, Motion(places, TRUTH.rotations))).gradient).max()
        for places in (TRUTH.translations + 0.01 * (path - TRUTH.translations), path)
    )
    assert fast < 0.05 * slow


def test_a_body_without_heels_has_no_plants(tracked: Motion) -> None:
    bare = replace(BODY, landmarks={name: at for name, at in BODY.landmarks.items() if "Heel" not in name})
    assert PlantFactor.found(bare, tracked, FPS) is None
