"""Collect the sessions of a sensor, and convert their calibrations to the same frame and form.

Errors that calibrations share, such as the error of local gravity, are not scatter and do not
average out. They are subtracted from the covariance of each session, with the columns that the
calibrations store.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.calibration import Calibration
from inercal.calibration.comparison import (
    fixed_coefficients,
    match_frame_and_form,
    recording_sha256,
)
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
    last = sessions[-1].calibration
    matched: list[Calibration] = []
    for one in sessions:
        try:
            matched.append(match_frame_and_form(one.calibration, last))
        except InputError as error:
            raise error.located(f"{one.label} compared with {sessions[-1].label}") from None
    fixed = frozenset[str]().union(*map(fixed_coefficients, matched))
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
        recording = recording_sha256(one.calibration)
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
