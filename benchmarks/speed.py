"""`kfmocap bench --speed`: times by the number of frames, cameras, performers and cores, or of two versions in turns.

Every row is the whole command in its own process, from the shot file to the written results. The footage is that of the
beam example, at the tracker's working size, played forwards and backwards until it is long enough; for the number of
performers, it is rendered: people who walk past each other, with nobody else in the picture.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import cv2

from ..core.calibration.charts import Chart, heat_colour, stacked_pictures, text
from ..core.errors import KFMocapError, OutputError
from ..core.formats.shot_toml import read_shot_spec
from ..core.runtime.output_files.files import replacing
from ..core.runtime.threads import worker_count
from .command_cost import Cost, command_cost
from .footage_renderer import render
from .long_shots import KEY_EVERY, write_shot
from .tables import markdown

LENGTHS = (34, 100, 400, 1000)
LONG = 3000
"""Numbers of frames of the shots."""
FAR_APART = 400
"""Number of frames of the shot with key poses only at its ends."""
CORES_LENGTH = 400
"""Number of frames of the shot that is tracked with different numbers of cores."""
CROSSING: Mapping[int, Sequence[str]] = MappingProxyType({1: "A", 2: "AB", 4: "ABCD"})
"""Who is in the picture, by the number of people who walk past each other."""
CROSSING_LENGTH, CROSSING_KEYS = 41, 20
"""Number of their frames, and of those between key poses."""
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
    crossing : int
        Number of people who walk past each other; 0 for the beam example.
    """

    frames: int
    cameras: int
    threads: int
    ends: bool = False
    crossing: int = 0

    @property
    def shot(self) -> str:
        """A name for its footage."""
        return f"{'crossing' if self.crossing else 'beam'}{self.crossing or self.frames}"

    @property
    def keys(self) -> str:
        """Which frames have key poses."""
        return "at the ends" if self.ends else f"every {CROSSING_KEYS if self.crossing else KEY_EVERY}"


def speed_rows(cores: int, quick: bool) -> list[SpeedRow]:
    """Return the rows for a machine with a number of cores."""
    lengths = LENGTHS[:2] if quick else (*LENGTHS, LONG)
    rows = [SpeedRow(frames, 4, cores) for frames in lengths]
    rows += [SpeedRow(100, cameras, cores) for cameras in (1, 2)]
    counts = sorted({*(1 << k for k in range(cores.bit_length())), cores} - {cores})
    rows += [SpeedRow(100 if quick else CORES_LENGTH, 4, count) for count in counts]
    if quick:
        return rows
    crossing = [SpeedRow(CROSSING_LENGTH, 4, cores, crossing=people) for people in CROSSING]
    return [*rows, SpeedRow(FAR_APART, 2, cores, ends=True), *crossing]


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
        shots = {row.shot: row for row in rows}
        files = {name: _write_footage(folder, Path(place) / name, row) for name, row in shots.items()}
        for row in rows:
            file = files[row.shot]
            cameras = [view.camera for view in read_shot_spec(file).views[: row.cameras]]
            runs: list[list[Cost]] = [[] for _ in programs]
            for _ in range(repeat):
                for program, costs in zip(programs, runs, strict=True):  # alternating, so that other load affects both
                    costs.append(command_cost(program, file, cameras, row.threads, ends=row.ends))
            medians = [Cost.median(costs) for costs in runs]
            found.append((medians[0], medians[1] if against is not None else None))
            print(f"kfmocap bench: {row}: {medians[0].seconds:.1f} s", file=sys.stderr, flush=True)
    if out is not None:
        write_plot(out / "speed.png", rows, [cost for cost, _ in found])
    return table(rows, found)


def table(rows: Sequence[SpeedRow], found: Sequence[tuple[Cost, Cost | None]]) -> str:
    """Return the table of all rows with their costs, and the ratio to another version."""
    heads = ["frames", "key poses", "cameras", "performers", "cores", "seconds", "processor s", "camera-frames/s", "MB"]
    paired = any(other is not None for _, other in found)
    cells = []
    for row, (cost, other) in zip(rows, found, strict=True):
        rate = row.frames * row.cameras / cost.seconds
        cells.append([str(row.frames), row.keys, str(row.cameras), str(row.crossing or 1), str(row.threads)])
        cells[-1] += [f"{cost.seconds:.1f}", f"{cost.processor:.1f}", f"{rate:.0f}"]
        cells[-1].append(f"{cost.memory / 1e6:.0f}" if cost.memory else "-")
        if paired:
            cells[-1] += [f"{other.seconds / cost.seconds:.2f}" if other is not None else "-"]
    return markdown(heads + ["times as fast"] * paired, cells)


def write_plot(path: Path, rows: Sequence[SpeedRow], costs: Sequence[Cost]) -> None:
    """Draw seconds against frames, cameras, cores and, where they were measured, performers.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    usual = max(row.threads for row in rows)
    beam = [(row, cost) for row, cost in zip(rows, costs, strict=True) if not row.crossing]
    several = CORES_LENGTH if any(row.frames == CORES_LENGTH for row, _ in beam) else 100
    curves = {
        "frames (four cameras, all cores)": [
            (row.frames, cost.seconds) for row, cost in beam if row.cameras == 4 and row.threads == usual
        ],
        "cameras (100 frames, all cores)": [
            (row.cameras, cost.seconds) for row, cost in beam if row.frames == 100 and row.threads == usual
        ],
        f"cores ({several} frames, four cameras)": [
            (row.threads, cost.seconds) for row, cost in beam if row.frames == several and row.cameras == 4
        ],
        f"performers ({CROSSING_LENGTH} frames, four cameras, all cores)": [
            (row.crossing, cost.seconds) for row, cost in zip(rows, costs, strict=True) if row.crossing
        ],
    }
    charts = []
    for name, measured in curves.items():
        if not measured:
            continue
        points = sorted(measured)
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


def _write_footage(example: Path, folder: Path, row: SpeedRow) -> Path:
    """Write the footage of a row, and return its shot file."""
    if not row.crossing:
        return write_shot(example, folder, row.frames)
    people = CROSSING[row.crossing]
    everybody = str(max(CROSSING))
    arguments = ["--people", everybody, "--only", *people, "--out", str(folder)]
    render("render_crossing.py", arguments, what="people who walk past each other")
    return folder / ("shot.toml" if len(people) > 1 else f"shot_{people[0]}.toml")


def _program(place: Path, checkout: Path) -> Path:
    """Return a folder from which Python imports a checkout as `kfmocap`."""
    place.mkdir()
    (place / "kfmocap").symlink_to(checkout.resolve(), target_is_directory=True)
    return place
