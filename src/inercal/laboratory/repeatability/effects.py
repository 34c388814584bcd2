"""Describe the scatter of a sensor between sessions by random effects.

Each effect has a known shape and one unknown variance. The same coefficients of similar axes have a
common variance from day to day, and another from one power cycle to the next. A new mounting
rotates the sensor in its fixture by a small angle vector ψ, which changes all misalignments
together::

    δ_O += ψ·O,   δ_P += ψ·P

If misalignments are stated in a frame that is fixed to the sensor, a new mounting has no effect.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.estimation.uncertainty.repeated_measurements import RandomEffect
from inercal.laboratory.repeatability.sessions import MatchedSessions
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import Sensor

Owner = Literal["sensor", "bench"]
Scope = Literal["day", "turn-on"]
"""What changes before the next use: the day, or only the turn-on (power cycle)."""
LevelName = Literal["session", "day", "turn-on", "mount"]
_DAY, _MOUNT, _TURN_ON = range(3)
_ROTATED = {"delta_o": 2, "delta_p": 1}  # row of the axis frame that is multiplied by ψ


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """A random effect with its description.

    Parameters
    ----------
    name : str
        Name such as "bias of accelerometers" or "rotation of the mounting".
    level : "session", "day", "turn-on" or "mount"
        The event that causes a new random value. "session" means a new day, turn-on and mounting at
        once.
    owner : "sensor" or "bench"
        Whether the effect belongs to the sensor, and is therefore part of its next use, or to the
        bench.
    places : tuple of int
        Indices of the coefficients that the effect changes.
    unit, si
        Unit of the standard deviation, and the size of this unit in SI.
    effect : RandomEffect
    """

    name: str
    level: LevelName
    owner: Owner
    places: tuple[int, ...]
    unit: str
    si: float
    effect: RandomEffect

    def is_in_next_use(self, scope: Scope) -> bool:
        """Return whether the effect has a new value in the next use, for a given scope."""
        return self.owner == "sensor" and (scope == "day" or self.level in ("turn-on", "session"))

    @property
    def similar(self) -> int:
        """Number of independent random values at each level."""
        return self.effect.shape.shape[1]


def named_effects(matched: MatchedSessions, mount_owner: Owner) -> tuple[NamedEffect, ...]:
    """Return the effects that these sessions can show."""
    days, mounts, turn_ons = (matched.level(which) for which in (_DAY, _MOUNT, _TURN_ON))
    k = len(matched.sessions)
    levels: list[tuple[LevelName, np.ndarray]] = []
    if days.max() + 1 == k:
        levels.append(("session", days))
    else:
        if days.max() > 0:
            levels.append(("day", days))
        if turn_ons.max() > days.max():
            levels.append(("turn-on", turn_ons))
    found: list[NamedEffect] = []
    for (name, unit, si), places in similar_coefficients(matched.sensor, matched.names).items():
        shape = np.eye(len(matched.names))[:, list(places)]
        found += [
            NamedEffect(name, level, "sensor", places, unit, si, RandomEffect(shape, number))
            for level, number in levels
        ]
    rotation = _rotation(matched)
    places = tuple(np.flatnonzero(rotation.any(axis=1)).tolist())
    if matched.frame == "mount" and mounts.max() > 0 and is_rotation_observed(rotation):
        effect = RandomEffect(rotation[:, rotation.any(axis=0)], mounts)
        found.append(
            NamedEffect("rotation of the mounting", "mount", mount_owner, places, "″",
                        np.pi / 648_000, effect)
        )  # fmt: skip
    return tuple(found)


def similar_coefficients(
    sensor: Sensor, names: Sequence[str]
) -> dict[tuple[str, str, float], tuple[int, ...]]:
    """Group similar coefficients: return their indices by name, unit and SI size of the unit."""
    groups: dict[tuple[str, str, float], list[int]] = {}
    measures = {axis.name: axis.measures for axis in sensor.axes}
    for place, name in enumerate(names):
        term = sensor.coefficient(name)
        meaning = "misalignment" if term.name in _ROTATED else term.meaning
        kind = QUANTITIES[measures[CoefficientName(name).axis]].sensors
        groups.setdefault((f"{meaning} of {kind}", term.unit, term.si), []).append(place)
    return {key: tuple(places) for key, places in groups.items()}


def is_rotation_observed(rotation: Array) -> bool:
    """Return whether a rotation of the mounting can be distinguished from other misalignments."""
    return 0 < np.linalg.matrix_rank(rotation) < int(rotation.any(axis=1).sum())


def _rotation(matched: MatchedSessions) -> Array:
    """Return the derivatives of all coefficients with respect to ψ, (p, 3)."""
    axes = {axis.name: axis for axis in matched.sensor.axes}
    result = np.zeros((len(matched.names), 3))
    for place, name in enumerate(matched.names):
        axis, term = CoefficientName(name).parts
        if term in _ROTATED:
            result[place] = axes[axis].frame[_ROTATED[term]]
    return result


def scatter(
    effects: Sequence[NamedEffect], variance: Array, of: Sequence[bool], size: int
) -> Array:
    """Return the covariance that the chosen effects add, (p, p), SI."""
    total = np.zeros((size, size))
    for one, s, chosen in zip(effects, variance, of, strict=True):
        if chosen:
            total += s * one.effect.shape @ one.effect.shape.T
    return total
