"""Whether a view's footage changes from key frame to key frame where the key poses move.

How well it does is measured by `core.evidence.movement_match`; here views are compared as they are, and with other
offsets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from ...cameras.camera import Camera
from ...errors import FootageError
from ...evidence.movement_match import COARSE_SIDE, movement_match
from ...shot.footage import frames_at, probe
from ...shot.footage_faults.footage_checks import stored_frames
from ...shot.frame_numbers import footage_index
from ...shot.shot import View
from .posed_views import PosedView
from .view_findings import FootageMatch, ViewFinding

_MAX_SHIFT, _MIN_SHIFT = 30, 2
"""Greatest and least change of the offset that is tried, frames of the shot."""
_MAX_SHIFTED_KEYS, _MAX_READ = 5, 300
"""Greatest number of key frames that are used for that, and of frames from the first of them to the last."""
_MIN_OTHER_MATCH, _MIN_GAIN, _MIN_LACK = 0.97, 3.0, 0.01
"""Footage with another offset, or mirrored, is better if it matches at least this well, and if it lacks, as it
is, more of a match (1 - match): this many times what the other lacks, and this much more."""
_MIN_OTHERWISE_MATCH = 0.99
"""How well footage must match if it is mirrored, or taken by another camera, for that to be named: that of a camera
opposite looks mirrored, too."""


def footage_matches(views: Sequence[PosedView], known: Sequence[ViewFinding] = ()) -> list[FootageMatch]:
    """Compare every view's pictures of key frames with the key poses; left out are cameras that move, those of which
    something is known that explains a bad match, and views in which the poses differ too little.
    """
    left_out = {own.camera for own in known}
    compared = [posed for posed in views if posed.stands_still and posed.name not in left_out]
    return [match for posed in compared if (match := _footage_match(posed, views)) is not None]


def _footage_match(posed: PosedView, views: Sequence[PosedView]) -> FootageMatch | None:
    own = movement_match(posed.pictures, posed.camera, posed.geometry, posed.poses)
    if own is None or 1 - own <= _MIN_LACK:
        return None if own is None else FootageMatch(posed.name, own)

    def match_by(pictures: NDArray[np.uint8], camera: Camera) -> float:
        """Return how well pictures match if a camera has taken them; 0 if not much better than these as they are."""
        other = movement_match(pictures, camera, posed.geometry, posed.poses, least=_MIN_OTHERWISE_MATCH) or 0.0
        return other if other > _MIN_OTHERWISE_MATCH and _is_better(1 - other, 1 - own) else 0.0

    mirrored = match_by(np.ascontiguousarray(posed.pictures[:, :, ::-1]), posed.camera)
    alike = [v for v in views if v is not posed and v.stands_still and v.pictures.shape == posed.pictures.shape]
    matches = {view.name: match_by(posed.pictures, view.camera) for view in alike}
    shows = max(matches, key=lambda name: matches[name], default=None)
    if shows is None or matches[shows] <= mirrored:
        return FootageMatch(posed.name, own, mirrored=mirrored or None)
    return FootageMatch(posed.name, own, shows=shows)


def _is_better(other: float, own: float) -> bool:
    """Whether footage that is shown in another way lacks so much less of a match that this is how it was taken."""
    return other < _better_below(own)


def _better_below(own: float) -> float:
    """Return what footage must lack less than in another way to be better, if it lacks so much as it is."""
    return min(1 - _MIN_OTHER_MATCH, (own - _MIN_LACK) / _MIN_GAIN)


def better_shift(view: View, posed: PosedView, *, least_lack: float = 0.0) -> int | None:
    """Return by how many frames of the shot later footage of a view matches the key poses much better.

    Only the first part of long footage is read, and none where it matches too well as it is.

    Parameters
    ----------
    view : View
        As given: with its lens distortion.
    posed : PosedView
        The same on key frames.
    least_lack : float
        How much of a match any footage is expected to lack.
    """
    few = [k for k, f in enumerate(posed.frames) if f - posed.frames[0] <= _MAX_READ][:_MAX_SHIFTED_KEYS]
    if len(few) < 2 or not posed.stands_still:
        return None
    keys = posed.on(few)
    try:
        count = stored_frames(view, probe(view.footage), 0)
        tried = _tried_shifts(keys, lambda frame: 0 <= footage_index(view, frame) < count, least_lack)
        needed = sorted({keys.frames[k] + by for shift, kept in tried.items() for k in kept for by in (0, shift)})
        factor = max(1.0, max(view.camera.size) / COARSE_SIDE)
        pictures = dict(zip(needed, frames_at(view, needed, factor, grey=False), strict=True))
    except FootageError:
        return None
    return _best_shift(keys, tried, pictures, view.camera.reduced(factor).rectified())


def _tried_shifts(keys: PosedView, shown: Callable[[int], bool], least_lack: float) -> dict[int, tuple[int, ...]]:
    """Return the shifts that may be better, with the numbers of those of K key frames that the footage shows with and
    without each.
    """
    found, lacks = {}, cache(lambda kept: _lack(keys.pictures[[*kept]], keys.camera, keys.on(kept)))
    for shift in (*range(-_MAX_SHIFT, 1 - _MIN_SHIFT), *range(_MIN_SHIFT, _MAX_SHIFT + 1)):
        kept = tuple(k for k, f in enumerate(keys.frames) if shown(f) and shown(f + shift))
        if len(kept) >= max(2, len(keys.frames) / 2) and _is_better(least_lack, lacks(kept) or 0.0):
            found[shift] = kept
    return found


def _best_shift(
    keys: PosedView, tried: Mapping[int, tuple[int, ...]], pictures: Mapping[int, NDArray[np.uint8]], camera: Camera
) -> int | None:
    def lack(kept: tuple[int, ...], shift: int, most: float = 1.0) -> float | None:
        return _lack(np.stack([pictures[keys.frames[k] + shift] for k in kept]), camera, keys.on(kept), most)

    present = cache(partial(lack, shift=0))
    best, least = None, 1.0
    for shift, kept in tried.items():
        own = present(kept)
        most = 0.0 if own is None else min(least, _better_below(own))
        other = lack(kept, shift, most) if most > 0 else None
        if other is not None and other < most:
            best, least = shift, other
    return best


def _lack(pictures: NDArray[np.uint8], camera: Camera, keys: PosedView, most: float = 1.0) -> float | None:
    """Return how much pictures of K key frames, taken by a camera, lack of a match with the key poses; if that is more
    than `most`, possibly less than they do.
    """
    match = movement_match(pictures, camera, keys.geometry, keys.poses, least=1 - most)
    return None if match is None else 1 - match
