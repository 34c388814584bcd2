"""How a sensor scatters between sessions: shapes of known form with one variance each.

Like coefficients of like axes share a variance, from day to day and from one power cycle to the
next. A new mounting turns the sensor in its fixture by a small ψ, all misalignments together::

    δ_O += ψ·O,   δ_P += ψ·P

In a frame that is the sensor's own a mounting changes nothing.
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
"""What is new in the next use."""
LevelName = Literal["session", "day", "turn-on", "mount"]
_DAY, _MOUNT, _TURN_ON = range(3)
_ROTATED = {"delta_o": 2, "delta_p": 1}  # the row of an axis's frame


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """A random effect, and what it is.

    Parameters
    ----------
    name : str
        "bias of accelerometers", or "rotation of the mounting".
    level : "session", "day", "turn-on" or "mount"
        What brings a new draw; a session is a new day, turn-on and mounting at once.
    owner : "sensor" or "bench"
        Whether it goes with the sensor into its next use.
    places : tuple of int
        The coefficients that it moves.
    unit, si
        Unit of its standard deviation, and its SI size.
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
        """Whether a next use on another day, or after another turn-on of a day, draws it anew."""
        return self.owner == "sensor" and (scope == "day" or self.level in ("turn-on", "session"))

    @property
    def similar(self) -> int:
        """How many independent draws a level brings."""
        return self.effect.shape.shape[1]


def named_effects(matched: MatchedSessions, mount_owner: Owner) -> tuple[NamedEffect, ...]:
    """Return the effects that sessions can show."""
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
    """Return the places of like coefficients, by name, unit and SI size of the unit."""
    groups: dict[tuple[str, str, float], list[int]] = {}
    measures = {axis.name: axis.measures for axis in sensor.axes}
    for place, name in enumerate(names):
        term = sensor.coefficient(name)
        meaning = "misalignment" if term.name in _ROTATED else term.meaning
        kind = QUANTITIES[measures[CoefficientName(name).axis]].sensors
        groups.setdefault((f"{meaning} of {kind}", term.unit, term.si), []).append(place)
    return {key: tuple(places) for key, places in groups.items()}


def is_rotation_observed(rotation: Array) -> bool:
    """Tell whether misalignments have directions that no rotation moves, and those it moves."""
    return 0 < np.linalg.matrix_rank(rotation) < int(rotation.any(axis=1).sum())


def _rotation(matched: MatchedSessions) -> Array:
    """Return the derivatives of all coefficients by ψ, (p, 3)."""
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
    """Return the covariance (p, p) that chosen effects add, SI."""
    total = np.zeros((size, size))
    for one, s, chosen in zip(effects, variance, of, strict=True):
        if chosen:
            total += s * one.effect.shape @ one.effect.shape.T
    return total
