"""`kfmocap bench --speed`: times by the number of frames, cameras and cores, and compared with another version.

Every row is the whole command in its own process, from the shot file to the written results. The footage is that of the
beam example, at the tracker's working size, played forwards and backwards until it is long enough.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.calibration.charts import Chart, heat_colour, stacked_pictures, text
from ..core.errors import KFMocapError, OutputError
from ..core.formats import read_trc
from ..core.formats.toml_cameras import save_cameras
from ..core.formats.trc import write_trc
from ..core.runtime.files import replacing
from ..core.runtime.threads import worker_count
from ..core.shot.footage import frames_at, working_factor
from ..core.shot.shot import Shot
from ..core.tracking.prepare import load_shot
from .tables import markdown

KEY_EVERY = 33
"""Largest number of frames between key poses."""
LENGTHS = (34, 100, 400, 1000)
LONG = 3000
FAR_APART = 400
"""Number of frames of the shot with key poses only at its ends."""
CORES_LENGTH = 400
_SAMPLED = 0.1  # seconds between samples of the memory
_CHART = (560, 280)


@dataclass(frozen=True)
class SpeedRow:
    """A row of the table.

    Attributes
    ----------
    frames, cameras : int
    threads : int
        Number of cores that the command may use.
    ends : bool
        Whether there are key poses only at the shot's ends.
    """

    frames: int
    cameras: int
    threads: int
    ends: bool = False


@dataclass(frozen=True)
class Cost:
    """The time and memory that a command took.

    Attributes
    ----------
    seconds : float
        From its start to its end.
    processor : float
        Processor time of all of its processes, seconds.
    memory : int
        Largest memory of all of its processes together, bytes, with shared memory counted once. 0 on systems that do
        not report it.
    """

    seconds: float
    processor: float
    memory: int


def speed_rows(cores: int, quick: bool) -> list[SpeedRow]:
    """Return the rows for a machine with a number of cores."""
    lengths = LENGTHS[:2] if quick else (*LENGTHS, LONG)
    rows = [SpeedRow(frames, 4, cores) for frames in lengths]
    rows += [SpeedRow(100, cameras, cores) for cameras in (1, 2)]
    counts = sorted({*(1 << k for k in range(cores.bit_length())), cores} - {cores})
    rows += [SpeedRow(100 if quick else CORES_LENGTH, 4, count) for count in counts]
    return rows if quick else [*rows, SpeedRow(FAR_APART, 2, cores, ends=True)]


def measure_speed(
    folder: Path, *, repeat: int, quick: bool, out: Path | None = None, against: Path | None = None
) -> str:
    """Measure all rows, alternating with another version of the program if one is given; returns the table.

    Parameters
    ----------
    folder : Path
        The beam example with its footage.
    repeat : int
        Number of runs of every row, of which medians are taken.
    quick : bool
        Whether to measure only short shots.
    out : Path, optional
        Folder for a plot, speed.png.
    against : Path, optional
        The folder of another checkout of the program.

    Raises
    ------
    KFMocapError
        A command fails, or the other folder does not contain the program.
    """
    if against is not None and not (against / "__main__.py").is_file():
        raise KFMocapError("there is no checkout of the program", where=str(against), todo="name its folder")
    rows, found = speed_rows(worker_count(), quick), list[tuple[Cost, Cost | None]]()
    with tempfile.TemporaryDirectory() as place:
        programs = [_program(Path(place) / "this", Path(__file__).parents[1])]
        if against is not None:
            programs.append(_program(Path(place) / "other", against))
        shots = {n: write_shot(folder, Path(place) / f"frames{n}", n) for n in sorted({row.frames for row in rows})}
        names = list(load_shot(folder / "shot.toml").views)
        for row in rows:
            cameras = [view.camera.name for view in names[: row.cameras]]
            runs: list[list[Cost]] = [[] for _ in programs]
            for _ in range(repeat):
                for program, costs in zip(programs, runs, strict=True):  # alternating, so that other load affects both
                    costs.append(command_cost(program, shots[row.frames], cameras, row.threads, ends=row.ends))
            medians = [_median(costs) for costs in runs]
            found.append((medians[0], medians[1] if against is not None else None))
            print(f"kfmocap bench: {row}: {medians[0].seconds:.1f} s", file=sys.stderr, flush=True)
    if out is not None:
        write_plot(out / "speed.png", rows, [cost for cost, _ in found])
    return table(rows, found)


def table(rows: Sequence[SpeedRow], found: Sequence[tuple[Cost, Cost | None]]) -> str:
    """Return the table of all rows with their costs, and the ratio to another version."""
    heads = ["frames", "key poses", "cameras", "cores", "seconds", "processor s", "camera-frames/s", "MB"]
    paired = any(other is not None for _, other in found)
    cells = []
    for row, (cost, other) in zip(rows, found, strict=True):
        rate = row.frames * row.cameras / cost.seconds
        keys = "at the ends" if row.ends else f"every {KEY_EVERY}"
        cells.append([str(row.frames), keys, str(row.cameras), str(row.threads)])
        cells[-1] += [f"{cost.seconds:.1f}", f"{cost.processor:.1f}", f"{rate:.0f}"]
        cells[-1].append(f"{cost.memory / 1e6:.0f}" if cost.memory else "-")
        if paired:
            cells[-1] += [f"{other.seconds / cost.seconds:.2f}" if other is not None else "-"]
    return markdown(heads + ["times as fast"] * paired, cells)


def write_plot(path: Path, rows: Sequence[SpeedRow], costs: Sequence[Cost]) -> None:
    """Draw seconds against frames, cameras and cores.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    usual = max(row.threads for row in rows)
    several = CORES_LENGTH if any(row.frames == CORES_LENGTH for row in rows) else 100
    groups = {
        "frames (four cameras, all cores)": [row.cameras == 4 and row.threads == usual for row in rows],
        "cameras (100 frames, all cores)": [row.frames == 100 and row.threads == usual for row in rows],
        f"cores ({several} frames, four cameras)": [row.frames == several and row.cameras == 4 for row in rows],
    }
    charts = []
    for (name, chosen), of in zip(groups.items(), ("frames", "cameras", "threads"), strict=True):
        points = sorted((getattr(r, of), c.seconds) for r, c, kept in zip(rows, costs, chosen, strict=True) if kept)
        x, y = [p[0] for p in points], [p[1] for p in points]
        chart = Chart(*_CHART, (0, 1.05 * max(x)), (0, 1.1 * max(y)), f"seconds against {name}")
        chart.line(x, y, heat_colour(0.1))
        for value, seconds in points:
            u, v = chart.place((value, seconds))
            cv2.circle(chart.picture, (u, v), 3, heat_colour(0.1), -1, cv2.LINE_AA)
            text(chart.picture, f"{seconds:.1f}", (u - 14, v - 8))
        charts.append(chart.picture)
    encoded, data = cv2.imencode(".png", stacked_pictures(charts))
    if not encoded:
        raise OutputError("the picture cannot be encoded", where=str(path))
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())


def write_shot(example: Path, folder: Path, frames: int) -> Path:
    """Write a shot with a number of frames, from an example played forwards and backwards; returns its file.

    Raises
    ------
    OutputError
        The footage cannot be written.
    """
    folder.mkdir()
    shot = load_shot(example / "shot.toml")
    order = back_and_forth(shot.length, frames)
    views = []
    for view in shot.views:
        factor = working_factor(view, shot.settings.working_size)
        pictures = list(frames_at(view, range(shot.frames[0], shot.frames[1] + 1), factor, grey=False))
        file = folder / f"{view.camera.name}.avi"
        _write_video(file, [pictures[f] for f in order], shot.fps)
        views.append(view.camera.reduced(factor).rectified())
    save_cameras(folder / "cameras.toml", views)
    truth = read_trc(example / "landmarks.trc")
    write_trc(folder / "landmarks.trc", truth.names, truth.points_world[order], truth.fps)
    file = folder / "shot.toml"
    file.write_text(_shot_text(shot, frames), encoding="utf-8")
    return file


def back_and_forth(length: int, count: int) -> NDArray[np.int64]:
    """Return `count` frame numbers that play a shot forwards and backwards, without showing any twice in a row."""
    once = np.concatenate([np.arange(length), np.arange(length - 2, 0, -1)])
    return np.asarray(np.resize(once, count))


def _write_video(file: Path, pictures: Sequence[NDArray[Any]], fps: float) -> None:
    height, width = pictures[0].shape[:2]
    video = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"MJPG"), fps, (width, height))
    if not video.isOpened():
        raise OutputError("OpenCV cannot write the footage", where=str(file))
    for picture in pictures:
        video.write(picture)
    video.release()


def _shot_text(shot: Shot, frames: int) -> str:
    keys = sorted({*range(0, frames - KEY_EVERY // 2, KEY_EVERY), frames - 1})
    views = "".join(f'[[view]]\ncamera = "{v.camera.name}"\nfootage = "{v.camera.name}.avi"\n\n' for v in shot.views)
    return (
        f'[shot]\nname = "speed"\nfps = {shot.fps}\nframes = [0, {frames - 1}]\n\n'
        f'[calibration]\nfile = "cameras.toml"\n\n{views}'
        f'[[performer]]\nname = "man"\nlandmarks = "landmarks.trc"\nkeyframes = {keys}\n'
    )


def _program(place: Path, checkout: Path) -> Path:
    """Return a folder from which Python imports a checkout as `kfmocap`."""
    place.mkdir()
    (place / "kfmocap").symlink_to(checkout.resolve(), target_is_directory=True)
    return place


def command_cost(program: Path, shot: Path, cameras: Sequence[str], threads: int, *, ends: bool = False) -> Cost:
    """Run `kfmocap track` of a program in its own process and measure its cost; `ends` as in `SpeedRow`.

    Raises
    ------
    KFMocapError
        The command fails.
    """
    limit = threads_text(shot, threads, ends=ends)
    with tempfile.TemporaryDirectory() as out, _memory_watched() as watch:
        command = [sys.executable, "-m", "kfmocap", "track", str(limit), "--out", out, "--no-blender"]
        begin, before = time.perf_counter(), _children_seconds()
        process = subprocess.Popen(
            [*command, "--views", ",".join(cameras)],
            env=os.environ | {"PYTHONPATH": str(program)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        watch.process = process.pid
        _, errors = process.communicate()
        seconds = time.perf_counter() - begin
    if process.returncode:
        raise KFMocapError((errors.strip().splitlines() or ["it ended without a message"])[-1], where=" ".join(command))
    return Cost(seconds, _children_seconds() - before, watch.most)


def threads_text(shot: Path, threads: int, *, ends: bool = False) -> Path:
    """Write a copy of a shot file with a number of threads, which every version of the program reads; returns its
    path.
    """
    file, text = shot.with_name(f"cores{threads}.toml"), shot.read_text(encoding="utf-8")
    if ends:
        text = re.sub(r"keyframes = \[(\d+),.* (\d+)\]", r"keyframes = [\1, \2]", text)
    file.write_text(f"{text}\n[track]\nthreads = {threads}\n", encoding="utf-8")
    return file


def _children_seconds() -> float:
    times = os.times()
    return times.children_user + times.children_system


class _MemoryWatch:
    """The largest memory of a process and those that it started."""

    def __init__(self) -> None:
        self.process: int | None = None
        self.most = 0
        self.ended = threading.Event()

    def run(self) -> None:
        while not self.ended.wait(_SAMPLED):
            if self.process is not None:
                self.most = max(self.most, sum(_own_memory(p) for p in _family(self.process)))


@contextmanager
def _memory_watched() -> Iterator[_MemoryWatch]:
    watch = _MemoryWatch()
    thread = threading.Thread(target=watch.run, daemon=True)
    thread.start()
    try:
        yield watch
    finally:
        watch.ended.set()
        thread.join()


def _family(process: int) -> list[int]:
    """Return a process and all its descendants, on Linux."""
    found = [process]
    for one in found:
        try:
            for file in Path(f"/proc/{one}/task").glob("*/children"):
                found += [int(number) for number in file.read_text().split()]
        except OSError:
            continue  # it ended meanwhile, or this is another system
    return found


def _own_memory(process: int) -> int:
    """Return a process's proportional set size, bytes: shared memory is divided among the processes that share it."""
    try:
        for line in Path(f"/proc/{process}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return 1024 * int(line.split()[1])
    except OSError:
        pass
    return 0


def _median(costs: Sequence[Cost]) -> Cost:
    return Cost(
        median(cost.seconds for cost in costs),
        median(cost.processor for cost in costs),
        int(median(cost.memory for cost in costs)),
    )
