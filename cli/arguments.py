"""The arguments of every command. A command NAME is run by the function `run` of NAME_command.py."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from ..core.choices import CALIBRATION_ENDINGS, FEET, ROOT_MOTIONS, SOLVERS, either
from ..core.runtime.program_version import program_version


def parser() -> argparse.ArgumentParser:
    """Build the parser; the name of the command is parsed into `command`."""
    program = _Parser(prog="kfmocap", description="Keyframe motion tracking of performers.")
    program.add_argument("--version", action=_Version, nargs=0, help="show the program's version and exit")
    commands = program.add_subparsers(required=True, metavar="COMMAND", dest="command")
    _add_track(commands.add_parser("track", help="track a shot and write motion, pictures and a report"))
    _add_batch(commands.add_parser("batch", help="track many shots, and sum them up in one table"))
    _add_calibrate(
        commands.add_parser("calibrate", help="find cameras from a waved wand or a performer, or refine a shot's")
    )
    _add_synchronise(
        commands.add_parser("synchronise", help="find the time offsets of another take's videos from its wand")
    )
    _add_demo(commands.add_parser("demo", help="track real footage of four cameras, downloaded once"))
    _add_retarget(commands.add_parser("retarget", help="put motion files on a character of a .blend file"))
    _add_bench(commands.add_parser("bench", help="measure the tracker's errors and times on the examples"))
    return program


class _Parser(argparse.ArgumentParser):
    """A parser that says how an option takes several values, if it was given them one after the other."""

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the arguments; those that are left over may belong to the option before them."""
        given = sys.argv[1:] if args is None else list(args)
        parsed, left = self.parse_known_args(given, namespace)
        if left:
            before = given[: given.index(left[0])]
            option = next((own for own in reversed(before) if own in _SEVERAL), "")
            hint = f"; for several: {option} {_SEVERAL[option]}" if option and not left[0].startswith("-") else ""
            self.error(f"unrecognized arguments: {' '.join(left)}{hint}")
        return parsed


_SEVERAL = {
    "--views": "cam01,cam02",
    "--keyframes": "0,20,40",
    "--offset": "cam01=3 --offset cam02=-2",
    "--set": "NAME=VALUE --set NAME=VALUE",
}
"""Options with several values, and how these are written."""


def _add_track(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "shot", nargs="?", type=_path, metavar="SHOT.toml", help="by default, in Blender, the open scene"
    )
    command.add_argument("--out", required=True, type=_path, metavar="DIR", help="folder for the results")
    command.add_argument("--views", metavar="CAM,CAM", help="use only the views of these cameras")
    command.add_argument("--keyframes", metavar="N,N | auto", help="use these key frames, or proposed ones")
    command.add_argument(
        "--offset", action="append", metavar="CAM=N", help="use this offset of a camera's footage; may be repeated"
    )
    command.add_argument(
        "--stabilise",
        action=argparse.BooleanOptionalAction,
        help="measure how cameras turn and zoom that the calibration holds still (default: where backgrounds shift)",
    )
    command.add_argument("--refine", action="store_true", help="refine the cameras first, and write them as well")
    command.add_argument("--threads", type=int, metavar="N", help="use N cores (default: all)")
    command.add_argument(
        "--leave-out-unknown", action="store_true", help="write no landmarks and bones of parts that nothing shows"
    )
    command.add_argument(
        "--resume", action="store_true", help="continue from the finished segments of an interrupted run"
    )
    _add_tracking(command)


def _add_batch(command: argparse.ArgumentParser) -> None:
    command.add_argument("shots", nargs="+", metavar="SHOT.toml", help="shot files, or patterns such as shots/*.toml")
    command.add_argument("--out", required=True, type=_path, metavar="DIR", help="folder for a folder of each shot")
    command.add_argument("--jobs", type=int, metavar="N", help="track N shots at a time (default: half the cores)")
    part = command.add_mutually_exclusive_group()
    part.add_argument("--task", type=int, metavar="N", help="track shot N alone, from 0, as one task of a render farm")
    part.add_argument("--summary", action="store_true", help="only write the table of what was tracked before")
    _add_tracking(command)


def _add_calibrate(command: argparse.ArgumentParser) -> None:
    source = command.add_mutually_exclusive_group(required=True)
    source.add_argument(
        "wand", nargs="?", type=_path, metavar="WAND.toml", help="capture of an L-frame and a wand, as videos or points"
    )
    source.add_argument("--refine", type=_path, metavar="SHOT.toml", help="refine a shot's cameras from its key poses")
    source.add_argument(
        "--performer", type=_path, metavar="SHOT.toml", help="find a shot's cameras from 2D keypoints of its performer"
    )
    command.add_argument(
        "--lenses", type=_path, metavar="FILE", help="with --performer: calibration whose lenses are kept"
    )
    command.add_argument("--out", required=True, type=_path, metavar="FILE", help="the calibration to write")
    command.add_argument("--format", metavar="NAME", help=f"{either(CALIBRATION_ENDINGS)} (default: by --out)")
    command.add_argument("--report", type=_path, metavar="DIR", help="folder for the calibration report")
    command.add_argument("--points", type=_path, metavar="FILE.csv", help="also write the detected marker positions")
    _add_drift(command)


def _add_synchronise(command: argparse.ArgumentParser) -> None:
    command.add_argument("wand", type=_path, metavar="WAND.toml", help="capture file of that take: videos or points")
    command.add_argument("--cameras", required=True, type=_path, metavar="FILE", help="calibration of the cameras")
    _add_drift(command)


def _add_demo(command: argparse.ArgumentParser) -> None:
    command.add_argument("--out", type=_path, default=Path("kfmocap-demo"), metavar="DIR", help="default: %(default)s")
    _add_tracking(command)


def _add_retarget(command: argparse.ArgumentParser) -> None:
    command.add_argument("motions", nargs="+", type=_path, metavar="MOTION", help="motion files (.bvh, .fbx)")
    command.add_argument(
        "--to", required=True, type=_path, metavar="CHARACTER", help="its file: .blend, .fbx, .glb, .vrm"
    )
    command.add_argument("--armature", metavar="NAME", help="the character's armature (default: the only candidate)")
    command.add_argument("--preset", metavar="NAME", help="kind of rig, such as rigify, mixamo (default: by its bones)")
    command.add_argument(
        "--out", required=True, type=_path, metavar="MOVED.blend", help="file to write; for several motions a folder"
    )
    command.add_argument("--bone-map", type=_path, metavar="FILE.json", help="bone map of the character")
    command.add_argument("--source-map", type=_path, metavar="FILE.json", help="bone map of the motion files")
    command.add_argument("--save-map", type=_path, metavar="FILE.json", help="also write the bone map that was used")
    command.add_argument("--root", default="world", metavar="NAME", help=either(ROOT_MOTIONS))
    command.add_argument("--feet", default="keep", metavar="NAME", help=either(FEET))
    command.add_argument("--hands", action="store_true", help="keep hands where they stand still")
    command.add_argument("--scale", type=float, metavar="X", help="size of the motion (default: by the legs)")
    command.add_argument("--layer", action="store_true", help="keep the present action below, as a strip of the NLA")
    command.add_argument(
        "--tolerance",
        nargs=2,
        type=float,
        default=(0.0, 0.0),
        metavar=("DEG", "MM"),
        help="leave out keys without which rotations and positions change by no more",
    )


def _add_bench(command: argparse.ArgumentParser) -> None:
    command.add_argument("--out", type=_path, metavar="DIR", help="also write bench.md and bench.json there")
    command.add_argument("--shot", metavar="NAME", help="measure one example or shot only, such as beam or walk")
    command.add_argument("--quick", action="store_true", help="measure a few rows only")
    command.add_argument("--repeat", type=int, default=1, metavar="N", help="times are medians of N runs (default: 1)")
    command.add_argument("--shots", action="store_true", help="measure the set of shots that judges the tracker")
    command.add_argument("--speed", action="store_true", help="measure times by frames, cameras and cores instead")
    command.add_argument("--against", type=_path, metavar="DIR", help="with --speed: another checkout, in turns")
    command.add_argument("--data", type=_path, metavar="DIR", help="with --shots: folder of further shots with truth")
    command.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="with --shots: measure once more with this setting of the tracker; may be repeated",
    )


def _add_tracking(command: argparse.ArgumentParser) -> None:
    command.add_argument("--solver", metavar="NAME", help=either(SOLVERS))
    command.add_argument("--no-blender", action="store_true", help="leave out the files that need Blender")


def _add_drift(command: argparse.ArgumentParser) -> None:
    command.add_argument("--drift", action="store_true", help="clocks may also run at different speeds (long takes)")


class _Version(argparse.Action):
    """Print the program's version, which is looked up only if it is asked for, and exit."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f"kfmocap {program_version()}, Python {sys.version.split()[0]}, {sys.platform}")
        parser.exit()


def _path(text: str) -> Path:
    """Parse a path; empty text, as from an unset shell variable, is an error, as it would mean the working folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError("the path is empty")
    return Path(text)
