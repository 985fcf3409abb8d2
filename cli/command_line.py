"""The command line: one parser for `kfmocap ...` and for `blender ... --command kfmocap ...`.

Importing it pulls in neither Blender nor the core.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import bpy

    from ..core.runtime.progress import Progress
    from ..core.shot.shot import Shot

_REDRAW_SECONDS = 0.1


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; by default the process's.

    Returns
    -------
    int
        Exit code: 0 when everything asked for was written, 1 after an error, 130 when interrupted.
    """
    _quiet_libraries()
    args = parser().parse_args(argv)
    from ..core.errors import KFMocapError

    try:
        return args.run(args)
    except KFMocapError as error:
        message = " ".join(str(error).split())
        print(f"kfmocap: error: {message}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("kfmocap: interrupted, nothing was written", file=sys.stderr)
        return 130


def _quiet_libraries() -> None:
    """Our own messages say what is wrong with footage; and threads inside small matrix products cost time.

    Both are read when the libraries are first loaded.
    """
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="kfmocap", description="Keyframe motion tracking of performers.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    track = commands.add_parser("track", help="track a shot and write motion, pictures and a report")
    track.add_argument("shot", nargs="?", type=Path, metavar="SHOT.toml", help="inside Blender: the open scene")
    track.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder for the results")
    track.add_argument("--views", metavar="CAM,CAM", help="use the views of these cameras only")
    track.add_argument("--keyframes", metavar="N,N | auto", help="use these key frames instead of the shot's")
    _add_tracking(track)
    track.set_defaults(run=_track)

    calibrate = commands.add_parser("calibrate", help="solve for cameras from a waved wand, or refine those of a shot")
    source = calibrate.add_mutually_exclusive_group(required=True)
    source.add_argument(
        "wand", nargs="?", type=Path, metavar="WAND.toml", help="an L-frame and a wand, filmed or points"
    )
    source.add_argument("--refine", type=Path, metavar="SHOT.toml", help="refine a shot's cameras from its key poses")
    calibrate.add_argument("--out", required=True, type=Path, metavar="FILE", help="the calibration to write")
    calibrate.add_argument("--format", metavar="NAME", help="toml, caliscope, qualisys or opencv (default: by --out)")
    calibrate.add_argument("--report", type=Path, metavar="DIR", help="folder for how far to trust a wand's cameras")
    calibrate.add_argument("--points", type=Path, metavar="FILE.csv", help="also write the points found of the markers")
    _add_drift(calibrate)
    calibrate.set_defaults(run=_calibrate)

    synchronise = commands.add_parser("synchronise", help="find the time offsets of one more take by its wand")
    synchronise.add_argument("wand", type=Path, metavar="WAND.toml", help="names that take's videos, or points")
    synchronise.add_argument("--cameras", required=True, type=Path, metavar="FILE", help="their calibration")
    _add_drift(synchronise)
    synchronise.set_defaults(run=_synchronise)

    demo = commands.add_parser("demo", help="track real footage of four cameras, fetched once")
    demo.add_argument("--out", type=Path, default=Path("kfmocap-demo"), metavar="DIR", help="default: %(default)s")
    _add_tracking(demo)
    demo.set_defaults(run=_demo)

    bench = commands.add_parser("bench", help="measure the tracker's errors and times on the examples")
    bench.add_argument("--out", type=Path, metavar="DIR", help="also write bench.md and bench.json there")
    bench.add_argument("--shot", metavar="NAME", help="of one example only: beam or walk")
    bench.add_argument("--quick", action="store_true", help="a few rows only")
    bench.add_argument("--repeat", type=int, default=1, metavar="N", help="times are medians of N runs (default: 1)")
    bench.set_defaults(run=_bench)
    return parser


def _add_tracking(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--solver", metavar="NAME", help="gauss-newton or relaxation")
    parser.add_argument("--no-blender", action="store_true", help="write only what needs no Blender")


def _add_drift(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--drift", action="store_true", help="clocks may also run faster or slower (long takes)")


def _calibrate(args: argparse.Namespace) -> int:
    return _refine(args) if args.refine is not None else _calibrate_by_wand(args)


def _calibrate_by_wand(args: argparse.Namespace) -> int:
    from .calibrate_command import run_calibrate

    with progress_bar() as progress:
        solution, files = run_calibrate(
            args.wand, args.out, args.report, args.points, progress, kind=args.format, drift=args.drift
        )
    print(*files, sep="\n")
    for line in (*solution.clocks.lines, *solution.findings):
        print(f"kfmocap: {line}", file=sys.stderr)
    return 0


def _synchronise(args: argparse.Namespace) -> int:
    from ..core.calibration.api import synchronise_take
    from ..core.formats import load_cameras
    from ..core.formats.wand_toml import load_wand

    with progress_bar() as progress:
        clocks = synchronise_take(load_wand(args.wand), load_cameras(args.cameras), progress, drift=args.drift)
    print(*clocks.lines, sep="\n")
    return 0


def _track(args: argparse.Namespace) -> int:
    from .track_command import check_output, require_blender, run_track

    check_output(args.out)
    if not args.no_blender:
        require_blender()
    begin = time.perf_counter()
    shot, scene = _shot(args)
    seconds = {"shot": time.perf_counter() - begin}
    with progress_bar() as progress:
        files = run_track(shot, args.out, not args.no_blender, progress, seconds, scene)
    print(*files, sep="\n")
    _tell_blind_spots(args.out / "report.json")
    return 0


def _refine(args: argparse.Namespace) -> int:
    from ..core.errors import KFMocapError
    from .refine_command import refine_shot, told

    if args.report is not None or args.points is not None or args.drift:
        todo = "leave them out with --refine"
        raise KFMocapError("--report, --points and --drift are of a wand", where="kfmocap calibrate", todo=todo)
    with progress_bar() as progress:
        refinement = refine_shot(args.refine, args.out, progress, kind=args.format)
    print(args.out)
    for line in told(refinement):
        print(f"kfmocap: {line}", file=sys.stderr)
    return 0


def _tell_blind_spots(path: Path) -> None:
    """What no camera saw and where key poses would help, for those who look; the list of files stays as it is."""
    from ..core.review.track_report import blind_spots

    for line in blind_spots(json.loads(path.read_text(encoding="utf-8"))):
        print(f"kfmocap: {line}", file=sys.stderr)


def _shot(args: argparse.Namespace) -> tuple[Shot, bpy.types.Scene | None]:
    """The shot of the file, or of the open scene, and that scene."""
    views = None if args.views is None else [name for name in args.views.split(",") if name]
    keyframes = _keyframes(args.keyframes)
    if args.shot is not None:
        from ..core.formats import load_shot

        return load_shot(args.shot, views=views, keyframes=keyframes, solver=args.solver), None
    from ..core.errors import ShotError
    from ..core.tracking.selection import selected

    if "bpy" not in sys.modules:
        raise ShotError("no shot file is named", where="kfmocap track", todo="kfmocap track SHOT.toml --out DIR")
    import bpy

    from ..kfmocap_addon.export import blender_outputs

    scene = bpy.context.scene
    return selected(blender_outputs.shot_from_scene(scene), views, keyframes, args.solver), scene


@contextmanager
def progress_bar() -> Iterator[Progress | None]:
    """A progress callback that draws a bar on standard error, or None where that is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    last = 0.0

    def draw(what: str, fraction: float) -> bool:
        nonlocal last
        now = time.monotonic()
        if now - last > _REDRAW_SECONDS or fraction >= 1:
            last = now
            width = max(10, shutil.get_terminal_size().columns - 30)
            done = round(width * min(max(fraction, 0.0), 1.0))
            bar = "#" * done + "." * (width - done)
            print(f"\r\x1b[K{what[:18]:18} [{bar}] {fraction:4.0%}", end="", file=sys.stderr, flush=True)
        return True

    try:
        yield draw
    finally:
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def _keyframes(text: str | None) -> list[int] | Literal["auto"] | None:
    from ..core.errors import ShotError

    if text is None or text == "auto":
        return text
    try:
        return [int(number) for number in text.split(",")]
    except ValueError as error:
        todo = "whole numbers with commas between, such as 0,33,66,99"
        raise ShotError(f"'{text}' is no list of frames", where="--keyframes", todo=todo) from error


def _demo(args: argparse.Namespace) -> int:
    from .demo_command import run

    return run(args.out, not args.no_blender, args.solver)


def _bench(args: argparse.Namespace) -> int:
    from ..core.errors import KFMocapError

    try:
        from ..benchmarks import bench
    except ImportError as error:
        todo = "run it from a checkout of the project"
        raise KFMocapError(f"the benchmark is not installed: {error}", todo=todo) from error
    return bench.run(args)
