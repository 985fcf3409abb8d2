"""Tracking some segments of a shot: what lies beside them is held as it is."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from ..body.motion import Motion
from ..errors import KFMocapError
from ..runtime.progress import Progress, report_progress, share
from ..runtime.worker_memory import WorkerMemory
from ..shot.fingerprint import checksum, value_bytes
from ..shot.grips import completed
from ..shot.shot import KeyPoses, Performer, Shot
from .run_context import NOTHING_KEPT, RunContext
from .schedule import SegmentShown
from .segment_stages import Around
from .segments import Segment, segments
from .track_result import TrackResult
from .tracker import track

PREVIEWED = 4
"""Iterations of a segment that a preview shows: the first of them is the initial solution."""


@dataclass(frozen=True, eq=False)
class Excerpt:
    """Frames of a shot that are tracked while the others stay.

    Attributes
    ----------
    first, last : int
        Shot frames, inclusive: where segments begin and end.
    around : tuple of (tuple of Motion or None)
        The poses beside them, see `tracking.track`.
    footage_offset : float, optional
        As it was measured on the rest of the shot, see `core.shot.shot.Settings`; None measures it on the excerpt.
    earlier : tuple of Motion
        Every performer's motion on these frames as it was tracked before, if it is to be begun with.
    """

    first: int
    last: int
    around: Around = (None, None)
    footage_offset: float | None = None
    earlier: tuple[Motion, ...] = ()


def segments_at(segments: Sequence[Segment], frame: int) -> list[Segment]:
    """The segments that a shot frame lies in: two where it is a key pose between them."""
    return [(first, last) for first, last in segments if first <= frame <= last]


def segments_after(segments: Sequence[Segment], frame: int) -> list[Segment]:
    """The segments that have frames after a shot frame."""
    return [(first, last) for first, last in segments if last > frame]


def segments_before(segments: Sequence[Segment], frame: int) -> list[Segment]:
    """The segments that have frames before a shot frame."""
    return [(first, last) for first, last in segments if first < frame]


def joined(segments: Sequence[Segment]) -> list[Segment]:
    """First and last frames of runs of segments that meet."""
    runs: list[Segment] = []
    for first, last in sorted(segments):
        begin = runs.pop()[0] if runs and runs[-1][1] == first else first
        runs.append((begin, last))
    return runs


def track_excerpts(
    shot: Shot,
    excerpts: Sequence[Excerpt],
    progress: Progress | None = None,
    *,
    run: RunContext = NOTHING_KEPT,
) -> list[TrackResult]:
    """Track excerpts of a shot; what it costs is theirs alone.

    Parameters
    ----------
    shot : Shot
    excerpts : sequence of Excerpt
    progress : callable, optional
    run : RunContext, optional
        Segments are shown in frames of the shot.

    Returns
    -------
    list of TrackResult
        One per part, whose frames it counts from the part's first.

    Raises
    ------
    KFMocapError
        See `tracking.track`.
    """
    shot = completed(shot)
    ends = np.cumsum([0] + [part.last - part.first for part in excerpts])
    ends = ends / max(1, ends[-1])
    results = []
    for part, (begin, end) in zip(excerpts, pairwise(ends), strict=True):
        asked = shot.between(part.first, part.last).with_footage_offset(part.footage_offset)
        shown = None if run.show is None else partial(_show_in_shot, run.show, part.first)
        results.append(
            track(
                asked,
                share(progress, float(begin), float(end)),
                around=part.around,
                run=replace(run, show=shown),
                earlier=part.earlier,
            )
        )
    return results


def preview_segment(
    shot: Shot,
    excerpts: Sequence[Excerpt],
    frame: int,
    show: SegmentShown,
    *,
    progress: Progress | None = None,
    memory: WorkerMemory | None = None,
) -> None:
    """Show a coarse solution of the segment that the user looks at, unless that is tracked first anyway.

    It is no part of the result, which does not depend on what is looked at. Errors are those of the tracking
    that follows, and left to it.
    """
    chosen = [(part, s) for part in excerpts for s in segments(shot) if part.first <= s[0] and s[1] <= part.last]
    number = next((i for i, (_, (first, last)) in enumerate(chosen) if first <= frame <= last), 0)
    if number == 0:
        return
    part, (first, last) = chosen[number]
    seen: list[int] = []

    def observed(segment: Segment, iteration: int, motions: Sequence[Motion]) -> None:
        _show_in_shot(show, first, segment, tuple(motions))
        seen.append(iteration)

    def looked(_what: str, _fraction: float) -> bool:
        report_progress(progress, "looking ahead", 0.0)
        return len(seen) < PREVIEWED

    asked = completed(shot).between(first, last).with_footage_offset(part.footage_offset)
    with contextlib.suppress(KFMocapError):  # it is cancelled, or the tracking that follows says what is wrong
        track(asked, looked, observed, run=RunContext(memory=memory))


def _show_in_shot(show: SegmentShown, start: int, segment: Segment, motions: tuple[Motion, ...]) -> None:
    """Show a segment of an excerpt that starts at a shot frame."""
    show((start + segment[0], start + segment[1]), motions)


def digest(shot: Shot, segment: Segment) -> str:
    """A text that changes with anything that the motion of a segment depends on, but what is beside it.

    What is in files counts by their names; where they are does not.
    """
    part = shot.between(*segment)
    numbers = {performer.name: str(i) for i, performer in enumerate(part.performers)}
    holds = tuple(replace(h, prop=numbers.get(h.prop, ""), holder=numbers.get(h.holder, "")) for h in part.holds)
    asked = replace(part, name="", performers=tuple(_asked(performer) for performer in part.performers), holds=holds)
    return checksum(value_bytes(asked))


def _asked(performer: Performer) -> Performer:
    """A performer without what key poses do not fix: tracking changes that."""
    keys, P = performer.key_poses, performer.key_poses.poses.rotations.shape[1]
    turned = keys.fixed[:, 3:].reshape(-1, P, 3).all(axis=2)[..., None, None]
    T, Q = keys.poses.translations, keys.poses.rotations
    poses = replace(keys.poses, translations=np.where(keys.fixed[:, :3], T, 0), rotations=np.where(turned, Q, 0))
    return replace(performer, name="", key_poses=KeyPoses(keys.frames, poses, keys.fixed))
