"""The model of a ramp at rest: readings and their derivatives, axis by axis."""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.methods.temperature_ramp.blocks import RampBlocks
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations
from inercal.recordings.environment import Environment

LAG = "lag"


class RampModel(NamedTuple):
    """The model of one recording.

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
    node_shift : (k,) array or None
        Of a coarse thermometer: by how much the nodes of its course differ from what they were
        before the fit, K.
    """

    blocks: RampBlocks
    sensor: Sensor
    whitening: list[Array]
    nuisances: tuple[str, ...]
    lag: float
    warm_up: float
    node_shift: Array | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """All parameters."""
        return (*self.sensor.coefficients, *self.nuisances)

    def lag_of(self, x: Array) -> float:
        """Return the lag of parameters x, s."""
        return float(x[self.names.index(LAG)]) if LAG in self.nuisances else self.lag

    def temperature_offset(self, x: Array) -> Array:
        """Return ΔT of the sensing element at the blocks, (b,) K."""
        kelvin, rate = self._course()
        return kelvin + self.lag_of(x) * rate - self.sensor.reference_temperature

    def node_effect(self, x: Array) -> Array:
        """Return the derivatives of the temperature at the blocks to the nodes, (b, k)."""
        course = self.blocks.course
        assert course is not None
        return course.kelvin + self.lag_of(x) * course.rate

    def _course(self) -> tuple[Array, Array]:
        """Return R and dR/dt at the blocks, (b,) K and K/s."""
        blocks, shift = self.blocks, self.node_shift
        if blocks.course is None or shift is None:
            return blocks.kelvin, blocks.rate
        return (
            blocks.kelvin + blocks.course.kelvin @ shift,
            blocks.rate + blocks.course.rate @ shift,
        )

    def slope(self, x: Array, k: int) -> Array:
        """Return db/dT of axis k at the blocks, (b,) SI per K."""
        return self._of_axis(x, k)[1]

    def largest_shift(self, x: Array, k: int, *, in_noise: bool = False) -> float:
        """Return what a second of lag shifts the bias of axis k at most, SI or in its noise."""
        shift = self.slope(x, k) * self.blocks.rate
        return float(np.abs(self.whitening[k] @ shift if in_noise else shift).max())

    def residual(self, x: Array) -> Array:
        """Return the readings less those of the model, (b, m) SI."""
        axes = range(len(self.sensor.axes))
        return self.blocks.reading - np.stack([self._of_axis(x, k)[0] @ x for k in axes], axis=-1)

    def linearise(self, x: Array) -> tuple[Array, Array]:
        """Return the whitened residual, (b m,) axis after axis, and its Jacobian."""
        residuals: list[Array] = []
        jacobians: list[Array] = []
        for k, whitening in enumerate(self.whitening):
            jacobian, slope = self._of_axis(x, k)
            residuals.append(whitening @ (self.blocks.reading[:, k] - jacobian @ x))
            if LAG in self.nuisances:
                jacobian[:, self.names.index(LAG)] = slope * self._course()[1]
            jacobians.append(whitening @ jacobian)
        return np.concatenate(residuals), np.concatenate(jacobians)

    def _of_axis(self, x: Array, k: int) -> tuple[Array, Array]:
        """Return the derivatives of an axis but to the lag, (b, p), and its db/dT, (b,)."""
        blocks, names, axis = self.blocks, self.names, self.sensor.axes[k]
        seen = {"dT": self.temperature_offset(x), "dTdt": self._course()[1]}
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
        return jacobian, slope


def ramp_model(
    observations: Observations, sensor: Sensor, environment: Environment | None
) -> RampModel:
    """Return the model of a recording.

    Parameters
    ----------
    observations : Observations
        One row, with the track of the recording; of one trial.
    sensor : Sensor
        With its noise.
    environment : Environment or None

    Raises
    ------
    InputError
        No temperature, no white noise, too short a recording, or a warm-up of a one-way ramp.
    """
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
        blocks.whitening(sensor, blocks.rounding_covariance(track, sensor)),
        tuple(nuisances),
        0.0 if stated is None else stated.value,
        environment.warm_up,
    )
