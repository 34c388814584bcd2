"""Pool scatter and drift over sensors of a type, for a sensor with too few calibrations.

Sensor s of a type has k_s calibrations of a coefficient at times t, with their own variances s_i²
and a shared covariance S. The level θ_s is different for each sensor. The variances τ², σ_b² and q
are the same for all sensors and similar axes::

    y = θ_s + b_s t + w(t) + e,   cov(e) = diag(s_i²) + S + τ² I
    b_s ~ N(0, σ_b²),   w is a random walk with variance q per year

σ_b² is the mean square of the drifts and not their variance, so it includes ageing that all sensors
share. τ², σ_b² and q maximise the restricted likelihood of all sensors together. For another sensor
of the type, at a time Δt after a calibration with its own variance s², the uncertainty of the
coefficient is::

    U²(Δt) = t_ν² (2τ² + s² + q Δt) + t_m² σ_b² Δt² + 4 u_B²

Here ν is the sum of k_s − 1 over sensors and similar axes, and m is the number of these terms. If
no sensor has three calibrations, scatter and drift cannot be distinguished. U(Δt) is then computed
once with only scatter and once with only drift, and the larger is used. If the variances of one
coefficient give a larger U(Δt) than the common variances of all similar axes, they are used, with
the same ν and m.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from inercal.basics.errors import InputError
from inercal.calibration.comparison.changes import chi2_p_value
from inercal.estimation.uncertainty import COVERAGE
from inercal.estimation.uncertainty.conformity import expanded_uncertainty
from inercal.estimation.uncertainty.repeated_measurements import MeasurementBlock, pooled_variances
from inercal.laboratory.repeatability.sessions import similar_coefficients
from inercal.laboratory.store.history import CoefficientTrend, SensorHistory

if TYPE_CHECKING:
    from inercal.laboratory.store.register import Register

MOST_SENSORS = 50
"""Largest number of sensors of a type that are read; they are the last calibrated sensors."""
_ALL = (0, 1, 2)  # indices of all `ChangeVariances`
_ALONE = ((0,), (2,))
_LEAST_P = 0.01  # p-value below which a sensor does not belong to its type


class ChangeVariances(NamedTuple):
    """The variances τ², q (per year) and σ_b² (per year²), in SI units."""

    scatter: float
    walk: float
    slope: float


@dataclass(frozen=True)
class PooledChange:
    """How one coefficient changes in sensors of a type.

    Parameters
    ----------
    sensors : int
    variances : tuple of ChangeVariances
        Variances from all similar axes, and from this coefficient only; the larger U is used.
    dof, slope_dof : float
        Degrees of freedom ν and m.
    rate : float
        Largest yearly change between two calibrations of a sensor, SI.
    """

    sensors: int
    variances: tuple[ChangeVariances, ...]
    dof: float
    slope_dof: float
    rate: float

    def expanded_after(self, own: float, shared: float, years: float) -> float:
        """Return U, SI, some years after a calibration.

        Parameters
        ----------
        own, shared : float
            Variances of the calibration: the independent part, and the part that calibrations
            share.
        years : float
        """
        factor, of_slope = expanded_uncertainty(np.ones(2), np.array([self.dof, self.slope_dof]))
        squares = [
            factor**2 * (2 * one.scatter + own + one.walk * years)
            + of_slope**2 * one.slope * years**2
            for one in self.variances
        ]
        return float(np.sqrt(max(squares) + COVERAGE**2 * shared))

    def is_of_type(self, trend: CoefficientTrend) -> bool:
        """Return whether the calibrations of a sensor scatter like others of its type."""
        if trend.time.size < 2:
            return True
        block = _block(trend, 1.0, 1.0)
        largest = max(self.variances, key=sum)
        v = block.covariance + sum(s * h @ h.T for s, h in zip(largest, block.factors, strict=True))
        inverse = np.linalg.inv(v)
        weights = inverse.sum(axis=0)
        off = block.y - weights @ block.y / weights.sum()
        return chi2_p_value(float(off @ inverse @ off), off.size - 1) >= _LEAST_P


@dataclass(frozen=True, eq=False)
class TypePool:
    """The scatter and drift of the sensors of a type.

    Parameters
    ----------
    type_name : str
        Printed name of the type, such as "QA 2000"; empty if the user named the sensors.
    sensors : tuple of str
        The sensors with two or more calibrations.
    changes : mapping of str to PooledChange
        Changes by full name of the coefficient.
    longest : float
        Longest interval between calibrations, years.
    """

    type_name: str
    sensors: tuple[str, ...]
    changes: dict[str, PooledChange]
    longest: float


def type_pool(
    register: "Register", own: SensorHistory, like: Sequence[str] = ()
) -> TypePool | None:
    """Return the pool of the sensors of a type; None if the type is unknown or the pool is empty.

    The pool is empty if no sensor has two calibrations.

    Parameters
    ----------
    register : Register
    own : SensorHistory
        History of the sensor in question; it belongs to the pool if it has two calibrations.
    like : sequence of str
        Names of the other sensors. By default, these are all sensors whose newest calibration
        states the same model and maker in [job].

    Raises
    ------
    InputError
        If a named sensor does not exist, was never calibrated, or has no axis in common with this
        sensor.
    """
    name = "" if like else _type_name(own)
    others = (
        [register.history(one) for one in dict.fromkeys(like) if one != own.sensor.name]
        if like
        else _histories_of_type(register, own, name)
    )
    if like:
        for one in others:
            if not {t.name for t in one.trends} & {t.name for t in own.trends}:
                raise InputError(
                    f"--like {one.sensor.name}: this sensor has no coefficient of "
                    f"{own.sensor.name}",
                    key="--like",
                    names=(one.sensor.name,),
                )
    return pool_of_histories(own, others, name)


def pool_of_histories(
    own: SensorHistory, others: Sequence[SensorHistory], type_name: str = ""
) -> TypePool | None:
    """Return the pool of several histories; None if no sensor has two calibrations.

    Calibrations are omitted if their frame or form differs from the newest calibration in `own`.
    """
    newest = own.entries[-1].calibration
    terms = newest.frame, newest.sensor.form
    pooled = [
        one
        for one in (own, *others)
        if (of := one.entries[-1].calibration) and (of.frame, of.sensor.form) == terms
    ]
    trends: dict[str, list[tuple[str, CoefficientTrend]]] = {}
    for one in pooled:
        for trend in one.trends:
            if np.ptp(trend.time[-len(trend.shared) :]) > 0:
                trends.setdefault(trend.name, []).append((one.sensor.name, trend))
    names = [one.name for one in own.trends if one.name in trends]
    if not names:
        return None
    changes: dict[str, PooledChange] = {}
    for places in similar_coefficients(newest.sensor, names).values():
        alike = [names[k] for k in places]
        found = [trend for name in alike for _, trend in trends[name]]
        together = pooled_change(found)
        for name in alike:
            mine = [trend for _, trend in trends[name]]
            alone = pooled_change(mine) if len(alike) > 1 else together
            changes[name] = replace(
                alone,
                variances=(*together.variances, *alone.variances),
                dof=together.dof,
                slope_dof=together.slope_dof,
            )
    used = {sensor for of_name in trends.values() for sensor, _ in of_name}
    gaps = [float(np.diff(one.time).max()) for name in names for _, one in trends[name]]
    return TypePool(
        type_name,
        tuple(one.sensor.name for one in pooled if one.sensor.name in used),
        changes,
        max(gaps),
    )


def pooled_change(found: Sequence[CoefficientTrend]) -> PooledChange:
    """Return the pooled change of coefficients with equal variances and at least two values."""
    parts = (_ALL,) if max(len(one.shared) for one in found) > 2 else _ALONE
    return PooledChange(
        len(found),
        tuple(_variances(found, one) for one in parts),
        float(sum(len(one.shared) - 1 for one in found)),
        float(len(found)),
        max(map(_rate, found)),
    )


def _type_name(own: SensorHistory) -> str:
    job = own.entries[-1].calibration.job
    return " ".join(job[key] for key in ("maker", "model") if key in job) if "model" in job else ""


def _histories_of_type(register: "Register", own: SensorHistory, name: str) -> list[SensorHistory]:
    if not name:
        return []
    found: list[SensorHistory] = []
    sensors = sorted(register.sensors(), key=lambda one: one.last or "", reverse=True)
    for one in sensors:
        if one.calibrations < 2 or one.id == own.sensor.id:
            continue
        (newest,) = register.calibrations(one.id, 1)
        job = newest.calibration.job
        stated = own.entries[-1].calibration.job
        if all(job.get(key) == stated.get(key) for key in ("maker", "model")):
            found.append(register.history(one.id))
        if len(found) == MOST_SENSORS:
            break
    return found


def _rate(trend: CoefficientTrend) -> float:
    gaps = np.diff(trend.time)
    steps = np.abs(np.diff(trend.values))
    return float((steps[gaps > 0] / gaps[gaps > 0]).max())


def _block(trend: CoefficientTrend, unit: float, span: float) -> MeasurementBlock:
    """Return the newest values, scaled by `unit` and `span`, with factors for τ, q and σ_b."""
    n = len(trend.shared)
    at = (trend.time[-n:] - trend.time[-n]) / span
    walk = np.tril(np.ones((n, n))) * np.sqrt(np.diff(at, prepend=at[0]))
    known = np.diag(trend.independent_variance) + trend.shared
    values = trend.values[-n:]
    return MeasurementBlock(
        (values - values.mean()) / unit,
        np.ones((n, 1)),
        known / unit**2,
        (np.eye(n), walk, at[:, None]),
    )


def _variances(found: Sequence[CoefficientTrend], parts: tuple[int, ...]) -> ChangeVariances:
    """Estimate the common variances of trends for the chosen parts; the other variances are 0."""
    newest = [(one.values[-len(one.shared) :], one.std[-len(one.shared) :]) for one in found]
    within = np.mean([np.var(values, ddof=1) for values, _ in newest])
    unit = float(np.sqrt(within + np.mean([np.mean(std**2) for _, std in newest])))
    span = max(float(np.ptp(one.time[-len(one.shared) :])) for one in found)
    blocks = [_block(one, unit, span) for one in found]
    blocks = [one._replace(factors=[one.factors[k] for k in parts]) for one in blocks]
    start = np.full(len(parts), 0.2 * float(within) / unit**2)
    tau2, walk, slope = np.bincount(parts, pooled_variances(blocks, start).variance, minlength=3)
    square = unit**2
    return ChangeVariances(
        square * float(tau2), square * float(walk) / span, square * float(slope) / span**2
    )
