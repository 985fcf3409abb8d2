"""A study of cameras solved from synthetic captures, compared with the Cramér-Rao bound.

python -m kfmocap.benchmarks.studies.wand_study --seeds 50
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.calibration.calibration_result import CalibrationResult
from ...core.calibration.lframe.lframe_pose import resting
from ...core.calibration.solving.ball_observations import BallObservations
from ...core.calibration.solving.bundle import covariance
from ...core.calibration.solving.bundle_scene import BundleEvidence, Scene, unknowns
from ...core.calibration.solving.camera_rig import CAMERA_DOF, FOCAL, K1, OFFSET, SHIFT, TURN, rig_of
from ...core.calibration.solving.wand_motion import Wand
from ...core.calibration.wand_calibration import solve_capture
from ...core.calibration.wand_matching import matched
from ...core.cameras.camera import Camera
from ...core.capture.capture import Capture
from ...core.errors import KFMocapError
from ...core.numerics import rotations
from ...core.numerics.arrays import Array
from ...core.runtime.output_files.files import replacing
from .wand_captures import FPS, HARD, LFRAME, WAND_LENGTH, Faults, capture, ring, scattered, waved

CAMERAS = 4
POSITIONS = 300
"""Places of the wand that all cameras film, one for each frame."""
FARTHEST_OFFSET = 30.0
"""By how much an unsynchronised camera begins earlier or later than the others, at most, frames."""
WRONG_FOCAL, WRONG_CENTRE = 0.02, 0.05
"""Errors from which a solution counts as wrong: of the focal length, relative, and of the position, metres."""
_EXACT = 1e-6
"""Standard deviation of the balls of an L-frame whose measures are exact, metres."""


@dataclass(frozen=True, eq=False)
class CaptureRow:
    """One solved capture.

    Attributes
    ----------
    focal, centre, turn : ndarray, shape (C,)
        Errors of each camera: of the focal length, relative; of the position, metres; of the rotation, degrees.
    bound : ndarray, shape (3, C)
        Cramér-Rao bounds of their standard deviations, in the same order.
    reprojection : float
        Ratio of the wand's residual to that of the noise alone.
    offset : ndarray, shape (C,)
        Errors of the time offsets, frames.
    seconds : float
        Processor time.
    """

    focal: Array
    centre: Array
    turn: Array
    bound: Array
    reprojection: float
    offset: Array
    seconds: float

    @property
    def wrong(self) -> bool:
        """Whether a focal length or a camera position is far off."""
        return bool(self.focal.max() > WRONG_FOCAL or self.centre.max() > WRONG_CENTRE)


def measured(seed: int, faults: Faults, count: int = POSITIONS) -> CaptureRow:
    """Solve a capture of independent positions with synchronised cameras."""
    cameras, positions = ring(CAMERAS, seed), scattered(count, seed)
    given = capture(cameras, [positions] * CAMERAS, faults, seed)
    return _solved(given, true_scene(cameras, positions))


def measured_in_time(seed: int, faults: Faults, count: int = POSITIONS) -> CaptureRow:
    """Solve a capture of a waved wand with cameras that are not synchronised."""
    return _solved(*out_of_step(seed, faults, count))


def out_of_step(seed: int, faults: Faults, count: int = POSITIONS) -> tuple[Capture, Scene]:
    """Return a capture of a waved wand with cameras that are not synchronised, and its truth."""
    cameras = ring(CAMERAS, seed)
    offset = np.random.default_rng([seed, 5]).uniform(-FARTHEST_OFFSET, FARTHEST_OFFSET, CAMERAS)
    offset[0] = 0.0
    paths = [waved((np.arange(count) - o) / FPS, seed) for o in offset]
    frames = np.arange(-int(FARTHEST_OFFSET) - 1, count + int(FARTHEST_OFFSET) + 2)
    scene = true_scene(cameras, waved(frames / FPS, seed), frames)
    truth = replace(scene, rig=replace(scene.rig, offset=offset))
    return capture(cameras, paths, faults, seed, offsets=[None] * CAMERAS), truth


def _solved(given: Capture, truth: Scene) -> CaptureRow:
    begin = time.process_time()
    solution = solve_capture(given)
    seconds = time.process_time() - begin
    pairs = [(solution.rig.camera(c), truth.rig.camera(c)) for c in range(len(truth.rig))]
    return CaptureRow(
        np.array([abs(a.matrix[0, 0] / b.matrix[0, 0] - 1) for a, b in pairs]),
        np.array([np.linalg.norm(a.centre_world() - b.centre_world()) for a, b in pairs]),
        np.rad2deg([np.linalg.norm(rotations.log(a.R_cam_world[0] @ b.R_cam_world[0].T)) for a, b in pairs]),
        bound(given, truth),
        _over_noise(solution),
        np.abs(solution.rig.offset - truth.rig.offset),
        seconds,
    )


def _over_noise(solution: CalibrationResult) -> float:
    """Return the ratio of the residual to that expected from the noise alone, root mean squares."""
    residual = solution.residual[: len(solution.seen)] / solution.seen.sigma[:, None]
    left = 1 - (5 * len(solution.wand) + solution.free.sum()) / residual.size
    return float(np.sqrt(np.mean(residual**2) / left))


def true_scene(cameras: Sequence[Camera], positions: Array, frames: NDArray[np.int64] | None = None) -> Scene:
    """Return the truth as a `Scene`; frames are counted from 0 by default."""
    direction = (positions[:, 0] - positions[:, 1]) / WAND_LENGTH
    frames = np.arange(len(positions)) if frames is None else frames
    wand = Wand(frames, positions.mean(axis=1), direction, WAND_LENGTH)
    return Scene(rig_of(cameras), wand, LFRAME.copy())


def bound(given: Capture, truth: Scene) -> Array:
    """Return the Cramér-Rao bounds (3, C) of focal length (relative), position (metres) and rotation (degrees).

    It is assumed to be known which balls are the wand's, and that the L-frame's measures are exact.
    """
    parts = []
    for v, view in enumerate(given.views):
        sigma = float(np.nanmedian(view.wand.sigma))
        near = matched(truth, v, view.wand, np.full((len(view.wand), 2), 4 * sigma))
        parts.append(near.observations(v, view.wand))
    seen = BallObservations.joined(parts)
    lframe = resting([view.lframe for view in given.views])
    timed = np.array([view.offset is None for view in given.views])
    evidence = BundleEvidence(seen, lframe, given.lframe_points, _EXACT, smooth=bool(timed.any()))
    count = len(truth.rig)
    own = np.zeros((count, CAMERA_DOF), bool)
    own[:, TURN] = own[:, SHIFT] = True
    own[:, [FOCAL, K1]] = True
    own[1:, OFFSET] = timed[1:]
    free = np.concatenate([np.ones(unknowns(truth) - own.size, bool), own.ravel()])
    blocks = covariance(truth, evidence, free).reshape(count, CAMERA_DOF, count, CAMERA_DOF)
    own_blocks = [blocks[c, :, c] for c in range(count)]
    focal = [np.sqrt(b[FOCAL, FOCAL]) for b in own_blocks]
    centre = [np.sqrt(np.trace(b[SHIFT, SHIFT])) for b in own_blocks]
    turn = [np.rad2deg(np.sqrt(np.trace(b[TURN, TURN]))) for b in own_blocks]
    return np.array([focal, centre, turn])


def ratios(rows: Sequence[CaptureRow]) -> dict[str, float]:
    """Return the ratios of root mean square errors to the bounds."""
    names = ("focal", "centre", "turn")
    return {
        name: _rms([getattr(row, name) for row in rows]) / _rms([row.bound[k] for row in rows])
        for k, name in enumerate(names)
    }


def _rms(values: Sequence[Array]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(values) ** 2)))


def study(name: str, rows: Sequence[CaptureRow], failed: int) -> str:
    """Return a line of the table."""
    ratio = ratios(rows)
    wrong = failed + sum(row.wrong for row in rows)
    return (
        f"| {name} | {len(rows) + failed} | {wrong} | {np.mean([row.reprojection for row in rows]):.3f} "
        f"| {_rms([row.focal for row in rows]):.3%} ({ratio['focal']:.2f}) "
        f"| {1000 * _rms([row.centre for row in rows]):.1f} mm ({ratio['centre']:.2f}) "
        f"| {_rms([row.turn for row in rows]):.3f}° ({ratio['turn']:.2f}) "
        f"| {max(row.offset.max() for row in rows):.3f} | {np.median([row.seconds for row in rows]):.1f} s |"
    )


HEAD = (
    "| capture | seeds | wrong | residual / noise | focal length | centre | turn | worst offset, frames | time |\n"
    "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure all captures and print the tables."""
    parser = argparse.ArgumentParser(description="Errors of cameras solved from synthetic captures.")
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--hard-seeds", type=int, default=200)
    parser.add_argument("--timed-seeds", type=int, default=20)
    parser.add_argument("--out", type=Path, help="also write the table there")
    args = parser.parse_args(argv)
    lines = HEAD.splitlines()
    print(HEAD)
    for name, run, faults, count, seeds in (
        ("clean", measured, Faults(), POSITIONS, args.seeds),
        ("hard", measured, HARD, POSITIONS, args.hard_seeds),
        ("clean, unsynchronised", measured_in_time, Faults(), POSITIONS, args.timed_seeds),
        ("hard, unsynchronised", measured_in_time, HARD, POSITIONS, args.timed_seeds),
        ("clean, 1000 positions", measured, Faults(), 1000, max(1, args.timed_seeds // 4)),
    ):
        if seeds <= 0:
            continue
        rows, failed = [], 0
        for seed in range(seeds):
            try:
                rows.append(run(seed, faults, count))
            except KFMocapError as error:
                print(f"{name}, seed {seed}: {error}")
                failed += 1
        lines.append(study(name, rows, failed))
        print(lines[-1], flush=True)
    if args.out:
        with replacing(args.out) as temporary:
            temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
