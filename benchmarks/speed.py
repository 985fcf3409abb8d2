"""`kfmocap bench --speed`: times by the number of frames, cameras and cores, and compared with another version.

Every row is the whole command in its own process, from the shot file to the written results. The footage is that of the
beam example, at the tracker's working size, played forwards and backwards until it is long enough.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2

from ..core.calibration.charts import Chart, heat_colour, stacked_pictures, text
from ..core.errors import KFMocapError, OutputError
from ..core.runtime.files import replacing
from ..core.runtime.threads import worker_count
from ..core.tracking.prepare import load_shot
from .command_cost import Cost, command_cost
from .long_shots import KEY_EVERY, write_shot
from .tables import markdown

LENGTHS = (34, 100, 400, 1000)
LONG = 3000
"""Numbers of frames of the shots."""
FAR_APART = 400
"""Number of frames of the shot with key poses only at its ends."""
CORES_LENGTH = 400
"""Number of frames of the shot that is tracked with different numbers of cores."""
_CHART = (560, 280)
"""Width and height of the plot, pixels."""


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
        views = load_shot(folder / "shot.toml").views
        for row in rows:
            cameras = [view.camera.name for view in views[: row.cameras]]
            runs: list[list[Cost]] = [[] for _ in programs]
            for _ in range(repeat):
                for program, costs in zip(programs, runs, strict=True):  # alternating, so that other load affects both
                    costs.append(command_cost(program, shots[row.frames], cameras, row.threads, ends=row.ends))
            medians = [Cost.median(costs) for costs in runs]
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


def _program(place: Path, checkout: Path) -> Path:
    """Return a folder from which Python imports a checkout as `kfmocap`."""
    place.mkdir()
    (place / "kfmocap").symlink_to(checkout.resolve(), target_is_directory=True)
    return place
