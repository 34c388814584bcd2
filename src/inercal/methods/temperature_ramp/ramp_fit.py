"""Fit a ramp by generalised least squares: coefficients, constants, and the lag if unknown.

The candidates for score tests are temperature terms, a drift, and a warm-up. A warm-up exp(−t/τ)
has an unknown time constant. The search selects the time constant that explains the residuals best.
The derivative with respect to ln τ is also a component of the candidate, so the significance of the
test allows for the search.

The model computes readings and their derivatives axis by axis.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName, ErrorName
from inercal.basics.run_file_advice import Change
from inercal.estimation import Candidate, Estimate, Gaussian, Problem, least_squares
from inercal.estimation.problem import Linearise
from inercal.methods import Priors
from inercal.methods.candidates import (
    Column,
    candidate,
    coefficient_column,
    extended_sensor,
    prior_candidates,
    together_and_alone,
)
from inercal.methods.temperature_ramp.blocks import RampBlocks
from inercal.physics.earth import EARTH_RATE
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import G0, Sensor
from inercal.physics.sensors.coefficient_tables import BIAS_UNITS
from inercal.recordings import Observations
from inercal.recordings.environment import Environment

LAG = "lag"
_LONGEST = 0.5  # of the recording's duration; a slower warm-up is a drift
_COARSE, _FINE = 16, 9  # number of time constants that are tried
WIDEST_LAG = 300.0  # s, standard deviation of the lag if it is not stated
_NATURAL = {"f": G0, "w": 1.0}


class RampModel(NamedTuple):
    """The model for one recording.

    Parameters
    ----------
    blocks : RampBlocks
    sensor : Sensor
        Biases and temperature terms are the only coefficients.
    whitening : list of (b, b) array
        Whitening matrix for each axis.
    nuisances : tuple of str
        The constants, "constant[gx]", a warm-up, and the lag if it is estimated.
    lag : float
        The lag if it is not estimated, s.
    warm_up : float
        Time constant of a warm-up, s; 0 means none.
    node_shift : (k,) array or None
        For a coarse thermometer: change of the temperature curve's nodes from their values before
        the fit, K.
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
        """Return the lag for parameters x, s."""
        return float(x[self.names.index(LAG)]) if LAG in self.nuisances else self.lag

    def temperature_offset(self, x: Array) -> Array:
        """Return ΔT of the sensing element in the blocks, (b,) K."""
        kelvin, rate = self._course()
        return kelvin + self.lag_of(x) * rate - self.sensor.reference_temperature

    def node_effect(self, x: Array) -> Array:
        """Return the sensitivity of the block temperatures to the nodes, (b, k)."""
        course = self.blocks.course
        assert course is not None
        return course.kelvin + self.lag_of(x) * course.rate

    def _course(self) -> tuple[Array, Array]:
        """Return R and dR/dt in the blocks, (b,) K and K/s."""
        blocks, shift = self.blocks, self.node_shift
        if blocks.course is None or shift is None:
            return blocks.kelvin, blocks.rate
        return (
            blocks.kelvin + blocks.course.kelvin @ shift,
            blocks.rate + blocks.course.rate @ shift,
        )

    def slope(self, x: Array, k: int) -> Array:
        """Return db/dT for axis k in the blocks, (b,) SI per K."""
        return self._of_axis(x, k)[1]

    def largest_shift(self, x: Array, k: int) -> float:
        """Return the largest shift of axis k's bias per second of lag, in its unit."""
        size, _ = BIAS_UNITS[self.sensor.axes[k].measures]
        return float(np.abs(self.slope(x, k) * self.blocks.rate).max()) / size

    def steepest_axis(self, x: Array) -> int:
        """Return the axis that an error of the lag affects most, relative to its noise."""
        shifts = [
            np.abs(whitening @ (self.slope(x, k) * self.blocks.rate)).max()
            for k, whitening in enumerate(self.whitening)
        ]
        return int(np.argmax(shifts))

    def residual(self, x: Array) -> Array:
        """Return the readings minus the model's readings, (b, m) SI."""
        axes = range(len(self.sensor.axes))
        return self.blocks.reading - np.stack([self._of_axis(x, k)[0] @ x for k in axes], axis=-1)

    def linearise(self, x: Array) -> tuple[Array, Array]:
        """Return the whitened residual, (b m,), axis after axis, and its Jacobian."""
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
        """Return an axis's Jacobian without the lag, (b, p), and its db/dT, (b,)."""
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
    """Return the model for a recording.

    Parameters
    ----------
    observations : Observations
        One row, with the track of the recording, from one trial.
    sensor : Sensor
        The sensor with its noise.
    environment : Environment or None

    Raises
    ------
    InputError
        There is no temperature or white noise, the recording is too short, or a warm-up is stated
        for a one-way ramp.
    """
    track = observations.track
    if track is None or track.temperature is None:
        raise InputError(
            "[data] temperature is missing, but a ramp needs the recorded temperature; name "
            "its column",
            key="[data] temperature",
        )
    blocks = RampBlocks.from_track(track)
    environment = environment or Environment("ramp")
    if environment.warm_up and blocks.is_monotonic:
        raise InputError(
            "[environment] warm_up: the temperature only rises or only falls, so a warm-up cannot "
            "be separated from the polynomial; go up and down, or remove warm_up and switch on "
            f"{5 * environment.warm_up:.0f} s before the recording",
            key="[environment] warm_up",
        )
    nuisances = [f"constant[{name}]" for name in sensor.channels]
    if environment.warm_up:
        nuisances += [f"warm_up[{name}]" for name in sensor.channels]
    stated = environment.lag
    # For a linear bias, the lag and the dT/dt term have the same effect, so with this term the lag
    # must be known.
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


def fit_ramp(model: RampModel, priors: Priors, environment: Environment) -> Estimate:
    """Return the estimate for a ramp.

    Parameters
    ----------
    model : RampModel
    priors : sequence of Gaussian
        Priors on coefficients.
    environment : Environment
        The environment, which states the lag or leaves it unknown.
    """
    rows = model.blocks.time.size * len(model.sensor.axes)
    lag = 0.0 if environment.lag is None else environment.lag.value

    def candidates(x: Array) -> list[Candidate]:
        found = _coefficient_candidates(model, x) + _drift_candidates(model)
        column = dict(zip(model.names, model.linearise(x)[1].T, strict=True))
        found += prior_candidates(model.sensor, model.names, priors, column)
        return found + _warm_up_candidates(model, x)

    return solve_ramp(model, priors, environment, model.linearise, rows, lag, candidates)


def solve_ramp(
    model: RampModel,
    priors: Priors,
    environment: Environment,
    linearise: Linearise,
    rows: int,
    lag: float,
    candidates: Callable[[Array], Sequence[Candidate]] | None = None,
) -> Estimate:
    """Solve the whitened rows from `linearise`, starting at the given lag, s."""
    names, sensor = model.names, model.sensor
    scale = np.array([*sensor.unit_scale, *(_size(name, sensor) for name in model.nuisances)])
    # At zero coefficients the lag has no effect, so the search starts from a fit at the given lag.
    start = np.zeros(len(names))
    if LAG in model.nuisances:
        start[-1] = lag
    residual, jacobian = model.linearise(start)
    free = [k for k, name in enumerate(names) if name != LAG]
    by = np.linalg.lstsq(jacobian[:, free] * scale[free], residual, rcond=1e-12)[0]
    start[free] += by * scale[free]
    return least_squares(
        Problem(
            names,
            start,
            linearise,
            np.ones(rows),
            scale,
            priors=(*priors, *_nuisance_priors(model, environment)),
            wanted=sensor.coefficients,
            candidates=candidates,
        )
    )


def _size(name: str, sensor: Sensor) -> float:
    """Return the natural size of a nuisance, SI."""
    if name == LAG:
        return 100.0
    axis = ErrorName(name).place
    return _NATURAL[sensor.measures[axis]]


def _nuisance_priors(model: RampModel, environment: Environment) -> list[Gaussian]:
    """Return priors on the constants and on the lag.

    The attitude is unknown, so a component of the earth's rate is treated as 0 ± Ω/√3 and a
    component of gravity as 0 ± g. An accelerometer's bias affects only the constant.
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


def _column(model: RampModel, k: int, values: Array) -> Array:
    """Return the effect of block values (b,) on axis k on the whitened rows, (b m,)."""
    parts = [np.zeros(len(values)) for _ in model.sensor.axes]
    parts[k] = model.whitening[k] @ values
    return np.concatenate(parts)


def _coefficient_candidates(model: RampModel, x: Array) -> list[Candidate]:
    sensor, seen = model.sensor, {"dT": model.temperature_offset(x), "dTdt": model.blocks.rate}
    larger = extended_sensor(sensor, temperature_varies=True)
    members: dict[str, list[Column]] = {}
    for full in larger.coefficients:
        line = larger.coefficient(full)
        axis, term = CoefficientName(full).parts
        inputs = {c for product in line.basis.products for c in product.components}
        # For a linear bias, a dT/dt term has the same effect as the lag.
        if full in sensor.coefficients or not inputs or not inputs <= set(seen):
            continue
        if "dTdt" in inputs and LAG in model.nuisances:
            continue
        k = [one.name for one in sensor.axes].index(axis)
        column = _column(model, k, np.asarray(line.basis.value(seen)))
        members.setdefault(term, []).append(coefficient_column(larger, full, column))
    return [
        one for family in members.items() for one in together_and_alone("coefficient", [family])
    ]


def _drift_candidates(model: RampModel) -> list[Candidate]:
    """Return a candidate for drift, linear in time from the first block to the last."""
    time = model.blocks.time
    shape = (time - time.mean()) / max(float(np.ptp(time)), 1e-300)
    drifts = [
        Column(f"drift of {axis.name}", QUANTITIES[axis.measures].unit, _column(model, k, shape))
        for k, axis in enumerate(model.sensor.axes)
    ]
    return [candidate(one.name, "time", [one]) for one in drifts]


def _warm_up_candidates(model: RampModel, x: Array) -> list[Candidate]:
    """Return a warm-up of all axes, with the key that makes the method estimate it."""
    if model.warm_up or model.blocks.is_monotonic:
        return []
    residual, jacobian = model.linearise(x)
    length = np.linalg.norm(jacobian, axis=0)
    q, _ = np.linalg.qr(jacobian / np.where(length > 0, length, 1.0))
    time, axes = model.blocks.time, range(len(model.sensor.axes))

    def columns(tau: float) -> Array:
        return np.stack([_column(model, k, np.exp(-time / tau)) for k in axes], axis=-1)

    def explained(tau: float) -> float:
        left = columns(tau)
        left = left - q @ (q.T @ left)
        u, _ = np.linalg.qr(left)
        return float(np.sum((u.T @ residual) ** 2))

    shortest, longest = model.blocks.seconds, _LONGEST * float(time[-1])
    best, ratio, count = float(np.sqrt(shortest * longest)), np.sqrt(longest / shortest), _COARSE
    for _ in range(3):
        tried: Array = np.geomspace(best / ratio, best * ratio, count)
        best = max(tried.tolist(), key=explained)
        ratio, count = float(tried[1] / tried[0]), _FINE
    wave = np.stack([_column(model, k, time / best * np.exp(-time / best)) for k in axes], axis=-1)
    names = [axis.name for axis in model.sensor.axes]
    units = tuple(QUANTITIES[axis.measures].unit for axis in model.sensor.axes)
    return [
        Candidate(
            "warm_up",
            "time",
            (
                *(f"warm_up[{name}]" for name in names),
                *(f"change of warm_up[{name}] by ln τ" for name in names),
            ),
            (*units, *units),
            np.concatenate([columns(best), wave], axis=1),
            changes=(
                Change("environment", "kind", "ramp"),
                Change("environment", "warm_up", f"{best:.3g} s"),
            ),
        )
    ]
