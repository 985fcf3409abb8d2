"""`kfmocap retarget`: put motion files on a character of a .blend file, each saved as a file of its own."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..core.errors import OutputError, ShotError
from ..core.retargeting.bone_roles.roles import named_together
from ..core.runtime.output_files.files import check_inputs_kept, check_writable, write_json
from .printed import print_outcome
from .services import RetargetRequest, Services


def run(args: argparse.Namespace, services: Services) -> int:
    """Run the command; returns the exit code."""
    requests = _requests(args)
    for request in requests:
        check_writable(request.out.parent)
    reports = [request.out.with_suffix(".report.json") for request in requests]
    results = [*(request.out for request in requests), *reports, *_given(args.save_map)]
    check_inputs_kept(results, [*args.motions, args.to, *_given(args.source_map)])
    files: list[Path] = []
    with services.blender_beside() as blender:  # damaged files make Blender crash
        for request, beside in zip(requests, reports, strict=True):
            report = blender.retarget(request)
            write_json(beside, report)
            files += [request.out, beside]
            if args.save_map is not None:
                from ..core.formats.bone_map_files import write_bone_map

                write_bone_map(args.save_map, report["target"]["bones"], report["target"]["preset"])
            for line in summary_lines(report):
                print(f"kfmocap: {line}", file=sys.stderr)
    print_outcome(files)
    return 0


def _given(path: Path | None) -> list[Path]:
    """Return the path, if there is one."""
    return [] if path is None else [path]


def _requests(args: argparse.Namespace) -> list[RetargetRequest]:
    """Return one request for each motion file; the results of several are written into the folder --out."""
    several = len(args.motions) > 1
    if several and args.out.suffix == ".blend":
        todo = "give a folder: every motion is saved as a file of its own"
        raise OutputError("several motions cannot be saved as one file", where="--out", todo=todo)
    if not several and args.out.suffix != ".blend":
        raise OutputError("does not end in .blend", where=f"--out {args.out}", todo="name the file to write")
    for path in [*args.motions, args.to]:
        if not path.is_file():
            raise ShotError("there is no such file", where=str(path))
    stems = [path.stem for path in args.motions]
    repeated = next((stem for stem in stems if stems.count(stem) > 1), None)
    if repeated is not None:
        raise OutputError(f"two motions are named {repeated}", where="MOTION", todo="rename one, or send it alone")
    return [
        RetargetRequest(
            motion,
            args.to,
            args.out / f"{motion.stem}.blend" if several else args.out,
            args.armature,
            args.preset,
            bone_map=args.bone_map,
            source_map=args.source_map,
            root=args.root,
            feet=args.feet,
            hands=args.hands,
            layer=args.layer,
            scale=args.scale,
            angle=args.tolerance[0],
            distance=args.tolerance[1],
        )
        for motion in args.motions
    ]


def summary_lines(report: Mapping[str, Any]) -> list[str]:
    """Return a few lines on what was done, and on the remaining errors."""
    target, source = report["target"], report["source"]
    how = f"preset {target['preset']}" if target["preset"] else f"bones by their {target['found_by']}"
    lines = [
        f"{source['name']}: {source['frames']} frames on {target['armature']} ({how}), "
        f"scale {report['scale']:.3f}, {report['keys']} keys, {report['seconds']:.1f} s"
    ]
    worst = max(report["error"].items(), key=lambda row: row[1]["worst_degrees"], default=None)
    if worst is not None:
        error = worst[1]
        lines.append(
            f"remaining error at most {error['worst_degrees']:.2f} degrees, {error['worst_mm']:.1f} mm ({worst[0]})"
        )
    if report["not_in_target"]:
        lines.append(f"{target['armature']} has no {named_together(report['not_in_target'])}: that motion is left out")
    return lines + [f"warning: {text}" for text in report["warnings"]]
