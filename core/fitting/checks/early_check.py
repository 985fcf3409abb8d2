"""Comparing footage with the first key poses, before anything is tracked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ...runtime.threads import one_library_thread
from ...shot.segments import whole_keys
from ...shot.shot import Shot
from ..key_frame_views import pictured_key_frames
from .background_checks import background_is_plain, moved_camera, with_plain_backgrounds
from .dissolve import DISSOLVE_SIZE, dissolves
from .flicker import FLICKER_FRAMES, MIN_FLICKER, flicker
from .footage_match import footage_matches
from .misfit_causes import attributed_findings
from .outline_check import outline_fits
from .picture_findings import DissolvingPictures, FadingPictures, FlickeringLight
from .posed_views import posed_views
from .view_findings import CameraFit, FootageMatch, ViewFinding

EARLY_MISFITS = "footage that does not match"
"""Key with which these are shown, beside those of segments."""
EARLY_KEYS = 3
"""Number of key frames by which footage is compared with the key poses before the shot is tracked."""


def early_frames(shot: Shot) -> frozenset[int]:
    """Return the shot frames whose pictures `early_misfits` compares: the first with key poses of the whole body, and
    the first of all.
    """
    return frozenset({*_early_keys(shot).tolist(), *range(min(FLICKER_FRAMES, shot.length))})


def _early_keys(shot: Shot) -> NDArray[np.int64]:
    return whole_keys(shot, 0, shot.length - 1)[:EARLY_KEYS]


@one_library_thread()
def early_misfits(shot: Shot, pictures: Sequence[Mapping[int, NDArray[np.uint8]]]) -> list[ViewFinding]:
    """Return the views whose light flickers, whose pictures fade or dissolve, whose camera moves, or whose footage does
    not match the first key poses, which is known before anything is tracked.

    Parameters
    ----------
    shot : Shot
    pictures : sequence of mappings
        Per view: rectified pictures by shot frame, including those of `early_frames`.
    """
    light = _light_findings(shot, pictures)
    frames = _early_keys(shot)
    if len(frames) < 2:
        return light
    rectified = replace(shot, views=tuple(replace(view, camera=view.camera.rectified()) for view in shot.views))
    pictured = pictured_key_frames(rectified, frames, pictures)
    views = posed_views(rectified, pictured, frames)
    moved = [found for posed in views if (found := moved_camera(posed)) is not None]
    blended = [own for own in light if isinstance(own, DissolvingPictures)]
    unmeasured = moved if shot.settings.stabilise is False else ()  # else it is measured how they move
    # A background that cannot show whether its camera was held in the hand leaves the performers' outlines.
    fits = outline_fits(rectified, pictured) if any(background_is_plain(posed) for posed in views) else ()
    unlike = attributed_findings(shot.views, views, footage_matches(views, [*moved, *blended]), fits)
    mismatches = [
        own
        for own in with_plain_backgrounds(unlike, views, ())
        if isinstance(own, FootageMatch) or (isinstance(own, CameraFit) and own.off and own.plain)
    ]
    return [*light, *unmeasured, *mismatches]


def _light_findings(shot: Shot, pictures: Sequence[Mapping[int, NDArray[np.uint8]]]) -> list[ViewFinding]:
    """Return the views whose light flickers, or whose pictures fade or dissolve, on the first frames."""
    found: list[ViewFinding] = []
    for view, own in zip(shot.views, pictures, strict=True):
        frames = range(min(FLICKER_FRAMES, shot.length))
        first = [cv2.resize(own[f], DISSOLVE_SIZE, interpolation=cv2.INTER_AREA) for f in frames]
        swing = flicker(first)
        if view.camera.stands_still and dissolves(first):
            found.append(DissolvingPictures(view.camera.name))
        elif swing.fades:
            found.append(FadingPictures(view.camera.name))
        elif swing.amplitude > MIN_FLICKER:
            found.append(FlickeringLight(view.camera.name, swing.amplitude, swing.in_bands))
    return found
