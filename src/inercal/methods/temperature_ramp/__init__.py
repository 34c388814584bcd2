"""A ramp at rest: biases against temperature, with the lag of the temperature sensor.

The sensor rests while its temperature moves, by a chamber or by itself. Of each axis::

    y = a + b(T) + c dT/dt + noise,   T = R + τ dR/dt

b is the polynomial of the coefficients beyond the constant, R what the temperature sensor reads, τ
its lag, common to all axes, and a a constant: of a gyro the bias and what it senses of the earth's
rate, of an accelerometer the bias and its part of gravity. The noise is that which [sensor] states;
generalised least squares weigh blocks of samples by it.

Only biases are found: scale factors need motion. Of an accelerometer that reads the vertical part
f of gravity the result is b(T) + s(T) f.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inercal.benches import Hand
from inercal.earth import EARTH_RATE
from inercal.environment import Environment
from inercal.environment.common_errors import with_temperature_shift
from inercal.estimate import Estimate, Gaussian, Problem, least_squares
from inercal.keys import ErrorName
from inercal.methods._base import Method
from inercal.methods.temperature_ramp.ramp_candidates import ramp_candidates
from inercal.methods.temperature_ramp.ramp_model import LAG, RampModel, ramp_model
from inercal.methods.temperature_ramp.ramp_remarks import remarks
from inercal.plan import Hold
from inercal.recording import Observations
from inercal.sensors import G0, Sensor

WIDEST_LAG = 300.0  # s, standard deviation of a lag that is not stated
_NATURAL = {"f": G0, "w": 1.0}


def rest(seconds: float = 3600.0) -> tuple[Hold, ...]:
    """Return the one rest of a ramp."""
    return (Hold("rest", (0.0, 0.0, 1.0), seconds),)


def ramp(
    observations: Observations,
    sensor: Sensor,
    bench: Hand,
    steps: Sequence[Hold],
    priors: Sequence[Gaussian] = (),
    *,
    environment: Environment | None = None,
) -> Estimate:
    """Return the biases against temperature, with constants and lag as nuisances.

    Parameters
    ----------
    observations : Observations
        One row, with the track of the recording; of one trial.
    sensor : Sensor
        With its noise.
    bench : Hand
    steps : sequence of Hold
    priors : sequence of Gaussian
        On coefficients.
    environment : Environment, optional
        Lag and its uncertainty, error of the temperature, warm-up.

    Raises
    ------
    InputError
        No temperature, no white noise, too short a recording, or a warm-up of a one-way ramp.
    """
    model = ramp_model(observations, sensor, environment)
    found = environment or Environment("ramp")
    stated = [*priors, *_nuisance_priors(model, found)]
    names, rows = model.names, model.blocks.time.size * len(sensor.axes)
    scale = np.array([*sensor.unit_scale, *(_size(name, sensor) for name in model.nuisances)])
    # At zero coefficients the lag has no effect: the search starts from the fit without lag.
    start = np.zeros(len(names))
    if LAG in model.nuisances:
        start[-1] = 0.0 if found.lag is None else found.lag.value
    residual, jacobian = model.linearise(start)
    free = [k for k, name in enumerate(names) if name != LAG]
    by = np.linalg.lstsq(jacobian[:, free] * scale[free], residual, rcond=1e-12)[0]
    start[free] += by * scale[free]
    estimate = least_squares(
        Problem(
            names,
            start,
            model.linearise,
            np.ones(rows),
            scale,
            priors=tuple(stated),
            wanted=sensor.coefficients,
            candidates=ramp_candidates(model),
        )
    )
    # Thousands of residuals of blocks have no names of rows that a report could print.
    estimate = replace(estimate, residual=np.zeros(0), whitened=np.zeros(0))
    return with_temperature_shift(estimate, sensor, found.temperature_sd)


def _size(name: str, sensor: Sensor) -> float:
    """Return the natural size of a nuisance, SI."""
    if name == LAG:
        return 100.0
    axis = ErrorName(name).place
    return _NATURAL[next(a.measures for a in sensor.axes if a.name == axis)]


def _nuisance_priors(model: RampModel, environment: Environment) -> list[Gaussian]:
    """Return what is known of the constants and of the lag.

    The attitude is unknown: a component of the earth's rate is 0 with Ω/√3, one of gravity with g,
    and the bias of an accelerometer has a place in the constant alone.
    """
    result: list[Gaussian] = []
    for axis in model.sensor.axes:
        sd = EARTH_RATE / np.sqrt(3) if axis.measures == "w" else G0
        result.append(Gaussian.independent((f"constant[{axis.name}]",), [0.0], [sd]))
    if LAG in model.nuisances:
        stated = environment.lag
        value, sd = (0.0, WIDEST_LAG) if stated is None else (stated.value, stated.sd)
        result.append(Gaussian.independent((LAG,), [value], [sd]))
    return result


METHOD = Method(
    name="temperature_ramp",
    bench=Hand,
    default_coefficients={"f": ("k0_dT",), "w": ("bias", "bias_dT")},
    also={
        "f": ("k0_dT2", "k0_dT3", "k0_dTdt"),
        "w": ("bias_dT2", "bias_dT3", "bias_dTdt"),
    },
    needs=(),
    plan=rest,
    estimators={"gls": ramp},
    source="IEEE Std 952 and 1431, thermal tests; PX4 thermal calibration",
    unknown_attitudes=True,
    follows_rest=True,
    remarks=remarks,
)
