"""The calibrations of a sensor over time, coefficient by coefficient."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import cached_property
from itertools import pairwise

import numpy as np

from inercal.arrays import Array
from inercal.calibration import Calibration
from inercal.errors import InputError
from inercal.sensors.choose import choose
from inercal.store import changes
from inercal.store.comparable import brought, held, recording_of
from inercal.store.comparison import compared
from inercal.store.entries import CalibrationEntry, SensorEntry


@dataclass(frozen=True, eq=False)
class Course:
    """One coefficient over time, SI.

    Parameters
    ----------
    name : str
        Full, "ax.k0".
    meaning : str
    unit : str
        As printed.
    si : float
        One such unit, in SI.
    points : tuple of int
        Which of the history's calibrations have it.
    time : (n,) array
        Years since the first of the history's calibrations.
    values, std : (n,) arrays
        With standard uncertainties (k = 1).
    """

    name: str
    meaning: str
    unit: str
    si: float
    points: tuple[int, ...]
    time: Array
    values: Array
    std: Array

    @cached_property
    def normalised(self) -> Array:
        """E_n of each calibration beyond the one before; NaN of the first, (n,)."""
        steps = changes.normalised(np.diff(self.values), self.std[:-1], self.std[1:])
        return np.concatenate([[np.nan], steps])

    @cached_property
    def line(self) -> changes.Line | None:
        """The straight line through it, of three calibrations at least."""
        return changes.line(self.time, self.values, self.std)

    @cached_property
    def constancy(self) -> changes.Constancy:
        """χ² about the weighted mean."""
        return changes.constancy(self.values, self.std)

    @property
    def verdict(self) -> changes.Verdict:
        """What it shows."""
        return changes.verdict(self.line, self.constancy)


@dataclass(frozen=True, eq=False)
class History:
    """The calibrations of a sensor in the terms of the newest, the first first.

    Parameters
    ----------
    sensor : SensorEntry
    entries : tuple of CalibrationEntry
        Those that can be compared.
    courses : tuple of Course
        Of the coefficients of the newest, in its order.
    joint : tuple of Joint or None
        The test of all coefficients together, of each calibration against the one before; None of
        the first, and of one that has no coefficient in common with it.
    left_out : tuple of str
        In words: calibrations of a recording that has a later one, or that cannot be compared;
        coefficients that are not in the newest or that no data stand behind.
    """

    sensor: SensorEntry
    entries: tuple[CalibrationEntry, ...]
    courses: tuple[Course, ...]
    joint: tuple[changes.Joint | None, ...]
    left_out: tuple[str, ...]

    def course(self, name: str) -> Course:
        """Return one coefficient over time by its full name.

        Raises
        ------
        InputError
            There is none of that name.
        """
        for one in self.courses:
            if one.name == name:
                return one
        there = ", ".join(one.name for one in self.courses)
        raise InputError(f"no coefficient {name!r} in this history; it has {there}")

    def chosen(self, words: Sequence[str]) -> "History":
        """Return the history of coefficients chosen by name, group or axis; of none, all.

        The joint tests stay those of all coefficients together.

        Raises
        ------
        InputError
            A word names none of them.
        """
        if not words:
            return self
        axes = self.entries[-1].calibration.sensor.axes
        names = choose(axes, words)
        courses = tuple(one for one in self.courses if one.name in names)
        if not courses:
            there = ", ".join(one.name for one in self.courses)
            raise InputError(f"{', '.join(words)}: not in this history; it has {there}")
        return replace(self, courses=courses)

    def date(self, years: float) -> str:
        """Return the time that lies so many years after the first calibration, ISO 8601."""
        first = datetime.fromisoformat(self.entries[0].measured)
        return (first + timedelta(seconds=years * changes.YEAR)).isoformat(timespec="seconds")

    @property
    def by_chance(self) -> float:
        """How many E_n would exceed 1 by chance where nothing changes."""
        return changes.BY_CHANCE * self.steps

    @property
    def steps(self) -> int:
        """How many E_n there are."""
        return sum(one.values.size - 1 for one in self.courses)

    @property
    def beyond(self) -> int:
        """How many of them exceed 1."""
        return sum(int(np.sum(np.abs(one.normalised[1:]) > 1)) for one in self.courses)

    @property
    def verdicts(self) -> dict[changes.Verdict, tuple[str, ...]]:
        """The coefficients by what they show."""
        found: dict[changes.Verdict, tuple[str, ...]] = {}
        for one in self.courses:
            found[one.verdict] = (*found.get(one.verdict, ()), one.name)
        return found


def history_of(sensor: SensorEntry, entries: Sequence[CalibrationEntry]) -> History:
    """Return the history that calibrations, the first first, make up.

    Raises
    ------
    InputError
        There is none.
    """
    if not entries:
        raise InputError(f"sensor {sensor.name!r} has no calibration in the register yet")
    entries, left_out = _once(entries)
    newest = entries[-1].calibration
    kept: list[tuple[CalibrationEntry, Calibration]] = []
    for entry in entries:
        try:
            kept.append((entry, brought(entry.calibration, newest)))
        except InputError as error:
            left_out.append(f"calibration #{entry.id} cannot be compared with the newest: {error}")
    fixed: set[str] = {name for _, one in kept for name in held(one)}
    names = [name for name in newest.sensor.coefficients if name not in fixed]
    others = {name for _, one in kept for name in one.sensor.coefficients} - fixed
    left_out += _without(
        (fixed & set(newest.sensor.coefficients), "no data stand behind {}"),
        (others - set(names), "{} not among the coefficients of the newest calibration"),
    )
    times = [datetime.fromisoformat(entry.measured).timestamp() for entry, _ in kept]
    years = (np.array(times) - times[0]) / changes.YEAR
    found = [one for _, one in kept]
    return History(
        sensor,
        tuple(entry for entry, _ in kept),
        tuple(_course(name, newest, found, years) for name in names),
        (None, *(compared(a, b).joint for a, b in pairwise(found))),
        tuple(left_out),
    )


def _once(entries: Sequence[CalibrationEntry]) -> tuple[list[CalibrationEntry], list[str]]:
    """Return one calibration of each recording, the last entered, and what is left out in words.

    Two of one recording have the same errors: as a repeat they would prove nothing.
    """
    last: dict[str, int] = {}
    for entry in entries:
        recording = recording_of(entry.calibration) or f"#{entry.id}"
        last[recording] = max(entry.id, last.get(recording, 0))
    kept: list[CalibrationEntry] = []
    left_out: list[str] = []
    for entry in entries:
        number = last[recording_of(entry.calibration) or f"#{entry.id}"]
        if number == entry.id:
            kept.append(entry)
        else:
            left_out.append(f"calibration #{entry.id} is of the same recording as #{number}")
    return kept, left_out


def _course(name: str, newest: Calibration, found: Sequence[Calibration], years: Array) -> Course:
    points = [k for k, one in enumerate(found) if name in one.sensor.coefficients]
    line = newest.sensor.coefficient(name)
    return Course(
        name,
        line.meaning,
        line.unit,
        line.si,
        tuple(points),
        years[points],
        np.array([found[k].value(name) for k in points]),
        np.array([found[k].uncertainty(name) for k in points]),
    )


def _without(*parts: tuple[Collection[str], str]) -> list[str]:
    return [words.format(", ".join(sorted(names))) for names, words in parts if names]
