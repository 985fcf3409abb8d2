"""Motion carried through key poses that it was found without, or before they changed: where tracking begins."""

from __future__ import annotations

import numpy as np

from ..body.motion import Motion
from ..numerics.arrays import Array
from .shot import KeyPoses


def carried(motion: Motion, keys: KeyPoses) -> Motion:
    """A motion bent so that it passes through key poses which are not, or no longer, on its way.

    How far each key pose is off the way of the frames beside it is spread over those up to the next key poses.

    Parameters
    ----------
    motion : Motion
        F >= 3 poses. On frames with a key pose they do not count: those may be the new ones already.
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
    """A motion bent so that it passes through key poses which were not known to it.

    How far its own pose on each key frame is off is spread over the frames up to the next key poses.

    Parameters
    ----------
    motion : Motion
        F poses.
    keys : KeyPoses
    """
    off = motion[keys.frames].difference(keys.poses) * keys.fixed
    return with_keys(motion.moved(_spread(off, keys, len(motion))), keys)


def with_keys(motion: Motion, keys: KeyPoses) -> Motion:
    """The motion with the key poses as they were set, to the last bit."""
    T, Q = motion.translations.copy(), motion.rotations.copy()
    turned = keys.fixed[:, 3:].reshape(len(keys.frames), -1, 3).all(axis=2)
    for k, frame in enumerate(keys.frames):
        T[frame] = np.where(keys.fixed[k, :3], keys.poses.translations[k], T[frame])
        Q[frame, turned[k]] = keys.poses.rotations[k, turned[k]]
    return Motion(T, Q)


def _spread(off: Array, keys: KeyPoses, length: int) -> Array:
    """Increments at key frames (K, D) as increments of all frames (F, D)."""
    return np.stack([np.interp(np.arange(length), keys.frames, own) for own in off.T], axis=1)


def _passed(motion: Motion, frame: int) -> Motion:
    """The pose on a frame by those beside it: between them, or at the ends as they go on."""
    if 0 < frame < len(motion) - 1:
        before, after, share = frame - 1, frame + 1, 0.5
    else:
        before, after, share = (1, 2, -1.0) if frame == 0 else (frame - 2, frame - 1, 2.0)
    return motion[[before]].moved(share * motion[[before]].difference(motion[[after]]))
