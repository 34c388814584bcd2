"""The patent's method finds K0 and k1 + K3 from four positions, and the rest from g² and priors.

The results from the four positions are fixed. Then ‖f̂‖ = g at the other positions determines δ,
K2, Kip and K3, with k1 = (k1 + K3) − K3. K_A3 and K_B3 have the same effect there, so their
difference needs a prior, and so does the difference between the two k1. Once δ is known, the
results from the four positions are computed again, and then the other coefficients.

Sums and differences of the readings at the four cardinal positions give bias, gain and K2 of both
accelerometers. Let u and v be the readings, in g, of a level accelerometer (0° and 180° for A, 270°
and 90° for B), and n and m those of a vertical accelerometer, up and down (90° and 270°, 0° and
180°)::

    K0 = (u + v)/2        k1 + K3 = √(((n − m)/2)² + ((u − v)/2)²) − 1        K2 = (n + m)/2 − K0

The head is trimmed so that the angles of a pair differ by less than the autocollimator's
resolution. The root corrects for the mounting angle. To lowest order it adds ½ ((u − v)/2)².
Without this term a mounting angle of 300″ would cause an error of 1.1 µg.

This angle is measured at the level positions, but the head has a different error at the vertical
positions. At a vertical position the other accelerometer is level and measures the angle, once δ is
known from g²::

    k1 + K3 = (n − m) / (2 cos φ) − 1        φ_A = φ of B − δ        φ_B = φ of A + δ

Sources: CN101852817A, steps 4 to 6, equations 5 to 19, with the exact observation instead of the
linear one, which fails at a bias of 1 mg and a mounting angle of 300″; CN101852817A, step 4,
equations 17 and 18; the root and φ are our own.
"""

from dataclasses import replace
from math import pi
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.benches.dividing_head.bench import (
    DividingHead,
    bench_covariance,
    reading_sensitivities,
    sensed_motion,
)
from inercal.benches.dividing_head.passes import CARDINAL_ANGLES, matches_any_angle
from inercal.estimation import Estimate, Gaussian, Problem, least_squares
from inercal.estimation.uncertainty import jacobian
from inercal.methods import Priors
from inercal.methods.dual_orthogonal import g_squared
from inercal.methods.mean_problem import ROUNDING
from inercal.physics.plan import Indexings
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations

# For A and B, as indices of `CARDINAL_ANGLES`
_LEVEL_ROWS, _VERTICAL_ROWS = ((0, 2), (3, 1)), ((1, 3), (0, 2))
_FOUR_POINT_TERMS = ("k0", "k1")


class FourPoints(NamedTuple):
    """Results for A and B from the four cardinal positions, in g, (..., 2) each."""

    k0: Array
    gain: Array  # k1 + K3
    k2: Array


def four_points(y: Array, delta: Array | None = None, *, corrected: bool = True) -> FourPoints:
    """Return bias, gain and K2 from the four cardinal positions.

    Parameters
    ----------
    y : (..., 4, 2) array
        Readings of A and B at 0°, 90°, 180°, 270°, g.
    delta : (...) array, optional
        δ = δ_B − δ_A if known, rad.
    corrected : bool
        Whether to correct the gain for the mounting angle; False is only for comparison.
    """
    k0, gain, k2, half, tilt = (np.empty((*y.shape[:-2], 2)) for _ in range(5))
    for k in range(2):
        u, v, n, m = (y[..., row, k] for row in (*_LEVEL_ROWS[k], *_VERTICAL_ROWS[k]))
        k0[..., k] = (u + v) / 2
        half[..., k], tilt[..., k] = (n - m) / 2, (u - v) / 2
        k2[..., k] = (n + m) / 2 - k0[..., k]
    if not corrected:
        gain = half - 1
    elif delta is None:
        gain = np.hypot(half, tilt) - 1
    else:
        angle = np.arctan2(tilt, half)[..., ::-1] + np.stack([-delta, delta], axis=-1)
        gain = half / np.cos(angle) - 1
    return FourPoints(k0, gain, k2)


def averaging_matrix(steps: Indexings) -> Array:
    """Return the matrix that averages the readings at each cardinal position, (4, r).

    Raises
    ------
    NotObserved
        A cardinal position is missing.
    """
    there = np.array(
        [[matches_any_angle(step.angle, [angle]) for step in steps] for angle in CARDINAL_ANGLES]
    )
    if lacking := tuple(
        f"{180 * angle / pi:.0f}°"
        for angle, at in zip(CARDINAL_ANGLES, there, strict=True)
        if not bool(at.any())
    ):
        raise NotObserved(
            f"estimator patent needs positions at {', '.join(lacking)}; add them, or use estimator "
            "dual or joint",
            lacking,
            key="steps",
        )
    return there / there.sum(axis=1, keepdims=True)


class _CoefficientMaps(NamedTuple):
    """Coefficients as a linear function of k0 and gain of a and b, (p, 4), and of the rest."""

    from_four_points: Array
    from_second_stage: Array
    names: tuple[str, ...]  # of the other coefficients


def two_stage_estimate(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Indexings,
    priors: Priors,
) -> Estimate:
    """Return the coefficients with the joint covariance of both stages.

    The covariance includes the readings and the bench.

    Raises
    ------
    InputError
        There are priors on coefficients from the four positions, or k0 or k1 is not selected.
    NotObserved
        Cardinal positions are missing, there are too few others, or K3 has no prior.
    """
    maps = _coefficient_maps(sensor, bench.gravity.value)
    if beyond := sorted({name for prior in priors for name in prior.names} - set(maps.names)):
        raise InputError(
            f"estimator patent computes {', '.join(beyond)} from the four cardinal positions; "
            "remove their priors, or use estimator joint",
            key="priors",
            names=tuple(beyond),
        )
    average = averaging_matrix(steps)
    others = [k for k in range(len(steps)) if not bool(average[:, k].any())]
    _require_enough(sensor, steps, others)
    g = bench.gravity.value

    def held(y: Array, delta: Array | None = None) -> Array:
        points = four_points(average @ y / g, delta)
        return np.concatenate([points.k0, points.gain], axis=-1)

    nominal = sensed_motion(bench, steps, {}).f[..., :2]
    at_nominal = replace(observations, mean=nominal).rows(others)
    up = at_nominal.mean / np.linalg.norm(at_nominal.mean, axis=-1, keepdims=True)
    ideal = _second_stage_problem(
        at_nominal, sensor, bench, maps, up, np.zeros(4), g_squared.centred_priors(priors)
    )
    structure = g_squared.solve_with_advice(ideal)
    seen_there = observations.rows(others)
    fixed = held(observations.mean)
    requested = _second_stage_problem(seen_there, sensor, bench, maps, up, fixed, tuple(priors))
    second = least_squares(requested)
    if set(g_squared.MOUNTING_ANGLES) <= set(maps.names):
        # Once δ is known, the angle for each gain is measured at the gain's own positions, so the
        # head's error cancels.
        delta = np.diff(second.select(g_squared.MOUNTING_ANGLES).value)[..., 0]
        fixed = held(observations.mean, delta)
        second = least_squares(
            _second_stage_problem(seen_there, sensor, bench, maps, up, fixed, tuple(priors))
        )

    seen = g_squared.compare_with_gravity(
        sensor, at_nominal.mean, np.zeros(len(sensor.coefficients)), g
    )
    to_held = jacobian(
        lambda flat: held(flat.reshape(*flat.shape[:-1], len(steps), 2)),
        nominal.ravel(),
        np.array(1e-3),
    )
    assert not callable(requested.noise)
    readings = observations.full_covariance + bench_covariance(sensor, bench, steps)
    covariance, gain = _two_stage_covariance(
        maps, seen, others, to_held, structure.covariance, requested.noise, readings, priors
    )
    value = fixed @ maps.from_four_points.T + second.value @ maps.from_second_stage.T
    residual, whitened = _residuals_at_all_positions(observations, sensor, nominal, value, g)
    return replace(
        second,
        residual=residual,
        whitened=whitened,
        observations=observations.labels,
        names=sensor.coefficients,
        wanted=sensor.coefficients,
        value=value,
        covariance=np.broadcast_to(covariance, (*value.shape, value.shape[-1])),
        # The residuals contain both noise and errors of the fixed values, so they test neither.
        chi2=np.zeros(value.shape[:-1]),
        dof=0,
        rank=structure.rank,
        singular_values=structure.singular_values,
        null_directions=structure.null_directions,
        weakest=structure.weakest,
        sensitivities={
            name: np.broadcast_to(-gain @ column, value.shape)
            for name, column in reading_sensitivities(sensor, bench, steps).items()
        },
    )


def _residuals_at_all_positions(
    observations: Observations, sensor: Sensor, nominal: Array, value: Array, g: float
) -> tuple[Array, Array]:
    """Return the residuals of g² at all positions, (..., r) m/s² and in standard deviations."""
    residual = g_squared.compare_with_gravity(sensor, observations.mean, value, g).residual
    up = nominal / np.linalg.norm(nominal, axis=-1, keepdims=True)
    noise = g_squared.covariance_along(up, observations.full_covariance)
    return residual, residual / np.sqrt(np.linalg.diagonal(noise))


def _two_stage_covariance(
    maps: _CoefficientMaps,
    seen: g_squared.SquaredComparison,
    others: list[int],
    to_held: Array,
    inside: Array,
    noise: Array,
    readings: Array,
    priors: Priors,
) -> tuple[Array, Array]:
    """Return the covariance of all coefficients, and their sensitivity to the readings, (p, 2r).

    Both stages are linear in the readings. The result of the second stage changes with its residual
    by dx = H⁻¹JᵀW dr, where dr = −∂‖f̂‖/∂y dy − ∂‖f̂‖/∂c (held) dy, H⁻¹ = `inside` and
    W⁻¹ = `noise`. The priors' errors have the priors' covariance.

    Parameters
    ----------
    maps : _CoefficientMaps
    seen : SquaredComparison
        The comparison at the other positions, at the nominal sensor.
    others : list of int
        Rows of the other positions.
    to_held : (4, 2r) array
        ∂(held)/∂y.
    inside, noise, readings : arrays
        Covariance of the second stage only, of its residuals and of all readings, (2r, 2r).
    priors : sequence of Gaussian
    """
    n = len(others)
    by_reading = np.zeros((n, to_held.shape[-1] // 2, 2))
    by_reading[np.arange(n), others] = seen.by_reading
    moved = -by_reading.reshape(n, -1) - seen.jacobian @ maps.from_four_points @ to_held
    weighted = np.asarray(
        np.linalg.solve(noise, seen.jacobian @ maps.from_second_stage), dtype=float
    )
    stated = maps.from_second_stage @ inside
    gain = maps.from_four_points @ to_held + stated @ weighted.mT @ moved
    size = len(maps.names)
    whites = [prior.rows(maps.names)[0] for prior in priors]
    known = sum((white.T @ white for white in whites), np.zeros((size, size)))
    own = stated @ known @ stated.mT
    return gain @ readings @ gain.mT + own, gain


def _coefficient_maps(sensor: Sensor, g: float) -> _CoefficientMaps:
    names = sensor.coefficients
    four = [f"{axis}.{term}" for term in _FOUR_POINT_TERMS for axis in "ab"]
    if lacking := tuple(name for name in four if name not in names):
        raise InputError(
            f"estimator patent needs k0 and k1 of both accelerometers; add {', '.join(lacking)} to "
            "the coefficients, or use estimator joint",
            key="[method]",
            names=lacking,
        )
    rest = tuple(name for name in names if name not in four)
    held, free = np.zeros((len(names), 4)), np.zeros((len(names), len(rest)))
    for k, name in enumerate(four):
        held[names.index(name), k] = g if name.endswith("k0") else 1.0
    for k, name in enumerate(rest):
        free[names.index(name), k] = 1.0
        if name.endswith(".k3"):
            free[names.index(name.replace("k3", "k1")), k] = -(g**2)
    return _CoefficientMaps(held, free, rest)


def _second_stage_problem(
    others: Observations,
    sensor: Sensor,
    bench: DividingHead,
    maps: _CoefficientMaps,
    up: Array,
    fixed: Array,
    priors: tuple[Gaussian, ...],
) -> Problem:
    """Return the problem of g² at the other positions, with the coefficients that are not fixed."""
    g = bench.gravity.value
    base = fixed @ maps.from_four_points.T
    noise = g_squared.covariance_along(up, others.full_covariance) + bench.gravity.sd**2
    unit_scale = np.array([sensor.unit_scale[sensor.coefficients.index(n)] for n in maps.names])

    def linearise(x: Array) -> tuple[Array, Array]:
        seen = g_squared.compare_with_gravity(
            sensor, others.mean, base + x @ maps.from_second_stage.T, g
        )
        return seen.residual, seen.jacobian @ maps.from_second_stage

    smallest = float(np.sqrt(np.linalg.diagonal(noise).min()))
    return Problem(
        names=maps.names,
        start=np.zeros((*noise.shape[:-2], len(maps.names))),  # each trial may have its noise
        linearise=linearise,
        noise=noise,
        correlated=True,
        scale=unit_scale,
        priors=priors,
        gauges=g_squared.gauges(sensor),
        observations=others.labels,
        rounding=g / smallest * ROUNDING,
    )


def _require_enough(sensor: Sensor, steps: Indexings, others: list[int]) -> None:
    """Raise NotObserved if the positions are too few for δ, K2 and Kip, even with priors.

    Raises
    ------
    NotObserved
        The message states a sufficient number of positions.
    """
    wanted = [
        k
        for k, name in enumerate(g_squared.TERMS)
        if name.endswith((".k2", ".kip")) and name in sensor.coefficients
    ]
    if set(g_squared.MOUNTING_ANGLES) <= set(sensor.coefficients):
        wanted.append(g_squared.TERMS.index("delta"))
    theta = np.array([steps[k].angle for k in others])
    rank = int(np.linalg.matrix_rank(g_squared.design_matrix(theta)[:, wanted], tol=1e-9))
    if rank < len(wanted):
        raise NotObserved(
            "estimator patent: the positions other than the four cardinal ones determine only "
            f"{rank} of {len(wanted)} combinations of δ, K2 and Kip; use 12 positions 30° "
            "apart, or use estimator joint",
            key="steps",
        )
