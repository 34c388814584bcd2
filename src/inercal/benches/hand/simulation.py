"""Simulate a plan by hand: the true motion at each sample, with random errors of the bench.

Between steps the sensor moves smoothly (minimum jerk) from one attitude to the next. Samples during
a hold or a turn have its label; samples during a move have an empty label.

At an upward direction u the field of the Earth is B (cos δ e − sin δ u), where δ is the dip and e
the horizontal direction of magnetic north. If the sensor turns by an angle, the field turns by the
opposite angle in its frame.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import pi, radians

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import Measured
from inercal.benches.contract import SimulatedMotion, concatenate_motions
from inercal.benches.hand.bench import (
    Hand,
    face_label,
    hold_tilt,
    sensed_motion,
    tangent_vectors,
    tilted_direction,
    visit_number,
)
from inercal.physics.motion import Motion
from inercal.physics.plan import HandStep, Hold, Turn


def shortest_rotation(start: Array, end: Array) -> tuple[Array, Array]:
    """Return the rotation from start to end: its axis, (trials, 3), and angle, (trials,)."""
    axis = np.cross(start, end)
    size = np.linalg.norm(axis, axis=-1, keepdims=True)
    aside = np.cross(start, np.eye(3)[np.argmin(np.abs(start[0]))])
    axis = np.where(size > 1e-12, axis, aside)  # to the opposite face about any level axis
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    return axis, np.arctan2((np.cross(start, end) * axis).sum(-1), (start * end).sum(-1))


def rotate_vectors(axis: Array, angles: Array, vector: Array) -> Array:
    """Rotate a vector about an axis by angles, (trials, n), and return (trials, n, 3)."""
    cos, sin = np.cos(angles)[..., None], np.sin(angles)[..., None]
    along = axis * (axis * vector).sum(-1, keepdims=True)
    return along[:, None] + (vector - along)[:, None] * cos + np.cross(axis, vector)[:, None] * sin


_STRENGTH, _DIP = Measured(50e-6, 0.0), Measured(radians(65), 0.0)  # in the middle of Europe
_AZIMUTHS = (0.0, pi, pi / 2, -pi / 2)  # of repeated visits to a face


class FieldSimulation:
    """The field in the sensor's frame, from step to step, (trials, n, 3) T.

    Parameters
    ----------
    bench : Hand
    rng : Generator
    trials : int
    carried : bool
        Whether the azimuth follows the motion. Otherwise each face has a random azimuth, to which
        repeated visits add 180°, 90° and −90°.
    """

    def __init__(self, bench: Hand, rng: "np.random.Generator", trials: int, *, carried: bool):
        self._rng, self._trials, self._carried = rng, trials, carried
        strength, dip = bench.field or _STRENGTH, bench.dip or _DIP
        self._strength = rng.normal(strength.value, strength.sd, (trials, 1))
        sign = -1.0 if bench.dip is None and bench.dip_sign < 0 else 1.0
        self._dip = sign * rng.normal(dip.value, dip.sd, (trials, 1))
        self._north: dict[str, Array] = {}
        self._field: Array | None = None

    def at_step(self, step: HandStep, up: Array, angles: Array) -> Array:
        """Return the field during a step in which the sensor turns about `up` by `angles`."""
        if self._field is None or not self._carried:
            face = face_label(step.label)
            if face not in self._north:
                self._north[face] = self._rng.uniform(-pi, pi, self._trials)
            visit = (visit_number(step.label) - 1) % len(_AZIMUTHS)
            azimuth = (self._north[face] + _AZIMUTHS[visit])[:, None]
            d = tangent_vectors(up)
            level = np.cos(azimuth) * d[..., 0, :] + np.sin(azimuth) * d[..., 1, :]
            self._field = self._strength * (np.cos(self._dip) * level - np.sin(self._dip) * up)
        found = rotate_vectors(up, -angles, self._field)
        self._field = found[:, -1]
        return found

    def during_move(self, start: Array, end: Array, travelled: Array) -> Array:
        """Return the field during a move, of which each sample has travelled some part, (n,)."""
        assert self._field is not None
        axis, angle = shortest_rotation(start, end)
        found = rotate_vectors(axis, angle[:, None] * np.append(travelled, 1.0), self._field)
        self._field = found[:, -1]
        return found[:, :-1]


MOVE_SECONDS = 2.0
PAUSE_SECONDS = 1.5  # unlabelled rest before and after a turn
_SETTLE = 0.25  # s at rest at each end of a turn's section


def simulate_hand_motion(
    bench: Hand,
    steps: Sequence[HandStep],
    rate_hz: float,
    rng: "np.random.Generator",
    trials: int = 1,
    *,
    carried: bool = False,
    magnetic: bool = False,
) -> SimulatedMotion:
    """Simulate the motion in each trial; all trials share times and labels.

    Parameters
    ----------
    bench : Hand
        The bench. Its parameters are drawn from normal distributions with their stated standard
        deviations.
    steps : sequence of HandStep
    rate_hz : float
        Samples per second on the recording's clock.
    rng : Generator
    trials : int
        Number of trials, which is the leading axis of the drawn errors and the motion.
    carried : bool
        Whether the sensor stays in the hand between holds. Its azimuth, and with it the horizontal
        earth rate, then follows its motion. Otherwise each position has an independent azimuth.
    magnetic : bool
        Whether to simulate the magnetic field: that of the bench, or 50 µT with a dip of 65°.
    """
    drawn = bench.qualified.draw(bench.acting_parameters(steps, rates=True), rng, trials)
    if carried:
        drawn |= _earth_rates_at_holds([step for step in steps if isinstance(step, Hold)], drawn)
    parts: list[tuple[Array, Array, str]] = []
    field = FieldSimulation(bench, rng, trials, carried=carried) if magnetic else None
    fields: list[Array] = []
    up = None
    for step in steps:
        q = drawn | _up_and_force(step, drawn)
        if up is not None:
            parts.append((*_transfer_motion(up, q["up"], drawn["g"], rate_hz), ""))
            if field is not None:
                fields.append(field.during_move(up, q["up"], _travelled(rate_hz)))
        up = q["up"]
        n = max(round(step.seconds * rate_hz), 1)
        mean, steady = sensed_motion(step, n / rate_hz, q), _constant_rate(step, q)
        profile = _turn_profile(n, rate_hz) if isinstance(step, Turn) else np.ones(n)
        f = np.repeat(mean.f[:, None], n, axis=1)
        w = steady[:, None] + (mean.w - steady)[:, None] * profile[:, None]
        pause = round(PAUSE_SECONDS * rate_hz) if isinstance(step, Turn) else 0
        still = (f[:, :1].repeat(pause, axis=1), steady[:, None].repeat(pause, axis=1), "")
        parts += [still, (f, w, step.label), still]
        if field is not None:
            angles = np.zeros((trials, n + 2 * pause))
            if isinstance(step, Turn):
                angle = step.angle + drawn[f"angle[{step.label}]"]
                angles[:, pause : pause + n] = angle[:, None] * np.cumsum(profile) / n
                angles[:, pause + n :] = angle[:, None]
            fields.append(field.at_step(step, up, angles))
    labels = np.concatenate([np.full(f.shape[1], label) for f, _, label in parts])
    motion = concatenate_motions([Motion(f, w) for f, w, _ in parts])
    if fields:
        motion = replace(motion, m=np.concatenate(fields, axis=-2))
    return SimulatedMotion(np.arange(labels.size) / rate_hz, motion, labels, drawn)


def _earth_rates_at_holds(holds: Sequence[Hold], drawn: dict[str, Array]) -> dict[str, Array]:
    """Return the horizontal earth rate in the body at each hold, rotated by the moves."""
    found: dict[str, Array] = {}
    level, before = np.zeros(0), np.zeros(0)
    for hold in holds:
        d, names = tangent_vectors(hold.up), [f"earth{k}[{face_label(hold.label)}]" for k in (1, 2)]
        up = _up_and_force(hold, drawn)["up"]
        if not found:
            level = np.stack([drawn[name] for name in names], axis=-1) @ d
        else:
            axis, angle = shortest_rotation(before, up)
            level = rotate_vectors(axis, angle[:, None], level)[:, 0]
        own = [f"earth_visit{k}[{hold.label}]" for k in (1, 2)]
        if own[0] in drawn:
            found |= dict.fromkeys(names, np.zeros(len(level)))
            names = own
        found |= {name: level @ row for name, row in zip(names, d, strict=True)}
        before = up
    return found


def _up_and_force(step: HandStep, drawn: dict[str, Array]) -> dict[str, Array]:
    """Return the upward direction in the body and, for a turn, the specific force along it."""
    if isinstance(step, Hold):
        direction, tangent = step.up, hold_tilt(drawn, step.label)
    else:
        direction = step.axis
        tangent = np.stack([drawn[f"axis{k}[{step.label}]"] for k in (1, 2)], axis=-1)
    up = tilted_direction(direction, tangent)[0]
    extra = {"up": up}
    if isinstance(step, Turn):
        force = drawn["g"][:, None] * up
        extra |= {f"force_{a}[{step.label}]": force[:, k] for k, a in enumerate("xyz")}
    return extra


def _constant_rate(step: HandStep, q: dict[str, Array]) -> Array:
    """Return the part of the angular rate that stays constant during a step, (trials, 3)."""
    if isinstance(step, Hold):
        return sensed_motion(step, 1.0, q).w
    own = [q.get(f"turn_on_{a}[{step.label}]", np.zeros(1)) for a in "xyz"]
    return q["earth_up"][:, None] * q["up"] + np.stack(own, axis=-1)


def _minimum_jerk(s: Array) -> Array:
    """Return the rate at times 0 ≤ s ≤ 1 during a minimum-jerk move of unit length and duration."""
    return 30 * s**2 * (1 - s) ** 2


def _travelled(rate_hz: float) -> Array:
    """Return the part of a move that is completed at each sample, (n,)."""
    n = round(MOVE_SECONDS * rate_hz)
    s = (np.arange(n) + 0.5) / n
    return 10 * s**3 - 15 * s**4 + 6 * s**5


def _turn_profile(n: int, rate_hz: float) -> Array:
    """Return the rate during a turn divided by its mean, (n,): rest, minimum jerk, rest."""
    at_rest = min(round(_SETTLE * rate_hz), n // 4)
    moving = n - 2 * at_rest
    profile = np.zeros(n)
    profile[at_rest : at_rest + moving] = _minimum_jerk((np.arange(moving) + 0.5) / moving)
    return profile / profile.mean()


def _transfer_motion(start: Array, end: Array, g: Array, rate_hz: float) -> tuple[Array, Array]:
    """Return f and ω during a move from one upward direction to another, (trials, n, 3).

    The directions `start` and `end`, (trials, 3), are in the body frame. If the body turns by −θ
    about an axis, the upward direction turns by +θ about it in the body frame.
    """
    n = round(MOVE_SECONDS * rate_hz)
    axis, angle = shortest_rotation(start, end)
    ups = rotate_vectors(axis, angle[:, None] * _travelled(rate_hz), start)
    rate = -angle[:, None] * _minimum_jerk((np.arange(n) + 0.5) / n) * rate_hz / n
    return g[:, None, None] * ups, rate[..., None] * axis[:, None]
