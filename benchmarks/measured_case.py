"""Measuring one case in its own process: `python -m kfmocap.benchmarks.measured_case CASE FOLDER` prints JSON."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.body.motion import Motion
from ..core.formats import read_trc
from ..core.review.scoring import Score, motion_error
from ..core.shot.keypose_spline import spline
from ..core.shot.segments import Segment
from ..core.shot.shot import Shot
from ..core.tracking.prepare import load_shot
from ..core.tracking.tracker import track
from .shot_scores import interval_cover, plants_found, plants_moved, triangulated_error


class Reference:
    """The landmarks that a shot's motion is compared with."""

    def __init__(self, shot: Shot, file: Path) -> None:
        self.performer, self.landmarks = shot.performers[0], read_trc(file)

    def score(self, motion: Motion) -> Score:
        """Compare the joints of a motion with the reference."""
        return motion_error(self.performer.body, motion, self.landmarks, self.performer.key_poses.full().tolist())

    def cover(self, motion: Motion, interval: NDArray[np.float64]) -> float:
        """Return the fraction of the joints within the 90 % interval of their expected error."""
        keys = self.performer.key_poses.full().tolist()
        return interval_cover(self.performer.body, motion, interval, self.landmarks, keys)


class Watch:
    """Collects the motions before each iteration, as the `observe` callback of `track`."""

    def __init__(self) -> None:
        self.seen: dict[Segment, list[Motion]] = {}

    def __call__(self, segment: Segment, _number: int, motions: Any) -> None:
        """Keep the first performer's motion."""
        self.seen.setdefault(segment, []).append(motions[0])

    def way(self, end: Motion) -> list[Motion]:
        """Return the whole motion before each iteration and after the last, with all segments iterated in parallel."""
        steps = max(len(motions) for motions in self.seen.values())
        return [self._at(step, end) for step in range(steps)] + [end]

    def before_last(self, end: Motion) -> Motion:
        """Return the whole motion with every segment as it was before its last iteration."""
        return self._at(-1, end)

    def _at(self, step: int, end: Motion) -> Motion:
        for (first, _last), motions in self.seen.items():
            if step < len(motions):
                end = end.replaced(first, motions[step])
        return end


def measure(case: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Track a case of the shot in a folder; the errors are mean joint errors in millimetres."""
    begin = time.perf_counter()
    file = folder / ("shot_keypoints.toml" if case["keypoints"] else "shot.toml")
    shot = load_shot(file, views=case["cameras"], keyframes=case["keyframes"] or "auto", solver=case["solver"])
    sweeps = {} if case["sweeps"] is None else {"sweeps": case["sweeps"]}
    shot = replace(shot, settings=replace(shot.settings, **sweeps, **case["settings"]))
    loaded = time.perf_counter()
    watch = Watch() if case["watch"] else None
    result = track(shot, observe=watch)
    seconds = {"load": loaded - begin, **result.seconds, "total": time.perf_counter() - begin}
    memory = peak_memory()
    reference = Reference(shot, folder / "landmarks.trc")
    body, planted = reference.performer.body, result.planted[0] if result.planted else None
    triangulated = triangulated_error(shot, reference.landmarks) if case["keypoints"] else None
    return {
        "fps": shot.fps,
        "score": asdict(reference.score(result.motions[0])),
        "triangulated": triangulated and triangulated.mean,
        "cover": reference.cover(result.motions[0], result.errors[0].interval),
        "plants": plants_found(body, planted, reference.landmarks),
        "plants_moved": plants_moved(body, result.motions[0], planted),
        "spline": reference.score(spline(reference.performer.key_poses, shot.length)).mean,
        "blender": _blender_error(shot, reference),
        "way": [reference.score(m).mean for m in watch.way(result.motions[0])] if watch else None,
        "before_last": reference.score(watch.before_last(result.motions[0])).mean if watch else None,
        "seconds": seconds,
        "camera_frames": result.camera_frames,
        "iterations": [segment.iterations for segment in result.segments],
        "memory": memory,
    }


def _blender_error(shot: Shot, reference: Reference) -> float | None:
    """Return the error of Blender's own curves through the key poses; None without its module or without key poses."""
    if not len(reference.performer.key_poses.full()):
        return None
    try:
        from .blender_curves import interpolated
    except ImportError:
        return None
    return reference.score(interpolated(reference.performer, shot.length)).mean


def peak_memory() -> int | None:
    """Return the largest resident size of this process so far, bytes; None on systems that do not report it."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


if __name__ == "__main__":
    print(json.dumps(measure(json.loads(sys.argv[1]), Path(sys.argv[2]))))
