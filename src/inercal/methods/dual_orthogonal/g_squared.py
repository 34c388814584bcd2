"""Observe g²: two orthogonal accelerometers together sense g at any angle of the head.

In g, with s = sin θ, c = cos θ and δ = δ_B − δ_A, z = ½(y_A² + y_B² − 1) is to first order

    z = K_A0 s + K_B0 c + k_A1 s² + k_B1 c² − δ s c + K_A2 s³ + K_B2 c³ + K_A3 s⁴ + K_B3 c⁴
        + K_Aip s² c − K_Bip s c²

The head's error does not appear. This linear form only decides which coefficients are observed:
eight combinations of the eleven coefficients. The estimate uses the exact form ‖f̂‖ = g, where f̂
is the force in the plane of rotation, computed with the inverse of the sensor's full model at both
readings. If α and β are the compensated readings, this is α² + β² + 2αβ sin δ = cos² δ, which does
not depend on the head's angle at all.

The exact form depends on the other three combinations through products of errors. This dependence
does not count as a measurement, so observability is judged at the nominal sensor.

Source: CN101852817A (Harbin Institute of Technology, 2010), step 3, derived again from the physics.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.basics.keys import CoefficientName
from inercal.benches.dividing_head.bench import DividingHead, drift_names, sensed_motion
from inercal.benches.dividing_head.passes import drift_ramps, first_visit_rows
from inercal.estimation import Candidate, Estimate, Gauge, Gaussian, Problem, least_squares
from inercal.methods import Priors, candidates
from inercal.methods.mean_problem import ROUNDING
from inercal.physics.motion import Motion
from inercal.physics.plan import Indexings
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations

TERMS = ("a.k0", "b.k0", "a.k1", "b.k1", "delta", "a.k2", "b.k2", "a.k3", "b.k3", "a.kip", "b.kip")
NULL_DIRECTIONS: tuple[tuple[str, dict[str, float]], ...] = (
    ("harmonic 1 of A", {"a.k0": 1.0, "a.k2": -1.0, "b.kip": 1.0}),
    ("harmonic 1 of B", {"b.k0": 1.0, "b.k2": -1.0, "a.kip": -1.0}),
    ("k1 against K3", {"a.k1": 1.0, "b.k1": -1.0, "a.k3": -1.0, "b.k3": 1.0}),
)
MOUNTING_ANGLES = ("a.delta_o", "b.delta_o")
_NEWTON_STEPS = 4  # each step squares an error that is 1e-3 at first
_DENSE_POSITIONS = 24  # number of positions that determines all combinations of g²
# Singular value of the design; repeated positions that differ by 1e-4 rad add no rank
_RANK_TOLERANCE = 1e-2


def design_matrix(theta: Array) -> Array:
    """Return ∂z/∂(coefficients in g), (..., r, 11), at angles (..., r) rad; columns as `TERMS`."""
    s, c = np.sin(theta), np.cos(theta)
    columns = (s, c, s**2, c**2, -s * c, s**3, c**3, s**4, c**4, s**2 * c, -s * c**2)
    return np.stack(columns, axis=-1)


def null_vectors(sensor: Sensor, g: float) -> tuple[tuple[str, Array], ...]:
    """Return the null directions among the sensor's coefficients, each (p,) in SI."""
    size = {"k0": g, "k1": 1.0, "k2": 1 / g, "k3": 1 / g**2, "kip": 1 / g}
    result: list[tuple[str, Array]] = []
    for words, weights in NULL_DIRECTIONS:
        if set(weights) <= set(sensor.coefficients):
            row = {name: w * size[CoefficientName(name).term] for name, w in weights.items()}
            result.append((words, np.array([row.get(name, 0.0) for name in sensor.coefficients])))
    return tuple(result)


class SquaredComparison(NamedTuple):
    """The result of `compare_with_gravity`; shapes are for r rows and p coefficients."""

    residual: Array  # (..., r), g − ‖f̂‖, m/s²
    jacobian: Array  # (..., r, p), ∂‖f̂‖/∂c
    by_reading: Array  # (..., r, 2), ∂‖f̂‖/∂y
    force: Array  # (..., r, 3), f̂


def compare_with_gravity(sensor: Sensor, y: Array, c: Array, g: float) -> SquaredComparison:
    """Compare g with the norm of the force in the plane, computed from the readings.

    Parameters
    ----------
    sensor : Sensor
        A sensor like `inercal.benches.dividing_head.bench.mounted_sensor`: axes along x and y.
    y : (..., r, 2) array
        Readings, m/s².
    c : (..., p) array
        Coefficients, SI.
    g : float
        Local gravity, m/s².
    """
    lead = np.broadcast_shapes(y.shape[:-2], c.shape[:-1])
    f = np.zeros((*lead, y.shape[-2], 3))
    f[..., :2] = y
    for _ in range(_NEWTON_STEPS):
        reading, _, slope = sensor.linearise(Motion(f), c)
        step = np.linalg.solve(slope[..., :2], (y - reading)[..., None])[..., 0]
        f = np.concatenate([f[..., :2] + step, f[..., 2:]], axis=-1)
    _, result, slope = sensor.linearise(Motion(f), c)
    length = np.linalg.norm(f, axis=-1)
    up = f[..., :2] / length[..., None]
    # From h(f̂; c) = y it follows that ∂f̂/∂y = S⁻¹ and ∂f̂/∂c = −S⁻¹ ∂h/∂c.
    to_reading = np.asarray(np.linalg.solve(slope[..., :2].mT, up[..., None])[..., 0], dtype=float)
    return SquaredComparison(
        g - length, -(to_reading[..., None, :] @ result)[..., 0, :], to_reading, f
    )


def g_squared_problem(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Indexings,
    priors: Priors = (),
) -> Problem:
    """Return the estimation problem with g² at every position.

    Parameters
    ----------
    observations : Observations
        (..., r, 2), m/s².
    sensor : Sensor
    bench : DividingHead
        The bench; the problem uses only its gravity.
    steps : sequence of r Index
    priors : sequence of Gaussian
        Priors on coefficients.
    """
    require_fixture_sensor(sensor)
    y, g = observations.mean, bench.gravity.value
    p = len(sensor.coefficients)
    nominal = sensed_motion(bench, steps, {}).f[..., :2]
    up = nominal / np.linalg.norm(nominal, axis=-1, keepdims=True)
    # The noise is taken along the nominal force: an angle of 300″ changes it by only a millionth.
    noise = covariance_along(up, observations.full_covariance)

    def linearise(x: Array) -> tuple[Array, Array]:
        seen = compare_with_gravity(sensor, y, x, g)
        return seen.residual, seen.jacobian

    def suspects(x: Array) -> list[Candidate]:
        larger = candidates.extended_sensor(sensor)
        there = np.concatenate([x, np.zeros(len(larger.coefficients) - p)])
        seen = compare_with_gravity(larger, y, there, g)
        column: dict[str, Array] = dict(zip(larger.coefficients, seen.jacobian.T, strict=True))
        if not {f"{channel}.k1" for channel in sensor.channels} <= set(sensor.coefficients):
            # If both k1 are estimated, an error of g acts like k1, up to a millionth of its size.
            column["g"] = np.full(len(steps), -1.0)
        families: dict[str, list[str]] = {}
        for k, channel in enumerate(sensor.channels):
            for name, ramp in zip(drift_names(channel, steps), drift_ramps(steps), strict=True):
                column[name] = -seen.by_reading[:, k] * ramp
                families.setdefault(f"drift of {channel}", []).append(name)
        declared = bench.nuisances(steps, sensor)
        return [
            *candidates.candidates_from_columns(
                observations.labels, larger, sensor.coefficients, declared, column, families
            ),
            *candidates.prior_candidates(sensor, sensor.coefficients, priors, column),
        ]

    return Problem(
        names=sensor.coefficients,
        start=np.zeros(p),
        linearise=linearise,
        noise=noise + bench.gravity.sd**2,
        correlated=True,
        scale=sensor.unit_scale,
        priors=tuple(priors),
        gauges=gauges(sensor),
        observations=observations.labels,
        known_nulls=null_vectors(sensor, g),
        rounding=g / float(np.sqrt(np.linalg.diagonal(noise).min())) * ROUNDING,
        candidates=suspects,
    )


def with_gravity_sensitivity(problem: Problem, estimate: Estimate) -> Estimate:
    """Return an estimate from `g_squared_problem` with its sensitivity to the stated gravity.

    If gravity increases by dg, so does every residual g − ‖f̂‖, and therefore dc = P Jᵀ W 1 dg.
    """
    _, jacobian = problem.linearise(estimate.value)
    assert not callable(problem.noise)
    one = np.ones((*estimate.value.shape[:-1], jacobian.shape[-2], 1))
    pull = jacobian.mT @ np.linalg.solve(problem.noise, one)
    return replace(estimate, sensitivities={"g": (estimate.covariance @ pull)[..., 0]})


def covariance_along(up: Array, covariance: Array) -> Array:
    """Return the covariance along `up`, (..., r, r).

    Parameters
    ----------
    up : (r, 2) array
        Unit vectors.
    covariance : (..., 2r, 2r) array
        Covariance of all readings, row after row.
    """
    r = len(up)
    rows = np.zeros((r, r, 2))
    rows[np.arange(r), np.arange(r)] = up
    rows = rows.reshape(r, 2 * r)
    return rows @ covariance @ rows.T


def gauges(sensor: Sensor) -> tuple[Gauge, ...]:
    """Return the gauge that fixes the common mounting angle, which g² does not show."""
    if not set(MOUNTING_ANGLES) <= set(sensor.coefficients):
        return ()
    return (Gauge("no common mounting angle", MOUNTING_ANGLES, np.ones((1, 2)), np.zeros(1)),)


def require_determined(
    sensor: Sensor, bench: DividingHead, steps: Indexings, priors: Priors
) -> None:
    """Raise NotObserved if g² and the priors leave coefficients free at the nominal sensor.

    Raises
    ------
    NotObserved
        Coefficients are free; the message names the null directions.
    """
    nominal = sensed_motion(bench, steps, {}).f[..., :2]
    r = len(steps)
    exact = Observations(
        tuple(step.label for step in steps),
        nominal,
        np.broadcast_to(np.eye(2), (r, 2, 2)),
        np.ones(r),
        np.ones(r, dtype=np.int64),
        np.arange(r, dtype=float),
        sensor.channels,
    )
    solve_with_advice(g_squared_problem(exact, sensor, bench, steps, centred_priors(priors)))


def solve_with_advice(problem: Problem) -> Estimate:
    """Solve a problem; its NotObserved gets advice on the priors that would help."""
    try:
        return least_squares(problem)
    except NotObserved as error:
        advice = "give priors of kip (single tests) and k3 (a centrifuge), or use estimator joint"
        raise NotObserved(f"{error}; {advice}", error.directions, names=error.names) from None


def centred_priors(priors: Priors) -> tuple[Gaussian, ...]:
    """Return the priors relative to the nominal sensor."""
    return tuple(replace(prior, mean=np.zeros(len(prior.names))) for prior in priors)


def require_enough_positions(sensor: Sensor, steps: Indexings) -> None:
    """Raise NotObserved if the positions are too few for g², even with priors.

    Raises
    ------
    NotObserved
        The message states a sufficient number of positions.
    """
    names = [("delta" if name in MOUNTING_ANGLES else name) for name in sensor.coefficients]
    wanted = [k for k, name in enumerate(TERMS) if name in names]
    if len(sensor.axes) == 1 or not wanted:
        return
    angles = np.array([step.angle for step in steps])
    many = 2 * np.pi * np.arange(_DENSE_POSITIONS) / _DENSE_POSITIONS
    shown, possible = (
        int(np.linalg.matrix_rank(design_matrix(theta)[:, wanted], tol=_RANK_TOLERANCE))
        for theta in (angles, many)
    )
    if shown < possible:
        different = len(set(first_visit_rows(steps)))
        raise NotObserved(
            f"{different} different positions determine only {shown} of the {possible} "
            "combinations of coefficients that g² can determine; use 8 or more evenly spaced "
            "positions, ideally 12 (30° apart)",
            key="steps",
        )


def require_fixture_sensor(sensor: Sensor, *, allow_single: bool = False) -> None:
    """Raise InputError if the sensor does not fit the fixture.

    Parameters
    ----------
    sensor : Sensor
    allow_single : bool
        Whether one accelerometer, with any name, is sufficient.

    Raises
    ------
    InputError
        The axes are not two accelerometers a and b, along x and y with P in the plane, or the
        sensor has mounting angles in the reference form.
    """
    x, y, back = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)
    one = allow_single and len(sensor.axes) == 1
    expected = {sensor.axes[0].name: (x, y)} if one else {"a": (x, y), "b": (y, back)}
    actual = {axis.name: (axis.i, axis.p) for axis in sensor.axes if axis.measures == "f"}
    same = actual.keys() == expected.keys() and len(sensor.axes) == len(expected)
    if not same or not all(np.allclose(actual[name], expected[name]) for name in expected):
        others = ", or one accelerometer along x" if allow_single else ""
        raise InputError(
            f"sensor {sensor.name} does not fit the fixture, which has two accelerometers: a "
            f"along x with P along y, and b along y with P along −x{others}",
            key="[sensor]",
            names=sensor.channels,
        )
    angles = tuple(name for name in sensor.coefficients if name.endswith(".delta_o"))
    if sensor.form != "tilted" and angles:
        raise InputError(
            f"sensor {sensor.name}: the reference form omits the cosine of the mounting angles, "
            '1 µg at 300″; set [sensor] form = "tilted"',
            key="[sensor] form",
            names=angles,
        )
