"""Track a shot and write its results: all of them, or nothing."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.body import landmark_positions
from ..core.errors import OutputError
from ..core.formats.shot_toml import shot_name
from ..core.formats.trc import write_trc
from ..core.review.overlay import contact_sheet, sheet_frames, write_contact_sheet
from ..core.review.track_report import report
from ..core.runtime.files import write_json
from ..core.runtime.progress import Progress, share
from ..core.shot.shot import Shot
from ..core.tracking.tracker import TrackResult, track

if TYPE_CHECKING:
    import bpy


def run_track(
    shot: Shot,
    out_dir: Path,
    blender: bool = True,
    progress: Progress | None = None,
    seconds: dict[str, float] | None = None,
    scene: bpy.types.Scene | None = None,
) -> list[Path]:
    """Track a shot; write NAME.trc, overlay.png, report.json; with Blender NAME.bvh, NAME.fbx, shot.blend.

    Parameters
    ----------
    shot : Shot
    out_dir : Path
        Made if it is not there; other files in it stay as they are.
    blender : bool
        Write what needs Blender's module bpy, too.
    progress : callable, optional
    seconds : dict, optional
        Seconds of earlier stages, for the report.
    scene : bpy.types.Scene, optional
        The scene that the shot was read from: shot.blend is then a copy of the open file with the motion.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    OutputError
        The folder cannot be written, seen before the tracking begins, or Blender's module is missing.
    FootageError
        The footage breaks off.
    CancelledError
        `progress` returned False.
    """
    shot_name(shot.name, "[shot]")
    if blender:
        require_blender()
    with staged(out_dir) as stage:
        shown = sheet_frames(shot)
        result = track(shot, share(progress, 0.0, 0.95), pictures=shown)
        clock = _Clock(dict(seconds or {}))
        write_landmarks(shot, result, stage)
        in_step, drawing = shot.in_step(result.footage_offset), share(progress, 0.95, 1.0)
        sheet = contact_sheet(in_step, result.motions, shown, drawing, result.pictures)
        write_contact_sheet(stage / "overlay.png", sheet)
        clock.lap("overlay")
        if blender:
            from ..kfmocap_addon.export import blender_outputs

            blender_outputs.write_blender_outputs(shot, result, stage, scene, home=out_dir)
            clock.lap("Blender")
        write_json(stage / "report.json", report(shot, result, clock.seconds))
        names = sorted(file.name for file in stage.iterdir())
    return [out_dir / name for name in names]


def require_blender() -> None:
    """See that Blender's module is there.

    Raises
    ------
    OutputError
        It is not, or it does not load.
    """
    try:
        import bpy  # noqa: F401
    except ImportError as error:
        raise OutputError(
            f"BVH, FBX and .blend need Blender's module bpy: {error}",
            todo="pip install 'kfmocap[blender]', or ask for the rest alone with --no-blender",
        ) from error


def write_landmarks(shot: Shot, result: TrackResult, folder: Path) -> None:
    """Write every performer's landmarks: NAME.trc, or NAME_PERFORMER.trc each where there are several."""
    for performer, motion in zip(shot.performers, result.motions, strict=True):
        names = list(performer.body.landmarks)
        several = len(shot.performers) > 1
        name = shot_name(f"{shot.name}_{performer.name}", "[[performer]]") if several else shot.name
        points = landmark_positions(performer.body, motion, names)
        write_trc(folder / f"{name}.trc", names, points, shot.fps)


def check_output(out_dir: Path) -> None:
    """See that results can be written, before any work is done.

    Raises
    ------
    OutputError
        They cannot.
    """
    _new_stage(out_dir).rmdir()


@contextmanager
def staged(out_dir: Path) -> Iterator[Path]:
    """Give an empty folder whose files are moved into `out_dir` when the block ends well, else dropped.

    Raises
    ------
    OutputError
        `out_dir` cannot be written: raised before the block begins.
    """
    stage = _new_stage(out_dir)
    try:
        yield stage
        _move_files(stage, out_dir)
    except OSError as error:
        raise _unwritable(out_dir, error) from error
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def _new_stage(out_dir: Path) -> Path:
    if out_dir.exists() and not out_dir.is_dir():
        raise OutputError("is a file, not a folder", where=f"--out {out_dir}")
    # On the file system of the results, so that moving a file into place cannot fail half-way.
    beside = next(folder for folder in (out_dir, *out_dir.absolute().parents) if folder.exists())
    try:
        return Path(tempfile.mkdtemp(prefix=".kfmocap-", dir=beside))
    except OSError as error:
        raise _unwritable(out_dir, error) from error


def _unwritable(out_dir: Path, error: OSError) -> OutputError:
    return OutputError(f"the folder cannot be written: {error.strerror or error}", where=f"--out {out_dir}")


def _move_files(stage: Path, out_dir: Path) -> None:
    files = sorted(stage.iterdir())
    for file in files:
        if (out_dir / file.name).is_dir():
            raise OutputError("a folder is in the way", where=f"--out {out_dir / file.name}")
    out_dir.mkdir(parents=True, exist_ok=True)
    for file in files:
        os.replace(file, out_dir / file.name)


class _Clock:
    """Adds up the seconds of stages."""

    def __init__(self, seconds: dict[str, float]) -> None:
        self.seconds, self._last = seconds, time.perf_counter()

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now
