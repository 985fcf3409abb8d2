"""A study of how well expected errors predict real ones: `python -m kfmocap.benchmarks.studies.review_study --help`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from ...cli.example_footage import example_folder
from ...core.body import landmark_positions
from ...core.body.limbs import MAIN_JOINTS
from ...core.formats import Landmarks, read_trc
from ...core.numerics.arrays import Array
from ...core.review.suggestions import suggest_keys_by_error
from ...core.shot.shot import Shot
from ...core.tracking.expected_errors.uncertainty import expected_errors
from ...core.tracking.prepare import load_shot
from ...core.tracking.results.track_result import TrackResult
from ...core.tracking.tracker import track
from ..rows import BEAM, ROWS, WALK, Row
from ..tables import markdown

MORE = (
    Row("beam", ("cam02", "cam04"), (0, 50, 99)),
    Row("walk", WALK, (0, 30, 59)),
    Row("walk", ("cam02", "cam03"), (0, 30, 59)),
    Row("walk", WALK, (0, 59)),
)
"""Rows in addition to those of the benchmark."""


def main(argv: Sequence[str] | None = None) -> int:
    """Rank the frames of the examples by their expected errors, and add key poses; print a table."""
    parser = argparse.ArgumentParser(prog="python -m kfmocap.benchmarks.studies.review_study", description=__doc__)
    parser.add_argument("--shot", choices=("beam", "walk"), help="of one example only")
    parser.add_argument("--quick", action="store_true", help="a few rows only")
    parser.add_argument("--add", action="store_true", help="also track with a key pose added, where suggested and not")
    args = parser.parse_args(argv)
    rows = [row for row in (*ROWS, *MORE) if args.shot in (None, row.shot) and not row.keypoints]
    heads = ["shot", "cameras", "key frames", "error", "expected", "rank by it", "by distance"]
    heads += ["share of time, %"] + ["all frames", "suggested", "with it", "middle", "with that"] * args.add
    cells = []
    for row in rows if not args.quick else [row for row in rows if row.quick]:
        cells.append(_cells(row, args.add))
        print(" | ".join(cells[-1]), flush=True)
    print(markdown(heads, cells))
    return 0


def _cells(row: Row, add: bool) -> list[str]:
    shot, result, error = _tracked(row, row.keyframes)
    keys = shot.performers[0].key_poses
    frames = np.setdiff1d(np.arange(shot.length), keys.frames)
    expected = 1000 * expected_errors(result.deviation[0], shot.performers[0].body.parents)
    distance = np.abs(np.arange(shot.length)[:, None] - keys.frames).min(axis=1)
    share = 100 * result.seconds["uncertainty"] / sum(result.seconds.values())
    cells = [row.shot, cameras(row), " ".join(map(str, row.keyframes))]
    cells += [f"{error[frames].mean():.1f}", f"{expected[frames].mean():.1f}"]
    cells += [f"{rank_correlation(values[frames], error[frames]):.2f}" for values in (expected, distance)]
    cells.append(f"{share:.1f}")
    if add:
        cells.append(f"{error.mean():.1f}")
        suggested = suggest_keys_by_error(result.deviation[0], keys, shot.performers[0].body.parents)[0].frame
        for frame in (suggested, middle_of_longest_gap(keys.frames)):
            *_, with_it = _tracked(row, sorted({*row.keyframes, shot.frames[0] + frame}))
            cells += [str(shot.frames[0] + frame), f"{with_it.mean():.1f}"]
    return cells


def cameras(row: Row) -> str:
    """Return the number of a row's cameras, or their names if they are not all."""
    every = BEAM if row.shot == "beam" else WALK
    return str(len(every)) if row.cameras == every else "+".join(row.cameras)


def _tracked(row: Row, keyframes: Sequence[int]) -> tuple[Shot, TrackResult, Array]:
    """Track a row with some key frames; returns the shot, the result, and the real errors."""
    folder = example_folder(row.shot)
    shot = load_shot(folder / "shot.toml", views=list(row.cameras), keyframes=list(keyframes))
    result = track(shot)
    return shot, result, real_errors(shot, result, folder / "landmarks.trc")


def real_errors(shot: Shot, result: TrackResult, reference: Path, performer: int = 0) -> Array:
    """Return the mean error of a performer's joints on every frame, millimetres, shape (F,)."""
    body, truth = shot.performers[performer].body, read_trc(reference)
    names = [n for n in truth.names if n in body.landmarks and n != "Hip" and n.endswith(MAIN_JOINTS)]
    found = Landmarks(tuple(names), landmark_positions(body, result.motions[performer], names), shot.fps).points_world
    true = truth.points_world[: len(found)][:, [truth.names.index(n) for n in names]]
    return 1000 * np.nanmean(np.linalg.norm(found - true, axis=2), axis=1)


def rank_correlation(a: Array, b: Array) -> float:
    """Return Spearman's rank correlation of values on the same frames."""
    return float(spearmanr(a, b).statistic)


def middle_of_longest_gap(frames: Sequence[int]) -> int:
    """Return the frame midway between the two neighbouring key frames that are farthest apart, the first such pair."""
    gaps = np.diff(frames)
    return int(frames[gaps.argmax()] + gaps.max() // 2)


if __name__ == "__main__":
    raise SystemExit(main())
