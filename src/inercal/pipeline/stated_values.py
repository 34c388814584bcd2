"""Bench constants stated without "±", and errors of qualified bench parameters.

The uncertainty of constants without "±" is assumed to be half a unit of the last digit
(`inercal.basics.units.parse_quantity`). The contribution of a constant to u of a coefficient is
found by assuming that the constant is exact::

    part² = u² − u²(exact)

If this part is larger than the rest, the run is refused, because the assumption would dominate the
result.

Calibrations with the same qualification share the covariance J Σ Jᵀ, where Σ is the covariance of
the bench parameters b₀ and J = ∂c/∂b₀. It is stored as the columns of J L, where Σ = L Lᵀ. Column j
is the part of parameter j that the previous parameters do not explain, so the columns are
independent.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parameters import Parameter
from inercal.basics.units import Measured, format_quantity, format_value_and_uncertainty, si_factor
from inercal.benches import Bench
from inercal.benches.qualification.joint_prior import joint_prior
from inercal.calibration import SharedError
from inercal.estimation import Estimate
from inercal.estimation.uncertainty import COVERAGE
from inercal.physics.earth import COMPUTED_GRAVITY_SD
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_selection import coefficient_words
from inercal.runfile import Run


def qualified_errors(
    run: Run, estimate: Estimate, expected: Mapping[str, Parameter], count: int
) -> tuple[SharedError, ...]:
    """Return the shared errors due to the qualified parameters.

    Parameters
    ----------
    run : Run
    estimate : Estimate
        Estimate whose first `count` parameters are the sensor's coefficients.
    expected : mapping of str to Parameter
        Bench parameters that have an effect, by full name.
    count : int
    """
    known = run.qualified.parameters
    declared = {one.name: one for one in run.bench.parameters}
    slopes = np.zeros((count, len(known.names)))
    for name in known.acting(expected):
        slope = estimate.sensitivity(name, expected[name].sd)
        if slope is not None:
            slopes[:, known.names.index(name)] = slope[:count]
    if not slopes.any():
        return ()
    # All are used, because a parameter without an effect may act through another parameter that
    # depends on it.
    root = np.linalg.cholesky(joint_prior(known)[1])
    parts = slopes @ root
    return tuple(
        SharedError(
            name,
            declared[name].unit,
            float(root[k, k]),
            parts[:, k] * root[k, k],
            known.determination[k],
            known.date[k],
        )
        for k, name in enumerate(known.names)
        if parts[:, k].any()
    )


def uncounted_notes(
    run: Run, estimate: Estimate, expected: Mapping[str, Parameter]
) -> tuple[str, ...]:
    """Return notes on qualifications that the uncertainty does not include, with reasons.

    There are two reasons: an estimator that treats the bench as exact does not use bench
    parameters, and some parameters have no effect in the steps of the run.
    """
    lines: list[str] = []
    for file, one in zip(run.qualified.files, run.qualified.each, strict=True):
        left_out = [name for name in one.names if not _is_counted(name, estimate, expected)]
        if not left_out:
            continue
        acting = any(q.name in left_out for q in expected.values())
        reason = (
            f"estimator {run.estimator} does not take it into account"
            if acting
            else "it has no effect in this run"
        )
        lines.append(
            f"Qualification {file}: the uncertainty of {', '.join(left_out)} is not included in U, "
            f"because {reason}. Its values do correct the bench."
        )
    return tuple(lines)


def _is_counted(name: str, estimate: Estimate, expected: Mapping[str, Parameter]) -> bool:
    found = [full for full, q in expected.items() if q.name == name and q.sd > 0]
    if any(estimate.sensitivity(full, expected[full].sd) is not None for full in found):
        return True
    # Parameters of a position or dwell may be eliminated together with the noise of its row.
    lasting = [full for full, q in expected.items() if q.scope == "run" and q.sd > 0]
    return any(expected[full].scope != "run" for full in found) and any(
        estimate.sensitivity(full, expected[full].sd) is not None for full in lasting
    )


def qualification_conditions(run: Run) -> dict[str, str]:
    """Describe the qualifications of a run."""
    return {
        f"qualification {file}": (
            f"{one.kind} of {one.date}"
            + (f", valid until {one.valid_until}" if one.valid_until else "")
            + (f", certificate {one.certificate}" if one.certificate else "")
        )
        for file, one in zip(run.qualified.files, run.qualified.each, strict=True)
    }


_MIN_IMPROVEMENT = 1.5  # a note is written if better gravity reduces U by this factor
_CONSTANT_UNITS = {  # units used in messages, by key of [bench]
    "gravity": "m/s²",
    "latitude": "°",
    "radius": "m",
    "stretch": "ppm/g",
    "azimuth": "°",
    "latency": "ms",
}


def find_assumed_constants(expected: Mapping[str, Parameter]) -> dict[str, tuple[str, ...]]:
    """Return the keys of constants without "±", each with the names of its parameters.

    Parameters
    ----------
    expected : mapping of str to Parameter
        Bench parameters that have an effect, by full name.
    """
    names: dict[str, tuple[str, ...]] = {}
    for name, parameter in expected.items():
        if key := parameter.assumed:
            names[key] = (*names.get(key, ()), name)
    return names


def constant_notes(bench: Bench, assumed: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Return a line for each constant without "±"; it states the assumed uncertainty."""
    return tuple(f"{_describe_constant(bench, key)}. State ± to replace it." for key in assumed)


def _describe_constant(bench: Bench, key: str) -> str:
    constant: Measured | tuple[Measured, ...] = getattr(bench, key)
    each = (constant,) if isinstance(constant, Measured) else constant
    widest = max((value for value in each if value.assumed), key=lambda value: value.sd)
    unit = _CONSTANT_UNITS[key]
    u = format_value_and_uncertainty(0.0, widest.sd / si_factor(unit))[1]
    return (
        f"{key} {format_quantity(widest.value, 0.0, unit)} is stated without ±, so its error is "
        f"assumed to be within half a unit of the last digit: u = {u} {unit}"
    )


def require_small_assumed_share(
    assumed: Mapping[str, tuple[str, ...]],
    estimate: Estimate,
    count: int,
    bench: Bench,
    solve: Callable[[Bench], Estimate],
) -> None:
    """Raise an error if an assumed uncertainty dominates u of a coefficient.

    Parameters
    ----------
    assumed : mapping of str to tuple of str
        Keys of the constants, with the names of their parameters.
    estimate : Estimate
        Estimate whose first `count` parameters are the sensor's coefficients.
    count : int
    bench : Bench
    solve : callable
        Function that returns the estimate for another bench. It is used if a constant is not a
        parameter of the estimate.

    Raises
    ------
    InputError
        If an assumed uncertainty dominates. The message names the key, the coefficient and the
        share.
    """
    variance = np.diagonal(estimate.covariance)[:count]
    for key, names in assumed.items():
        if all(name in estimate.names for name in names):
            part = _variance_part(estimate, count, names)
        else:
            exact = solve(_with_exact_constant(bench, key))
            part = np.maximum(variance - np.diagonal(exact.covariance)[:count], 0.0)
        if not (part > np.maximum(variance - part, 0.0)).any():
            continue
        k = int(np.argmax(part / np.where(variance > 0, variance, np.inf)))
        share = 100 * float(np.sqrt(part[k] / variance[k]))
        raise InputError(
            f"[bench] {_describe_constant(bench, key)}; that is {share:.0f} % of u of "
            f"{estimate.names[k]}, more than all other contributions: state ± of {key}, or ± 0 if "
            "it is exact",
            key=f"[bench] {key}",
            names=(estimate.names[k],),
        )


def _variance_part(estimate: Estimate, count: int, names: Sequence[str]) -> Array:
    """Return the decrease of each variance, (count,), if some parameters were exact."""
    at = [estimate.names.index(name) for name in names]
    own = estimate.covariance[np.ix_(at, at)]
    cross = estimate.covariance[:count, at]
    return np.einsum("ij,jk,ik->i", cross, np.linalg.pinv(own, hermitian=True), cross)


def _with_exact_constant(bench: Bench, key: str) -> Bench:
    """Return the bench with exact values of the constants of a key."""
    constant: Measured | tuple[Measured, ...] = getattr(bench, key)
    exact: Any = (
        replace(constant, sd=0.0)
        if isinstance(constant, Measured)
        else tuple(replace(value, sd=0.0) for value in constant)
    )
    return replace(bench, **{key: exact})


def gravity_notes(bench: Bench, sensor: Sensor, estimate: Estimate) -> tuple[str, ...]:
    """Return a note if gravity dominates the U of coefficients; more readings do not help.

    The note also states the U that would result if gravity were computed from latitude and height.

    Parameters
    ----------
    bench : Bench
    sensor : Sensor
    estimate : Estimate
        Estimate without a trial axis; its first parameters are the coefficients.
    """
    gravity, p = getattr(bench, "gravity", None), len(sensor.coefficients)
    if not isinstance(gravity, Measured) or not gravity.sd > COMPUTED_GRAVITY_SD:
        return ()
    slopes = estimate.sensitivity("g", gravity.sd)
    if slopes is None:
        return ()
    old = estimate.std[:p]
    left = (COMPUTED_GRAVITY_SD / gravity.sd) ** 2
    part = np.square(slopes[:p] * gravity.sd)
    new = np.sqrt(np.maximum(old**2 - (1 - left) * part, 0.0))
    weak = np.flatnonzero(old > _MIN_IMPROVEMENT * new)
    if not weak.size:
        return ()
    names = [sensor.coefficients[k] for k in weak]
    k = int(weak[np.argmax(new[weak])])
    line = sensor.coefficient(sensor.coefficients[k])
    before, after = (
        format_value_and_uncertainty(0.0, COVERAGE * float(sd[k]) / line.si)[1] for sd in (old, new)
    )
    u = format_value_and_uncertainty(0.0, COVERAGE * gravity.sd)[1]
    words = coefficient_words(sensor, ", ".join(names), names)
    return (
        f"Most of the U of the {words} comes from gravity (± {u} m/s²), so more readings cannot "
        "reduce it. State latitude and height, or measured gravity, in [bench]. With latitude and "
        f"height the U of {sensor.coefficients[k]} would drop from {before} to {after} "
        f"{line.unit}.",
    )
