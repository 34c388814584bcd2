"""Follow the calibrations of a sensor over time, coefficient by coefficient."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import cached_property
from itertools import pairwise
from math import isfinite

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.calibration import Calibration
from inercal.calibration.comparison import (
    ROUNDING,
    build_comparison,
    changes,
    fixed_coefficients,
    match_frame_and_form,
    recording_sha256,
)
from inercal.calibration.comparison.courses import (
    NEWEST,
    CourseComparison,
    CourseFit,
    compare_courses,
)
from inercal.laboratory.store.entries import CalibrationEntry, SensorEntry
from inercal.physics.sensors.coefficient_selection import select_coefficients

_LEAST_OWN = 1e-4  # assumed independent fraction of u if calibrations share all of u


@dataclass(frozen=True, eq=False)
class CoefficientTrend:
    """One coefficient over time, in SI units.

    Parameters
    ----------
    name : str
        Full name of the coefficient, such as "ax.k0".
    meaning : str
    unit : str
        Unit in which the coefficient is printed.
    si : float
        Size of the unit in SI units.
    points : tuple of int
        Indices of the calibrations in the history that state the coefficient.
    time : (n,) array
        Years since the first calibration in the history.
    values, std : (n,) arrays
        Values and standard uncertainties (k = 1).
    step_std : (n - 1,) array
        Standard uncertainties of the differences between successive values.
    shared : (m, m) array
        Covariance of the newest m values that is due to shared errors; m is at most
        `courses.NEWEST`.
    """

    name: str
    meaning: str
    unit: str
    si: float
    points: tuple[int, ...]
    time: Array
    values: Array
    std: Array
    step_std: Array
    shared: Array

    @cached_property
    def normalised_errors(self) -> Array:
        """E_n of each calibration relative to the previous calibration, (n,); NaN for the first."""
        steps = changes.normalised_errors(np.diff(self.values), self.step_std)
        return np.concatenate([[np.nan], steps])

    @property
    def independent_variance(self) -> Array:
        """Variances of the newest m values without their shared part, (m,)."""
        variance = self.std[-len(self.shared) :] ** 2
        return np.maximum(variance - np.diag(self.shared), _LEAST_OWN**2 * variance)

    @cached_property
    def courses(self) -> CourseComparison | None:
        """Level, line and random walk fitted to the newest values; None if there are only two."""
        m = len(self.shared)
        return compare_courses(
            self.time[-m:], self.values[-m:], self.independent_variance, self.shared
        )

    @property
    def line(self) -> CourseFit | None:
        """The straight line through the values; None for fewer than three calibrations."""
        return None if self.courses is None else self.courses.line

    @property
    def course(self) -> CourseFit | None:
        """The line if the coefficient drifts, otherwise the level; None for fewer than three."""
        if self.courses is None:
            return None
        return self.courses.line if self.courses.drifts else self.courses.level

    @cached_property
    def constancy(self) -> changes.ConstancyTest:
        """χ² of the newest values about their weighted mean."""
        newest = self.values[-len(self.shared) :]
        return changes.constancy_test(newest, np.sqrt(self.independent_variance), self.shared)

    @property
    def verdict(self) -> changes.TrendVerdict:
        """Whether the coefficient is steady, drifts or changed."""
        drifts = self.courses is not None and self.courses.drifts
        return changes.trend_verdict(drifts=drifts, constant=self.constancy)


@dataclass(frozen=True, eq=False)
class SensorHistory:
    """The calibrations of a sensor, oldest first, in the frame and form of the newest.

    If only the newest calibration is in the mount frame, it is converted to the frame of the
    others.

    Parameters
    ----------
    sensor : SensorEntry
    entries : tuple of CalibrationEntry
        The calibrations that can be compared.
    trends : tuple of CoefficientTrend
        One trend for each coefficient of the newest calibration, in the same order.
    calibrations : tuple of Calibration
        Calibrations of the entries, in the frame and form of the newest calibration.
    exclusions : tuple of str
        Descriptions of what is excluded: calibrations that cannot be compared or whose recording
        has a later calibration, and coefficients that were not measured or that the newest
        calibration does not contain.
    """

    sensor: SensorEntry
    entries: tuple[CalibrationEntry, ...]
    trends: tuple[CoefficientTrend, ...]
    calibrations: tuple[Calibration, ...]
    exclusions: tuple[str, ...]

    @cached_property
    def joint_test(self) -> tuple[changes.JointTest | None, ...]:
        """The joint test of all coefficients for each calibration and the previous calibration.

        The test is None for the first calibration, and if two successive calibrations have no
        coefficient in common.
        """
        return None, *(build_comparison(a, b).joint_test for a, b in pairwise(self.calibrations))

    @property
    def newest_joint_test(self) -> changes.JointTest | None:
        """The last element of `joint_test`, without computing the other elements."""
        last = self.calibrations[-2:]
        return build_comparison(*last).joint_test if len(last) > 1 else None

    @cached_property
    def operating_hours(self) -> tuple[float | None, ...]:
        """Operating hours of the sensor at each calibration, if [job] states them."""
        return tuple(_operating_hours(one) for one in self.calibrations)

    def trend(self, name: str) -> CoefficientTrend:
        """Return the trend of the coefficient with this full name.

        Raises
        ------
        InputError
            If no coefficient has this name.
        """
        trends = {trend.name: trend for trend in self.trends}
        if name not in trends:
            raise InputError(
                f"there is no coefficient {name!r} in this history; it has {', '.join(trends)}",
                names=(name,),
            )
        return trends[name]

    def select(self, words: Sequence[str]) -> "SensorHistory":
        """Return the history of coefficients chosen by name, group or axis; without words, of all.

        The joint tests still include all coefficients.

        Raises
        ------
        InputError
            If the words select no coefficient of this history.
        """
        if not words:
            return self
        axes = self.entries[-1].calibration.sensor.axes
        names = select_coefficients(axes, words)
        trends = tuple(trend for trend in self.trends if trend.name in names)
        if not trends:
            available = ", ".join(trend.name for trend in self.trends)
            raise InputError(
                f"this history has no {', '.join(words)}; it has {available}", names=tuple(words)
            )
        return replace(self, trends=trends)

    def date(self, years: float) -> str:
        """Return the time, ISO 8601, that is some years after the first calibration."""
        first = datetime.fromisoformat(self.entries[0].measured)
        return (first + timedelta(seconds=years * changes.YEAR)).isoformat(timespec="seconds")

    @property
    def expected_exceedances(self) -> float:
        """Number of E_n expected to exceed 1 by chance if nothing changed."""
        return changes.CHANCE_FRACTION * self.comparison_count

    @property
    def comparison_count(self) -> int:
        """Number of E_n in the history."""
        return sum(one.values.size - 1 for one in self.trends)

    @property
    def exceedances(self) -> int:
        """Number of |E_n| that exceed 1."""
        return sum(int(np.sum(np.abs(one.normalised_errors[1:]) > 1)) for one in self.trends)

    @property
    def verdicts(self) -> dict[changes.TrendVerdict, tuple[str, ...]]:
        """The names of the coefficients by verdict."""
        found: dict[changes.TrendVerdict, tuple[str, ...]] = {}
        for one in self.trends:
            found[one.verdict] = (*found.get(one.verdict, ()), one.name)
        return found


def build_history(sensor: SensorEntry, entries: Sequence[CalibrationEntry]) -> SensorHistory:
    """Return the history of a sensor's calibrations, oldest first.

    Raises
    ------
    InputError
        If there are no calibrations.
    """
    if not entries:
        raise InputError(
            f"sensor {sensor.name!r} has no calibration in the register; enter one with "
            "inercal store import",
            names=(sensor.name,),
        )
    entries, left_out = latest_per_recording(entries)
    newest = _common_terms(entries)
    if newest is not entries[-1].calibration:
        left_out.append(
            "the mount frame, because not all calibrations have it; all are compared in the "
            f"{newest.frame} frame"
        )
    kept: list[tuple[CalibrationEntry, Calibration]] = []
    for entry in entries:
        try:
            kept.append((entry, match_frame_and_form(entry.calibration, newest)))
        except InputError as error:
            left_out.append(f"calibration #{entry.id} cannot be compared with the newest: {error}")
    fixed: set[str] = {name for _, one in kept for name in fixed_coefficients(one)}
    names = [name for name in newest.sensor.coefficients if name not in fixed]
    others = {name for _, one in kept for name in one.sensor.coefficients} - fixed
    for missing, words in (
        (fixed & set(newest.sensor.coefficients), "not measured"),
        (others - set(names), "not among the coefficients of the newest calibration"),
    ):
        left_out += [f"{words}: {', '.join(sorted(missing))}"] * bool(missing)
    times = [datetime.fromisoformat(entry.measured).timestamp() for entry, _ in kept]
    years = (np.array(times) - times[0]) / changes.YEAR
    found = [one for _, one in kept]
    parts = [_shared_parts(one) for one in found]
    return SensorHistory(
        sensor,
        tuple(entry for entry, _ in kept),
        tuple(_coefficient_trend(name, newest, found, parts, years) for name in names),
        tuple(found),
        tuple(left_out),
    )


def _common_terms(entries: Sequence[CalibrationEntry]) -> Calibration:
    """Return the newest calibration in a frame to which all can be converted, or unchanged.

    No other frame can be converted to "mount", because a hand-held calibration has no mount frame.
    """
    newest = entries[-1].calibration
    frames = [one.calibration.frame for one in entries if one.calibration.frame != "mount"]
    if newest.frame != "mount" or not frames:
        return newest
    try:
        turned = match_frame_and_form(newest, replace(newest, frame=frames[-1]))
    except InputError:
        return newest
    return turned if any(_can_have(one, turned) for one in entries[:-1]) else newest


def _can_have(entry: CalibrationEntry, terms: Calibration) -> bool:
    """Return whether a calibration that is not in frame "mount" can be converted to these terms."""
    if entry.calibration.frame == "mount":
        return False
    try:
        match_frame_and_form(entry.calibration, terms)
    except InputError:
        return False
    return True


def _operating_hours(calibration: Calibration) -> float | None:
    try:
        hours = float(calibration.job.get("operating hours", ""))
    except ValueError:
        return None
    return hours if isfinite(hours) else None


def latest_per_recording(
    entries: Sequence[CalibrationEntry],
) -> tuple[list[CalibrationEntry], list[str]]:
    """Return the last entered calibration of each recording, and a line for each omitted one.

    Two calibrations from one recording have the same errors, so they are not independent.
    """
    last: dict[str, int] = {}
    for entry in entries:
        recording = recording_sha256(entry.calibration) or f"#{entry.id}"
        last[recording] = max(entry.id, last.get(recording, 0))
    kept: list[CalibrationEntry] = []
    left_out: list[str] = []
    for entry in entries:
        number = last[recording_sha256(entry.calibration) or f"#{entry.id}"]
        if number == entry.id:
            kept.append(entry)
        else:
            left_out.append(
                f"calibration #{entry.id}, because #{number} is a later one of the same recording"
            )
    return kept, left_out


_SharedParts = Mapping[tuple[str, str], Sequence[float]]


def _shared_parts(calibration: Calibration) -> _SharedParts:
    """Return each coefficient's signed u, SI, due to each error that may be shared.

    The keys are the name and the determination of the error.
    """
    return {
        (one.name, one.determination): (one.covariance / one.std).tolist()
        for one in calibration.shared or ()
    }


def _coefficient_trend(
    name: str,
    newest: Calibration,
    found: Sequence[Calibration],
    parts: Sequence[_SharedParts],
    years: Array,
) -> CoefficientTrend:
    points = [k for k, one in enumerate(found) if name in one.sensor.coefficients]
    places = [found[k].sensor.coefficients.index(name) for k in points]
    line = newest.sensor.coefficient(name)
    variance = np.array([found[k].covariance[i, i] for k, i in zip(points, places, strict=True)])
    shared = np.array(
        [
            sum(u[i] * parts[b][error][j] for error, u in parts[a].items() if error in parts[b])
            for (a, i), (b, j) in pairwise(zip(points, places, strict=True))
        ]
    )
    own = variance[:-1] + variance[1:]
    return CoefficientTrend(
        name,
        line.meaning,
        line.unit,
        line.si,
        tuple(points),
        years[points],
        np.array([found[k].values[i] for k, i in zip(points, places, strict=True)]),
        np.sqrt(variance),
        np.sqrt(np.maximum(own - 2 * shared, ROUNDING**2 * own)),
        _shared_of_newest([parts[k] for k in points[-NEWEST:]], places[-NEWEST:]),
    )


def _shared_of_newest(parts: Sequence[_SharedParts], places: Sequence[int]) -> Array:
    """Return the covariance of one coefficient due to shared errors, (m, m)."""
    columns: dict[tuple[str, str], Array] = {}
    for k, (own, i) in enumerate(zip(parts, places, strict=True)):
        for error, u in own.items():
            columns.setdefault(error, np.zeros(len(parts)))[k] = u[i]
    total = np.zeros((len(parts), len(parts)))
    for column in columns.values():
        total += np.outer(column, column)
    return total
