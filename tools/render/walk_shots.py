"""Rendered walks that judge how planted feet are found: who walks how, filmed how. Needs no Blender."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from .benchmark_shots import PLANS, ShotPlan, ring
from .people import Person
from .walking import Walk
from .walking_feet import Footfalls

_LOOKS = ("footwork", "walk_shots", "walking", "walking_feet")  # besides those of all shots
_WAIST = (0.0, 0.0, 0.85)


@dataclass(frozen=True)
class WalkPlan(ShotPlan):
    """A shot of somebody who walks; its `movement` is a `Walk`."""

    movement: Walk
    moments: int = 2

    def digest(self) -> str:
        """Hash of everything that the shot's files depend on."""
        sources = [Path(__file__).with_name(f"{name}.py").read_bytes() for name in _LOOKS]
        return hashlib.sha256(b"".join([super().digest().encode(), *sources])).hexdigest()[:16]


def _person(height: float, clothes: str, build: str, girth: float = 1.0, looseness: float = 0.0) -> Person:
    """A person with the clothes and the build of those of two shots of the benchmark."""
    return Person(height, PLANS[clothes].person.wardrobe, PLANS[build].person.proportions, girth, looseness)


WALKS = (
    WalkPlan("march", "deciding", _person(1.75, "round_kick", "stretching"),
             Walk(Footfalls(0.95, 1.55, 0.60, -18, 28, 0.7, flat=0.16, heel_off=0.62, lift=0.10, start=0.1, seed=1,
                            heading=-20), arms=34, elbow=15),
             25.0, (0, 25, 49), ring(4, 4.5, 470, -70, 85, at=_WAIST)),
    WalkPlan("backwards", "reporting", _person(1.68, "bow", "round_kick"),
             Walk(Footfalls(1.05, -0.9, 0.62, 18, -12, 0.8, flat=0.3, heel_off=0.75, start=0.3, seed=2, heading=10),
                  arms=14),
             25.0, (0, 26, 51), ring(3, 4.3, 490, -120, 60, at=_WAIST)),
    WalkPlan("hurried", "deciding", _person(1.63, "ball_throw", "bow"),
             Walk(Footfalls(0.82, 1.9, 0.57, -22, 38, 0.85, flat=0.12, heel_off=0.5, lift=0.05, middle=0.6, start=0.2,
                            seed=3, heading=30), arms=30, elbow=60, lean=6),
             50.0, (0, 30, 60), ring(2, 4.4, 480, -100, 80, at=_WAIST), exposure=0.5),
    WalkPlan("carrying", "reporting", _person(1.8, "front_kick", "front_kick"),
             Walk(Footfalls(1.0, 1.35, 0.62, -16, 32, 0.75, heel_off=0.58, lift=0.05, middle=0.85, start=0.45, seed=4,
                            heading=-150), carries=True, lean=0),
             30.0, (0, 26, 52), ring(4, 4.5, 470, -30, 80, at=_WAIST)),
    WalkPlan("run", "deciding", _person(1.72, "front_kick", "round_kick", 0.97),
             Walk(Footfalls(0.70, 3.0, 0.36, -10, 48, 0.85, flat=0.22, heel_off=0.5, lift=0.13, middle=0.45, start=0.15,
                            seed=5, heading=-15), arms=42, elbow=85, lean=9, crouch=0.03),
             60.0, (0, 27, 54), ring(3, 4.6, 450, -125, 60, at=_WAIST), exposure=0.5),
    WalkPlan("chase", "reporting", _person(1.66, "punches", "bow"),
             Walk(Footfalls(0.68, 3.2, 0.37, -8, 46, 0.9, flat=0.25, heel_off=0.5, lift=0.14, middle=0.45, start=0.33,
                            seed=6, heading=160), arms=44, elbow=90, lean=11, crouch=0.04),
             60.0, (0, 27, 54), ring(2, 4.6, 450, -110, 80, at=_WAIST), exposure=0.5),
    WalkPlan("limp", "deciding", _person(1.7, "stretching", "front_kick", 1.05),
             Walk(Footfalls(1.2, 0.75, 0.66, -8, 22, 0.8, lift=0.04, limp=0.18, middle=0.9, start=0.2, seed=7,
                            heading=-75), arms=12, lean=6),
             30.0, (0, 27, 54), ring(3, 4.2, 500, -140, 55, at=_WAIST)),
    WalkPlan("curve", "reporting", _person(1.85, "stretching", "stretching", 1.08, 0.02),
             Walk(Footfalls(1.1, 1.05, 0.63, -14, 28, 0.8, flat=0.14, lift=0.05, turning=55, middle=0.9, start=0.6,
                            seed=8, heading=-60), arms=18),
             30.0, (0, 27, 54), ring(2, 4.3, 480, -130, 80, at=_WAIST), sensor=PLANS["leap"].sensor),
    WalkPlan("stop_and_go", "deciding", _person(1.78, "bow", "bow"),
             Walk(Footfalls(1.1, 1.15, 0.63, -14, 28, 0.75, flat=0.14, lift=0.05, pause=(0.80, 0.5), middle=0.9,
                            start=0.42, seed=9, heading=20), arms=20),
             24.0, (0, 26, 52), ring(3, 4.4, 480, -80, 65, at=_WAIST)),
    WalkPlan("turning", "reporting", _person(1.73, "round_kick", "front_kick"),
             Walk(Footfalls(1.0, 0.02, 0.62, 3, 8, 0.9, heel_off=0.8, turning=75, start=0.2, seed=10, heading=-90),
                  arms=6),
             24.0, (0, 25, 50), ring(3, 4.0, 530, -100, 60, at=_WAIST)),
    WalkPlan("sneak", "deciding", _person(1.64, "punches", "round_kick"),
             Walk(Footfalls(1.5, 0.55, 0.68, 14, 26, 0.75, flat=0.25, heel_off=0.65, lift=0.09, middle=0.9, start=0.2,
                            seed=11, heading=-40), crouch=0.12, arms=10, elbow=60, lean=14),
             30.0, (0, 27, 54), ring(2, 4.1, 500, -130, 80, at=_WAIST)),
    WalkPlan("jog", "reporting", _person(1.76, "ball_throw", "stretching"),
             Walk(Footfalls(0.74, 2.3, 0.42, -12, 42, 0.8, flat=0.2, heel_off=0.52, lift=0.10, middle=0.55, start=0.05,
                            seed=12, heading=200), arms=34, elbow=80, lean=7, crouch=0.03),
             50.0, (0, 27, 54), ring(3, 4.5, 460, -150, 65, at=_WAIST), exposure=0.5),
)  # fmt: skip
"""In pairs of like difficulty: of each the first decides and the second reports."""
WALK_PLANS = {plan.name: plan for plan in WALKS}
