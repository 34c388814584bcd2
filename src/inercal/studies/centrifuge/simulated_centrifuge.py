"""Simulate the experiment from section 5 of Wang and Li 2021: dwells, outputs and truth.

Outputs are N = S (h·f + D (h·f)²) + b (their equation 6) along unit input axes h, in units of
output ("V", printed as g). The specific force is in the source's unit of g, 9.8 m/s². S is in V/g,
b in V and D in 1/g.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import cos, pi, sin
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import Measured
from inercal.benches.arm import outward_and_up_directions
from inercal.benches.centrifuge.arm_motion import sensed_motion
from inercal.benches.centrifuge.bench import Centrifuge
from inercal.estimation import Estimate
from inercal.methods.centrifuge_norm import RATES, closed_formulas, ml, plan
from inercal.methods.centrifuge_norm.closed_formulas import G, paper_coefficients
from inercal.physics.earth import EARTH_RATE
from inercal.physics.plan import Spin
from inercal.physics.sensors import Readout, Sensor, triad
from inercal.recordings import Observations

NOISE = 1e-5  # V, noise of each reading as stated in the source
LATITUDE = 39 * pi / 180  # rad, misalignment that the source states and then ignores
NOMINAL_SCALE = 1.25  # V/g, start value for ml
BENCH = Centrifuge(Measured(G, 0.0), Measured(1.0, 0.0), latitude=Measured(0.0, 0.0))
AXES = ("x", "y", "z")
QUANTITIES = ("S", "b", "D")
UNITS = {"S": "V/g", "b": "g", "D": "1/g"}


@dataclass(frozen=True, eq=False)
class SimulatedTriad:
    """Three simulated accelerometers.

    Parameters
    ----------
    scale, bias, bend : (3,) arrays
        S in V/g, b in V and D in 1/g for x, y and z.
    axes : (3, 3) array
        Rows are the unit input axes h in the body.
    arms : (3, 3) array
        Rows are the positions of the axes relative to the sensor's centre, in the body frame, m.
    """

    scale: Array
    bias: Array
    bend: Array
    axes: Array = field(default_factory=lambda: np.eye(3))
    arms: Array = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def values(self) -> Array:
        """Return S, b and D of the axes, (3, 3)."""
        return np.stack([self.scale, self.bias, self.bend])


TRUTH = SimulatedTriad(
    np.array([1.29, 1.21, 1.26]),
    np.array([0.213, 0.256, 0.516]),
    np.array([0.57e-4, 0.31e-4, 0.45e-4]),
)
Attitudes = Literal["half-circle", "full-circle"]


def steps(attitudes: Attitudes = "half-circle", rates: Sequence[float] = RATES) -> tuple[Spin, ...]:
    """Return the dwells in the order of the printed table: twenty positions at each rate."""
    return plan(attitudes, rates)


def dwell_force(spins: Sequence[Spin], latitude: float = 0.0) -> Array:
    """Return the specific force in each dwell, (r, 3) g, for arm rates relative to the ground.

    Parameters
    ----------
    spins : sequence of r Spin
    latitude : float
        Latitude, rad; the earth's rate along the spindle is proportional to its sine.
    """
    declared = BENCH.acting_parameters(spins, vectors=True)
    at = {name: np.array(parameter.value) for name, parameter in declared.items()}
    return sensed_motion(BENCH, spins, at | {"latitude": np.array(latitude)}).f / G


def earth_rate_ratio() -> float:
    """Return the earth's rate along the spindle divided by the first rate of the arm."""
    return EARTH_RATE * sin(LATITUDE) / RATES[0]


def outputs(device: SimulatedTriad, spins: Sequence[Spin], sensed: Array | None = None) -> Array:
    """Return noise-free outputs, (..., r, 3) V.

    Parameters
    ----------
    device : SimulatedTriad
    spins : sequence of r Spin
    sensed : (..., r, 3) array, optional
        Specific force at the sensor's centre, g; by default that of the bench.

    Notes
    -----
    An axis at r also senses −(ω²/g) h·(I − u uᵀ) r, where u is the spindle's direction in the body.
    """
    sensed = dwell_force(spins) if sensed is None else sensed
    along = sensed @ device.axes.T
    if device.arms.any():
        _, up = outward_and_up_directions(spins)
        level = device.arms - (up @ device.arms.T)[..., None] * up[:, None, :]  # (r, 3, 3)
        rate = np.array([step.rate for step in spins])
        along = along - rate[:, None] ** 2 / G * (level * device.axes).sum(-1)
    return device.scale * (along + device.bend * along**2) + device.bias


def sensor(*also: str, symmetric: bool = False) -> Sensor:
    """Return the sensor model with bias, scale factor, k2 and optionally other coefficients."""
    result = triad("triad", "f", "", Readout(NOMINAL_SCALE / G, 0.0, "V"))
    result = result.with_coefficients("k0", "k1", "k2", *also)
    return replace(result, form="tilted", frame="symmetric" if symmetric else "mount")


def observations(output: Array, made: Sensor, noise: float = NOISE) -> Observations:
    """Convert outputs, (..., r, 3) V, to observations with standard deviation `noise`, V."""
    r: int = output.shape[-2]
    sd = noise * G / NOMINAL_SCALE
    return Observations(
        tuple(f"d{k:02d}" for k in range(1, r + 1)),
        made.to_si(output),
        np.broadcast_to(sd**2 * np.eye(3), (r, 3, 3)),
        np.ones(r),
        np.ones(r, dtype=np.int64),
        np.arange(r, dtype=float),
        made.channels,
    )


def noisy_outputs(output: Array, trials: int, seed: int) -> Array:
    """Return outputs with noise, (trials, r, 3) V; the same seed gives the same noise."""
    rng = np.random.default_rng([seed, 2021])
    return output + NOISE * rng.standard_normal((trials, *output.shape))


def coefficients_as_printed(value: Array) -> Array:
    """Return S, b and D, (..., 3, 3), from the coefficients of `sensor`, (..., p ≥ 9) SI."""
    k0, k1, k2 = np.moveaxis(value[..., :9].reshape(*value.shape[:-1], 3, 3), -1, 0)
    return np.stack(paper_coefficients(k0, k1, k2, NOMINAL_SCALE), axis=-2)


def closed_form_estimate(
    invert: closed_formulas.SeriesInverse, output: Array, spins: Sequence[Spin]
) -> Array:
    """Return S, b and D from closed formulas, (..., 3, 3); NaN without a root.

    Parameters
    ----------
    invert : callable
        `paper` or `series` in `closed_formulas`.
    output : (..., r, 3) array
        Outputs, V.
    spins : sequence of r Spin
    """
    rate = np.array([step.rate for step in spins])
    c = regress_squared_norms(output, (rate**2 * BENCH.radius.value / G) ** 2 + 1)
    return np.stack(invert(*(c[..., k : k + 3] for k in (1, 4, 7, 10))), axis=-2)


def regress_squared_norms(output: Array, target: Array) -> Array:
    """Return C of (16), (..., 13), for squared norms `target`, g²: C₀, then C₁ to C₄ by axis."""
    rows = closed_formulas.regression_matrix(output)
    size = np.linalg.norm(rows, axis=-2, keepdims=True)
    q, r = np.linalg.qr(rows / size)
    right = np.swapaxes(q, -1, -2) @ target[:, None]
    return np.linalg.solve(r, right)[..., 0] / size[..., 0, :]


def ml_estimate(output: Array, spins: Sequence[Spin], bench: Centrifuge = BENCH) -> Estimate:
    """Return the maximum-likelihood estimate `ml` with nine parameters."""
    result = sensor()
    return ml(observations(output, result), result, bench, spins)


def closed_form_errors(invert: closed_formulas.SeriesInverse, output: Array) -> Array:
    """Return the errors of `closed_form_estimate` on the printed dwells, (..., 3, 3)."""
    return closed_form_estimate(invert, output, steps()) - TRUTH.values


def ml_errors(output: Array) -> Array:
    """Return the errors of `ml_estimate` on the printed dwells, (..., 3, 3)."""
    return coefficients_as_printed(ml_estimate(output, steps()).value) - TRUTH.values


def estimator_errors(output: Array) -> dict[str, Array]:
    """Return the errors of S, b and D, (..., 3, 3), on the printed dwells, by estimator."""
    return {
        "paper": closed_form_errors(closed_formulas.paper, output),
        "series": closed_form_errors(closed_formulas.series, output),
        "ml": ml_errors(output),
    }


def stated_deviations(estimate: Estimate) -> Array:
    """Return the standard deviations of S, b and D stated by an estimate, (3, 3)."""
    spread = 1e-3 * estimate.std[:9]
    here = coefficients_as_printed(estimate.value[:9])
    there = np.stack([coefficients_as_printed(estimate.value[:9] + row) for row in np.diag(spread)])
    slope = (there - here).reshape(9, 9) / spread[:, None]
    return np.sqrt(np.diagonal(slope.T @ estimate.covariance[:9, :9] @ slope)).reshape(3, 3)


def misaligned_triad(phi: Array) -> SimulatedTriad:
    """Return a triad with input axes along the rows of I + Φ, where Φ is (3, 3) rad."""
    axes = np.eye(3) + phi
    return replace(TRUTH, axes=axes / np.linalg.norm(axes, axis=1, keepdims=True))


def non_orthogonal_triad(gamma: float) -> SimulatedTriad:
    """Return a triad whose axes lean towards one another by γ, rad, with symmetric Φ."""
    return misaligned_triad(gamma * (np.ones((3, 3)) - np.eye(3)))


def rotated_triad(gamma: float) -> SimulatedTriad:
    """Return a triad rotated by γ about each axis, which is the source's Φ with equal angles."""
    angle = gamma * np.sqrt(3)
    k = np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]]) / np.sqrt(3)
    return replace(TRUTH, axes=np.eye(3) + sin(angle) * k + (1 - cos(angle)) * k @ k)


ML_TRIAL_RATIO = 20  # trials of the closed formulas per trial of ml
_BATCH = 4000
ESTIMATORS = ("paper", "series", "ml")


@dataclass(frozen=True, eq=False)
class CentrifugeTrials:
    """Errors of S, b and D by estimator, over trials (n, 3, 3) and without noise (3, 3).

    Parameters
    ----------
    error, noise_free : mappings of str to array
        Errors with and without noise. Trials in which an estimator finds no root are not included
        in `error`.
    rootless : float
        Share of the trials in which `paper` finds no root for at least one axis.
    bound : (3, 3) array
        Cramér–Rao bound for norms: the standard deviations that `ml` states without noise.
    chi2 : (n,) array
        χ² of `ml`, with `dof` degrees of freedom.
    """

    error: dict[str, Array]
    noise_free: dict[str, Array]
    rootless: float
    bound: Array
    chi2: Array
    dof: int

    def std(self, estimator: str) -> Array:
        """Return the standard deviations of S, b, D, (3, 3)."""
        return self.error[estimator].std(axis=0)

    def std_error(self, estimator: str) -> Array:
        """Return the Monte Carlo error of `std`, (3, 3), as s/√(2n) for normal errors."""
        return self.std(estimator) / np.sqrt(2 * len(self.error[estimator]))


def repeat_experiment(trials: int, seed: int) -> CentrifugeTrials:
    """Run the estimators on the paper's design with the stated noise.

    Parameters
    ----------
    trials : int
        Number of trials for the closed formulas; `ml` uses one in twenty, but at least twenty.
    seed : int
    """
    spins = steps()
    exact = outputs(TRUTH, spins)
    noisy = noisy_outputs(exact, trials, seed)
    paper = _closed_form_estimates(closed_formulas.paper, noisy) - TRUTH.values
    possible = np.isfinite(paper).all(axis=(1, 2))
    fitted = ml_estimate(noisy[: max(trials // ML_TRIAL_RATIO, 20)], spins)
    return CentrifugeTrials(
        {
            "paper": paper[possible],
            "series": _closed_form_estimates(closed_formulas.series, noisy) - TRUTH.values,
            "ml": coefficients_as_printed(fitted.value) - TRUTH.values,
        },
        estimator_errors(exact),
        1 - float(possible.mean()),
        stated_deviations(ml_estimate(exact, spins)),
        fitted.chi2,
        fitted.dof,
    )


def _closed_form_estimates(invert: closed_formulas.SeriesInverse, noisy: Array) -> Array:
    """Return S, b and D of the trials, (n, 3, 3); compute them in blocks to limit the memory."""
    parts = np.array_split(noisy, -(-len(noisy) // _BATCH))
    return np.concatenate([closed_form_estimate(invert, part, steps()) for part in parts])
