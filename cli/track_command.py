"""`kfmocap track`: read a shot, with the choices of the command line, and track it."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import replace
from typing import Literal

from ..core.cameras.camera import Camera
from ..core.errors import ShotError
from ..core.fitting.shot_cameras import camera_fits, refine_shot_cameras
from ..core.formats.shot_toml import read_shot_spec
from ..core.review.pretracking_warnings import warnings_before_tracking
from ..core.review.report_text import report_lines
from ..core.runtime.interrupts import REPORT_FILE, results_are_written
from ..core.runtime.output_files.files import check_inputs_kept, check_writable
from ..core.runtime.processes.worker_memory import WorkerMemory
from ..core.runtime.processes.worker_process import can_be_copied
from ..core.runtime.progress import share
from ..core.runtime.threads import worker_count
from ..core.runtime.timing import Seconds
from ..core.shot.settings import Settings, check_threads
from ..core.shot.shot import Shot
from ..core.shot.shot_spec import ShotSpec
from ..core.tracking.footage_corrections.damaged_footage import decoder_messages
from ..core.tracking.footage_reading.frames_ahead import remember_ahead
from ..core.tracking.footage_reading.reader import kept_rate
from ..core.tracking.prepare import prepare_shot
from ..core.tracking.results.journal import journal_beside
from ..core.tracking.scheduling.worker_counts import WORKER_MODULES, workers_for
from ..core.tracking.selection import selected
from .printed import print_outcome
from .progress_bar import progress_bar
from .services import BlenderWriter, Services
from .tracked_files import SCENE, ResultFiles, check_shot_kept, frames_ahead, run_track

REFINING = 0.2
"""Fraction of the work that refining the cameras takes, if it is requested."""


def run(args: argparse.Namespace, services: Services) -> int:
    """Run the command; returns the exit code."""
    check_writable(args.out)
    if args.threads is not None:
        check_threads(args.threads, where="--threads")
    with closing(services.workers or WorkerMemory(limit=0)) as memory:
        if args.shot is not None:
            spec = _spec(args)
            check_shot_kept(spec, args.out)
            if worker_count(spec.settings.threads) == 1:
                memory.close()
            # Other processes load their modules while this one fits the key poses, unless they are copies of this one.
            modules = *WORKER_MODULES, camera_fits.__module__, "scipy.interpolate"  # of SciPy's splines of rotations
            memory.start_workers(workers_for(spec), modules, copied=can_be_copied())
        with nullcontext() if args.no_blender else services.blender_beside() as blender:
            return _run(args, services, memory, blender)


def _run(
    args: argparse.Namespace,
    services: Services,
    memory: WorkerMemory,
    blender: BlenderWriter | None,
) -> int:
    """Run the command, with processes in `memory` and with or without Blender."""
    seconds = Seconds()
    with seconds.measure("shot"):
        shot = _shot(args, services, memory=None if args.refine else memory)
    if blender is not None:
        blender.check()
    for view in shot.views:
        rate = kept_rate(shot, view, memory)
        if rate is not None and rate.varies:  # it may not be worth the time then
            print(f"kfmocap: {view.camera.name}: {rate.text(shot.fps * view.every)}", file=sys.stderr)
    for text in warnings_before_tracking(shot):
        print(f"kfmocap: {text}", file=sys.stderr)
    refined = None
    with journal_beside(args.out, resume=args.resume) as journal, progress_bar() as progress:
        if args.refine:
            with seconds.measure("refining cameras"):
                refined = refine_shot_cameras(shot, share(progress, 0.0, REFINING))
                shot = refined.applied(shot) if args.shot is None else _shot(args, services, refined.cameras)
        files = run_track(
            shot,
            args.out,
            ResultFiles(blender, args.shot is None, refined, args.leave_out_unknown, seconds),
            progress=share(progress, REFINING, 1.0) if args.refine else progress,
            journal=journal,
            memory=memory,
        )
    with results_are_written():
        if args.resume:
            count = len(journal.taken)
            taken = f"{count or 'no'} finished segment{' was' if count == 1 else 's were'} taken"
            print(f"kfmocap: {taken} from a run that was ended", file=sys.stderr)
        print_outcome(files, report_lines(json.loads((args.out / REPORT_FILE).read_text(encoding="utf-8"))))
    return 0


def _shot(
    args: argparse.Namespace,
    services: Services,
    cameras: Mapping[str, Camera] | None = None,
    *,
    memory: WorkerMemory | None = None,
) -> Shot:
    """Read the shot of the file or, inside Blender, of the open scene; `cameras` are used instead of the file's. The
    tracker finds the first frames decoded in `memory`.
    """
    if args.shot is not None:
        spec = _spec(args)
        return prepare_shot(spec, cameras) if memory is None else _shot_with_frames(spec, memory)
    if not services.in_blender:
        raise ShotError("no shot file is named", where="kfmocap track", todo="kfmocap track SHOT.toml --out DIR")
    offsets, session = _offsets(args.offset), services.blender()
    if not args.no_blender and (file := session.open_file()) is not None:
        check_inputs_kept([args.out / SCENE], [file])
    shot = selected(session.read_shot(), _views(args), _keyframes(args.keyframes), args.solver, offsets=offsets)
    return replace(shot, settings=_with_choices(shot.settings, args))


def _shot_with_frames(spec: ShotSpec, memory: WorkerMemory) -> Shot:
    """Prepare a shot, and decode its first frames meanwhile."""
    if (ahead := frames_ahead(spec)) is None:
        return prepare_shot(spec)
    remember_ahead(memory, ahead)
    with decoder_messages(memory):
        return prepare_shot(spec, ahead=ahead)


def _spec(args: argparse.Namespace) -> ShotSpec:
    """Read the shot file, and apply the choices of the command line."""
    spec = read_shot_spec(args.shot).selected(
        views=_views(args), keyframes=_keyframes(args.keyframes), solver=args.solver, offsets=_offsets(args.offset)
    )
    return replace(spec, settings=_with_choices(spec.settings, args))


def _with_choices(settings: Settings, args: argparse.Namespace) -> Settings:
    given = {name: value for name in ("threads", "stabilise") if (value := getattr(args, name)) is not None}
    return replace(settings, **given)


def _views(args: argparse.Namespace) -> list[str] | None:
    return None if args.views is None else [name for name in args.views.split(",") if name]


def _offsets(given: Sequence[str] | None) -> dict[str, float]:
    found = {}
    for text in given or ():
        camera, _, number = text.rpartition("=")
        try:
            found[camera] = float(number)
        except ValueError:
            found[camera] = math.nan
        if not camera or not math.isfinite(found[camera]):
            todo = "give a camera and a number of frames, such as cam02=3"
            raise ShotError(f"'{text}' is not an offset of a camera", where="--offset", todo=todo)
    return found


def _keyframes(text: str | None) -> list[int] | Literal["auto"] | None:
    if text is None:
        return None
    if text == "auto":
        return "auto"
    try:
        return [int(number) for number in text.split(",")]
    except ValueError as error:
        todo = "give whole numbers separated by commas, such as 0,33,66,99"
        raise ShotError(f"'{text}' is not a list of frames", where="--keyframes", todo=todo) from error
