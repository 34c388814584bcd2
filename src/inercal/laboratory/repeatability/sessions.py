"""Collect the sessions of a sensor, and convert their calibrations to the same frame and form.

Errors that calibrations share, such as the error of local gravity, are not scatter and do not
average out. They are subtracted from the covariance of each session, with the columns that the
calibrations store.

Random effects that describe the scatter of a sensor between sessions.

Each effect has a known shape and one unknown variance. The same coefficients of similar axes have a
common variance from day to day, and another from one power cycle to the next. A new mounting
rotates the sensor in its fixture by a small angle vector ψ, which changes all misalignments
together::

    δ_O += ψ·O,   δ_P += ψ·P

If misalignments are stated in a frame that is fixed to the sensor, a new mounting has no effect.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, error_location
from inercal.basics.keys import CoefficientName
from inercal.calibration import Calibration, comparison
from inercal.estimation.uncertainty.repeated_measurements import RandomEffect
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import Sensor

_OWN_OF_UNSTATED = 1e-6  # fraction of a covariance that is not shared if nothing is stated
_LEAST_EIGENVALUE = 1e-9  # least eigenvalue without shared errors, relative to the stated one


@dataclass(frozen=True, eq=False)
class RepeatedSession:
    """A calibration with its day, mounting and turn-on.

    Parameters
    ----------
    label : str
        Name used in messages, such as the file name.
    calibration : Calibration
    day, mount, turn_on : str
        Sessions with the same text belong to the same day, mounting in the fixture or power cycle.
    """

    label: str
    calibration: Calibration
    day: str
    mount: str
    turn_on: str

    @property
    def named(self) -> tuple[str, Mapping[str, str]]:
        """Name and [job] of the sensor."""
        return self.calibration.sensor.name, self.calibration.job

    def level_names(self) -> tuple[str, str, str]:
        """Return the texts for day, mount and turn-on."""
        return self.day, self.mount, self.turn_on


@dataclass(frozen=True, eq=False)
class SharedColumn:
    """A bench error that all sessions with the same determination share.

    Parameters
    ----------
    name : str
    column : (k, p) array
        Covariance of the coefficients with the error, divided by the standard deviation of the
        error; 0 for sessions with another determination.
    members : (k,) array of bool
        Whether each session has this determination.
    """

    name: str
    column: Array
    members: NDArray[np.bool_]

    @property
    def is_common(self) -> bool:
        """Whether all sessions share this error."""
        return bool(self.members.all())


@dataclass(frozen=True, eq=False)
class MatchedSessions:
    """k sessions with p coefficients each, in SI units.

    Parameters
    ----------
    sessions : tuple of RepeatedSession
    sensor : Sensor
        Sensor of the last session.
    frame : str
        Body frame of the misalignments.
    names : tuple of str
        Coefficients that all sessions measured.
    values : (k, p) array
    own : (k, p, p) array
        Covariance without shared errors.
    stated : (k, p, p) array
        Covariance that the calibrations state.
    shared : tuple of SharedColumn
    unstated : tuple of str
        Sessions that do not state their shared errors; their whole uncertainty is treated as
        shared.
    left_out : tuple of str
        Coefficients that not all sessions measured.
    """

    sessions: tuple[RepeatedSession, ...]
    sensor: Sensor
    frame: str
    names: tuple[str, ...]
    values: Array
    own: Array
    stated: Array
    shared: tuple[SharedColumn, ...]
    unstated: tuple[str, ...]
    left_out: tuple[str, ...]

    def level(self, which: int) -> NDArray[np.intp]:
        """Return the index of each session's day (0), mounting (1) or turn-on (2), (k,)."""
        words = [one.level_names()[which] for one in self.sessions]
        order = {word: n for n, word in enumerate(dict.fromkeys(words))}
        return np.array([order[word] for word in words], dtype=np.intp)

    def without(self, index: int) -> "MatchedSessions":
        """Return all sessions except the session with this index."""
        return self.subset([k for k in range(len(self.sessions)) if k != index])

    def subset(self, kept: Sequence[int]) -> "MatchedSessions":
        """Return the sessions with these indices."""
        shared = (
            replace(one, column=one.column[kept], members=one.members[kept]) for one in self.shared
        )
        return replace(
            self,
            sessions=tuple(self.sessions[k] for k in kept),
            values=self.values[kept],
            own=self.own[kept],
            stated=self.stated[kept],
            shared=tuple(one for one in shared if one.members.any()),
        )


def match_sessions(sessions: Sequence[RepeatedSession]) -> MatchedSessions:
    """Convert all sessions to the frame and form of the last session.

    Raises
    ------
    InputError
        If there are fewer than two sessions, if two sessions come from the same recording, or if
        the calibrations cannot be compared.
    """
    if len(sessions) < 2:
        raise InputError(
            f"{len(sessions)} session is not enough to estimate scatter; give two or more "
            "calibrations of one sensor"
        )
    _refuse_one_recording(sessions)
    if serials := comparison.different_sensors(*(one.named for one in sessions))[0]:
        raise InputError(
            f"the calibrations are of different sensors, serial numbers {serials}; give those of "
            "one sensor, or correct [job] serial_number",
            key="[job] serial_number",
        )
    last = sessions[-1].calibration
    matched: list[Calibration] = []
    for one in sessions:
        with error_location(f"{one.label} compared with {sessions[-1].label}"):
            matched.append(comparison.match_frame_and_form(one.calibration, last))
    fixed = frozenset[str]().union(*map(comparison.fixed_coefficients, matched))
    names = tuple(
        name
        for name in last.sensor.coefficients
        if name not in fixed and all(name in one.sensor.coefficients for one in matched)
    )
    if not names:
        raise InputError(
            "the calibrations have no measured coefficient in common; give calibrations that "
            "estimate the same coefficients"
        )
    known = {name for one in matched for name in one.sensor.coefficients}
    stated = np.array([_covariance(one, names) for one in matched])
    shared = _shared_columns(matched, names, stated)
    unstated = [one.shared is None for one in matched]
    own = stated - sum(
        (np.einsum("kp,kq->kpq", one.column, one.column) for one in shared if one.name),
        np.zeros_like(stated),
    )
    own[unstated] = _OWN_OF_UNSTATED * stated[unstated]
    return MatchedSessions(
        tuple(sessions),
        last.sensor,
        last.frame,
        names,
        np.array([[one.value(name) for name in names] for one in matched]),
        np.array([_nonnegative(o, w) for o, w in zip(own, stated, strict=True)]),
        stated,
        shared,
        tuple(s.label for s, is_so in zip(sessions, unstated, strict=True) if is_so),
        tuple(sorted(known - set(names))),
    )


def _refuse_one_recording(sessions: Sequence[RepeatedSession]) -> None:
    by_recording: dict[str, str] = {}
    for one in sessions:
        recording = comparison.recording_sha256(one.calibration)
        if recording and recording in by_recording:
            raise InputError(
                f"{by_recording[recording]} and {one.label} come from the same recording; give "
                "only one of them"
            )
        by_recording[recording] = one.label


def _covariance(calibration: Calibration, names: Sequence[str]) -> Array:
    place = {name: k for k, name in enumerate(calibration.sensor.coefficients)}
    picks = [place[name] for name in names]
    return calibration.covariance[np.ix_(picks, picks)]


def _shared_columns(
    calibrations: Sequence[Calibration], names: Sequence[str], stated: Array
) -> tuple[SharedColumn, ...]:
    """Return a column for each determination, and columns of a root for unstated shared errors."""
    k, p = len(calibrations), len(names)
    columns: dict[tuple[str, str], Array] = {}
    for i, one in enumerate(calibrations):
        picks = [one.sensor.coefficients.index(name) for name in names]
        for error in one.shared or ():
            column = columns.setdefault((error.name, error.determination), np.zeros((k, p)))
            column[i] = error.covariance[picks] / error.std
    found = [
        SharedColumn(name, column, np.asarray(column.any(axis=1)))
        for (name, _), column in columns.items()
    ]
    silent = np.array([one.shared is None for one in calibrations])
    if silent.any():
        roots = np.zeros((p, k, p))
        for i in np.flatnonzero(silent):
            roots[:, i] = _root(stated[i]).T
        found += [SharedColumn("", column, silent) for column in roots]
    return tuple(found)


def _root(covariance: Array) -> Array:
    """Return the symmetric root of a covariance, which is the same for the same covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T


def _nonnegative(own: Array, stated: Array) -> Array:
    """Return a covariance without shared errors, made positive definite in spite of rounding."""
    scale = np.sqrt(np.diag(stated))
    values, vectors = np.linalg.eigh(own / np.outer(scale, scale))
    values = np.maximum(values, _LEAST_EIGENVALUE)
    return (vectors * values) @ vectors.T * np.outer(scale, scale)


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
    for place, name in enumerate(names):
        term = sensor.coefficient(name)
        meaning = "misalignment" if term.name in _ROTATED else term.meaning
        kind = QUANTITIES[sensor.measures[CoefficientName(name).axis]].sensors
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
