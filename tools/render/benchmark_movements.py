"""The movements of the benchmark's shots, from a slow bow to a kick. Needs no Blender."""

from __future__ import annotations

from .movement_phrases import Movement, Phrase

_AT_REST = {
    "drop.L": 80, "drop.R": 80, "elbow.L": 12, "elbow.R": 12, "swing.L": 4, "swing.R": 4,
    "flex.L": 2, "flex.R": 2, "knee.L": 4, "knee.R": 4,
}  # fmt: skip
"""Arms hanging, standing upright."""
_GUARD = {
    "drop.L": 68, "drop.R": 68, "swing.L": 40, "swing.R": 34, "elbow.L": 112, "elbow.R": 118,
    "turn.L": -20, "turn.R": -20, "bend": 10, "ahead.L": 0.18, "ahead.R": -0.12, "z": -0.04,
}  # fmt: skip
"""Fists before the face, one foot ahead."""


def _phrase(start: float, duration: float, profile: str, **goals: float) -> Phrase:
    """A phrase whose channels are written with an underscore for the dot."""
    return Phrase(start, duration, profile, {name.replace("_", "."): value for name, value in goals.items()})


BOW = Movement(
    _AT_REST | {"heading": -70},
    (
        _phrase(0.25, 0.8, "swing", tilt=38, bend=28, nod=14, swing_L=34, swing_R=34, x=-0.05, y=0.06),
        _phrase(1.35, 0.75, "settle", tilt=0, bend=0, nod=0, swing_L=4, swing_R=4, x=0.0, y=0.0),
    ),
    seed=1,
)
STRETCHING = Movement(
    _AT_REST | {"heading": -115},
    (
        _phrase(0.1, 0.7, "swing", drop_L=-62, swing_L=8, elbow_L=28, out_L=0.05),
        _phrase(0.5, 0.75, "swing", side=24, roll=5, y=-0.05, look=14, drop_R=86),
        _phrase(1.45, 0.6, "swing", side=-6, roll=0, y=0.0, drop_L=60, elbow_L=20, look=0),
        _phrase(1.6, 0.55, "swing", drop_R=-58, swing_R=10, elbow_R=30),
    ),
    seed=2,
)
FRONT_KICK = Movement(
    _GUARD | {"heading": -40, "flex.R": -10, "knee.R": 34},
    (
        _phrase(0.10, 0.22, "swing", flex_R=78, knee_R=104, tilt=-4, bend=4, z=-0.05),
        _phrase(0.30, 0.18, "strike", flex_R=88, knee_R=8, ankle_R=-22, tilt=-14, swing_L=20, swing_R=-12),
        _phrase(0.48, 0.2, "swing", knee_R=92, ankle_R=0, flex_R=70),
        _phrase(0.62, 0.34, "settle", flex_R=2, knee_R=30, tilt=0, swing_L=40, swing_R=34, bend=10),
    ),
    free="R",
    seed=3,
)
ROUND_KICK = Movement(
    _GUARD | {"heading": -130, "flex.L": -6, "knee.L": 34},
    (
        _phrase(0.1, 0.35, "swing", heading=-215, toes_R=-70, roll=-16, side=14, drop_R=40, swing_R=0),
        _phrase(0.15, 0.17, "swing", flex_L=58, spread_L=38, knee_L=112),
        _phrase(0.33, 0.16, "strike", knee_L=14, flex_L=74, spread_L=52, twist=24),
        _phrase(0.50, 0.2, "swing", knee_L=88, flex_L=48, spread_L=24, twist=0),
        _phrase(0.68, 0.36, "settle", flex_L=2, spread_L=4, knee_L=30, heading=-190, roll=0, side=0, drop_R=68),
    ),
    free="L",
    seed=4,
)
PUNCHES = Movement(
    _GUARD | {"heading": -75},
    (
        _phrase(0.2, 0.17, "strike", swing_L=88, elbow_L=8, drop_L=82, twist=-18, turn_L=30),
        _phrase(0.39, 0.3, "settle", swing_L=40, elbow_L=112, drop_L=68, twist=0, turn_L=-20),
        _phrase(0.6, 0.18, "strike", swing_R=92, elbow_R=6, drop_R=80, twist=30, heading=-60, turn_R=30),
        _phrase(0.8, 0.3, "settle", swing_R=34, elbow_R=118, drop_R=68, twist=0, heading=-75, turn_R=-20),
        _phrase(1.05, 0.18, "strike", swing_L=70, drop_L=30, elbow_L=78, twist=-34, z=-0.10),
        _phrase(1.24, 0.34, "settle", swing_L=40, drop_L=68, elbow_L=112, twist=0, z=-0.04),
    ),
    seed=5,
)
THROW_A_BALL = Movement(
    _AT_REST | {"heading": -100, "ahead.L": 0.22, "ahead.R": -0.18, "z": -0.02},
    (
        _phrase(0.1, 0.5, "swing", drop_R=-14, swing_R=-22, elbow_R=98, twist=-34, x=-0.03, swing_L=66, elbow_L=24),
        _phrase(0.64, 0.22, "strike", twist=26, swing_R=62, drop_R=2, elbow_R=16, bend=18, tilt=8, heading=-84),
        _phrase(0.87, 0.36, "settle", swing_R=68, drop_R=70, elbow_R=18, bend=26, swing_L=-22, elbow_L=40),
        _phrase(1.2, 0.4, "swing", bend=4, tilt=0, twist=0, swing_R=6, drop_R=80, swing_L=4, elbow_L=12),
    ),
    seed=6,
)
_LEAP_START, _LEAP_TIME = 0.24, 0.40
LEAP = Movement(
    _AT_REST | {"heading": -60},
    (
        _phrase(0.0, 0.14, "swing", z=-0.20, tilt=22, bend=12, swing_L=-40, swing_R=-40),
        _phrase(0.13, 0.12, "strike", z=0.0, tilt=0, bend=0),
        _phrase(0.06, 0.42, "swing", swing_L=95, swing_R=105),
        _phrase(_LEAP_START, _LEAP_TIME, "flight", z=0.235, lift_L=0.22, lift_R=0.2),
        _phrase(_LEAP_START, _LEAP_TIME, "even", x=0.25, ahead_L=0.28, ahead_R=0.24),
        _phrase(_LEAP_START + _LEAP_TIME, 0.09, "snap", z=-0.17, tilt=16, bend=14),
        _phrase(_LEAP_START + 0.3, 0.26, "settle", swing_L=30, swing_R=34),
    ),
    seed=7,
)
HOP_TURN = Movement(
    _AT_REST | {"heading": -150, "drop.L": 40, "drop.R": 44, "elbow.L": 60, "elbow.R": 50},
    (
        _phrase(0.0, 0.16, "swing", z=-0.16, bend=14, twist=-20),
        _phrase(0.15, 0.12, "strike", z=0.0, bend=0, twist=10),
        _phrase(0.26, 0.36, "flight", z=0.19, lift_L=0.17, lift_R=0.17),
        _phrase(0.26, 0.36, "even", heading=-65, toes_L=85, toes_R=85, drop_L=8, drop_R=70),
        _phrase(0.62, 0.1, "snap", z=-0.14, bend=20),
        _phrase(0.58, 0.25, "settle", drop_L=52, drop_R=52),
    ),
    seed=8,
)


def _steps(side: str, first: float, pace: float, *places: float) -> tuple[Phrase, ...]:
    """Steps of one foot to places ahead: it swings for `pace` seconds, then stands as long."""
    starts = [first + 2 * pace * k for k in range(len(places))]
    return (
        *(_phrase(s, pace, "swing", **{f"ahead_{side}": place}) for s, place in zip(starts, places, strict=True)),
        *(_phrase(s, pace, "there and back", **{f"lift_{side}": 0.09}) for s in starts),
    )


STROLL = Movement(
    _AT_REST | {"heading": 0, "x": -0.75, "z": -0.03},
    (
        *_steps("L", 0.05, 0.42, 0.5, 1.3),
        *_steps("R", 0.47, 0.42, 0.9, 1.7),
        _phrase(0.05, 1.65, "even", x=0.85),
        _phrase(0.05, 0.42, "swing", swing_L=-20, swing_R=26, twist=7),
        _phrase(0.47, 0.42, "swing", swing_L=26, swing_R=-20, twist=-7),
        _phrase(0.89, 0.42, "swing", swing_L=-20, swing_R=26, twist=7),
        _phrase(1.31, 0.42, "swing", swing_L=20, swing_R=-12, twist=-5),
    ),
    seed=9,
)
SIT_DOWN = Movement(
    _AT_REST | {"heading": -85, "out.L": 0.03, "out.R": 0.03},
    (
        _phrase(0.15, 0.75, "swing", z=-0.43, y=0.30, tilt=10, bend=24, swing_L=40, swing_R=44),
        _phrase(0.9, 0.12, "settle", z=-0.45, tilt=-2),
        _phrase(0.95, 0.4, "swing", bend=6, swing_L=30, swing_R=32, elbow_L=66, elbow_R=60),
        _phrase(1.3, 0.3, "swing", look=-34, nod=-8, swing_R=70, elbow_R=30, drop_R=70),
    ),
    seed=10,
)
DANCE = Movement(
    _AT_REST | {"heading": -90, "drop.L": 50, "drop.R": 50, "elbow.L": 50, "elbow.R": 50},
    (
        _phrase(0.1, 0.4, "snap", drop_L=-30, swing_L=20, drop_R=30, twist=20, y=-0.08, out_L=0.12),
        _phrase(0.1, 0.4, "there and back", lift_L=0.08),
        _phrase(0.6, 0.35, "snap", drop_L=60, swing_L=50, elbow_L=90, drop_R=-44, elbow_R=20, twist=-26, side=-10),
        _phrase(0.7, 0.6, "swing", heading=0, toes_L=80, toes_R=70, x=0.05),
        _phrase(0.75, 0.25, "there and back", lift_R=0.07),
        _phrase(1.0, 0.25, "there and back", lift_L=0.07),
        _phrase(1.2, 0.3, "strike", drop_L=10, elbow_L=10, drop_R=10, elbow_R=10, z=-0.16, side=0, twist=0),
        _phrase(1.6, 0.4, "swing", drop_L=-60, drop_R=-60, z=-0.02, elbow_L=30, elbow_R=30, bend=-6),
    ),
    seed=11,
    tremor=1.5,
)
LUNGES = Movement(
    _AT_REST | {"heading": -60, "drop.L": 20, "drop.R": 20, "elbow.L": 20, "elbow.R": 20},
    (
        _phrase(0.15, 0.3, "strike", ahead_L=0.55, x=0.16, y=-0.25, z=-0.24, bend=10),
        _phrase(0.15, 0.3, "there and back", lift_L=0.12),
        _phrase(0.45, 0.3, "swing", twist=34, swing_L=40, drop_R=60, elbow_R=70),
        _phrase(0.85, 0.4, "snap", ahead_L=0.05, x=0.0, y=0.0, z=-0.02, twist=0, bend=0, swing_L=0, drop_R=20),
        _phrase(0.85, 0.35, "there and back", lift_L=0.1),
        _phrase(1.35, 0.3, "strike", out_R=0.5, x=-0.2, y=-0.12, z=-0.26, side=-16, drop_L=-50, elbow_R=60),
        _phrase(1.35, 0.3, "there and back", lift_R=0.1),
    ),
    seed=12,
    tremor=1.5,
)
WAVING = Movement(
    _AT_REST | {"heading": -105},
    (
        _phrase(0.1, 0.45, "swing", drop_R=-20, elbow_R=70, swing_R=18, look=-12),
        _phrase(0.55, 0.22, "swing", elbow_R=35),
        _phrase(0.77, 0.22, "swing", elbow_R=80),
        _phrase(0.99, 0.22, "swing", elbow_R=35, look=8),
        _phrase(1.25, 0.5, "settle", drop_R=78, elbow_R=14, swing_R=4, look=0),
        _phrase(0.7, 0.6, "swing", drop_L=66, swing_L=30, elbow_L=80, side=5),
    ),
    seed=13,
)
PICK_UP = Movement(
    _AT_REST | {"heading": -55, "ahead.L": 0.12, "ahead.R": -0.1},
    (
        _phrase(0.1, 0.65, "swing", z=-0.34, tilt=30, bend=34, swing_R=60, swing_L=30, elbow_L=50, y=-0.1, nod=10),
        _phrase(0.8, 0.1, "snap", elbow_R=22, twist=8),
        _phrase(1.0, 0.6, "swing", z=-0.02, tilt=0, bend=-2, swing_R=52, elbow_R=86, swing_L=8, y=0.0, nod=-4, twist=0),
    ),
    seed=14,
)
_LIMP_LEGS = {"knee.L": 8, "knee.R": 8, "flex.L": 4, "flex.R": 4}
"""Both legs off the floor or about to leave it."""
JUMP_SPIN = Movement(
    _AT_REST | _LIMP_LEGS | {"heading": -120, "drop.L": 30, "drop.R": 30, "elbow.L": 15, "elbow.R": 15},
    (
        _phrase(0.05, 0.2, "swing", z=-0.16, twist=-35, flex_L=40, flex_R=40, knee_L=70, knee_R=70, bend=15),
        _phrase(0.05, 0.2, "swing", ankle_L=30, ankle_R=30),
        _phrase(0.24, 0.14, "strike", z=0.03, twist=10, flex_L=5, flex_R=5, knee_L=8, knee_R=8, bend=0),
        _phrase(0.24, 0.14, "strike", ankle_L=0, ankle_R=0),
        _phrase(0.36, 0.52, "flight", z=0.39),
        _phrase(0.26, 0.7, "swing", heading=330, drop_L=70, drop_R=70, elbow_L=100, elbow_R=105),
        _phrase(0.26, 0.7, "swing", swing_L=40, swing_R=40),
        _phrase(0.40, 0.3, "there and back", flex_L=50, knee_L=80),
        _phrase(0.88, 0.12, "snap", z=-0.14, flex_L=45, flex_R=38, knee_L=75, knee_R=65, bend=16),
        _phrase(0.88, 0.12, "snap", drop_L=10, drop_R=10, elbow_L=20, elbow_R=20, ankle_L=30, ankle_R=27),
        _phrase(1.0, 0.3, "settle", z=0.0, flex_L=5, flex_R=5, knee_L=8, knee_R=8, bend=2, ankle_L=0, ankle_R=0),
    ),
    free="LR",
    seed=22,
)
CARTWHEEL = Movement(
    _AT_REST | _LIMP_LEGS | {"heading": -90, "x": -0.85, "drop.L": 55, "drop.R": 55, "spread.L": 8, "spread.R": 8},
    (
        _phrase(0.05, 0.25, "swing", drop_L=-75, drop_R=-70, spread_L=30, z=-0.04),
        _phrase(0.25, 0.95, "swing", roll=-360, x=0.9),
        _phrase(0.3, 0.35, "swing", spread_L=58, spread_R=54, knee_R=3, knee_L=3, z=0.33),
        _phrase(0.3, 0.35, "swing", drop_R=-80, drop_L=-80, elbow_L=24, elbow_R=20),
        _phrase(0.8, 0.35, "swing", spread_L=12, spread_R=14, z=-0.02, knee_L=14, knee_R=20),
        _phrase(1.05, 0.3, "settle", drop_L=40, drop_R=45, knee_L=5, knee_R=5, z=0.0),
    ),
    free="LR",
    seed=21,
)
