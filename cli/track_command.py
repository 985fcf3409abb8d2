"""`kfmocap track`: track a shot and write its results, all of them or none."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from ..core.body import landmark_positions
from ..core.body.unknown_parts import known_landmarks
from ..core.cameras.camera import Camera
from ..core.errors import InputError, ShotError
from ..core.fitting.camera_refinement import Refinement
from ..core.fitting.shot_cameras import (
    camera_fits,
    checked_frames,
    early_frames,
    early_misfits,
    for_camera_fits,
    refine_shot_cameras,
)
from ..core.fitting.view_findings import ViewFinding
from ..core.formats.calibrations.toml_cameras import save_cameras
from ..core.formats.keypoint_files import read_shot_keypoints
from ..core.formats.shot_toml import read_shot_spec
from ..core.formats.trc import write_trc
from ..core.keypoints.hand_points import tracked_hands
from ..core.numerics.arrays import Array
from ..core.review.overlay import contact_sheet, sheet_frames, write_contact_sheet
from ..core.review.report_text import offset_text, report_lines
from ..core.review.track_report import report
from ..core.runtime.files import check_inputs_kept, check_writable, staged, write_json
from ..core.runtime.interrupts import REPORT_FILE, results_are_written
from ..core.runtime.progress import Progress, share
from ..core.runtime.threads import worker_count
from ..core.runtime.timing import Seconds
from ..core.runtime.worker_memory import WorkerMemory
from ..core.runtime.worker_pool import WorkerPool
from ..core.shot.settings import check_threads
from ..core.shot.shot import Gap, Shot
from ..core.shot.shot_spec import ShotSpec, result_names
from ..core.tracking.journal import Journal, journal_beside
from ..core.tracking.prepare import prepare_shot
from ..core.tracking.reader import kept_rate
from ..core.tracking.run_context import FirstPictures, RunContext, SolvedShot
from ..core.tracking.selection import selected
from ..core.tracking.track_result import TrackResult
from ..core.tracking.tracker import WORKER_MODULES, track, workers_for
from .printed import print_outcome
from .progress_bar import print_beside_bar, progress_bar
from .services import BlenderWriter, OutputRequest, Services

REFINING = 0.2
"""Fraction of the work that refining the cameras takes, if it is requested."""
REFINED = "refined.toml"
SCENE = "shot.blend"
OVERLAY = "overlay.png"


def run(args: argparse.Namespace, services: Services) -> int:
    """Run the command; returns the exit code."""
    check_writable(args.out)
    if args.threads is not None:
        check_threads(args.threads, where="--threads")
    with closing(services.workers or WorkerMemory(limit=0)) as memory:
        if args.shot is not None:
            spec = _spec(args)
            check_shot_kept(spec, args.out)
            if worker_count(spec.settings.threads if args.threads is None else args.threads) == 1:
                memory.close()
            # Other processes load their modules while this one fits the key poses.
            memory.start_workers(workers_for(spec, args.threads), (*WORKER_MODULES, camera_fits.__module__))
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
        shot = _shot(args, services)
    if blender is not None:
        blender.check()
    for view in shot.views:
        rate = kept_rate(shot, view, memory)
        if rate is not None and rate.varies:  # it may not be worth the time then
            print(f"kfmocap: {view.camera.name}: {rate.text(shot.fps * view.every)}", file=sys.stderr)
    refined = None
    with journal_beside(args.out, resume=args.resume) as journal, progress_bar() as progress:
        if args.refine:
            with seconds.measure("refining cameras"):
                refined = refine_shot_cameras(shot, share(progress, 0.0, REFINING))
                shot = refined.applied(shot) if args.shot is None else _shot(args, services, refined.cameras)
        files = run_track(
            shot,
            args.out,
            blender=blender,
            progress=share(progress, REFINING, 1.0) if args.refine else progress,
            seconds=seconds,
            open_scene=args.shot is None,
            refined=refined,
            leave_out_unknown=args.leave_out_unknown,
            journal=journal,
            memory=memory,
        )
    with results_are_written():
        if args.resume:
            count = len(journal.taken) or "no"
            print(f"kfmocap: {count} finished segments were taken from a run that was ended", file=sys.stderr)
        print_outcome(files, report_lines(json.loads((args.out / REPORT_FILE).read_text(encoding="utf-8"))))
    return 0


def check_shot_kept(spec: ShotSpec, out: Path) -> None:
    """Check that none of the possible results of a shot would overwrite one of its inputs.

    Raises
    ------
    OutputError
        One would.
    """
    motions = result_names(spec.name, [performer.name for performer in spec.performers])
    results = [out / name for name in _file_names(motions, blender=True, refined=True)]
    check_inputs_kept(results, [spec.path, *spec.files()])


def _file_names(motions: Sequence[str], *, blender: bool, refined: bool) -> list[str]:
    """Return the names of all results, with those that Blender writes and the refined cameras or without."""
    endings = (".trc", ".bvh", ".fbx") if blender else (".trc",)
    scene, cameras = (SCENE,) if blender else (), (REFINED,) if refined else ()
    return [*(f"{name}{ending}" for name in motions for ending in endings), *scene, *cameras, OVERLAY, REPORT_FILE]


def run_track(
    shot: Shot,
    out_dir: Path,
    *,
    blender: BlenderWriter | None = None,
    progress: Progress | None = None,
    seconds: Mapping[str, float] | None = None,
    open_scene: bool = False,
    refined: Refinement | None = None,
    leave_out_unknown: bool = False,
    journal: Journal | None = None,
    memory: WorkerMemory | None = None,
) -> list[Path]:
    """Track a shot; write NAME.trc, overlay.png and report.json, and with Blender NAME.bvh, NAME.fbx and shot.blend.

    Parameters
    ----------
    shot : Shot
    out_dir : Path
        Created if it does not exist; other files in it are not changed.
    blender : BlenderWriter, optional
        By default the files that need Blender are left out.
    progress : callable, optional
    seconds : mapping of str to float, optional
        Seconds of earlier stages, for the report.
    open_scene : bool
        Whether the shot was read from Blender's open scene: shot.blend is then a copy of the open file with the motion.
    refined : Refinement, optional
        The refinement of the shot's cameras, if any; they are then written as refined.toml.
    leave_out_unknown : bool
        Whether the files leave out landmarks and bones of parts that nothing shows.
    journal : Journal, optional
        Stores finished segments, and provides those of an earlier run; see `core.tracking.journal`.
    memory : WorkerMemory, optional
        Cache with worker processes; by default they are started for this run.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    ShotError
        A name is not a valid file name; raised before tracking begins.
    OutputError
        The folder cannot be written; raised before tracking begins if possible.
    FootageError
        The footage ends early.
    CancelledError
        `progress` returned False.
    """
    motions = result_names(shot.name, [performer.name for performer in shot.performers])
    names = _file_names(motions, blender=blender is not None, refined=refined is not None)
    times = Seconds(seconds or {})
    with staged(out_dir, names) as stage, ExitStack() as stack:
        if blender is not None and not open_scene:
            blender.prepare(shot, out_dir, stage.parent)
        if memory is None:
            memory = stack.enter_context(closing(WorkerMemory(limit=0)))
        check = _CameraCheck(shot)
        # A shot's reader has just checked its footage.
        early = FirstPictures(early_frames(shot), partial(_print_misfits, shot))
        context = RunContext(journal, memory, solved=check.begin, first_pictures=early, footage_checked=not open_scene)
        pictures = sorted({*sheet_frames(shot), *checked_frames(shot)})
        result = track(shot, share(progress, 0.0, 0.9), pictures=pictures, run=context)
        # Blender keeps one core busy, in this thread; meanwhile the others draw, and check the cameras if still needed.
        with memory.pool(memory.workers) as pool, ThreadPoolExecutor(1) as beside:
            check.begin(pool, result)
            drawing = beside.submit(_draw_overlay, shot, result, stage / OVERLAY, share(progress, 0.95, 1.0), times)
            files = [stage / f"{name}.trc" for name in motions]
            _write_landmarks(shot, result, files, leave_out_unknown=leave_out_unknown)
            if blender is not None:
                with times.measure("Blender"):
                    hands = _hands(shot, result)
                    request = OutputRequest(stage, out_dir, open_scene, leave_out_unknown, hands)
                    blender.write_outputs(shot, result, request)
            drawing.result()
            with times.measure("camera check"):
                fits = check.result()
        if refined is not None:
            save_cameras(stage / REFINED, refined.cameras)
        write_json(stage / REPORT_FILE, report(shot, result, times, fits=fits, refined=refined))
        written = sorted(file.name for file in stage.iterdir())
    return [out_dir / name for name in written]


def _print_misfits(shot: Shot, pictures: Sequence[Mapping[int, Any]]) -> None:
    """Print which footage does not match the first key poses while the shot is being tracked."""
    for misfit in early_misfits(shot, pictures):
        offset = offset_text(misfit.camera, misfit.offset) if misfit.by == "movement" else ""
        print_beside_bar(f"kfmocap: {misfit.summary}{offset} (tracking goes on; Ctrl-C ends it)")


class _CameraCheck:
    """A check of how well a shot's cameras fit, which a worker does as soon as it is idle."""

    def __init__(self, shot: Shot) -> None:
        self._shot = shot
        self._gaps: tuple[tuple[Gap, ...], ...] = ()
        self._job: Future[tuple[ViewFinding, ...]] | None = None

    def begin(self, pool: WorkerPool, solved: TrackResult | SolvedShot) -> None:
        """Start the check in a pool, unless it was started before with the same gaps in the footage."""
        if self._job is None or self._gaps != solved.gaps:
            self._gaps = solved.gaps
            work = partial(camera_fits, self._shot, for_camera_fits(self._shot, solved))
            self._job = pool.submit(work, lambda _: None)

    def result(self) -> tuple[ViewFinding, ...]:
        """Wait for the result."""
        assert self._job is not None
        return self._job.result()


def _draw_overlay(shot: Shot, result: TrackResult, file: Path, progress: Progress | None, times: Seconds) -> None:
    with times.measure("overlay"):
        in_step = shot.with_footage_offset(result.footage_offset)
        sheet = contact_sheet(in_step, result.motions, sheet_frames(shot), progress, result.pictures)
        write_contact_sheet(file, sheet)


def _shot(args: argparse.Namespace, services: Services, cameras: Mapping[str, Camera] | None = None) -> Shot:
    """Read the shot of the file or, inside Blender, of the open scene; `cameras` are used instead of the file's."""
    if args.shot is not None:
        shot = prepare_shot(_spec(args), cameras)
    elif services.in_blender:
        shot = selected(
            services.blender().read_shot(),
            _views(args),
            _keyframes(args.keyframes),
            args.solver,
            offsets=_offsets(args.offset),
        )
    else:
        raise ShotError("no shot file is named", where="kfmocap track", todo="kfmocap track SHOT.toml --out DIR")
    if args.threads is None:
        return shot
    return replace(shot, settings=replace(shot.settings, threads=args.threads))


def _spec(args: argparse.Namespace) -> ShotSpec:
    """Read the shot file, and apply the choices of the command line."""
    return read_shot_spec(args.shot).selected(
        views=_views(args), keyframes=_keyframes(args.keyframes), solver=args.solver, offsets=_offsets(args.offset)
    )


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


def _hands(shot: Shot, result: TrackResult) -> tuple[Array | None, ...]:
    """Return the points of the hands of performers with `fingers`; prints a remark on those not found."""
    if not any(performer.fingers for performer in shot.performers):
        return ()
    detections, found = read_shot_keypoints(shot, hands=True), list[Array | None]()
    for i, performer in enumerate(shot.performers):
        hands = None
        if performer.fingers:
            try:
                hands = tracked_hands(shot, detections, i, result.motions[i])
            except InputError as error:
                print(f"kfmocap: {performer.name} is written without fingers: {error}", file=sys.stderr)
        found.append(hands)
    return tuple(found)


def _write_landmarks(shot: Shot, result: TrackResult, files: Sequence[Path], *, leave_out_unknown: bool) -> None:
    """Write every performer's landmarks."""
    for i, file in enumerate(files):
        body, motion = shot.performers[i].body, result.motions[i]
        names = known_landmarks(body, result.unknown[i] if leave_out_unknown else ())
        write_trc(file, names, landmark_positions(body, motion, names), shot.fps)
