"""What is filmed for a calibration: an L-frame or a standing performer, and a wand."""

from __future__ import annotations

LFRAME_BALLS = 4
"""Balls of an L-frame: corner, middle and end of the long arm, end of the short arm."""
LFRAME_ARMS = ((0, 1), (1, 2), (0, 3))
"""Pairs of these that a rod connects."""
WAND_BALLS = 2
"""Balls of a wand, one at each end."""
PERFORMER_POINTS = 3
"""Points of a standing performer in place of an L-frame: left foot, right foot, top of the head."""
USUAL_WAND_LENGTH = 0.5
"""Length assumed for a wand of unknown length until the scale is known, metres."""
