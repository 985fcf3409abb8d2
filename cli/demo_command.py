"""`kfmocap demo`: track real footage from four cameras, or a small rendered example if it cannot be downloaded."""

from __future__ import annotations

import argparse
import sys
import time
from contextlib import nullcontext
from pathlib import Path

from ..core.errors import FootageError
from ..core.formats import read_trc
from ..core.review.scoring import joint_error
from ..core.runtime.interrupts import results_are_written
from ..core.runtime.output_files.files import check_writable
from ..core.shot.shot import Shot
from ..core.tracking.prepare import load_shot
from .example_footage import example_folder
from .progress_bar import progress_bar
from .services import BlenderWriter, Services
from .tracked_files import ResultFiles, run_track


def run(args: argparse.Namespace, services: Services) -> int:
    """Track the example, write the results, print their distance from the reference; returns the exit code."""
    check_writable(args.out)
    with nullcontext() if args.no_blender else services.blender_beside() as blender:
        return _run(args, blender)


def _run(args: argparse.Namespace, blender: BlenderWriter | None) -> int:
    """Track the example with Blender, or without."""
    folder = _demo_folder()
    begin = time.perf_counter()
    shot = load_shot(folder / "shot.toml", solver=args.solver)
    seconds = {"shot": time.perf_counter() - begin}
    with progress_bar() as progress:
        files = run_track(shot, args.out, ResultFiles(blender, seconds=seconds), progress=progress)
    with results_are_written():
        print(*files, sep="\n")
        print(_summary(shot, args.out, folder, time.perf_counter() - begin))
    return 0


def _summary(shot: Shot, out_dir: Path, folder: Path, seconds: float) -> str:
    keys = [int(f) for f in shot.performers[0].key_poses.frames]
    score = joint_error(read_trc(out_dir / f"{shot.name}.trc"), read_trc(folder / "landmarks.trc"), keys)
    return (
        f"{shot.name}: {len(shot.views)} cameras, {shot.length} frames, key poses at {len(keys)} of them, "
        f"{seconds:.0f} s. Joints on the other frames are {score.mean:.1f} mm (mean) from the reference.\n"
        f"See how it fits: {out_dir / 'overlay.png'}"
    )


def _demo_folder() -> Path:
    try:
        return example_folder("beam")
    except FootageError as error:
        print(
            f"kfmocap: the demo's footage could not be downloaded: {' '.join(str(error).split())}",
            file=sys.stderr,
        )
        print("kfmocap: tracking the small rendered example instead", file=sys.stderr)
        return example_folder("walk")
