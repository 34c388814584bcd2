"""Calibrate a triad with level mountings on a rate table by linear least squares.

Let a be the readings and f the specific force that the bench states. For each axis separately::

    f_x = Sx a_x + Exy a_y + Exz a_z + Axp        and similarly for y and z

The mountings XY, YX and ZY at 0, 46 and 86 r/min give nine equations with four unknowns per axis.
The mountings are treated as exact. The covariance of the result includes the readings' noise and,
to first order, the effects of pose, seat, speed and lean.

The covariance of the calibration also gives the error in new poses. Residuals of the fit only show
how well the model follows the fitted readings. Users need the error of the corrected vector in
other poses, δf = −S⁻¹ ∂h/∂c δc, because a free direction has an effect only in other poses.

Source: Xiao Changrun, Liu Yang, Liu Ruijie, Transducer and Microsystem Technologies 33(10), 2014,
equations 1 to 5. The covariance is our own.
"""

from math import pi
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import NotObserved
from inercal.basics.units import format_value_and_uncertainty
from inercal.benches.rate_table.bench import RateTable, sensed_motion
from inercal.benches.rate_table.fixture import PLANES, is_tilted, planar_plan
from inercal.estimation import Estimate, NullDirection
from inercal.methods import Fit, Method, Priors, Remarks, ship_consistency, solving
from inercal.methods.observability import require_observed
from inercal.physics.motion import Motion
from inercal.physics.plan import Spin, Spins
from inercal.physics.sensors import G0, Sensor
from inercal.physics.sensors.affine import AffineModel, require_affine_triad, to_coefficients
from inercal.recordings import Observations

_POSE_COUNT = 300
_MILLI_G = 1e-3 * G0
_ROUNDING = 1e-13
# Relative to the largest singular value of the sensed motion; below it, an axis is not excited
_EXCITATION_LIMIT = 1e-3


def pose_forces(fastest: float, radius: float, g: float) -> Array:
    """Return the specific force in random attitudes at rest and at rates, (300, 3) m/s².

    Parameters
    ----------
    fastest : float
        Largest rate of the table, rad/s; the rates are evenly spaced from 0.
    radius : float
        Radius, m.
    g : float
        Local gravity, m/s².
    """
    rng = np.random.default_rng(0)  # the same poses in all calls
    up, across = rng.standard_normal((2, _POSE_COUNT, 3))
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    across -= np.sum(across * up, axis=-1, keepdims=True) * up
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    rate = np.linspace(0.0, fastest, _POSE_COUNT)[:, None]
    return g * up + radius * rate**2 * across


def expected_error(sensor: Sensor, estimate: Estimate, f: Array) -> float:
    """Return the rms error of the corrected vector over poses f, (n, 3), m/s²."""
    p = len(sensor.coefficients)
    _, result, slope = sensor.linearise(Motion(f), estimate.value[:p])
    by_coefficient = np.asarray(np.linalg.solve(slope[..., :3], result), dtype=float)
    covariance = estimate.stated_covariance[:p, :p]
    return float(
        np.sqrt(np.einsum("nip,pq,niq->", by_coefficient, covariance, by_coefficient) / len(f))
    )


def prediction_note(
    sensor: Sensor, estimate: Estimate, fastest: float, radius: float, g: float
) -> str:
    """Return a note on the error in new poses and on the residuals of the fit, in mg."""
    error = expected_error(sensor, estimate, pose_forces(fastest, radius, g)) / _MILLI_G
    inside = float(np.sqrt(np.mean(estimate.residual**2))) / _MILLI_G
    frame = "" if sensor.frame == "mount" else f", in the {sensor.frame} frame,"
    return (
        f"In new poses, at any attitude and up to {fastest * 30 / pi:.3g} r/min, the corrected "
        f"vector{frame} is wrong by {format_value_and_uncertainty(0.0, error)[1]} mg (rms, k = 1). "
        f"The residuals of this fit are {format_value_and_uncertainty(0.0, inside)[1]} mg rms."
    )


def remarks(fit: Fit[RateTable, Spin]) -> Remarks:
    """Return the note on the error in new poses if the fit converged."""
    if not np.all(fit.estimate.converged):
        return Remarks()
    fastest = max(abs(step.rate) for step in fit.steps)
    radius, g = fit.bench.radius.value, fit.bench.gravity.value
    return Remarks(notes=(prediction_note(fit.sensor, fit.estimate, fastest, radius, g),))


class LevelStates(NamedTuple):
    """The model from the level states, and its sensitivity to the errors of their rows."""

    model: AffineModel  # for (...) trials
    gain: Array  # (..., 12, 3 r), ∂θ/∂f for each row; the axis index varies fastest


def fit_level_states(a: Array, f: Array) -> LevelStates:
    """Return the least-squares model.

    Parameters
    ----------
    a : (..., r, 3) array
        Readings in g.
    f : (r, 3) array
        Specific force that the bench states, g.
    """
    rows = np.concatenate([a, np.ones((*a.shape[:-1], 1))], axis=-1)
    back = np.asarray(np.linalg.pinv(rows), dtype=float)
    solved = (back @ f).mT  # (..., 3, 4)
    model = AffineModel(solved[..., :3], solved[..., 3])
    r, lead = len(f), a.shape[:-2]
    gain = np.zeros((*lead, 12, r, 3))
    for axis in range(3):
        # Errors of M a + p − f in the rows shift the solution in the opposite direction.
        gain[..., 3 * axis : 3 * axis + 3, :, axis] = -back[..., :3, :]
        gain[..., 9 + axis, :, axis] = -back[..., 3, :]
    return LevelStates(model, gain.reshape(*lead, 12, 3 * r))


def require_excitation(bench: RateTable, steps: Spins) -> None:
    """Raise NotObserved if the states do not excite an axis independently of the others and bias.

    Raises
    ------
    NotObserved
        The message names the axes of the body and the mountings to add.
    """
    rows = np.zeros((max(len(steps), 4), 4))
    if steps:
        rows[: len(steps)] = np.insert(sensed_motion(bench, steps, {}).f / G0, 3, 1.0, axis=1)
    _, size, directions = np.linalg.svd(rows)
    free = directions[size <= _EXCITATION_LIMIT * size[0]]
    if not len(free):
        return
    # The axes with a component in a direction that is not excited independently.
    part = np.abs(free[:, :3]).max(axis=0)
    lacking = tuple(axis for axis, share in zip("xyz", part, strict=True) if share > 0.1)
    radial = {toward: plane for plane, (toward, _) in PLANES.items()}
    axes, adding = ", ".join(lacking), ", ".join(radial[axis] for axis in lacking)
    raise NotObserved(
        f"these {len(steps)} states do not determine axis {axes}, because the specific force "
        f"along {axes} does not vary independently of the bias and the other axes; add "
        f"mounting {adding} (axis {axes} toward the centre) at two speeds or more",
        lacking,
        names=lacking,
    )


def affine_estimate(
    sensor: Sensor,
    model: AffineModel,
    covariance: Array,
    residual: Array,
    variance: Array,
    observations: tuple[str, ...],
    agreement: ship_consistency.Consistency,
    *,
    notes: tuple[str, ...],
    rank: int = 12,
    null_directions: tuple[NullDirection, ...] = (),
    converged: Bools | None = None,
    iterations: Indices | None = None,
) -> Estimate:
    """Return the estimate for a model fitted with equal weights.

    The rows share the bench's errors. The residuals are standardised row by row, but χ² uses all
    rows together, with their covariance due to the bench's errors.

    Parameters
    ----------
    sensor : Sensor
    model : AffineModel
        Models for (...) trials.
    covariance : (..., 12, 12) array
        Covariance of θ, in g.
    residual, variance : (..., m) arrays
        In g and g².
    observations : tuple of m str
    agreement : Consistency
        Tests of the rows that were used, and the sensitivity of θ to the bench's stated errors.
    notes, rank, null_directions, converged, iterations
        The same as for `Estimate`.
    """
    value, slope = to_coefficients(sensor, model)
    whole = slope @ covariance @ slope.mT
    trials, sd = value.shape[:-1], np.sqrt(variance)
    first = whole.reshape(-1, 12, 12)[0] / np.outer(sensor.unit_scale, sensor.unit_scale)
    known = np.maximum(np.linalg.eigvalsh(first), np.finfo(float).tiny)
    known = known[known > _ROUNDING * known[-1]]  # a stated frame fixes the others
    return Estimate(
        names=sensor.coefficients,
        value=value,
        covariance=whole,
        chi2=agreement.chi2,
        dof=agreement.dof,
        residual=residual * G0,
        whitened=residual / np.where(sd > 0, sd, np.inf),
        observations=observations,
        wanted=sensor.coefficients,
        rank=rank,
        singular_values=1 / np.sqrt(known),
        null_directions=null_directions,
        weakest=None,
        converged=np.ones(trials, dtype=bool) if converged is None else converged,
        iterations=np.ones(trials, dtype=np.intp) if iterations is None else iterations,
        notes=notes,
        scoring=agreement.scoring,
        sensitivities={
            name: (slope @ by[..., None])[..., 0] for name, by in agreement.sensitivities.items()
        },
    )


def planar(
    observations: Observations, sensor: Sensor, bench: RateTable, steps: Spins, priors: Priors = ()
) -> Estimate:
    """Return the twelve coefficients from the states that are not tilted.

    Parameters
    ----------
    observations : Observations
        One row per state, (..., r, 3) m/s²; rows with tilted mountings are not used.
    sensor : Sensor
        A triad with bias, scale factor and misalignments, in the reference form.
    bench : RateTable
    steps : sequence of r Spin
        The steps of the rows, in known attitudes.
    priors : sequence of Gaussian
        Must be empty.

    Raises
    ------
    InputError
        There are priors, the sensor is unsuitable, or the steps do not match the rows.
    NotObserved
        The states do not excite an axis; the message states the mounting to add.
    """
    solving.refuse_priors(priors, "planar", "joint of ship_multi_angle")
    solving.refuse_temperature_terms(sensor, "planar", "joint of ship_multi_angle")
    require_affine_triad(sensor)
    solving.require_matching_rows(observations, sensor, steps)
    rows = [k for k, step in enumerate(steps) if not is_tilted(step)]
    here = [steps[k] for k in rows]
    require_excitation(bench, here)
    f = sensed_motion(bench, here, {}).f / G0
    a = observations.mean[..., rows, :] / G0
    model, gain = fit_level_states(a, f)
    at = np.array([3 * k + axis for k in rows for axis in range(3)])
    spread = ship_consistency.row_covariance(observations, bench, steps, model.matrix)
    spread = spread[..., at, :][..., at]
    whole = np.zeros((*gain.shape[:-1], 3 * len(steps)))
    whole[..., at] = gain
    agreement = ship_consistency.consistency(observations, sensor, bench, steps, model, whole, rows)
    tilted = len(steps) - len(rows)
    estimate = affine_estimate(
        sensor,
        model,
        gain @ spread @ gain.mT,
        (f - model.correct(a)).reshape(*a.shape[:-2], -1),
        np.linalg.diagonal(spread),
        tuple(f"f{axis}[{step.label}]" for step in here for axis in "xyz"),
        agreement,
        notes=(
            *([f"Estimator planar does not use the {tilted} tilted states."] if tilted else []),
            "The frame is that of the mountings' nominal axes. The uncertainties include the "
            "effects of pose, seat, speed and lean.",
        ),
    )
    require_observed(estimate, sensor, missing=())
    return estimate


METHOD = Method(
    name="ship_planar",
    bench=RateTable,
    default_coefficients={"f": ("k0", "k1", "delta_o", "delta_p")},
    needs=("f",),
    plan=planar_plan,
    estimators={"planar": planar},
    remarks=remarks,
    source="Xiao, Liu and Liu, Transducer and Microsystem Technologies 33(10), 2014",
)
