"""Fit a ramp by generalised least squares: coefficients, constants, and the lag if unknown.

A warm-up changes the bias by an amount per axis, with a time constant τ that all axes share::

    (e^{−t/τ} − e^{−L/τ})/(1 − e^{−L/τ}),    t = 0 … L

This is 1 at the start and 0 at the end of the recording, so the biases apply at the end. At 1/τ = 0
it is a drift linear in time. 1/τ is estimated too, and the stated τ only gives the prior
1/τ ± 1/τ, because a wrong τ would bias the coefficients.

The candidates for score tests are temperature terms, a drift, hysteresis, and a warm-up. For the
warm-up the search selects the time constant that explains the residuals best. The derivative with
respect to 1/τ is also a component of the candidate, so the significance of the test allows for the
search.

The model computes readings and their derivatives axis by axis.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName, ErrorName
from inercal.basics.run_file_advice import Change
from inercal.estimation import Candidate, Estimate, Gaussian, Problem, least_squares
from inercal.estimation.problem import Linearise
from inercal.estimation.scores import HYSTERESIS
from inercal.methods import Priors
from inercal.methods.candidates import (
    Column,
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
from inercal.recordings.temperature import first_order_response

LAG = "lag"
WARM_UP_RATE = "warm_up_rate"  # 1/τ
_LONGEST = 0.5  # of the recording's duration; a slower warm-up is a drift
_STEP = 0.01  # s, of the lag in derivatives
_STRAIGHT = 1e-6  # L/τ, of a drift that is linear in time
_TRIED = 40  # number of time constants
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
        The constants, "constant[gx]", a warm-up and its 1/τ, and the lag if it is estimated.
    lag : float
        The lag if it is not estimated, s.
    warm_up : float
        Time constant of a warm-up as stated, s; 0 means none.
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
        return self._of_element(*self._course(), self.lag_of(x)) - self.sensor.reference_temperature

    def node_effect(self, x: Array) -> Array:
        """Return the sensitivity of the block temperatures to the nodes, (b, k)."""
        course = self.blocks.course
        assert course is not None
        return self._of_element(course.kelvin, course.rate, self.lag_of(x))

    def _of_element(self, kelvin: Array, rate: Array, lag: float) -> Array:
        """Return the element's temperature; behind a low-pass filter if the thermometer leads."""
        if lag > -self.blocks.seconds:  # R − |τ| dR/dt is accurate enough within a block
            return kelvin + lag * rate
        return first_order_response(kelvin.T, -lag, self.blocks.seconds).T

    def _course(self) -> tuple[Array, Array]:
        """Return R and dR/dt in the blocks, (b,) K and K/s."""
        blocks, shift = self.blocks, self.node_shift
        if blocks.course is None or shift is None:
            return blocks.kelvin, blocks.rate
        return (
            blocks.kelvin + blocks.course.kelvin @ shift,
            blocks.rate + blocks.course.rate @ shift,
        )

    def warm_up_shape(self, rate: float) -> tuple[Array, Array]:
        """Return the course of a warm-up and its derivative by 1/τ = `rate`, 1/s, (b,)."""
        end = float(self.blocks.time[-1])
        step = 1e-3 / end

        def shape(rate: float) -> Array:
            decay = rate * end if abs(rate * end) > _STRAIGHT else _STRAIGHT
            passed = self.blocks.time / end
            return np.exp(-decay * passed) * np.expm1(-decay * (1 - passed)) / np.expm1(-decay)

        return shape(rate), (shape(rate + step) - shape(rate - step)) / (2 * step)

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
                lag, course = self.lag_of(x), self._course()
                later, earlier = (self._of_element(*course, lag + by) for by in (_STEP, -_STEP))
                jacobian[:, self.names.index(LAG)] = slope * (later - earlier) / (2 * _STEP)
            if self.warm_up:
                at = self.names.index(WARM_UP_RATE)
                size = x[self.names.index(f"warm_up[{self.sensor.axes[k].name}]")]
                jacobian[:, at] = size * self.warm_up_shape(float(x[at]))[1]
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
            rate = float(x[names.index(WARM_UP_RATE)])
            jacobian[:, at] = self.warm_up_shape(rate)[0]
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
        nuisances += [*(f"warm_up[{name}]" for name in sensor.channels), WARM_UP_RATE]
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
    # At zero coefficients, lag and τ have no effect: the search starts from a fit at given values.
    start = np.zeros(len(names))
    if LAG in model.nuisances:
        start[-1] = lag
    if model.warm_up:
        start[names.index(WARM_UP_RATE)] = 1 / model.warm_up
    residual, jacobian = model.linearise(start)
    free = [k for k, name in enumerate(names) if name not in (LAG, WARM_UP_RATE)]
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
    if name == WARM_UP_RATE:
        return 1e-3
    axis = ErrorName(name).place
    return _NATURAL[sensor.measures[axis]]


def _nuisance_priors(model: RampModel, environment: Environment) -> Iterator[Gaussian]:
    """Yield priors on the constants and on the lag.

    The attitude is unknown, so a component of the earth's rate is treated as 0 ± Ω/√3 and a
    component of gravity as 0 ± g. An accelerometer's bias affects only the constant. The prior on
    1/τ of a warm-up allows a linear drift, 1/τ = 0.
    """
    for axis in model.sensor.axes:
        sd = EARTH_RATE / np.sqrt(3) if axis.measures == "w" else G0
        yield Gaussian.independent((f"constant[{axis.name}]",), [0.0], [sd])
    if model.warm_up:
        rate = 1 / model.warm_up
        yield Gaussian.independent((WARM_UP_RATE,), [rate], [rate])
    if LAG in model.nuisances:
        stated = environment.lag
        value, sd = (0.0, WIDEST_LAG) if stated is None else (stated.value, stated.sd)
        yield Gaussian.independent((LAG,), [value], [sd])


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
    """Return candidates for a drift, linear in time, and for hysteresis over temperature."""
    time = model.blocks.time
    shape = (time - time.mean()) / max(float(np.ptp(time)), 1e-300)
    loop = (
        () if model.blocks.is_monotonic else ((HYSTERESIS, " over temperature", loop_shape(model)),)
    )
    keys = () if model.warm_up or not loop else _warm_up_keys(_LONGEST * float(time[-1]))
    found: list[Candidate] = []
    for before, after, values in (("drift of ", "", shape), *loop):
        columns = [
            Column(name, QUANTITIES[axis.measures].unit, _column(model, k, values))
            for k, axis in enumerate(model.sensor.axes)
            for name in (f"{before}{axis.name}{after}",)
        ]
        together = together_and_alone("time", [(f"{before}all axes{after}", columns)])
        found += [replace(one, changes=() if after else keys) for one in together]
    return found


def loop_shape(model: RampModel) -> Array:
    """Return a loop that closes within a sixth of the range after a turn of the temperature, (b,).

    The bias retains a part of the last change: dz = (±1 − z) |dT|/ΔT.
    """
    loop, kelvin = [0.0], model.blocks.kelvin
    for change in (6 * np.diff(kelvin) / float(np.ptp(kelvin))).tolist():
        loop.append(loop[-1] + (np.sign(change) - loop[-1]) * min(abs(change), 1.0))
    return np.array(loop)


def _warm_up_keys(seconds: float) -> tuple[Change, ...]:
    return (
        Change("environment", "kind", "ramp"),
        Change("environment", "warm_up", f"{float(f'{seconds:.3g}'):g} s"),
    )


def _warm_up_candidates(model: RampModel, x: Array) -> list[Candidate]:
    """Return a warm-up of all axes, with the key that makes the method estimate it."""
    if model.warm_up or model.blocks.is_monotonic:
        return []
    residual, jacobian = model.linearise(x)
    length = np.linalg.norm(jacobian, axis=0)
    q, _ = np.linalg.qr(jacobian / np.where(length > 0, length, 1.0))
    axes = range(len(model.sensor.axes))

    def columns(shape: Array) -> Array:
        return np.stack([_column(model, k, shape) for k in axes], axis=-1)

    def explained(tau: float) -> float:
        left = columns(model.warm_up_shape(1 / tau)[0])
        u, _ = np.linalg.qr(left - q @ (q.T @ left))
        return float(np.sum((u.T @ residual) ** 2))

    tried: Array = np.geomspace(
        model.blocks.seconds, _LONGEST * float(model.blocks.time[-1]), _TRIED
    )
    best = max(tried.tolist(), key=explained)
    shape, change = model.warm_up_shape(1 / best)
    names = list(model.sensor.channels)
    units = tuple(QUANTITIES[axis.measures].unit for axis in model.sensor.axes)
    return [
        Candidate(
            "warm_up",
            "time",
            (
                *(f"warm_up[{name}]" for name in names),
                *(f"change of warm_up[{name}] by ln 1/τ" for name in names),
            ),
            (*units, *units),
            np.concatenate([columns(shape), columns(change / best)], axis=1),
            changes=_warm_up_keys(best),
        )
    ]
