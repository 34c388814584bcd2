"""A ramp at rest: biases against temperature, with the lag of the temperature sensor.

The sensor rests while its temperature moves, by a chamber or by itself. Of each axis::

    y = a + b(T) + c dT/dt + noise,   T = R + τ dR/dt

b is the polynomial of the coefficients beyond the constant, R what the temperature sensor reads, τ
its lag, common to all axes, and a a constant: of a gyro the bias and what it senses of the earth's
rate, of an accelerometer the bias and its part of gravity. The noise is that which [sensor] states;
generalised least squares weigh blocks of samples by it. A thermometer that reports whole or half
degrees is followed along the instants at which its reading changes
(`inercal.methods.temperature_ramp.node_fit`).

Only biases are found: scale factors need motion. Of an accelerometer that reads the vertical part
f of gravity the result is b(T) + s(T) f.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inercal.benches import Hand
from inercal.estimation import Estimate, Gaussian
from inercal.methods._base import Method
from inercal.methods.temperature_ramp.node_fit import fit_along_nodes
from inercal.methods.temperature_ramp.ramp_fit import fit_ramp
from inercal.methods.temperature_ramp.ramp_model import ramp_model
from inercal.methods.temperature_ramp.ramp_remarks import remarks
from inercal.methods.temperature_ramp.thermometer_steps import TRUNCATION
from inercal.physics.plan import Hold
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations
from inercal.recordings.environment import Environment
from inercal.recordings.environment.soaks import with_temperature_shift


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
    NotObserved
        A lag that a coarse thermometer does not determine.
    """
    model = ramp_model(observations, sensor, environment)
    found = environment or Environment("ramp")
    fit = fit_ramp if model.blocks.course is None else fit_along_nodes
    # Thousands of residuals of blocks have no names of rows that a report could print.
    estimate = replace(fit(model, priors, found), residual=np.zeros(0), whitened=np.zeros(0))
    sd = found.temperature_sd or TRUNCATION * model.blocks.step
    return with_temperature_shift(estimate, sensor, sd)


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
