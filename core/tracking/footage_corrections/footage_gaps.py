"""Correcting the frame numbers of a view that is early or late from some frame on.

Everything behind a missing frame is early by one (`core.tracking.results.late_views`). Once that is found, the count
of the view's frames is corrected, pairs of pictures across the gap get no weight, and the segments that this affects
are tracked again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...body.kinematics import scene_poses
from ...evidence.background_shift import background_shift
from ...evidence.movement_match import FINE_SIDE, MIN_MATCH, key_poses_of, movement_match
from ...evidence.rendering.label_images import render_labels
from ...evidence.rendering.part_geometry import Geometry
from ...numerics.arrays import evenly_spaced
from ...shot.footage import frames_at, probe, working_factor
from ...shot.footage_faults.continuity import COMPARED_PAIRS
from ...shot.footage_faults.footage_checks import stored_frames
from ...shot.footage_faults.footage_times import FootageRate, timed_gaps
from ...shot.frame_numbers import across_gaps, footage_index, frames_damaged, gap_frame
from ...shot.segments import whole_keys
from ...shot.shot import Gap, Shot, View
from ..results.journal import FinishedSegment
from ..results.track_result import TrackResult

MAX_GAPS = 4
"""How often a shot is tracked again with one more gap, at most: of several frames that are missing, one is found at a
time."""
SAME_GAP_FRAMES = 2
"""Distance in frames within which gaps are one: at most so far from its true place one was found, with one exception
(docs/studies.md)."""

MAX_COMPARED_FRAMES = 8
"""How many frames, at most, beside those at a delay, show whether a camera moves before the delay is believed."""
MAX_COMPARED_KEYS = 5
"""Greatest number of key frames by which footage is compared with the key poses before delays are believed."""


def without_false_delays(shot: Shot, result: TrackResult) -> TrackResult:
    """Return a result without delays of views if some view's footage does not show the key poses, or its camera moves
    though its calibration has one pose, or its frames are repeated at regular intervals: what is found late in footage
    of another take, by a calibration of another world, in footage that shakes or that stutters, says nothing.
    """
    repeated = any(pattern.every for pattern in result.patterns)
    if any(result.late) and (repeated or not (_shows_key_poses(shot) and _cameras_stand_still(shot, result))):
        return replace(result, late=(None,) * len(shot.views))
    return result


def _shows_key_poses(shot: Shot) -> bool:
    keys = whole_keys(shot, 0, shot.length - 1)
    frames = keys[evenly_spaced(len(keys), MAX_COMPARED_KEYS)]
    if len(frames) < 2:
        return True
    geometry, poses = Geometry.of([performer.body for performer in shot.performers]), key_poses_of(shot, frames)
    for view in shot.views:
        if view.camera.stands_still:
            factor = max(1.0, max(view.camera.size) / FINE_SIDE)
            pictures = np.stack([*frames_at(view, (shot.frames[0] + frames).tolist(), factor, grey=False)])
            match = movement_match(pictures, view.camera.reduced(factor).rectified(), geometry, poses)
            if match is not None and match < MIN_MATCH:
                return False
    return True


def _cameras_stand_still(shot: Shot, result: TrackResult) -> bool:
    """Whether the background of every camera that should stand still does, as far as some of the frames show."""
    spread = evenly_spaced(shot.length, MAX_COMPARED_FRAMES).tolist()
    ends = [frame for late in result.late if late is not None for frame in (late.frame - 1, late.frame)]
    frames = np.array(sorted({*spread, *ends}))
    bodies = [performer.body for performer in shot.performers]
    geometry, poses = Geometry.of(bodies), scene_poses(bodies, [motion[frames] for motion in result.motions])
    for view in shot.views:
        if view.camera.stands_still:
            factor = working_factor(view, shot.settings.working_size)
            pictures = [*frames_at(view, (shot.frames[0] + frames).tolist(), factor, grey=False)]
            seen = render_labels(geometry, view.camera.reduced(factor).rectified(), 0, *poses).part >= 0
            if background_shift(pictures, list(seen), frames.tolist(), factor) is not None:
                return False
    return True


def with_timed_gaps(shot: Shot, rates: Sequence[FootageRate | None]) -> Shot:
    """Return a shot in which frames are missing, or there too often, in views without known gaps where the times in
    their files say so.
    """
    if not shot.settings.correct_gaps:
        return shot
    views = []
    for view, rate in zip(shot.views, rates, strict=True):
        views.append(replace(view, gaps=view.gaps or timed_gaps(view, rate)))
    return replace(shot, views=tuple(views))


def with_gaps(shot: Shot, result: TrackResult) -> Shot | None:
    """Return a shot with one more frame missing, or one less, in the views that its result shows to be early or late;
    None if none is, or it is not clear which.
    """
    if not (shot.settings.correct_gaps and any(own is not None and own.clear for own in result.late)):
        return None
    views = []
    for view, own in zip(with_found_gaps(shot, result.gaps).views, result.late, strict=True):
        if own is not None:
            view = _with_gap(view, footage_index(view, shot.frames[0] + own.frame), 1 if own.delay > 0 else -1)
            view = _ended(view, shot.frames[1])
        views.append(view)
    return replace(shot, views=tuple(views))


def _with_gap(view: View, place: int, missing: int) -> View:
    """Return a view of whose footage more frames are missing before one of its frames, or there too often if less than
    none are. They belong to a gap that is known nearby.
    """
    near = min(view.gaps, key=lambda gap: abs(gap.frame - place), default=Gap(place, 0))
    if abs(near.frame - place) > SAME_GAP_FRAMES:
        near = Gap(place, 0)
    changed = Gap(near.frame, near.missing + missing)
    gaps = [gap for gap in (*view.gaps, changed) if gap != near and gap.missing]
    return replace(view, gaps=tuple(sorted(gaps, key=lambda gap: gap.frame)))


def _ended(view: View, last: int) -> View:
    """Return a view without the shot's last frames, up to frame `last`, where its footage ends before it."""
    end = footage_index(view, last)
    count = stored_frames(view, probe(view.footage), end + 1)
    return view if end < count else _with_gap(view, count, end + 1 - count)


def unaffected(done: Sequence[FinishedSegment], before: Shot, after: Shot) -> list[FinishedSegment]:
    """Return the segments of a shot that would be tracked to the same result after the views' gaps have changed, or
    which of their frames are damaged.

    A segment knows of the one after it, which begins on its last frame, and pictures are compared with some after them.
    Keypoints are fitted to the shot as a whole.
    """
    if any(view.keypoints for view in before.views):
        return []
    frames, changed = range(before.frames[0], before.frames[1] + 1), np.zeros(before.length, bool)
    for a, b in zip(before.views, after.views, strict=True):
        changed |= [footage_index(a, frame) != footage_index(b, frame) for frame in frames]
        changed |= frames_damaged(a, frames) != frames_damaged(b, frames)
    safe = min(np.flatnonzero(changed), default=before.length) - 1 - COMPARED_PAIRS
    return [one for one, following in pairwise(done) if following.result.last < safe]


@dataclass(frozen=True)
class FoundGap:
    """A gap in a view's footage, as it is reported.

    Attributes
    ----------
    frame : int
        The shot's first frame that is missing in the footage; or the one behind the frame that is there more than once.
    missing, timed
        See `Gap`.
    given : bool
        Whether the user stated it; else tracking has found it.
    """

    frame: int
    missing: int
    timed: bool = False
    given: bool = False

    def counted_from(self, first: int) -> FoundGap:
        """Return the same with frames in a count in which the shot's first has a number."""
        return replace(self, frame=first + self.frame)

    @property
    def brief(self) -> str:
        """Short message, for a panel."""
        if self.missing < 0:
            often = "twice" if self.missing == -1 else f"{1 - self.missing} times"
            return f"frame {self.frame - 1} is there {often} (corrected)"
        if self.missing == 1:
            return f"frame {self.frame} is missing (corrected)"
        return f"frames {self.frame} to {self.frame + self.missing - 1} are missing (corrected)"

    @property
    def text(self) -> str:
        """Message that says what was done, too."""
        what = self.brief.removesuffix(" (corrected)")
        return (
            f"{what}, as everything after it shows; from there on, its frames were counted correctly and tracked "
            "again; pairs of pictures across the gap had no weight"
        )


def found_gaps(shot: Shot, result: TrackResult) -> list[list[FoundGap]]:
    """Return the gaps of every view as they are reported, with frames in the count of `Shot.frames`."""
    return [
        [FoundGap(gap_frame(replace(view, gaps=gaps), gap), gap.missing, gap.timed, gap in view.gaps) for gap in gaps]
        for view, gaps in zip(shot.views, result.gaps or [()] * len(shot.views), strict=True)
    ]


def torn_frames(shot: Shot, result: TrackResult) -> list[list[int]]:
    """Return the frames of every view that do not continue the one before, counted from the shot's first, except those
    at gaps that the times in its file show, or that the user stated.
    """
    frames, found = range(shot.frames[0], shot.frames[1] + 1), []
    counted = with_found_gaps(shot, result.gaps).views
    for view, given, torn in zip(counted, shot.views, result.torn, strict=True):
        known = tuple(gap for gap in view.gaps if gap.timed or gap in given.gaps)
        across = across_gaps(replace(view, gaps=known), frames)
        found.append([frame for frame in torn if not across[frame - 1]])
    return found


def with_found_gaps(shot: Shot, gaps: Sequence[tuple[Gap, ...]]) -> Shot:
    """Return a shot with the gaps of its views that tracking has found."""
    if not gaps:
        return shot
    return replace(shot, views=tuple(replace(view, gaps=own) for view, own in zip(shot.views, gaps, strict=True)))


def fits_better(again: TrackResult, before: TrackResult) -> bool:
    """Whether a result with one more gap in a view is right: not if the view is now as wrong the other way."""
    pairs = zip(again.late, before.late, strict=True)
    return not any(now is not None and then is not None and now.delay * then.delay < 0 for now, then in pairs)
