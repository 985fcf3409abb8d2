"""A study of whether added key poses make other frames worse."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...core.errors import ShotError
from ...core.formats.shot_toml import read_shot_spec
from ...core.numerics.arrays import Array
from ...core.shot.shot_spec import ShotSpec
from ...core.tracking.prepare import prepare_shot
from ...core.tracking.tracker import track
from ..tables import markdown
from .review_study import real_errors

MOST = 3
"""Largest number of key poses added for a performer."""
KeysOfAll = tuple[tuple[int, ...], ...]
"""Key frames of every performer, as frame numbers of the footage."""


def main(argv: Sequence[str] | None = None) -> int:
    """Track a shot with its key poses, and with random ones added; print how the errors of all other frames change."""
    parser = argparse.ArgumentParser(prog="python -m kfmocap.benchmarks.studies.added_keys", description=__doc__)
    parser.add_argument("shot", type=Path, help="shot file whose performers have landmarks, the truth, on all frames")
    parser.add_argument("--count", type=int, default=12, metavar="N", help="so many times; default: 12")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the frames that are drawn; default: 0")
    args = parser.parse_args(argv)
    spec = read_shot_spec(args.shot)
    begin = given_keys(spec)
    before = errors_with(spec, begin)
    heads = ["performer", "key frames", "error before", "error", "ratio"]
    cells, ratios = [], []
    for keys in additions(begin, spec.frames, args.count, args.seed):
        after = errors_with(spec, keys)
        for performer, own, old, new in zip(spec.performers, keys, before, after, strict=True):
            untouched = np.setdiff1d(np.arange(len(old)), np.array(own) - spec.frames[0])
            a, b = (float(np.nanmean(errors[untouched])) for errors in (old, new))
            ratios.append(b / a)
            cells.append([performer.name, " ".join(map(str, own)), f"{a:.1f}", f"{b:.1f}", f"{b / a:.2f}"])
            print(" | ".join(cells[-1]), flush=True)
    print(f"\n{markdown(heads, cells)}\n\nLargest ratio: {max(ratios):.2f}")
    return 0


def given_keys(spec: ShotSpec) -> KeysOfAll:
    """Return the key frames that a shot file lists.

    Raises
    ------
    ShotError
        A performer has none, or no landmarks.
    """
    for performer in spec.performers:
        if not isinstance(performer.keyframes, tuple) or performer.landmarks is None:
            todo = "list its 'keyframes' and give its 'landmarks'"
            raise ShotError("key poses cannot be added to it", where=performer.where, todo=todo)
    return tuple(p.keyframes for p in spec.performers if isinstance(p.keyframes, tuple))


def additions(keys: KeysOfAll, frames: tuple[int, int], count: int, seed: int) -> list[KeysOfAll]:
    """Return sets of key frames, in each of which random ones are added for some performers.

    Parameters
    ----------
    keys : tuple of tuple of int
        Key frames of every performer.
    frames : tuple of int
        First and last frame of the shot.
    count : int
        Number of sets.
    seed : int
    """
    rng = np.random.default_rng(seed)
    found: list[KeysOfAll] = []
    while len(found) < count:
        more = rng.integers(0, MOST + 1, len(keys))
        drawn = []
        for own, extra in zip(keys, more, strict=True):
            free = np.setdiff1d(np.arange(frames[0], frames[1] + 1), own)
            added = rng.choice(free, min(int(extra), len(free)), replace=False)
            drawn.append(tuple(sorted({*own, *added.tolist()})))
        if tuple(drawn) != keys:
            found.append(tuple(drawn))
    return found


def errors_with(spec: ShotSpec, keys: KeysOfAll) -> list[Array]:
    """Return the mean error of every performer's joints on every frame (F,), millimetres, with these key frames."""
    performers = tuple(replace(p, keyframes=own) for p, own in zip(spec.performers, keys, strict=True))
    shot = prepare_shot(replace(spec, performers=performers))
    result = track(shot)
    files = [performer.landmarks for performer in performers]
    return [real_errors(shot, result, file, i) for i, file in enumerate(files) if file is not None]


if __name__ == "__main__":
    raise SystemExit(main())
