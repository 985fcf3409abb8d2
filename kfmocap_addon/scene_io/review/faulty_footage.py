"""What tracking found wrong with footage: in full to be said once, and in brief beside the view."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import bpy

from ....core.errors import listed
from ....core.review.report_text import NO_KEYPOINTS_TEXT, keypoint_numbers_text, keypoints_text, rate_text, torn_text
from ....core.shot.footage import container_rate
from ....core.shot.shot import Shot, View
from ....core.tracking.footage_corrections.footage_gaps import found_gaps, torn_frames
from ....core.tracking.results.track_result import TrackResult
from ....core.tracking.retracking import Excerpt

_SHOWN = 5


def show_faults(
    scene: bpy.types.Scene, shot: Shot, parts: Sequence[Excerpt], results: Sequence[TrackResult]
) -> list[str]:
    """Show in the views of a scene what is wrong with the footage of the parts that were tracked; returns messages.

    What was shown before stays if only a part of the shot was tracked, and nothing is wrong there.
    """
    whole = _is_whole(shot, parts)
    slots = {slot.name: slot for slot in scene.kfmocap.views}
    messages, zero = [], scene.kfmocap.frame_start - shot.frames[0]
    for v, (view, own) in enumerate(zip(shot.views, found_gaps(shot, results[-1]), strict=True)):
        gaps = [gap.counted_from(zero) for gap in own if not gap.timed]
        found = [(gap.brief, gap.text) for gap in gaps] + list(
            _faults(scene.kfmocap.frame_start, v, shot, parts, results)
        )
        if rate := _rate(view, v, shot, results):
            found.append((rate, rate))
        messages += [f"{view.camera.name}: {text}" for _, text in found]
        slot = slots.get(view.camera.name)
        if slot is not None and (found or whole):
            slot.faults = "; ".join(brief for brief, _ in found)
    return messages


def _is_whole(shot: Shot, parts: Sequence[Excerpt]) -> bool:
    """Whether all of a shot was tracked."""
    return sum(part.last - part.first for part in parts) >= shot.length - 1


def _rate(view: View, v: int, shot: Shot, results: Sequence[TrackResult]) -> str:
    """Return what is to be said of a view's frame rate; its file is opened only if tracking has not measured it."""
    measured = next((rate for r in results if r.rates and (rate := r.rates[v]) is not None), None)
    stated = container_rate(view) if measured is None or measured.varies else 0.0
    return rate_text(stated, measured, view.every, shot.fps, shot.length)


def _faults(
    frame_start: int, v: int, shot: Shot, parts: Sequence[Excerpt], results: Sequence[TrackResult]
) -> Iterator[tuple[str, str]]:
    """Generate what is wrong with a view's footage, in brief and in full."""
    begins = [frame_start + part.first for part in parts]
    pairs = list(zip(begins, results, strict=True))
    shots = [shot.between(part.first, part.last) for part in parts]
    each = [torn_frames(own, r)[v] if r.torn else [] for own, r in zip(shots, results, strict=True)]
    patterns = [r.patterns[v] for r in results if r.patterns and r.patterns[v].text]
    torn = sorted({begin + frame for begin, found in zip(begins, each, strict=True) for frame in found})
    if torn and not any(pattern.every for pattern in patterns):
        yield f"pictures at {listed(torn, _SHOWN)} do not continue", torn_text(torn)
    if late := [off.counted_from(begin) for begin, r in pairs if r.late and (off := r.late[v]) is not None]:
        yield late[0].brief, late[0].text
    if patterns:
        yield patterns[0].brief, patterns[0].text
    if damage := [own for r in results if r.damage and (own := r.damage[v]) is not None]:
        yield "its file is damaged" if damage[0].reported else "its pictures may be damaged", damage[0].text
    agreements = [performer.agreements()[v] for r in results for performer in r.observed.performers]
    nobody = bool(agreements) and all(agreement is None for agreement in agreements)
    if nobody and shot.views[v].keypoints is not None and _is_whole(shot, parts):
        yield "its keypoints show no performer", NO_KEYPOINTS_TEXT
    contradicting = [text for agreement in agreements if agreement is not None and (text := keypoints_text(agreement))]
    if contradicting:
        yield "most of its keypoints contradict the others", f"of its keypoints, {contradicting[0]}"
    if apart := [n for r in results if r.observed.frames_off and (n := r.observed.frames_off[v]) is not None]:
        yield f"its keypoints are {abs(apart[0]):.1f} frames off", keypoint_numbers_text(apart[0])
    if rates := [rate for r in results if r.rates and (rate := r.rates[v]) is not None and rate.varies]:
        yield (
            "frames are missing in it" if rates[0].missing else "its frame rate varies",
            rates[0].text(shot.fps * shot.views[v].every),
        )
