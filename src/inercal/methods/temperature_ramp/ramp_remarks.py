"""What is said of a ramp: lag, direction, hysteresis, drift, and what accelerometers mix."""

from typing import Any, NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.estimate import Estimate
from inercal.keys import CoefficientName
from inercal.methods._base import Fit, Remarks
from inercal.methods.temperature_ramp.blocks import RampBlocks
from inercal.recording import Finding
from inercal.sensors import G0, Sensor
from inercal.units import ZERO_CELSIUS

_STRONG = 0.9  # correlation of temperature and time
_BINS = 20  # of the temperature, in which rising and falling are compared
_UNITS = {"f": (1e-6 * G0, "µg"), "w": (np.pi / 180 / 3600, "°/h")}


class Hysteresis(NamedTuple):
    """Half of the difference between rising and falling at equal temperatures, by axis, SI."""

    axis: str
    kelvin: Array
    half: Array


def bias_slopes(blocks: RampBlocks, sensor: Sensor, c: Array, lag: float) -> dict[str, Array]:
    """Return db/dT of each axis at the blocks, (b,) SI per K."""
    dT = blocks.kelvin + lag * blocks.rate - sensor.reference_temperature
    seen = {"dT": dT, "dTdt": blocks.rate}
    result = {axis.name: np.zeros(dT.size) for axis in sensor.axes}
    for value, name in zip(c, sensor.coefficients, strict=True):
        for product in sensor.coefficient(name).basis.derivative("dT"):
            result[CoefficientName(name).axis] += value * product.value(seen)
    return result


def hysteresis(blocks: RampBlocks, estimate: Estimate, sensor: Sensor) -> list[Hysteresis]:
    """Return the loops of each axis; none where the temperature does not come back."""
    if blocks.is_monotonic:
        return []
    named = dict(zip(estimate.names, estimate.value.tolist(), strict=True))
    lag = named.get("lag", 0.0)
    dT = blocks.kelvin + lag * blocks.rate - sensor.reference_temperature
    seen = {"dT": dT, "dTdt": blocks.rate}
    edges: Array = np.linspace(float(dT.min()), float(dT.max()), _BINS + 1)
    place = np.minimum(np.searchsorted(edges[1:], np.asarray(dT)), _BINS - 1)
    found: list[Hysteresis] = []
    for k, axis in enumerate(sensor.axes):
        left = blocks.reading[:, k].copy()
        for name in sensor.coefficients:
            if CoefficientName(name).axis == axis.name:
                left -= named[name] * sensor.coefficient(name).basis.value(seen)
        kelvin: list[float] = []
        half: list[float] = []
        for one in range(_BINS):
            up = left[(place == one) & (blocks.rate > 0)]
            down = left[(place == one) & (blocks.rate < 0)]
            if up.size and down.size:
                kelvin.append(0.5 * float(edges[one] + edges[one + 1]))
                half.append(0.5 * float(up.mean() - down.mean()))
        at = np.array(kelvin) + sensor.reference_temperature
        found.append(Hysteresis(axis.name, at, np.array(half)))
    return found


def lag_and_rate_correlation(blocks: RampBlocks, slope: Array, whitening: Array) -> float:
    """Return the correlation of the lag with the term of dT/dt, of one axis.

    Both are estimated beside a constant and a polynomial of order 3.

    Parameters
    ----------
    slope : (b,) array
        db/dT.
    whitening : (b, b) array
    """
    span = 0.5 * float(np.ptp(blocks.kelvin))
    x = (blocks.kelvin - blocks.kelvin.mean()) / span
    beside = whitening @ np.stack([x**k for k in range(4)], axis=-1)
    both = whitening @ np.stack([slope * blocks.rate, blocks.rate], axis=-1)
    both /= np.linalg.norm(both, axis=0)
    basis = np.linalg.qr(beside)[0]
    rest = both - basis @ (basis.T @ both)
    sizes = np.linalg.norm(rest, axis=0)
    if not np.all(sizes > 0):
        return -1.0
    # The covariance of two columns is the inverse of their Gram matrix: the sign is reversed.
    return -float(rest[:, 0] @ rest[:, 1] / (sizes[0] * sizes[1]))


def remarks(fit: Fit[Any, Any]) -> Remarks:
    """Return what is said of a ramp."""
    track, sensor, estimate = fit.observations.track, fit.sensor, fit.estimate
    assert track is not None
    blocks = RampBlocks.from_track(track)
    named = list(estimate.names)
    fitted = "lag" in named
    lag = float(estimate.value[named.index("lag")]) if fitted else 0.0
    lag_sd = float(estimate.std[named.index("lag")]) if fitted else 0.0
    slopes = bias_slopes(blocks, sensor, estimate.value[: len(sensor.coefficients)], lag)
    whitening = blocks.whitening(sensor)
    fastest = float(np.abs(blocks.rate).max())
    notes: list[str] = []
    findings: list[Finding] = []
    conditions: dict[str, str] = {}
    steepest = max(
        range(len(sensor.axes)),
        key=lambda k: float(
            np.abs(whitening[k] @ (slopes[sensor.channels[k]] * blocks.rate)).max()
        ),
    )
    axis = sensor.axes[steepest]
    size, unit = _UNITS[axis.measures]
    slope = slopes[axis.name]
    shift = float(np.abs(slope * blocks.rate).max()) / size
    if fitted:
        text = f"{lag:.1f} ± {2 * lag_sd:.1f} s (k = 2)"
        conditions["lag of the temperature"] = text
        r = lag_and_rate_correlation(blocks, slope, whitening[steepest])
        notes.append(
            f"the recorded temperature is behind the sensing element by {text}; the correlation of "
            f"this lag with a term of dT/dt is {r:+.4f}, and only one of the two is estimated"
        )
    else:
        notes.append(
            "the lag of the temperature is taken as stated: where the bias is a line in "
            "temperature, a term of dT/dt and the lag are one"
        )
    walk = axis.noise.random_walk * float(np.sqrt(blocks.time[-1])) / size
    notes.append(
        f"the temperature moves at {60 * fastest:.2f} K/min at most; on {axis.name} an error of "
        f"the lag by its u shifts b(T) by {shift * lag_sd:.2g} {unit}, and the random walk of the "
        f"bias over the run is {walk:.2g} {unit}"
    )
    if blocks.is_monotonic:
        findings.append(
            Finding(
                "warning",
                "one_way",
                f"the temperature goes one way: b(T) is shifted by b′ Ṫ τ, {shift:.2g} {unit} a "
                f"second of lag on {axis.name}, unless τ is known; go up and down, or state "
                "[environment] lag",
            )
        )
    correlation = float(np.corrcoef(blocks.kelvin, blocks.time)[0, 1])
    conditions["correlation of temperature and time"] = f"{correlation:+.3f}"
    if abs(correlation) > _STRONG:
        findings.append(
            Finding(
                "warning",
                "drift_in_time",
                f"temperature and time rise together (correlation {correlation:+.3f}): a drift in "
                "time cannot be told from b(T); go up and down",
            )
        )
    for one in hysteresis(blocks, estimate, sensor):
        if not one.half.size:
            continue
        measures = sensor.axes[sensor.channels.index(one.axis)].measures
        size, unit = _UNITS[measures]
        k = int(np.abs(one.half).argmax())
        conditions[f"hysteresis of {one.axis}"] = (
            f"{one.half[k] / size:+.3g} {unit} at {one.kelvin[k] - ZERO_CELSIUS:.1f} °C"
        )
    if any(key.startswith("hysteresis") for key in conditions):
        notes.append(
            "half the loop between rising and falling temperature (conditions) is not corrected; "
            "it adds its size over √3 to u of each use"
        )
    if sensor.select_axes("f").axes:
        notes.append(
            "a rest does not separate bias and scale factor of accelerometers: an axis along "
            "gravity shows b(T) + s(T) · 1 g, and a case that bends with temperature adds g times "
            "its tilt to the level axes"
        )
    return Remarks(tuple(findings), tuple(notes), conditions)
