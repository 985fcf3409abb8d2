"""A study of cameras refined from key poses: `python -m kfmocap.benchmarks.studies.refinement_study` prints a table.

Cameras are moved away from a calibration and refined again. Before and after, the reference's joints are projected by
those cameras that could be refined, and compared with the calibration's projections; and the shot is tracked.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...cli.example_footage import example_folder
from ...core.cameras.camera import Camera
from ...core.fitting.camera_fits.camera_refinement import refine_cameras
from ...core.fitting.camera_fits.resection import adjusted
from ...core.formats import Landmarks, load_cameras, read_trc
from ...core.shot.shot import Shot
from ...core.tracking.prepare import load_shot
from ...core.tracking.tracker import track
from ..measured_case import Reference

Cameras = Mapping[str, Camera]

SHOTS = ("beam", "walk")
POSITION, ROTATION, FOCAL = 0.04, 0.02, 0.01
"""Standard deviations of the errors added: metres along and radians about each axis, and relative."""
HEAD = (
    "| shot | key frames | cameras | refined | off before, px | off after, px | expected, px | track before, mm "
    "| track after, mm | seconds |\n| --- | --- | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |"
)


@dataclass(frozen=True)
class RefinementCase:
    """A shot, its true calibration, and the calibration to start from."""

    shot: Shot
    folder: Path
    name: str
    true: Cameras
    start: Cameras


def cases(shots: Sequence[str], seeds: int) -> Iterator[RefinementCase]:
    """Generate every shot with its own cameras, with its original ones, and with randomly moved ones."""
    for name in shots:
        folder = example_folder(name)
        shot = load_shot(folder / "shot.toml")
        true = {view.camera.name: view.camera for view in shot.views}
        yield RefinementCase(shot, folder, "calibration.toml", true, true)
        shipped = folder / "calibration_original.toml"
        if shipped.is_file():
            yield RefinementCase(shot, folder, shipped.name, true, load_cameras(shipped))
        for seed in range(seeds):
            yield RefinementCase(shot, folder, f"moved at random, {seed}", true, moved(true, seed))


def moved(cameras: Cameras, seed: int) -> Cameras:
    """Return the cameras with random errors added."""
    deviation = [POSITION] * 3 + [ROTATION] * 3 + [FOCAL]
    rng = np.random.default_rng(seed)
    return {name: adjusted(camera, rng.normal(0, deviation)) for name, camera in cameras.items()}


def row(case: RefinementCase) -> str:
    """Measure a case; returns a row of the table."""
    cameras = [case.start[view.camera.name] for view in case.shot.views]
    views = [replace(view, camera=camera) for view, camera in zip(case.shot.views, cameras, strict=True)]
    start = replace(case.shot, views=tuple(views))
    begin = time.process_time()
    refinement = refine_cameras(start)
    seconds = time.process_time() - begin
    landmarks, reference = read_trc(case.folder / "landmarks.trc"), Reference(case.shot, case.folder / "landmarks.trc")
    found = {view.camera.name: view for view in refinement.views if not view.lost}
    true = {name: case.true[name] for name in found}
    off = [away(cameras, true, landmarks) for cameras in (case.start, refinement.cameras)]
    expected = np.sqrt(np.mean([view.deviation**2 for view in found.values()]))
    errors = [reference.score(track(shot).motions[0]).mean for shot in (start, refinement.applied(start))]
    keys = " ".join(str(case.shot.frames[0] + f) for f in case.shot.performers[0].key_poses.frames)
    numbers = [f"{x:.1f}" for x in (*off, expected, *errors)]
    share = f"{len(found)} of {len(refinement.views)}"
    return f"| {case.shot.name} | {keys} | {case.name} | {share} | {' | '.join(numbers)} | {seconds:.0f} |"


def away(cameras: Cameras, true: Cameras, landmarks: Landmarks) -> float:
    """Return the root mean square distance between two sets of cameras' projections of the landmarks, pixels."""
    apart = [
        cameras[name].project(points, f) - camera.project(points, f)
        for name, camera in true.items()
        for f, points in enumerate(landmarks.points_world)
    ]
    return float(np.sqrt(np.nanmean(np.sum(np.square(apart), axis=-1))))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m kfmocap.benchmarks.studies.refinement_study", description=__doc__)
    parser.add_argument("--seeds", type=int, default=2, metavar="N", help="cameras moved at random (default: 2)")
    parser.add_argument("--shot", choices=SHOTS, help="of one example only")
    args = parser.parse_args()
    print(HEAD)
    for case in cases([args.shot] if args.shot else SHOTS, args.seeds):
        print(row(case), flush=True)


if __name__ == "__main__":
    main()
