"""A study of bad 2D keypoints, made from given ones: `python -m kfmocap.benchmarks.studies.keypoint_noise --help`."""

from __future__ import annotations

import argparse
import json
import re
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import mean

import numpy as np

from ...core.formats.keypoint_files import read_keypoints
from ...core.formats.keypoint_layouts import HALPE_26, mirrored_name
from ...core.shot.detections import Detections
from ...core.shot.shot import Shot
from ...core.tracking.prepare import load_shot
from ...core.tracking.tracker import track
from ..measured_case import Reference
from ..tables import markdown

MISSING, TURNED, LEAPS, LEAP = 0.20, 0.10, 0.05, 100.0
"""Fractions of frames that are missing and that have left and right exchanged, fraction of keypoints that are outliers,
and their distance, pixels."""
_NAMED_FILE = re.compile(r'^(\s*(?:file|footage|landmarks|keyposes)\s*=\s*)"([^"]*)"', re.MULTILINE)
_NAMED_KEYPOINTS = re.compile(r'^(\s*keypoints\s*=\s*)"([^"]*)"', re.MULTILINE)


def main(argv: Sequence[str] | None = None) -> int:
    """Track a shot with its keypoints and, on request, without them and with worse ones; print a table."""
    parser = argparse.ArgumentParser(prog="python -m kfmocap.benchmarks.studies.keypoint_noise", description=__doc__)
    parser.add_argument("shot", type=Path, help="a shot file with keypoints")
    parser.add_argument("reference", type=Path, help="TRC with the true landmarks")
    parser.add_argument("--keyframes", action="append", required=True, metavar="N,N | auto", help="may be repeated")
    parser.add_argument("--views", metavar="CAM,CAM", help="use the views of these cameras only")
    parser.add_argument("--worse", type=int, default=0, metavar="N", help="also with keypoints made worse, N times")
    parser.add_argument("--without", action="store_true", help="also without keypoints")
    args = parser.parse_args(argv)
    rows = [_row(args, keyframes) for keyframes in args.keyframes]
    heads = ("shot", "cameras", "key frames", "without", "with", "seconds", f"worse, mean of {args.worse}")
    print(markdown(heads, rows))
    return 0


def _row(args: argparse.Namespace, keyframes: str) -> list[str]:
    views = None if args.views is None else args.views.split(",")
    keys = "auto" if keyframes == "auto" else [int(number) for number in keyframes.split(",")]
    shot = load_shot(args.shot, views=views, keyframes=keys)
    begin = time.perf_counter()
    cells = [None, error(shot, args.reference), time.perf_counter() - begin, None]
    if args.without and keys != "auto":
        cells[0] = error(replace(shot, views=tuple(replace(v, keypoints=None) for v in shot.views)), args.reference)
    if args.worse:
        cells[3] = mean(_worse_error(args, views, keys, seed) for seed in range(args.worse))
    named = "+".join(view.camera.name for view in shot.views)
    return [shot.name, named, keyframes.replace(",", " "), *("-" if c is None else f"{c:.1f}" for c in cells)]


def error(shot: Shot, reference: Path) -> float:
    """Track a shot; returns the mean error of the joints on frames without a key pose set by the user, millimetres."""
    return Reference(shot, reference).score(track(shot).motions[0]).mean


def _worse_error(args: argparse.Namespace, views: list[str] | None, keys: list[int] | str, seed: int) -> float:
    with tempfile.TemporaryDirectory() as folder:
        path = worse_shot(args.shot, Path(folder), seed)
        return error(load_shot(path, views=views, keyframes=keys), args.reference)


def worse_shot(path: Path, folder: Path, seed: int) -> Path:
    """Write a copy of a shot file into a folder, with worse copies of its keypoints; returns its path."""
    home, sources = path.resolve().parent, []

    def spoil(match: re.Match[str]) -> str:
        sources.append(home / match[2])
        target = folder / f"keypoints{len(sources)}.json"
        found = worse(read_keypoints(sources[-1]), np.random.default_rng([seed, len(sources)]))
        target.write_text(json.dumps(as_coco(found)), encoding="utf-8")
        return f'{match[1]}"{target.as_posix()}"'

    text = _NAMED_FILE.sub(lambda m: f'{m[1]}"{(home / m[2]).as_posix()}"', path.read_text(encoding="utf-8"))
    copy = folder / path.name
    copy.write_text(_NAMED_KEYPOINTS.sub(spoil, text), encoding="utf-8")
    return copy


def worse(found: Detections, rng: np.random.Generator) -> Detections:
    """Return detections with gross errors, see `MISSING`."""
    kept = np.sort(rng.permutation(len(found))[round(MISSING * len(found)) :])
    points, confidence = found.points[kept].copy(), found.confidence[kept].copy()
    turned = rng.permutation(len(kept))[: round(TURNED * len(kept))]
    order = [found.names.index(mirrored_name(name)) for name in found.names]
    points[turned], confidence[turned] = points[turned][:, order], confidence[turned][:, order]
    leaping = rng.random(confidence.shape) < LEAPS
    angle = rng.uniform(0, 2 * np.pi, confidence.shape)
    points[leaping] += LEAP * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[leaping]
    return Detections(found.names, found.frames[kept], points, confidence, found.tracks[kept])


def as_coco(found: Detections) -> list[dict[str, object]]:
    """Return detections in COCO's results format, in the order of HALPE_26."""
    table = np.zeros((len(found), len(HALPE_26), 3))
    for k, name in enumerate(HALPE_26):
        if name in found.names:
            column = found.names.index(name)
            table[:, k, :2], table[:, k, 2] = found.points[:, column], found.confidence[:, column]
    table[~np.isfinite(table).all(axis=-1)] = 0
    return [
        {"image_id": int(frame), "category_id": 1, "keypoints": values.ravel().tolist(), "score": 1.0}
        for frame, values in zip(found.frames, table, strict=True)
    ]


if __name__ == "__main__":
    raise SystemExit(main())
