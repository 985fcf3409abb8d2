"""The motions of the rendered figure by name.

A motion is a function of the body, the number of frames and the frame rate.
"""

from __future__ import annotations

from collections.abc import Callable

from kfmocap.core.body import Body
from kfmocap.core.body.motion import Motion

from .gait import crossing, walk
from .gestures import throw, whirl

MOTIONS: dict[str, Callable[[Body, int, float], Motion]] = {
    "walk": walk,
    "crossing": crossing,
    "throw": throw,
    "whirl": whirl,
}
