"""Track a shot and write its results, all of them or none."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from ..core.body import landmark_positions
from ..core.body.unknown_parts import known_landmarks
from ..core.errors import InputError
from ..core.fitting.camera_fits.camera_refinement import Refinement
from ..core.fitting.checks.early_check import early_frames, early_misfits
from ..core.fitting.checks.flicker import FLICKER_FRAMES
from ..core.fitting.checks.view_findings import ViewFinding
from ..core.fitting.shot_cameras import camera_fits, checked_frames, for_camera_fits
from ..core.formats.calibrations.toml_cameras import save_cameras
from ..core.formats.keypoint_files import read_shot_keypoints
from ..core.formats.trc import write_trc
from ..core.keypoints.hand_points import tracked_hands
from ..core.numerics.arrays import Array
from ..core.review.overlay import contact_sheet, keys_and_middles, sheet_frames, write_contact_sheet
from ..core.review.report_text import offset_text
from ..core.review.track_report import report
from ..core.runtime.interrupts import REPORT_FILE
from ..core.runtime.output_files.files import check_inputs_kept, staged, write_json
from ..core.runtime.processes.worker_memory import WorkerMemory
from ..core.runtime.processes.worker_pool import WorkerPool
from ..core.runtime.progress import Progress, share
from ..core.runtime.threads import one_library_thread, worker_count
from ..core.runtime.timing import Seconds
from ..core.shot.shot import Gap, Shot
from ..core.shot.shot_spec import ShotSpec, result_names
from ..core.tracking.footage_reading.frames_ahead import FramesAhead
from ..core.tracking.footage_reading.turned_cameras import with_turns
from ..core.tracking.results.journal import Journal
from ..core.tracking.results.track_result import TrackResult
from ..core.tracking.scheduling.run_context import FirstPictures, RunContext, SolvedShot
from ..core.tracking.tracker import track
from .progress_bar import print_beside_bar
from .services import BlenderWriter, OutputRequest

REFINED = "refined.toml"
SCENE = "shot.blend"
OVERLAY = "overlay.png"


@dataclass(frozen=True)
class ResultFiles:
    """What is written beside landmarks, overlay and report, and how.

    Attributes
    ----------
    blender : BlenderWriter, optional
        Writes the files that need Blender; without it they are left out.
    open_scene : bool
        Whether the shot was read from Blender's open scene: shot.blend is then a copy of the open file with the motion.
    refined : Refinement, optional
        The refinement of the shot's cameras, if any; they are then written as refined.toml.
    leave_out_unknown : bool
        Whether the files leave out landmarks and bones of parts that nothing shows.
    seconds : mapping of str to float
        Seconds of the stages before tracking, for the report.
    """

    blender: BlenderWriter | None = None
    open_scene: bool = False
    refined: Refinement | None = None
    leave_out_unknown: bool = False
    seconds: Mapping[str, float] = field(default_factory=dict)


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


def frames_ahead(spec: ShotSpec) -> FramesAhead | None:
    """Return what decodes the first frames of a shot before `run_track` does, with the pictures that it may ask for.

    None with a single thread, or if the shot file does not name the key frames.
    """
    keys = spec.named_keyframes
    if not keys or worker_count(spec.settings.threads) == 1:
        return None
    (first, last), length = spec.frames, spec.frames[1] - spec.frames[0] + 1
    pictures = keys_and_middles((frame - first for own in keys for frame in own), length)
    return FramesAhead((first, last), {*pictures, *range(min(FLICKER_FRAMES, length))}, spec.settings)


def run_track(
    shot: Shot,
    out_dir: Path,
    files: ResultFiles | None = None,
    *,
    progress: Progress | None = None,
    journal: Journal | None = None,
    memory: WorkerMemory | None = None,
) -> list[Path]:
    """Track a shot; write NAME.trc, overlay.png and report.json, and with Blender NAME.bvh, NAME.fbx and shot.blend.

    Parameters
    ----------
    shot : Shot
    out_dir : Path
        Created if it does not exist; other files in it are not changed.
    files : ResultFiles, optional
        By default the files that need Blender are left out.
    progress : callable, optional
    journal : Journal, optional
        Stores finished segments, and provides those of an earlier run; see `core.tracking.results.journal`.
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
    files = files or ResultFiles()
    names = _file_names(_motion_names(shot), blender=files.blender is not None, refined=files.refined is not None)
    times = Seconds(files.seconds)
    with staged(out_dir, names) as stage, ExitStack() as stack:
        if files.blender is not None and not files.open_scene:
            files.blender.prepare(shot, out_dir, stage.parent)
        if memory is None:
            memory = stack.enter_context(closing(WorkerMemory(limit=0)))
        check = _CameraCheck(shot)
        context = _run_context(shot, files, check, journal, memory)
        pictures = sorted({*sheet_frames(shot), *checked_frames(shot)})
        result = track(shot, share(progress, 0.0, 0.9), pictures=pictures, run=context)
        # Blender keeps one core busy, in this thread; meanwhile the others draw, and check the cameras if still needed.
        with memory.pool(memory.workers) as pool, ThreadPoolExecutor(1) as beside:
            check.begin(pool, result)
            shot = with_turns(shot, result.turns)
            drawing = beside.submit(_draw_overlay, shot, result, stage / OVERLAY, share(progress, 0.95, 1.0), times)
            _write_motions(shot, result, files, times, stage=stage, out_dir=out_dir)
            drawing.result()
            with times.measure("camera check"):
                fits = check.result()
        if files.refined is not None:
            save_cameras(stage / REFINED, files.refined.cameras)
        write_json(stage / REPORT_FILE, report(shot, result, times, fits=fits, refined=files.refined))
        written = sorted(file.name for file in stage.iterdir())
    return [out_dir / name for name in written]


def _motion_names(shot: Shot) -> list[str]:
    """Return the name of every performer's files, without their endings."""
    return result_names(shot.name, [performer.name for performer in shot.performers])


def _run_context(
    shot: Shot, files: ResultFiles, check: _CameraCheck, journal: Journal | None, memory: WorkerMemory
) -> RunContext:
    """Return what goes on beside tracking: the first key frames and the cameras are checked."""
    early = FirstPictures(early_frames(shot), partial(_print_misfits, shot))
    checked = not files.open_scene  # the reader of a shot file has just checked its footage
    return RunContext(journal, memory, solved=check.begin, first_pictures=early, footage_checked=checked)


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


@one_library_thread()
def _draw_overlay(shot: Shot, result: TrackResult, file: Path, progress: Progress | None, times: Seconds) -> None:
    with times.measure("overlay"):
        in_step = shot.with_footage_offset(result.footage_offset)
        sheet = contact_sheet(in_step, result.motions, sheet_frames(shot), progress, result.pictures)
        write_contact_sheet(file, sheet)


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


def _write_motions(
    shot: Shot, result: TrackResult, files: ResultFiles, times: Seconds, *, stage: Path, out_dir: Path
) -> None:
    """Write every performer's landmarks into the folder `stage`, and with Blender the motions and the scene."""
    for i, name in enumerate(_motion_names(shot)):
        body, motion = shot.performers[i].body, result.motions[i]
        landmarks = known_landmarks(body, result.unknown[i] if files.leave_out_unknown else ())
        write_trc(stage / f"{name}.trc", landmarks, landmark_positions(body, motion, landmarks), shot.fps)
    if files.blender is None:
        return
    with times.measure("Blender"):
        request = OutputRequest(stage, out_dir, files.open_scene, files.leave_out_unknown, _hands(shot, result))
        files.blender.write_outputs(shot, result, request)
