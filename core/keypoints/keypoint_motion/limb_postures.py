"""How people hold their arms and legs: how likely the directions of a limb's bones are, relative to the trunk.

The density is a mixture of common postures of captured people, who walk, run, jump, dance, fight, fall, crawl, roll and
get up, and of any posture at all. It only has to tell which of a few readings of a picture people would show: that
elbows and knees are ahead of the limb that bends, and that hands are mostly ahead of the trunk.
"""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from ...numerics.arrays import Array

SPREAD = 0.35
"""Standard deviation of the direction of each bone from that of a common posture, radians."""
UNCOMMON_SHARE = 0.05
"""Probability of a posture that is like none of the common ones: all directions are equally likely then."""
# Rows of a share and of unit vectors along the upper and the lower bone: x to the limb's own side, y from the hips to
# the shoulders, z ahead. Made by tools/captured_postures.py from the captured clips of DeepMimic (github.com/xbpeng/
# DeepMimic, MIT licence).
_ARMS = (
    (0.11, 0.21, -0.96, 0.17, -0.01, -0.84, 0.54),
    (0.08, 0.38, -0.77, 0.51, -0.05, -0.52, 0.85),
    (0.08, 0.21, -0.95, -0.24, 0.13, -0.99, 0.08),
    (0.06, 0.52, -0.85, -0.01, 0.39, -0.82, 0.42),
    (0.05, 0.52, -0.49, -0.7, 0.28, -0.94, 0.16),
    (0.05, 0.53, -0.79, -0.31, -0.01, -0.47, 0.88),
    (0.05, 0.42, -0.8, -0.41, -0.55, -0.56, 0.61),
    (0.04, 0.43, -0.16, 0.89, -0.24, 0.05, 0.97),
    (0.04, 0.66, 0.21, 0.73, -0.55, 0.75, 0.36),
    (0.04, 0.35, -0.84, -0.41, 0.38, -0.92, -0.1),
    (0.04, 0.78, -0.55, -0.3, 0.85, -0.52, 0.04),
    (0.04, 1.0, 0.04, 0.01, 0.9, 0.25, 0.36),
    (0.03, 0.39, 0.63, 0.67, 0.02, 0.73, 0.69),
    (0.03, 0.5, -0.8, 0.34, -0.46, -0.01, 0.89),
    (0.03, 0.15, 0.18, 0.97, -0.87, 0.42, 0.26),
    (0.03, 0.78, -0.46, 0.41, 0.48, -0.13, 0.87),
    (0.03, 0.64, -0.76, 0.03, -0.16, 0.57, 0.8),
    (0.03, 0.75, 0.66, 0.07, 0.62, 0.76, 0.19),
    (0.03, 0.47, -0.54, 0.7, -0.6, 0.6, 0.53),
    (0.03, 0.3, -0.27, 0.92, -0.97, 0.21, 0.14),
    (0.03, 0.99, 0.11, -0.12, 0.16, 0.66, 0.73),
    (0.02, 0.12, -0.46, 0.88, -0.63, -0.31, 0.72),
    (0.02, 0.26, -0.47, -0.84, 0.37, -0.71, -0.6),
    (0.01, -0.07, -0.8, 0.6, -0.94, 0.35, -0.02),
)
_LEGS = (
    (0.09, -0.04, -0.99, -0.15, -0.11, -0.87, -0.47),
    (0.08, -0.02, -0.98, 0.18, -0.03, -1.0, -0.06),
    (0.08, 0.15, -0.87, 0.48, 0.1, -0.98, 0.15),
    (0.07, 0.14, -0.84, 0.52, -0.15, -0.87, -0.47),
    (0.06, 0.28, -0.95, 0.1, 0.12, -0.87, -0.49),
    (0.06, 0.04, -0.67, 0.74, -0.16, -0.99, 0.06),
    (0.05, 0.17, -0.95, 0.25, -0.15, -0.49, -0.86),
    (0.04, 0.1, -0.31, 0.95, -0.05, -0.85, 0.52),
    (0.04, 0.05, -0.43, 0.9, -0.01, -0.86, -0.51),
    (0.04, 0.07, -0.29, 0.95, 0.08, -0.99, 0.07),
    (0.04, -0.29, -0.85, 0.44, -0.59, -0.77, -0.26),
    (0.04, 0.34, -0.59, 0.73, -0.02, -0.98, -0.17),
    (0.03, 0.15, 0.61, 0.78, -0.02, -0.61, 0.79),
    (0.03, 0.56, -0.36, 0.75, 0.38, -0.9, 0.2),
    (0.03, 0.43, -0.88, 0.19, 0.38, -0.92, -0.12),
    (0.03, 0.08, 0.59, 0.81, -0.09, -0.99, 0.11),
    (0.03, 0.11, -0.95, -0.3, 0.0, -0.39, -0.92),
    (0.03, 0.56, 0.26, 0.78, 0.7, -0.27, 0.66),
    (0.03, 0.28, -0.02, 0.96, -0.11, -0.79, -0.6),
    (0.02, 0.29, 0.21, 0.93, -0.17, -0.98, -0.13),
    (0.02, 0.28, 0.08, 0.96, 0.28, -0.68, 0.68),
    (0.02, 0.66, -0.58, 0.47, 0.05, -0.9, -0.44),
    (0.02, 0.49, 0.27, 0.83, -0.6, -0.7, 0.39),
    (0.01, 0.39, -0.29, 0.87, -0.56, -0.45, -0.69),
)
_TABLES = {"upper_arm": np.array(_ARMS), "thigh": np.array(_LEGS)}


def posture_rarity(upper_part: str, upper: Array, lower: Array) -> Array:
    """Return how unlikely postures of a limb are, shape (...): twice the negative logarithm of their density, as a
    multiple of the highest that a single common posture would have.

    Parameters
    ----------
    upper_part : str
        The upper part of the limb, without its side: "upper_arm" or "thigh".
    upper, lower : ndarray, shape (..., 3)
        Along both bones, in any unit, relative to the trunk: x to the limb's own side, y from the hips to the
        shoulders, z ahead.
    """
    table = _TABLES[upper_part]
    bones = np.concatenate(
        [each / np.maximum(np.linalg.norm(each, axis=-1, keepdims=True), 1e-9) for each in (upper, lower)], axis=-1
    )
    far = np.sum((bones[..., None, :] - table[:, 1:]) ** 2, axis=-1) / SPREAD**2
    common = logsumexp(-0.5 * far, axis=-1, b=(1 - UNCOMMON_SHARE) * table[:, 0] / table[:, 0].sum())
    anywhere = UNCOMMON_SHARE * (0.5 * SPREAD**2) ** 2  # two bones that are spread evenly over spheres
    return np.asarray(-2 * np.logaddexp(common, np.log(anywhere)))
