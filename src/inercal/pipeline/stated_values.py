"""Values that a run file states, checked against the data: white noise, and constants without "±".

White noise: uncertainties follow from the noise in the recording, except in filters, which use the
stated noise. A large difference shows a wrong noise, unit or scale factor. Besides white noise N a
mean over T contains bias instability B, random walk K and the quantisation step q: at most
B² + K² T/3 + q²/12 of variance, which is allowed for.

Constants of a bench without "±": their uncertainty is taken as half a unit of the last digit
(`inercal.units.parse_quantity`). Their part in u of a coefficient is the decrease of u when the
constant is taken as exact::

    part² = u² − u²(exact)

Where the part is larger than the rest, the assumption would determine the result: the run is
refused.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from inercal.arrays import Array
from inercal.benches import Bench
from inercal.errors import InputError
from inercal.estimate import Estimate
from inercal.parameters import Parameter
from inercal.plan import Rotation, Spin, Step, Turn
from inercal.recording import Finding, Observations
from inercal.sensors import Sensor
from inercal.units import Measured, format_quantity, format_value_and_uncertainty, si_factor

_LARGE_RATIO = 2.0  # of noise; 20 batches determine white noise within 20 %
_SEEN = 0.5  # steps: smaller noise is hidden by the rounding of the readings
_NOISE_UNITS = {"f": ("accelerometer", "m/s²", "µg/√Hz"), "w": ("gyro", "rad/s", "°/√h")}
_CONSTANT_UNITS = {  # of messages, by key of [bench]
    "gravity": "m/s²",
    "latitude": "°",
    "radius": "m",
    "stretch": "ppm/g",
    "azimuth": "°",
    "latency": "ms",
}


def check_stated_noise(
    observations: Observations, sensor: Sensor, steps: Sequence[Step], *, by_hand: bool
) -> tuple[Finding, ...]:
    """Return a warning for each kind of axes whose noise is not as stated.

    Parameters
    ----------
    observations : Observations
        Means of sections of a recording, without a trial axis.
    sensor : Sensor
    steps : sequence of r Step
        Of each row. In motion and in a hand readings contain more than the sensor's noise.
    by_hand : bool
        Whether the sensor is held by hand.
    """
    variance = np.diagonal(observations.covariance, axis1=-2, axis2=-1)
    rounding, hidden = observations.rounding, np.zeros(len(sensor.axes), dtype=np.bool_)
    if rounding is not None:
        variance = np.maximum(variance - rounding.variances, 0.0)
        hidden = (rounding.steps.step > 0) & (rounding.steps.noise < _SEEN)
    resting = np.array([not by_hand and _is_at_rest(step) for step in steps])
    duration = observations.duration[:, None]
    findings: list[Finding] = []
    for kind, (section, like, unit) in _NOISE_UNITS.items():
        own = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind and not hidden[k]]
        noises = [sensor.axes[k].noise for k in own]
        if not any(noise.white for noise in noises):
            continue
        stated = np.array([noise.white**2 for noise in noises])
        slow = np.array([n.bias_instability**2 + n.quantisation**2 / 12 for n in noises])
        walk = np.array([n.random_walk**2 for n in noises])
        most = stated + slow * duration + walk * duration**2 / 3
        density = variance[:, own] * duration
        low = np.median(density / stated, axis=0)
        high = np.median((density / most)[resting], axis=0) if resting.any() else np.ones(len(own))
        off = np.where(low < _LARGE_RATIO**-2, low, np.where(high > _LARGE_RATIO**2, high, 1.0))
        k = int(np.argmax(np.abs(np.log(off))))
        if off[k] == 1.0:
            continue
        size = si_factor(unit, f"({like})/√Hz")
        mean = float(np.sqrt(np.median(density[:, k])))
        name = sensor.axes[own[k]].name
        recorded, white = (
            format_value_and_uncertainty(0.0, x / size)[1] for x in (mean, noises[k].white)
        )
        text = (
            f"{name}: the noise of the recording is {recorded} {unit}, but [sensor.{section}] "
            f"white states {white} {unit}; check white, unit and scale of [sensor.{section}]"
        )
        findings.append(Finding("warning", "noise", text, name))
    return tuple(findings)


def _is_at_rest(step: Step) -> bool:
    """Return whether a step is at rest."""
    if isinstance(step, Spin):
        return step.rate == 0
    return not isinstance(step, Turn | Rotation)


def find_assumed_constants(expected: Mapping[str, Parameter]) -> dict[str, tuple[str, ...]]:
    """Return the keys of constants without "±", each with the names of its parameters.

    Parameters
    ----------
    expected : mapping of str to Parameter
        The bench's parameters that act, by full name.
    """
    names: dict[str, tuple[str, ...]] = {}
    for name, parameter in expected.items():
        if key := parameter.assumed:
            names[key] = (*names.get(key, ()), name)
    return names


def constant_notes(bench: Bench, assumed: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Return a line for each constant without "±": the uncertainty that was used."""
    return tuple(f"{_describe_constant(bench, key)}; state ± to replace it" for key in assumed)


def _describe_constant(bench: Bench, key: str) -> str:
    constant: Measured | tuple[Measured, ...] = getattr(bench, key)
    each = (constant,) if isinstance(constant, Measured) else constant
    widest = max((value for value in each if value.assumed), key=lambda value: value.sd)
    unit = _CONSTANT_UNITS[key]
    u = format_value_and_uncertainty(0.0, widest.sd / si_factor(unit))[1]
    return (
        f"{key} {format_quantity(widest.value, 0.0, unit)} is stated without ±: half a unit of its "
        f"last digit is taken, u = {u} {unit}"
    )


def require_small_assumed_share(
    assumed: Mapping[str, tuple[str, ...]],
    estimate: Estimate,
    count: int,
    bench: Bench,
    solve: Callable[[Bench], Estimate],
) -> None:
    """Refuse an assumed uncertainty that is the larger part of u of a coefficient.

    Parameters
    ----------
    assumed : mapping of str to tuple of str
        Keys of the constants, with the names of their parameters.
    estimate : Estimate
        Its first `count` parameters are the sensor's coefficients.
    count : int
    bench : Bench
    solve : callable
        Returns the estimate on another bench; used where a constant is not a parameter of the
        estimate.

    Raises
    ------
    InputError
        The message names the key, the coefficient and the share.
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
    """Return the decrease of each variance when these parameters are exact, (count,)."""
    at = [estimate.names.index(name) for name in names]
    own = estimate.covariance[np.ix_(at, at)]
    cross = estimate.covariance[:count, at]
    return np.einsum("ij,jk,ik->i", cross, np.linalg.pinv(own, hermitian=True), cross)


def _with_exact_constant(bench: Bench, key: str) -> Bench:
    """Return the bench with the constants of a key exact."""
    constant: Measured | tuple[Measured, ...] = getattr(bench, key)
    exact: Any = (
        replace(constant, sd=0.0)
        if isinstance(constant, Measured)
        else tuple(replace(value, sd=0.0) for value in constant)
    )
    return replace(bench, **{key: exact})
