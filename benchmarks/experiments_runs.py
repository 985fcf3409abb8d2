"""The papers' experiments as functions of rendered footage: what is tracked, measured and shown."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from pathlib import Path
from statistics import fmean, median
from typing import Any

import numpy as np

from ..core.body import landmark_positions
from ..core.body.motion import Motion, stacked
from ..core.choices import SOLVERS
from ..core.formats import Landmarks, read_trc
from ..core.review.scoring import Score, joint_error, motion_error
from ..core.shot.keypose_spline import spline
from ..core.shot.shot import KeyPoses, Shot
from ..core.tracking.prepare import load_shot
from ..core.tracking.selection import selected
from ..core.tracking.tracker import track
from .experiments_pictures import Image, Panels, stacked_rows
from .measured_case import Watch
from .tables import convergence, markdown

Switches = Sequence[tuple[int, int, str]]

SWEEPS = (5, 50, 500, 1000)
"""Numbers of sweeps of the relaxation after which the throw is measured."""
SHOWN_SWEEPS, SHOWN_FIELD = (5, 50, 500), 14
"""Numbers of sweeps that are shown, and the field of the throw; the paper shows the next field, which has a key
pose."""
DRIFTED = (90, 96)
"""Frames of the walk on which tracking without an end key is shown."""
SEEDS = 10
"""Number of random seeds of a limb search."""
LEG = ("Hip", "Knee", "Ankle")
ARM = ("Shoulder", "Elbow", "Wrist")
SWITCHES = ((0, 11, "cam01"), (11, 46, "cam02"), (46, 75, "cam03"), (75, 96, "cam01"))
"""The camera that sees most of the turning performer's arms: first and last frame, camera."""
SWITCHES_AT_KEYS = ((0, 24, "cam03"), (24, 48, "cam02"), (48, 72, "cam03"), (72, 96, "cam01"))
"""The same with changes of camera only at key poses."""


@dataclass(frozen=True, eq=False)
class RenderedShot:
    """A rendered shot, with all cameras and key poses, and its true landmarks."""

    shot: Shot
    truth: Landmarks

    @classmethod
    def load(cls, folder: Path) -> RenderedShot:
        """Read the shot and the true landmarks of a folder."""
        return cls(load_shot(folder / "shot.toml"), read_trc(folder / "landmarks.trc"))

    @property
    def keys(self) -> list[int]:
        """Key frames, which are left out of all errors whether or not their key poses were used."""
        return [int(f) for f in self.shot.performers[0].key_poses.frames]

    def score(self, motion: Motion, among: Sequence[int] | None = None) -> Score:
        """Return joint errors on the frames that are not key frames, or on those of them that are `among` given
        ones.
        """
        others = [] if among is None else np.setdiff1d(np.arange(len(motion)), among).tolist()
        return motion_error(self.shot.performers[0].body, motion, self.truth, sorted({*self.keys, *others}))

    def sight_errors(self, motion: Motion) -> tuple[float, float]:
        """Return mean joint errors perpendicular to the first camera's line of sight, and along it, mm."""
        body, truth = self.shot.performers[0].body, self.truth
        R, t = self.shot.views[0].camera.poses(0, len(motion))
        true = truth.points_world[: len(motion)]
        sight = true + (np.swapaxes(R, 1, 2) @ t[..., None])[:, None, :, 0]
        sight /= np.linalg.norm(sight, axis=2, keepdims=True)
        error = landmark_positions(body, motion, list(truth.names)) - true
        along = (error * sight).sum(axis=2, keepdims=True) * sight
        parts = (replace(truth, points_world=true + part) for part in (error - along, along))
        across, depth = (joint_error(part, truth, self.keys).mean for part in parts)
        return across, depth


@dataclass(frozen=True, eq=False)
class ExperimentResult:
    """The result of an experiment: text in Markdown, pictures by name, and the scores behind the text."""

    text: str
    pictures: dict[str, Image] = field(default_factory=dict)
    scores: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class WalkVariant:
    """How the walk is tracked."""

    solver: str
    end_key: bool
    prediction: bool
    limb_search: bool = False

    @property
    def seeds(self) -> range:
        """Seeds of the limb search; a single one without a search."""
        return range(SEEDS if self.limb_search else 1)

    def tracked(self, shot: Shot, seed: int) -> Motion:
        """Track a shot; returns the motion."""
        keyed = selected(shot, solver=self.solver, keyframes=None if self.end_key else [shot.frames[0]])
        settings = replace(keyed.settings, prediction=self.prediction, limb_search=self.limb_search, search_seed=seed)
        return track(replace(keyed, settings=settings)).motions[0]

    def words(self) -> list[str]:
        """Cells of a table."""
        return [self.solver, *map(_yes, (self.end_key, self.prediction, self.limb_search))]


WALK_VARIANTS = tuple(
    WalkVariant(solver, end_key, prediction, limb_search)
    for solver, searches in (("relaxation", (False,)), ("gauss-newton", (False, True)))
    for end_key in (False, True)
    for limb_search in (searches if end_key else (False,))
    for prediction in (False, True)
)
"""Limbs are only searched for between two key poses."""


def walk(footage: RenderedShot) -> ExperimentResult:
    """Track a walk past one camera, with and without the key pose at its end, prediction and limb search."""
    shot = footage.shot
    found: dict[WalkVariant, list[Motion]] = {}
    for variant in WALK_VARIANTS:
        say(f"{' '.join(variant.words())} ...")
        found[variant] = [variant.tracked(shot, seed) for seed in variant.seeds]
    scores = {variant: [footage.score(motion) for motion in motions] for variant, motions in found.items()}
    heads = ("solver", "end key", "prediction", "limb search", "all joints", "of seeds")
    groups = ("hidden leg", "near leg", "hidden arm", "near arm")
    rows = [[*variant.words(), *_medians(among)] for variant, among in scores.items()]
    full, bare = (WalkVariant("gauss-newton", on, on, on) for on in (True, False))
    both, without = (median(limb(score, "R", LEG) for score in scores[variant]) for variant in (full, bare))
    text = (
        f"{markdown((*heads, *groups), rows)}\n\n"
        f"The hidden leg's error with all three is {both / without:.2f} of that with none of them."
    )
    drifting = WalkVariant("gauss-newton", end_key=False, prediction=True)
    panels = Panels(shot, footage.truth)
    drifted = panels.row([(f, found[drifting][0], str(f)) for f in DRIFTED], 360, whole=True)
    kept = panels.row([(f, found[full][0], str(f)) for f in range(0, shot.length, 8)], 190)
    every = {" ".join(variant.words()): [_json(score) for score in among] for variant, among in scores.items()}
    return ExperimentResult(text, {"walk_without": drifted, "walk_with": kept}, every)


def limb(score: Score, side: str, joints: Sequence[str]) -> float:
    """Return the mean error of some joints of one side, millimetres."""
    return fmean(score.per_landmark[side + joint] for joint in joints)


def _medians(scores: Sequence[Score]) -> list[str]:
    """Return medians of mean errors: of all joints, with the smallest and the largest, and of the hidden (right) and
    near (left) legs and arms.
    """
    means = [score.mean for score in scores]
    among = f"{min(means):.0f} to {max(means):.0f}" if len(means) > 1 else "-"
    limbs = [median(limb(score, side, joints) for score in scores) for joints in (LEG, ARM) for side in "RL"]
    return [f"{median(means):.0f}", among, *(f"{error:.0f}" for error in limbs)]


def throw(footage: RenderedShot) -> ExperimentResult:
    """Track a throw of the discus filmed in fields; both solvers, with their convergence."""
    results, motions = [], {}
    for solver, sweeps in [("gauss-newton", None), *(("relaxation", s) for s in SWEEPS)]:
        say(f"{solver}{'' if sweeps is None else f', {sweeps} sweeps'} ...")
        result, motion = _watched(footage, solver, sweeps)
        results.append(result)
        motions[sweeps] = motion
    key_curve = spline(footage.shot.performers[0].key_poses, footage.shot.length)
    curve = footage.score(key_curve)
    shown = {sweeps: footage.score(motion, [SHOWN_FIELD]).mean for sweeps, motion in motions.items()}
    swept = ", ".join(f"{shown[sweeps]:.0f} mm after {sweeps} sweeps" for sweeps in SWEEPS)
    seen = {"the curves": key_curve, f"{SWEEPS[-1]} sweeps": motions[SWEEPS[-1]], "Gauss-Newton": motions[None]}
    sight = [[name, *(f"{error:.1f}" for error in footage.sight_errors(motion))] for name, motion in seen.items()]
    text = (
        f"{convergence(results)}\n\n{markdown(('errors, mm', 'across the line of sight', 'along it'), sight)}\n\n"
        f"The curves through the key poses alone: {curve.mean:.1f} mm. "
        f"On field {SHOWN_FIELD} alone: {swept}; {shown[None]:.0f} mm with Gauss-Newton."
    )
    panels = Panels(footage.shot, footage.truth)
    best = [(f, motions[None], str(f)) for f in range(0, footage.shot.length, 6)]
    half = len(best) // 2
    way = [(SHOWN_FIELD, None, f"field {SHOWN_FIELD}")]
    way += [(SHOWN_FIELD, motions[s], f"{s} sweeps") for s in SHOWN_SWEEPS]
    way += [(SHOWN_FIELD, motions[None], "Gauss-Newton")]
    strip = stacked_rows([panels.row(best[:half], 230), panels.row(best[half:], 230)])
    return ExperimentResult(text, {"throw": strip, "throw_convergence": panels.row(way, 360)}, {"runs": results})


def _watched(footage: RenderedShot, solver: str, sweeps: int | None) -> tuple[dict[str, Any], Motion]:
    """Return a tracked motion and its convergence, as for `tables.convergence`."""
    shot = selected(footage.shot, solver=solver)
    if sweeps is not None:
        shot = replace(shot, settings=replace(shot.settings, sweeps=sweeps))
    watch, begin = Watch(), time.perf_counter()
    result = track(shot, observe=watch)
    end = result.motions[0]
    found = {
        "solver": solver,
        "sweeps": sweeps,
        "score": _json(footage.score(end)),
        "way": [footage.score(m).mean for m in watch.way(end)],
        "before_last": footage.score(watch.before_last(end)).mean,
        "seconds": {"total": time.perf_counter() - begin},
        "iterations": [segment.iterations for segment in result.segments],
    }
    return found, end


def whirl(footage: RenderedShot) -> ExperimentResult:
    """Track a turn on the spot with waving arms with one camera, a camera switched by hand, and all; both solvers."""
    ways: dict[str, Callable[[Shot, Switches], Motion]] = {
        "cam01": lambda s, _: track(selected(s, views=["cam01"])).motions[0],
        "switched": track_switched,
        "all": lambda s, _: track(s).motions[0],
    }
    found, rows, scores = {}, [], {}
    spans = list(pairwise([0, *footage.keys[1:]]))
    keyed = (([0], SWITCHES), (footage.keys, SWITCHES_AT_KEYS))
    for solver, (keys, switches), cameras in product(SOLVERS, keyed, ways):
        say(f"{solver}, {cameras}, key poses at {' '.join(map(str, keys))} ...")
        shot = selected(footage.shot, solver=solver, keyframes=[footage.shot.frames[0] + k for k in keys])
        motion = ways[cameras](shot, switches)
        found[solver, len(keys), cameras] = motion
        parts = [footage.score(motion, range(a, b)).mean for a, b in spans]
        score = footage.score(motion)
        scores[f"{solver} {cameras} {keys}"] = _json(score)
        arms = fmean(limb(score, side, ARM) for side in "LR")
        numbers = [f"{error:.0f}" for error in (*parts, arms, score.mean)]
        rows.append([solver, cameras, " ".join(map(str, keys)), *numbers])
    heads = ("solver", "cameras", "key frames", *(f"{a + 1}-{b - 1}" for a, b in spans), "arms", "all joints")
    panels = Panels(footage.shot, footage.truth, "cam02")
    shown = range(0, footage.shot.length, 16)
    strips = [
        panels.row([(f, found["gauss-newton", 1, cameras], f"{cameras} {f}") for f in shown], 180) for cameras in ways
    ]
    return ExperimentResult(markdown(heads, rows), {"whirl": stacked_rows(strips)}, scores)


def track_switched(shot: Shot, switches: Switches) -> Motion:
    """Track segment after segment with one camera each, from the pose where the last one ended.

    Parameters
    ----------
    switches : sequence of (int, int, str)
        First and last shot frame, the one the last of the segment before, and the camera.
    """
    pose = shot.performers[0].key_poses.poses[[0]]
    tracked = []
    for first, last, camera in switches:
        motion = track(excerpt(selected(shot, views=[camera]), first, last, pose)).motions[0]
        pose = motion[[-1]]
        tracked.append(motion[:-1])
    return stacked([*tracked, pose])


def excerpt(shot: Shot, first: int, last: int, pose: Motion) -> Shot:
    """Return the frames first to last of a shot of one performer: they begin with that pose, or a key pose in its
    place.
    """
    performer = shot.performers[0]
    keys = performer.key_poses
    inside = (keys.frames >= first) & (keys.frames <= last)
    frames, poses, fixed = keys.frames[inside] - first, keys.poses[inside], keys.fixed[inside]
    if first not in keys.frames:
        begun = KeyPoses.whole([0], pose)
        frames, poses, fixed = np.r_[0, frames], stacked([pose, poses]), np.concatenate([begun.fixed, fixed])
    performer = replace(performer, key_poses=KeyPoses(frames, poses, fixed))
    return replace(shot, frames=(shot.frames[0] + first, shot.frames[0] + last), performers=(performer,))


def _json(score: Score) -> dict[str, Any]:
    return {"frames": score.frames, "mean": score.mean, "per_landmark": score.per_landmark}


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def say(text: str) -> None:
    """Tell how far it is on standard error."""
    print(f"experiments: {text}", file=sys.stderr, flush=True)
