"""Bending a motion to pass through key poses that were set or changed after it was found, and turning it once more."""

from __future__ import annotations

import numpy as np

from ..body.motion import Motion
from ..numerics import rotations
from ..numerics.arrays import Array, Bools
from .shot import KeyPoses


def carried(motion: Motion, keys: KeyPoses) -> Motion:
    """Return a motion bent to pass through key poses, each compared with the frames next to it.

    The offset of each key pose from the motion of the frames next to it is spread over the frames up to the next key
    poses.

    Parameters
    ----------
    motion : Motion
        F >= 3 poses. Those on key frames are ignored, as they may be the new key poses already.
    keys : KeyPoses
    """
    if not len(keys.frames):
        return motion
    off = np.concatenate([_passed(motion, int(f)).difference(keys.poses[[k]]) for k, f in enumerate(keys.frames)])
    off *= keys.fixed
    step = _spread(off, keys, len(motion))
    step[keys.frames] = 0
    passed = motion.moved(step)
    for k, frame in enumerate(keys.frames.tolist()):
        passed = passed.replaced(frame, _passed(motion, frame).moved(off[[k]]))
    return with_keys(passed, keys)


def bent(motion: Motion, keys: KeyPoses) -> Motion:
    """Return a motion bent to pass through key poses, each compared with the motion's own pose on its frame.

    The offset on each key frame is spread over the frames up to the next key poses.

    Parameters
    ----------
    motion : Motion
        F poses.
    keys : KeyPoses
    """
    off = motion[keys.frames].difference(keys.poses) * keys.fixed
    return with_keys(motion.moved(_spread(off, keys, len(motion))), keys)


def with_keys(motion: Motion, keys: KeyPoses) -> Motion:
    """Return the motion with exactly the key poses on their frames."""
    T, Q = motion.translations.copy(), motion.rotations.copy()
    turned = keys.fixed_axes.all(axis=2)
    for k, frame in enumerate(keys.frames):
        T[frame] = np.where(keys.fixed[k, :3], keys.poses.translations[k], T[frame])
        Q[frame, turned[k]] = keys.poses.rotations[k, turned[k]]
    return Motion(T, Q)


def _spread(off: Array, keys: KeyPoses, length: int) -> Array:
    """Interpolate increments at key frames (K, D) to all frames (F, D)."""
    return np.stack([np.interp(np.arange(length), keys.frames, own) for own in off.T], axis=1)


def _passed(motion: Motion, frame: int) -> Motion:
    """Return the pose on a frame predicted from those next to it: interpolated, or extrapolated at the ends."""
    if 0 < frame < len(motion) - 1:
        before, after, share = frame - 1, frame + 1, 0.5
    else:
        before, after, share = (1, 2, -1.0) if frame == 0 else (frame - 2, frame - 1, 2.0)
    return motion[[before]].moved(share * motion[[before]].difference(motion[[after]]))


def turned(motion: Motion, fixed: Bools, axis: Array) -> Motion:
    """Add a whole turn of the root to a motion, which begins and ends as before.

    Parameters
    ----------
    motion : Motion
        F poses.
    fixed : ndarray of bool, shape (F, D)
        Degrees of freedom that keep their values.
    axis : ndarray, shape (3,)
        Unit vector, in the root's axes.
    """
    along = np.linspace(0, 1, len(motion))
    # Between a constant speed, as in the midst of a pirouette, and one that begins and ends at rest.
    share = 0.5 * (along + along**2 * (3 - 2 * along))
    Q = motion.rotations.copy()
    Q[:, 0] = Q[:, 0] @ rotations.exp(2 * np.pi * share[:, None] * axis)
    guess = Motion(motion.translations, Q)
    return guess.moved(np.where(fixed, guess.difference(motion), 0.0))
