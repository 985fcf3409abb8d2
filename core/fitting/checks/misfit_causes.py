"""What explains that views do not show the key poses: a camera that is off, or another offset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...shot.shot import View
from .footage_match import better_shift
from .posed_views import PosedView
from .view_findings import CameraFit, FootageMatch, ViewFinding

MAX_SHIFT_SPREAD = 4.0
"""Largest difference between shifts of all views that mean one thing, key poses that lag, frames of the shot: each is
known to two frames at most."""

_MIN_LACK = 0.005
"""How much footage must lack of a match with the key poses for other offsets to be tried (1 - match): more than all of
75 views with the right offset but four, in which things that move or stand in front explain it."""


def attributed_findings(
    views: Sequence[View], posed: Sequence[PosedView], matches: Sequence[FootageMatch], fits: Sequence[CameraFit]
) -> tuple[ViewFinding, ...]:
    """Return the cameras' fits, and what else explains that views do not show the key poses.

    A camera that can be corrected explains that its footage does not match. Another offset explains both; but where
    performers walk steadily, a camera that was turned looks like one that is late. No offset is expected to make
    footage match better than the view that matches best.

    Parameters
    ----------
    views : sequence of View
        As given: with their lens distortion.
    posed : sequence of PosedView
        The same on key frames.
    matches, fits : sequence of FootageMatch, of CameraFit
        How well the views' footage and cameras fit the key poses.
    """
    correctable = {fit.camera for fit in fits if fit.off}
    explained = {match.camera: match for match in matches if match.explained}
    unlike = {match.camera: match for match in matches if match.off and match.camera not in correctable} | explained
    pairs = {own.name: (view, own) for view, own in zip(views, posed, strict=True)}
    shifts: dict[str, int] = {}
    for match in matches:
        view, own = pairs[match.camera]
        doubtful = match.camera in correctable or match.camera in unlike or 1 - match.match > _MIN_LACK
        if not match.explained and doubtful:
            lacks = [1 - other.match for other in matches if other is not match]
            shift = better_shift(view, own, least_lack=min((lack for lack in lacks if lack <= _MIN_LACK), default=0.0))
            if shift is not None:
                shifts[match.camera] = shift
                unlike[match.camera] = replace(match, offset=view.offset + view.every * shift)
    if len(matches) > 1 and len(unlike) == len(matches) and common_shift(list(shifts.values()), len(matches)) is None:
        # The key poses are elsewhere, or of another movement: some offset always fits a little better.
        unlike = {name: without for name, own in unlike.items() if (without := replace(own, offset=None)).off}
    rest = [fit for fit in fits if fit.camera not in (explained if fit.off else unlike)]
    return (*unlike.values(), *rest)


def common_shift(shifts: Sequence[float], views: int) -> float | None:
    """Return the shift, in frames of the shot, by which the footage of all of a number of views matches better.

    None if it is not known of all of them, or if they differ by more than `MAX_SHIFT_SPREAD`. Where they agree, the key
    poses are rather late or early than all the views.
    """
    if not shifts or len(shifts) < views or max(shifts) - min(shifts) > MAX_SHIFT_SPREAD:
        return None
    return float(np.median(shifts))
