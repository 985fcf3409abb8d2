"""Tracking some segments of a shot, while the motion beside them stays as it is."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from ..body.motion import Motion
from ..errors import KFMocapError, ShotError
from ..runtime.processes.worker_memory import WorkerMemory
from ..runtime.progress import Progress, report_progress, share
from ..shot.fingerprint import ValueBytes, checksum
from ..shot.frame_numbers import without_gaps_beyond
from ..shot.segments import Segment, segments
from ..shot.shot import KeyPoses, Performer, Shot
from .footage_corrections.footage_gaps import with_found_gaps
from .results.track_result import TrackResult
from .scheduling.run_context import PLAIN_RUN, RunContext
from .scheduling.schedule import SegmentShown
from .shot_scale import ShotScale
from .track_state import Around
from .tracker import track

PREVIEW_ITERATIONS = 4
"""Number of iterations that a preview shows; the first is the initial solution."""


@dataclass(frozen=True, eq=False)
class Excerpt:
    """A range of a shot's frames that is tracked while the other frames stay as they are.

    Attributes
    ----------
    first, last : int
        First and last shot frame; they are ends of segments.
    around : tuple of (tuple of Motion or None)
        The poses before and after these frames, see `tracker.track`.
    footage_offset : float, optional
        Offset as measured on the rest of the shot, see `core.shot.settings.Settings`; None: measured on the excerpt.
    earlier : tuple of Motion
        Per performer: the motion on these frames as it was tracked before, to start from; empty to start anew.
    """

    first: int
    last: int
    around: Around = (None, None)
    footage_offset: float | None = None
    earlier: tuple[Motion, ...] = ()


def segments_at(segments: Sequence[Segment], frame: int) -> list[Segment]:
    """Return the segments that contain a shot frame: two if it is a key pose between them."""
    return [(first, last) for first, last in segments if first <= frame <= last]


def segments_after(segments: Sequence[Segment], frame: int) -> list[Segment]:
    """Return the segments with frames after a shot frame."""
    return [(first, last) for first, last in segments if last > frame]


def segments_before(segments: Sequence[Segment], frame: int) -> list[Segment]:
    """Return the segments with frames before a shot frame."""
    return [(first, last) for first, last in segments if first < frame]


def excerpt_at(shot: Shot, frame: int, motions: Sequence[Motion], footage_offset: float | None) -> Excerpt:
    """Return the segments that contain a frame as an excerpt: the two beside a key pose that was corrected.

    Parameters
    ----------
    shot : Shot
    frame : int
        Shot frame.
    motions : sequence of Motion
        Per performer: its motion on all frames, as it was tracked before.
    footage_offset : float, optional
        As measured then (`TrackResult.footage_offset`).

    Raises
    ------
    ShotError
        The frame is none of the shot's.
    """
    ends = [end for segment in segments_at(segments(shot), frame) for end in segment]
    if not ends:
        raise ShotError(f"there is no frame {frame}", where=shot.name, todo=f"give 0 to {shot.length - 1}")
    first, last = min(ends), max(ends)

    def pose(number: int) -> tuple[Motion, ...] | None:
        return tuple(m[[number]] for m in motions) if 0 <= number < shot.length else None

    earlier = tuple(m[first : last + 1] for m in motions)
    return Excerpt(first, last, (pose(first - 1), pose(last + 1)), footage_offset, earlier)


def track_excerpts(
    shot: Shot,
    excerpts: Sequence[Excerpt],
    progress: Progress | None = None,
    *,
    run: RunContext = PLAIN_RUN,
) -> list[TrackResult]:
    """Track excerpts of a shot; the time depends on the excerpts alone, not on the length of the shot.

    Parameters
    ----------
    shot : Shot
    excerpts : sequence of Excerpt
    progress : callable, optional
    run : RunContext, optional
        Its `show` is called with segments in frames of the shot.

    Returns
    -------
    list of TrackResult
        One per excerpt; frames are counted from its first.

    Raises
    ------
    KFMocapError
        See `tracker.track`.
    """
    shot = ShotScale.of(shot).completed(shot)
    ends = np.cumsum([0] + [part.last - part.first for part in excerpts])
    ends = ends / max(1, ends[-1])
    results = []
    for part, (begin, end) in zip(excerpts, pairwise(ends), strict=True):
        asked = _between(shot, part.first, part.last).with_footage_offset(part.footage_offset)
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
        shot = with_found_gaps(shot, results[-1].gaps)
    return results


def preview_segment(
    shot: Shot,
    excerpts: Sequence[Excerpt],
    frame: int,
    show: SegmentShown,
    *,
    progress: Progress | None,
    memory: WorkerMemory | None,
) -> None:
    """Show a coarse solution of the segment at a frame early, unless this segment is tracked first anyway.

    The preview has no influence on the result. Errors are ignored here: the tracking that follows reports them.

    Parameters
    ----------
    shot : Shot
    excerpts : sequence of Excerpt
        The excerpts that are going to be tracked.
    frame : int
        Shot frame that the user has on the screen.
    show : callable
        See `SegmentShown`.
    progress : callable or None
    memory : WorkerMemory or None
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
        return len(seen) < PREVIEW_ITERATIONS

    asked = _between(ShotScale.of(shot).completed(shot), first, last).with_footage_offset(part.footage_offset)
    around = (part.around[0] if first == part.first else None, part.around[1] if last == part.last else None)
    with contextlib.suppress(KFMocapError):  # cancelled, or an error that the tracking that follows reports
        track(asked, looked, observed, around=around, run=RunContext(memory=memory))


def _between(shot: Shot, first: int, last: int) -> Shot:
    """Return an excerpt of a shot; how cameras turn is only measured on whole shots, whose first key pose they refer
    to.
    """
    if (first, last) == (0, shot.length - 1):
        return shot
    excerpt = shot.between(first, last)
    return replace(excerpt, settings=replace(excerpt.settings, stabilise=False))


def _show_in_shot(show: SegmentShown, start: int, segment: Segment, motions: tuple[Motion, ...]) -> None:
    """Show a segment of an excerpt that starts at a shot frame."""
    show((start + segment[0], start + segment[1]), motions)


def digest(shot: Shot, segment: Segment) -> str:
    """Hash of everything that the motion of a segment depends on, except the motion beside it.

    Files count by their names, not by their folders or content.
    """
    return digests(shot, [segment])[segment]


def digests(shot: Shot, segments: Iterable[Segment]) -> dict[Segment, str]:
    """Return the `digest` of each of some segments."""
    numbers = {performer.name: str(i) for i, performer in enumerate(shot.performers)}
    values, found = ValueBytes(), {}
    for segment in segments:
        part = shot.between(*segment)
        holds = tuple(replace(h, prop=numbers.get(h.prop, ""), holder=numbers.get(h.holder, "")) for h in part.holds)
        asked = replace(
            part,
            name="",
            views=tuple(without_gaps_beyond(view, *part.frames) for view in part.views),
            performers=tuple(_as_keyed(performer) for performer in part.performers),
            holds=holds,
        )
        found[segment] = checksum(values.of(asked))
    return found


def _as_keyed(performer: Performer) -> Performer:
    """Return a performer without the values that its key poses do not fix, as tracking changes these."""
    keys = performer.key_poses
    turned = keys.fixed_axes.all(axis=2)[..., None, None]
    T, Q = keys.poses.translations, keys.poses.rotations
    poses = replace(keys.poses, translations=np.where(keys.fixed[:, :3], T, 0), rotations=np.where(turned, Q, 0))
    return replace(performer, name="", key_poses=KeyPoses(keys.frames, poses, keys.fixed))
