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
from typing import NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.benches import Hand
from inercal.earth import EARTH_RATE
from inercal.environment import Environment
from inercal.environment.common_errors import with_temperature_shift
from inercal.errors import InputError
from inercal.estimate import Estimate, Gaussian, Problem, least_squares
from inercal.keys import CoefficientName, ErrorName
from inercal.methods._base import Method
from inercal.methods.temperature_ramp.blocks import RampBlocks
from inercal.methods.temperature_ramp.ramp_remarks import remarks
from inercal.plan import Hold
from inercal.recording import Observations
from inercal.sensors import G0, Sensor

LAG = "lag"
WIDEST_LAG = 300.0  # s, standard deviation of a lag that is not stated
_NATURAL = {"f": G0, "w": 1.0}


def rest(seconds: float = 3600.0) -> tuple[Hold, ...]:
    """Return the one rest of a ramp."""
    return (Hold("rest", (0.0, 0.0, 1.0), seconds),)


class RampModel(NamedTuple):
    """The model of one recording, whitened axis by axis.

    Parameters
    ----------
    blocks : RampBlocks
    sensor : Sensor
        Its coefficients are biases and terms of temperature.
    whitening : list of (b, b) array
        Of each axis.
    nuisances : tuple of str
        The constants, "constant[gx]", a warm-up, and the lag where it is estimated.
    lag : float
        s, where it is not estimated.
    warm_up : float
        Time constant of a warm-up, s; 0 is none.
    """

    blocks: RampBlocks
    sensor: Sensor
    whitening: list[Array]
    nuisances: tuple[str, ...]
    lag: float
    warm_up: float

    @property
    def names(self) -> tuple[str, ...]:
        """All parameters."""
        return (*self.sensor.coefficients, *self.nuisances)

    def lag_of(self, x: Array) -> float:
        """Return the lag of parameters x, s."""
        return float(x[self.names.index(LAG)]) if LAG in self.nuisances else self.lag

    def linearise(self, x: Array) -> tuple[Array, Array]:
        """Return the whitened residual, (b m,) axis after axis, and its Jacobian."""
        lag, blocks, names = self.lag_of(x), self.blocks, self.names
        dT = blocks.kelvin + lag * blocks.rate - self.sensor.reference_temperature
        seen = {"dT": dT, "dTdt": blocks.rate}
        residuals: list[Array] = []
        jacobians: list[Array] = []
        for k, axis in enumerate(self.sensor.axes):
            jacobian = np.zeros((blocks.time.size, len(names)))
            slope = np.zeros(blocks.time.size)
            for at, name in enumerate(self.sensor.coefficients):
                if CoefficientName(name).axis != axis.name:
                    continue
                basis = self.sensor.coefficient(name).basis
                jacobian[:, at] = basis.value(seen)
                for product in basis.derivative("dT"):
                    slope += x[at] * product.value(seen)
            jacobian[:, names.index(f"constant[{axis.name}]")] = 1.0
            if self.warm_up:
                at = names.index(f"warm_up[{axis.name}]")
                jacobian[:, at] = np.exp(-blocks.time / self.warm_up)
            reading = jacobian @ x
            if LAG in self.nuisances:
                jacobian[:, names.index(LAG)] = slope * blocks.rate
            residuals.append(self.whitening[k] @ (blocks.reading[:, k] - reading))
            jacobians.append(self.whitening[k] @ jacobian)
        return np.concatenate(residuals), np.concatenate(jacobians)


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
        )
    )
    # Thousands of residuals of blocks have no names of rows that a report could print.
    estimate = replace(estimate, residual=np.zeros(0), whitened=np.zeros(0))
    return with_temperature_shift(estimate, sensor, found.temperature_sd)


def ramp_model(
    observations: Observations, sensor: Sensor, environment: Environment | None
) -> RampModel:
    """Return the model of a recording; arguments and refusals as of `ramp`."""
    track = observations.track
    if track is None or track.temperature is None:
        raise InputError(
            "[data] temperature is missing: a ramp needs the recorded temperature; name its column",
            key="[data] temperature",
        )
    blocks = RampBlocks.from_track(track)
    environment = environment or Environment("ramp")
    if environment.warm_up and blocks.is_monotonic:
        raise InputError(
            "[environment] warm_up: the temperature goes one way, in which a warm-up cannot be "
            "told from the polynomial; go up and down, or remove warm_up and switch on "
            f"{5 * environment.warm_up:.0f} s before the recording",
            key="[environment] warm_up",
        )
    nuisances = [f"constant[{name}]" for name in sensor.channels]
    if environment.warm_up:
        nuisances += [f"warm_up[{name}]" for name in sensor.channels]
    stated = environment.lag
    # Where the bias is a line, lag and the term of dT/dt are one: with that term the lag is known.
    if not sensor.uses("dTdt") and (stated is None or stated.sd > 0):
        nuisances.append(LAG)
    return RampModel(
        blocks,
        sensor,
        blocks.whitening(sensor),
        tuple(nuisances),
        0.0 if stated is None else stated.value,
        environment.warm_up,
    )


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
