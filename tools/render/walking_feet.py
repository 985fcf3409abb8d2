"""Feet that walk: they strike the floor, roll over heel and toes, and swing to where they strike next. Needs no
Blender.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from kfmocap.core.body import Body
from kfmocap.core.numerics.arrays import Array

from .footwork import sole_turn

PLACE_SIGMA = 0.012
"""Standard deviation of the places of steps along both axes, metres."""
TOES_OUT = 0.12
"""Radians."""
DESCENT = 0.25
"""Speed at which a foot comes down, metres per second."""
PAUSE_EDGE = 0.18
"""Time in which somebody stops, and sets off again, seconds."""


@dataclass(frozen=True)
class Footfalls:
    """The steps of a walk. Phase 0 of the stride is where the right foot strikes.

    Attributes
    ----------
    stride_time : float
        Seconds from one strike of a foot to the next.
    speed : float
        Metres per second along the heading; negative for walking backwards.
    duty : float
        Share of the stride on which a foot touches the floor.
    strike, leave : float
        How far toes point down as a foot strikes, and as it leaves, degrees; negative if the heel is lower.
    pivot : float
        Where a foot rolls with its toes down, as a share of the way from heel to toes.
    flat, heel_off : float
        Shares of the contact at which the foot is flat, and at which it begins to leave.
    lift : float
        Additional height of a swinging foot, metres.
    turning, heading : float
        Degrees per second, and degrees from +X at `middle`.
    limp : float
        Share by which the right foot's contact is shorter.
    pause : tuple of float
        When everything stops, and for how long, seconds; empty for no pause.
    start : float
        Time in the walk at second 0, seconds.
    middle : float
        Second at which the walk passes the origin.
    landing : float
        Share of the mean speed of a swing with which a foot strikes.
    seed : int
        Of the places of steps.
    """

    stride_time: float
    speed: float
    duty: float
    strike: float
    leave: float
    pivot: float
    flat: float = 0.15
    heel_off: float = 0.6
    lift: float = 0.06
    turning: float = 0.0
    heading: float = 0.0
    half_width: float = 0.09
    limp: float = 0.0
    pause: tuple[float, ...] = ()
    start: float = 0.0
    middle: float = 1.0
    landing: float = 0.25
    seed: int = 0

    def own_time(self, seconds: Array | float) -> Array:
        """Time in the walk, which stands still in a pause, seconds."""
        t = np.asarray(seconds, float)
        if self.pause:
            begin, length = self.pause
            known = np.linspace(-2, 8, 10001)
            stopping, going = (begin - known) / PAUSE_EDGE, (known - begin - length) / PAUSE_EDGE
            rate = eased(np.clip(np.where(known < begin + length / 2, stopping, going) + 0.5, 0, 1))
            passed = np.concatenate([[0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(known))])
            t = np.interp(t, known, passed - np.interp(0, known, passed))
        return np.asarray(t + self.start)

    def phase(self, side: str, time: Array) -> Array:
        """Strides of a foot since the right one's first strike, at times in the walk."""
        return np.asarray(time / self.stride_time + (0.5 if side == "L" else 0.0))

    def way(self, time: Array) -> tuple[Array, Array]:
        """Places on the floor (F, 2) and headings (F,), radians, at times in the walk."""
        since = time - float(self.own_time(self.middle))
        rate, first = np.radians(self.turning), np.radians(self.heading)
        heading = first + rate * since
        if abs(rate) < 1e-9 or abs(self.speed) < 1e-9:
            ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
            return self.speed * since[..., None] * ahead, heading
        round_about = [np.sin(heading) - np.sin(first), np.cos(first) - np.cos(heading)]
        return self.speed / rate * np.stack(round_about, axis=-1), heading

    def foot(self, body: Body, side: str, time: Array) -> tuple[Array, Array, Array]:
        """Return the ankle (F, 3), how far the toes point down, and where they point, (F,), at times in the walk."""
        step, share = np.divmod(self.phase(side, time), 1.0)
        contact = self._contact(side)
        ankle, pitch, toes = self._in_contact(body, side, step, np.clip(share / contact, 0, 1))
        swings = share > contact
        if swings.any():
            along = (share[swings] - contact) / (1 - contact)
            ankle[swings], pitch[swings], toes[swings] = self._swinging(body, side, step[swings], along)
        return ankle, pitch, toes

    def _contact(self, side: str) -> float:
        return self.duty * (1 - self.limp * (side == "R"))

    def _in_contact(self, body: Body, side: str, step: Array, share: Array) -> tuple[Array, Array, Array]:
        """The foot of the steps of these numbers, at shares of their contacts from 0 to 1; see `foot`."""
        sign = 1.0 if side == "L" else -1.0
        xy, heading = self.way((step - (0.5 if side == "L" else 0.0) + self._contact(side) / 2) * self.stride_time)
        left = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
        scatter = np.random.default_rng([self.seed, ord(side)]).normal(size=(400, 2)) * PLACE_SIGMA
        place = xy + sign * self.half_width * left + scatter[np.asarray(step, int) + 100]
        toes = heading + sign * TOES_OUT
        rolled = 1 - eased(np.clip(share / self.flat, 0, 1) ** 0.8)
        left_off = np.clip((share - self.heel_off) / (1 - self.heel_off), 0, None) ** 2
        pitch = np.radians(self.strike) * rolled + np.radians(self.leave) * left_off
        heel, toe = (body.landmarks[f"{side}{name}"][1] for name in ("Heel", "BigToe"))
        part = body.parts[body.index(f"foot.{side}")]
        about = np.where((pitch < 0)[:, None], heel, heel + self.pivot * (toe - heel))
        flat = np.column_stack([place, np.full(len(place), part.head_world[2])])
        level, rolling = (sole_turn(toes, down) @ part.R_world_rest for down in (0 * pitch, pitch))
        return flat + np.einsum("fab,fb->fa", level - rolling, about), pitch, toes

    def _swinging(self, body: Body, side: str, step: Array, along: Array) -> tuple[Array, Array, Array]:
        """The foot between these steps and the next, at shares of its swing; it keeps the speed at which it left."""
        contact, short = self._contact(side), 1e-3
        duration = (1 - contact) * self.stride_time
        ends = [(step, 1.0), (step, 1.0 - short), (step + 1, 0.0), (step + 1, short)]
        found = [self._in_contact(body, side, k, np.full(len(step), share)) for k, share in ends]
        (a, down, toes), (a_before, down_before, _), (b, down_next, toes_next), (_, down_after, _) = found
        per_second = 1 / (short * contact * self.stride_time)
        speeds = (a - a_before) * per_second, self.landing * (b - a) / duration - [0, 0, DESCENT]
        raised = self.lift * (np.sin(np.pi * along) ** 2)[:, None] * [0, 0, 1]
        ankle = between(along, a, speeds[0] * duration, b, speeds[1] * duration) + raised
        rates = [0.5 * (down - down_before) * per_second, 0.3 * (down_after - down_next) * per_second]
        pitch = between(along, *(v[:, None] for v in (down, rates[0] * duration, down_next, rates[1] * duration)))
        return ankle, pitch[:, 0], toes + (toes_next - toes) * eased(along)


def eased(u: Array) -> Array:
    """From 0 to 1, at rest at both ends."""
    return u * u * (3 - 2 * u)


def between(u: Array, a: Array, speed_a: Array, b: Array, speed_b: Array) -> Array:
    """Cubic from a to b, (F, D), with these speeds at the ends, at shares (F,) of the way."""
    s = u[:, None]
    ends = (2 * s**3 - 3 * s**2 + 1) * a + (-2 * s**3 + 3 * s**2) * b
    return np.asarray(ends + (s**3 - 2 * s**2 + s) * speed_a + (s**3 - s**2) * speed_b)
