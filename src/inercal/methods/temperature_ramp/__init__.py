"""Estimate biases as functions of temperature from a temperature ramp at rest.

The sensor is at rest while its temperature changes, in a chamber or by itself. For each axis::

    y = a + b(T) + c dT/dt + noise,   T = R + τ dR/dt

b is the polynomial of the coefficients other than the constant. R is the reading of the temperature
sensor, and τ its lag, which is common to all axes. The constant a is the bias plus the sensed part
of the earth's rate for a gyro, or plus the sensed part of gravity for an accelerometer. The noise
comes from [sensor], and generalised least squares use it to weight blocks of samples. For a
thermometer that reports whole or half degrees, the temperature is derived from the instants at
which its reading changes (`inercal.methods.temperature_ramp.node_fit`).

Only biases are estimated, because scale factors need motion. For an accelerometer that reads the
vertical part f of gravity, the result is b(T) + s(T) f.

Findings and notes state the lag, the direction, hysteresis and drift, and which effects cannot be
separated for accelerometers.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import ZERO_CELSIUS, format_quantity
from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.methods import Fit, Method, Priors, Remarks
from inercal.methods.temperature_ramp.blocks import RampBlocks
from inercal.methods.temperature_ramp.node_fit import NodeProblem, fit_along_nodes
from inercal.methods.temperature_ramp.ramp_fit import (
    LAG,
    WARM_UP_RATE,
    RampModel,
    fit_ramp,
    loop_shape,
    ramp_model,
)
from inercal.methods.temperature_ramp.sudden_changes import sudden_change
from inercal.methods.temperature_ramp.thermometer_steps import TRUNCATION
from inercal.physics.plan import Hold
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_tables import BIAS_UNITS
from inercal.recordings import Finding, Observations
from inercal.recordings.environment import Environment
from inercal.recordings.soaks import with_temperature_shift
from inercal.recordings.temperature import FOUND_LAG

_SURE = 4.0  # standard deviations of a loop that is reported
_STRONG = 0.9  # correlation between temperature and time
_BINS = 20  # number of temperature bins in which rising and falling are compared


def rest(seconds: float = 3600.0) -> tuple[Hold, ...]:
    """Return the plan for a ramp, which is a single rest."""
    return (Hold("rest", (0.0, 0.0, 1.0), seconds),)


def ramp(
    observations: Observations,
    sensor: Sensor,
    bench: Hand,
    steps: Sequence[Hold],
    priors: Priors = (),
    *,
    environment: Environment | None = None,
) -> Estimate:
    """Return the biases against temperature, with constants and lag as nuisances.

    Parameters
    ----------
    observations : Observations
        One row, with the track of the recording, from one trial.
    sensor : Sensor
        The sensor with its noise.
    bench : Hand
    steps : sequence of Hold
    priors : sequence of Gaussian
        Priors on coefficients.
    environment : Environment, optional
        The lag and its uncertainty, the error of the temperature, and the warm-up.

    Raises
    ------
    InputError
        There is no temperature or white noise, the recording is too short, or a warm-up is stated
        for a one-way ramp.
    NotObserved
        A coarse thermometer does not determine the lag.
    """
    model = ramp_model(observations, sensor, environment)
    found = environment or Environment("ramp")
    fit = fit_ramp if model.blocks.course is None else fit_along_nodes
    # The residuals of thousands of blocks have no row names that a report could print.
    estimate = replace(fit(model, priors, found), residual=np.zeros(0), whitened=np.zeros(0))
    sd = found.temperature_sd or TRUNCATION * model.blocks.step
    return with_temperature_shift(estimate, sensor, sd)


class Hysteresis(NamedTuple):
    """Half the difference between rising and falling at equal temperatures, for one axis, SI."""

    axis: str
    kelvin: Array
    half: Array


def hysteresis(model: RampModel, x: Array) -> list[Hysteresis]:
    """Return each axis's hysteresis loop beyond the model; the list is empty for a one-way ramp.

    Parameters
    ----------
    model : RampModel
    x : (p,) array
        The model's parameters, SI.
    """
    blocks, sensor = model.blocks, model.sensor
    if blocks.is_monotonic:
        return []
    dT, residual = model.temperature_offset(x), model.residual(x)
    edges: Array = np.linspace(float(dT.min()), float(dT.max()), _BINS + 1)
    place = np.minimum(np.searchsorted(edges[1:], dT), _BINS - 1)
    found: list[Hysteresis] = []
    for k, axis in enumerate(sensor.axes):
        kelvin: list[float] = []
        half: list[float] = []
        for one in range(_BINS):
            up = residual[(place == one) & (blocks.rate > 0), k]
            down = residual[(place == one) & (blocks.rate < 0), k]
            if up.size and down.size:
                kelvin.append(0.5 * float(edges[one] + edges[one + 1]))
                half.append(0.5 * float(up.mean() - down.mean()))
        at = np.array(kelvin) + sensor.reference_temperature
        found.append(Hysteresis(axis.name, at, np.array(half)))
    return found


def lag_and_rate_correlation(blocks: RampBlocks, slope: Array, whitening: Array) -> float:
    """Return the correlation between the lag and the term of dT/dt on one axis.

    Lag and term are estimated together with a constant and a polynomial of order 3.

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
    # The covariance of two columns is the inverse of their Gram matrix, so the sign is reversed.
    return -float(rest[:, 0] @ rest[:, 1] / (sizes[0] * sizes[1]))


def remarks(fit: Fit[Any, Any]) -> Remarks:
    """Return the findings, notes and conditions for a ramp."""
    model, x = ramp_model(fit.observations, fit.sensor, fit.environment), fit.estimate.value
    linearise = model.linearise
    if model.blocks.course is not None:
        problem = NodeProblem(model)
        model, linearise = problem.solved(x), problem.rows
    blocks, sensor = model.blocks, model.sensor
    loops = _loop_conditions(model, x)
    correlation = float(np.corrcoef(blocks.kelvin, blocks.time)[0, 1])
    conditions = {"correlation of temperature and time": f"{correlation:+.3f}"} | loops
    lag_sd = 0.0
    if LAG in model.nuisances:
        lag_sd = float(fit.estimate.std[model.names.index(LAG)])
        conditions[FOUND_LAG] = _lag_text(model.lag_of(x), lag_sd)
    if model.warm_up:
        at = model.names.index(WARM_UP_RATE)
        drifts = bool(x[at] < 2 * fit.estimate.std[at])
        time_constant = "none, a drift in time" if drifts else f"{1 / x[at]:.0f} s"
        conditions["time constant of the warm-up"] = time_constant
    notes = list(_lag_notes(model, x, lag_sd))
    if blocks.step:
        conditions["step of the thermometer"] = f"{blocks.step:.3g} K"
        notes += _step_notes(model, fit.environment)
    if sizes := list(_loop_uncertainties(model, x)):
        notes.append(
            "Hysteresis between rising and falling temperature is not corrected. Whenever the "
            f"sensor is used, add half the loop, divided by √3, to u: {', '.join(sizes)}."
        )
    if sensor.select_axes("f").axes:
        notes.append(
            "A rest cannot separate bias and scale factor of accelerometers: an axis along gravity "
            "reads b(T) + s(T) · 1 g. If the case bends with temperature, g times its tilt is "
            "added to the level axes."
        )
    findings = sudden_change(model, x, linearise(x), fit.estimate.std)
    lag_is_stated = fit.environment is not None and fit.environment.lag is not None
    if blocks.is_monotonic and not lag_is_stated:
        findings.append(_one_way_finding(model, x))
    if abs(correlation) > _STRONG:
        findings.append(
            Finding(
                "warning",
                "drift_in_time",
                f"temperature and time rise together (correlation {correlation:+.3f}), so a drift "
                "in time cannot be distinguished from b(T); let the temperature rise and fall",
            )
        )
    return Remarks(tuple(findings), tuple(notes), conditions)


def _lag_text(lag: float, sd: float) -> str:
    return f"{lag:.1f} ± {2 * sd:.1f} s (k = 2)"


def _loop_conditions(model: RampModel, x: Array) -> dict[str, str]:
    """Return half the width of each axis's largest loop, as text."""
    found: dict[str, str] = {}
    for one in hysteresis(model, x):
        if one.half.size:
            size, unit = BIAS_UNITS[model.sensor.measures[one.axis]]
            k = int(np.abs(one.half).argmax())
            found[f"hysteresis of {one.axis}"] = (
                f"{one.half[k] / size:+.3g} {unit} at {one.kelvin[k] - ZERO_CELSIUS:.1f} °C"
            )
    return found


def _loop_uncertainties(model: RampModel, x: Array) -> Iterator[str]:
    """Yield the uncertainty due to hysteresis of each axis whose residuals show a loop."""
    residual = model.residual(x)
    for k, one in enumerate(hysteresis(model, x)):
        shape = model.whitening[k] @ loop_shape(model)
        if abs(shape @ model.whitening[k] @ residual[:, k]) > _SURE * np.linalg.norm(shape):
            u = float(np.abs(one.half).max(initial=0.0)) / np.sqrt(3)
            unit = BIAS_UNITS[model.sensor.measures[one.axis]][1]
            yield f"{format_quantity(u, 0.0, unit, 2)} for {one.axis}"


def _lag_notes(model: RampModel, x: Array, lag_sd: float) -> tuple[str, str]:
    """Return notes on the lag, and on the errors from the lag and the bias's random walk."""
    blocks, k = model.blocks, model.steepest_axis(x)
    axis = model.sensor.axes[k]
    size, unit = BIAS_UNITS[axis.measures]
    shift = model.largest_shift(x, k)
    walk = axis.noise.random_walk * float(np.sqrt(blocks.time[-1])) / size
    fastest = 60 * float(np.abs(blocks.rate).max())
    if LAG in model.nuisances:
        r = lag_and_rate_correlation(blocks, model.slope(x, k), model.whitening[k])
        lag = (
            f"The recorded temperature {'lags' if model.lag_of(x) > 0 else 'leads'} the sensing "
            f"element by {_lag_text(abs(model.lag_of(x)), lag_sd)}. The correlation of this lag "
            f"with a term of dT/dt is {r:+.4f}, so only one of the two is estimated."
        )
        error = f"an error of the lag by its u shifts b(T) by {shift * lag_sd:.2g} {unit}"
    else:
        lag = (
            f"The lag of the temperature is taken as {model.lag:g} s and not estimated: if the "
            "bias is linear in temperature, a term of dT/dt and the lag have the same effect."
        )
        error = f"an error of the lag by 1 s shifts b(T) by {shift:.2g} {unit}"
    return lag, (
        f"The temperature changes by at most {fastest:.2f} K/min. On {axis.name} {error}; the "
        f"random walk of the bias over the run is {walk:.2g} {unit}."
    )


def _step_notes(model: RampModel, environment: Environment | None) -> Iterator[str]:
    """Yield notes on how the steps of a coarse thermometer affect the result."""
    blocks = model.blocks
    if blocks.course is not None:
        crossings = blocks.course.nodes.crossings
        refreshed = ""
        if crossings.refreshed > 1.5 * float(blocks.seconds / blocks.samples):
            refreshed = f", which is updated every {crossings.refreshed:.3g} s"
        yield (
            f"The thermometer reads in steps of {blocks.step:.3g} K{refreshed}. The temperature is "
            f"derived from the {crossings.time.size} instants at which its reading changes."
        )
    if environment is None or not environment.temperature_sd:
        yield (
            "It is not known whether the thermometer rounds or truncates. If it truncates, all "
            f"temperatures are {blocks.step / 2:.3g} K too low; U includes this. State "
            "[environment] temperature_sd if you know it."
        )


def _one_way_finding(model: RampModel, x: Array) -> Finding:
    k = model.steepest_axis(x)
    axis = model.sensor.axes[k]
    return Finding(
        "warning",
        "one_way",
        f"the temperature only rises or only falls: b(T) is shifted by b′ Ṫ τ, "
        f"{model.largest_shift(x, k):.2g} {BIAS_UNITS[axis.measures][1]} per second of lag on "
        f"{axis.name}, unless τ is known; go up and down, or state [environment] lag",
    )


METHOD = Method(
    name="temperature_ramp",
    bench=Hand,
    default_coefficients={"f": ("k0_dT",), "w": ("bias", "bias_dT")},
    also={"f": ("k0_dT2", "k0_dT3", "k0_dTdt"), "w": ("bias_dT2", "bias_dT3", "bias_dTdt")},
    needs=(),
    plan=rest,
    estimators={"gls": ramp},
    source="IEEE Std 952 and 1431, thermal tests; PX4 thermal calibration",
    unknown_attitudes=True,
    follows_rest=True,
    remarks=remarks,
)
