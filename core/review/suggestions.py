"""Suggestions: the frames on which one more key pose would help most.

There are two reasons to suggest a frame: parts are hidden just before or after it (paper 1, section 6), or the expected
error of the motion is large there.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ..evidence.occlusion import LONG_GAP
from ..numerics.arrays import Array, Ints
from ..numerics.frame_ranges import runs
from ..shot.shot import KeyPoses
from ..tracking.expected_errors.uncertainty import expected_errors, joint_parts

MIN_SPACING = 5
"""Least distance of a suggested key frame from other key frames, frames."""
MAX_HIDDEN_SUGGESTIONS = 6
"""Largest number of key frames suggested for one performer because parts are hidden."""
MIN_VISIBLE_FRAMES = 3
"""Number of frames for which a part must be visible to be posed there."""
MAX_FRAME_DISTANCE = 5
"""Largest distance of a suggested key frame from the frames on which a part is hidden, frames."""
MAX_ERROR_SUGGESTIONS = 5
"""Largest number of key frames suggested for one performer because of the expected error."""
MAX_NAMED_PARTS = 3
"""Largest number of parts named with an expected error."""
NAMED_ERROR_SHARE = 0.7
"""A part is named if its expected error is at least this, relative to the largest."""
MIN_GAIN = 0.05
"""Least share of the expected error that a suggestion must remove."""


@dataclass(frozen=True)
class KeySuggestion:
    """A key frame that would help.

    Attributes
    ----------
    frame : int
        Shot frame.
    parts : tuple of int
        The parts to look at, worst first: those hidden longest, or with the largest expected error.
    hidden : tuple of int or None
        First and last frame on which the first of the parts is hidden, if that is the reason.
    deviation : float
        Expected error on the frame, mean over the joints, metres; 0 if that is not the reason.
    worst : float
        Expected error of the first of the parts on the frame, metres; 0 if that is not the reason.
    gain : float
        How much a key pose there, in addition to those earlier in the list, would lower the expected error, mean over
        joints and frames of the shot, metres; 0 if that is not the reason.
    """

    frame: int
    parts: tuple[int, ...]
    hidden: tuple[int, int] | None = None
    deviation: float = 0.0
    worst: float = 0.0
    gain: float = 0.0


def suggest_keys_beside_hidden(unseen: NDArray[np.bool_], keys: KeyPoses) -> list[KeySuggestion]:
    """Suggest key frames just before or after the frames on which parts are hidden.

    Of these frames, the one on which the fewest parts are hidden is chosen.

    Parameters
    ----------
    unseen : ndarray of bool, shape (F, P)
        Frames on which no camera sees a part.
    keys : KeyPoses
        A part needs no further key pose near a frame on which its rotation is keyed.

    Returns
    -------
    list of KeySuggestion
        At most `MAX_HIDDEN_SUGGESTIONS`, those of the longest hidden parts first.
    """
    glimpse = np.ones((MIN_VISIBLE_FRAMES, 1), np.uint8)
    within = cv2.morphologyEx(
        unseen.astype(np.uint8), cv2.MORPH_CLOSE, glimpse, borderType=cv2.BORDER_CONSTANT, borderValue=0
    )
    hidden = unseen | (within > 0)
    found: list[KeySuggestion] = []
    for part, first, last in _longest_hidden(hidden, keys):
        for side in (
            range(first - 1, first - 1 - MAX_FRAME_DISTANCE, -1),
            range(last + 1, last + 1 + MAX_FRAME_DISTANCE),
        ):
            near = [f for f in side if 0 <= f < len(hidden) and not hidden[f, part]]
            near = _away_from(near, _keyed(keys, part))
            shared = next((i for i, other in enumerate(found) if other.frame in near), None)
            if shared is not None:
                parts = dict.fromkeys([*found[shared].parts, part])
                found[shared] = replace(found[shared], parts=tuple(parts))
            elif free := _away_from(near, [other.frame for other in found]):
                frame = min(free, key=lambda f: hidden[f].sum())
                found.append(KeySuggestion(frame, (part,), hidden=(first, last)))
    return found[:MAX_HIDDEN_SUGGESTIONS]


def suggest_keys_by_error(
    deviation: Array, keys: KeyPoses, parents: Sequence[int], unknown: Sequence[int] = ()
) -> list[KeySuggestion]:
    """Suggest the key frames that would lower the expected error most.

    Between two key poses the error of the motion is assumed to drift like a random walk (Brownian bridge). The frame
    where a key pose removes most of the expected error comes first; the next is found as if that one were keyed.

    Parameters
    ----------
    deviation : ndarray, shape (F, P)
        Expected error of every part, metres; see `core.tracking.expected_errors.uncertainty.JointErrors`.
    keys : KeyPoses
    parents : sequence of int
        Index of the parent of each part.
    unknown : sequence of int
        Parts that nothing shows, which are left out.

    Returns
    -------
    list of KeySuggestion
        At most `MAX_ERROR_SUGGESTIONS`, the most helpful first. Only parts whose tips are joints are named.
    """
    expected, joints = expected_errors(deviation, parents, unknown), np.array(joint_parts(parents, unknown))
    keyed = {int(f) for f in keys.full()}
    found: list[KeySuggestion] = []
    least = MIN_GAIN * float(expected.sum())
    while len(found) < MAX_ERROR_SUGGESTIONS:
        gains = _gains(expected, keyed)
        best = int(np.argmax(gains)) if len(gains) else 0
        if not len(gains) or gains[best] <= least:
            break
        row = deviation[best, joints]
        worst = [
            int(joints[p])
            for p in np.argsort(-row, kind="stable")[:MAX_NAMED_PARTS]
            if row[p] >= NAMED_ERROR_SHARE * row.max()
        ]
        gain, most = float(gains[best]) / len(expected), float(row.max())
        found.append(KeySuggestion(best, tuple(worst), deviation=float(row.mean()), worst=most, gain=gain))
        a, b = next((a, b) for a, b in _gaps(keyed, len(expected)) if a < best < b)
        frames = _between(a, b, len(expected))
        expected[frames] *= _kept(best, a, b, frames)
        keyed.add(best)
    return found


def _gains(expected: Array, keyed: set[int]) -> Array:
    """Return by how much a key pose on each frame would lower the sum of the expected errors (F,), shape (F,); 0 within
    `MIN_SPACING` frames of other key frames.
    """
    length = len(expected)
    gains = np.zeros(length)
    for a, b in _gaps(keyed, length):
        frames = _between(a, b, length)
        for frame in range(a + MIN_SPACING if a >= 0 else 0, b + 1 - MIN_SPACING if b < length else length):
            gains[frame] = expected[frames] @ (1 - _kept(frame, a, b, frames))
    return gains


def _gaps(keyed: set[int], length: int) -> list[tuple[int, int]]:
    """Return pairs of key frames between which there is none.

    Before the first and after the last, a walk (`_kept`) counts as known as many frames away as the shot is long.
    """
    return list(itertools.pairwise([-length, *sorted(keyed), 2 * length]))


def _between(a: int, b: int, length: int) -> Ints:
    """Return the frames of a shot that lie between two others."""
    return np.arange(max(a + 1, 0), min(b, length))


def _kept(frame: int, a: int, b: int, frames: Ints) -> Array:
    """Return how much of the expected error a key pose would leave on N frames between key frames a and b, relative to
    what is there, shape (N,): the standard deviation of a random walk that is also known on `frame`, relative to that
    of one that is known on a and b alone.
    """
    before = (frame - frames) * (b - a) / ((frame - a) * (b - frames))
    after = (frames - frame) * (b - a) / ((b - frame) * (frames - a))
    return np.asarray(np.sqrt(np.where(frames < frame, before, after)))


def _longest_hidden(hidden: NDArray[np.bool_], keys: KeyPoses) -> list[tuple[int, int, int]]:
    """Return part, first and last frame of every long interval on which a part is neither visible nor keyed."""
    spans = []
    for part in range(hidden.shape[1]):
        unknown = hidden[:, part].copy()
        unknown[_keyed(keys, part)] = False
        spans += [(part, a, b) for a, b in runs(unknown) if b + 1 - a >= LONG_GAP]
    return sorted(spans, key=lambda span: (span[1] - span[2], span[1]))


def _keyed(keys: KeyPoses, part: int) -> list[int]:
    return [int(f) for f in keys.frames[keys.fixed[:, 3 + 3 * part : 6 + 3 * part].all(axis=1)]]


def _away_from(frames: Sequence[int], others: Sequence[int]) -> list[int]:
    """Return the frames that are at least `MIN_SPACING` frames from all others."""
    return [f for f in frames if all(abs(f - other) >= MIN_SPACING for other in others)]
