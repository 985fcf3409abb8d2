"""The set of shots that the tracker is judged by: one half decides about its constants, the other half only reports.

`kfmocap bench --shots` measures them. Most are rendered by `tools/render_benchmark.py` when they are first needed.
Shots in a folder of one's own, with the same files, are measured together with them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from ..core.choices import BEST_SOLVER
from ..core.errors import FootageError, KFMocapError
from ..core.formats.shot_toml import read_shot_spec
from .footage_renderer import ROOT, render
from .rows import Case, Row

DECIDING, REPORTING = "deciding", "reporting"
MADE: Mapping[str, str] = MappingProxyType(
    {
        "bow": DECIDING,
        "stretching": REPORTING,
        "front_kick": DECIDING,
        "round_kick": REPORTING,
        "punches": DECIDING,
        "ball_throw": REPORTING,
        "leap": DECIDING,
        "hop_turn": REPORTING,
        "stroll_behind_bench": DECIDING,
        "sitting_down": REPORTING,
        "dance": DECIDING,
        "lunges": REPORTING,
        "waving_far": DECIDING,
        "picking_up_near": REPORTING,
        "jump_spin": DECIDING,
        "cartwheel": REPORTING,
    }
)
"""The half that each rendered shot belongs to."""
CACHE = ROOT / "build" / "shots"
GIVEN = ("shot.toml", "shot_keypoints.toml", "landmarks.trc")
"""The files of a further shot."""


@dataclass(frozen=True)
class JudgedShot:
    """A shot of the set.

    Attributes
    ----------
    half : str
        `DECIDING` or `REPORTING`.
    folder : Path
        With shot.toml, shot_keypoints.toml and landmarks.trc.
    """

    name: str
    half: str
    folder: Path

    def cases(self, quick: bool = False) -> list[Case]:
        """Return the cases: the file's key frames and, if there are keypoints, the first and last of them, and none."""
        spec = read_shot_spec(self.folder / "shot.toml")
        keys = spec.performers[0].keyframes
        if not isinstance(keys, tuple):
            raise KFMocapError("its performer lists no key frames", where=str(self.folder / "shot.toml"))
        cameras = tuple(view.camera for view in spec.views)
        rows = [Row(self.name, cameras, keys)]
        if not quick:
            rows.append(Row(self.name, cameras, (keys[0], keys[-1]), keypoints=True))
        if not quick and len(cameras) > 1:
            rows.append(Row(self.name, cameras, (), keypoints=True))
        return [Case(row, BEST_SOLVER) for row in rows]


def judged_shots(shot: str | None = None, data: Path | None = None) -> list[JudgedShot]:
    """Return all shots of the set, or the one with a name; they are rendered if necessary.

    Parameters
    ----------
    data : Path, optional
        A folder of further shots, which belong to the deciding half.

    Raises
    ------
    KFMocapError
        There is no such shot.
    FootageError
        It cannot be rendered.
    """
    given = _given_shots(data)
    known = [*MADE, *(found.name for found in given)]
    if shot is not None and shot not in known:
        raise KFMocapError(f"there is no '{shot}'", where="--shot", todo=f"there are {', '.join(known)}")
    wanted = [name for name in MADE if shot in (None, name)]
    if wanted:
        CACHE.mkdir(parents=True, exist_ok=True)
        render("render_benchmark.py", [*wanted, "--out", str(CACHE)], what=" ".join(wanted))
    made = [JudgedShot(name, MADE[name], CACHE / name) for name in wanted]
    return [*made, *(found for found in given if shot in (None, found.name))]


def _given_shots(data: Path | None) -> list[JudgedShot]:
    if data is None:
        return []
    if not data.is_dir():
        raise FootageError("there is no such folder", where=str(data))
    homes = sorted(file.parent for file in data.glob("*/shot.toml"))
    return [JudgedShot(home.name, DECIDING, home) for home in homes if all((home / name).is_file() for name in GIVEN)]
