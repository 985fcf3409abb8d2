"""Whether footage begins with a dissolve, in which an editor has blended another scene into this one.

All that stands still then changes along one and the same difference of two pictures, frame after frame in one
direction. What moves, and a camera that moves, changes pictures in another way on every frame; light that changes
leaves them alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

DISSOLVE_SIZE = 64, 36
"""Width and height to which pictures are reduced, pixels."""
_MIN_SHARE = 0.8
"""Share of the changes (their sum of squares) that one difference must explain: 0.87 and 0.95 in two dissolves, at most
0.83 where nothing dissolves."""
_MIN_CHANGE, _MAX_ALIKE = 0.3, 0.95
"""Least change from the first picture to the last, in terms of the last one's contrast, and their largest correlation;
0.52, and 0.86 to 0.90, in two dissolves, 0.20 and 0.98 where one difference explains the changes otherwise."""
_MIN_STEP, _MIN_STEPS = 0.2, 3
"""Least step on the way, in terms of the longest one, and fewest of them: a dissolve may end on these pictures, and in
a cut all changes at once."""


def dissolves(pictures: Sequence[NDArray[np.uint8]]) -> bool:
    """Whether consecutive pictures (h, w, 3) of one view dissolve into one another."""
    if len(pictures) < 4:
        return False
    small = [
        cv2.resize(own, DISSOLVE_SIZE, interpolation=cv2.INTER_AREA).astype(float).mean(axis=-1) for own in pictures
    ]
    changes = np.array([(after - before).ravel() for before, after in pairwise(small)])
    changes -= changes.mean(axis=1, keepdims=True)
    first, last = small[0].ravel(), small[-1].ravel()
    if np.sqrt(np.mean(changes.sum(axis=0) ** 2)) < _MIN_CHANGE * max(float(last.std()), 1.0):
        return False
    steps, sizes, _ = np.linalg.svd(changes, full_matrices=False)
    ways = steps[:, 0] * np.sign(steps[:, 0].sum()) / np.abs(steps[:, 0]).max()
    one_way = ways.min() > -_MIN_STEP and np.count_nonzero(ways > _MIN_STEP) >= _MIN_STEPS
    alike = first.std() < 1.0 or np.corrcoef(first, last)[0, 1] > _MAX_ALIKE
    return bool(one_way and not alike and sizes[0] ** 2 > _MIN_SHARE * np.sum(sizes**2))
