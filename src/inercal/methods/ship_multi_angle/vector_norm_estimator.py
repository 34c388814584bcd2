"""Untilted states as vectors and tilted ones as norms, with equal weights.

    minimise Σ |M a + p − f|² over untilted states + Σ (|M a + p| − √(A² + 1))² over tilted ones

The vectors determine the rotations that norms leave free, so that no damping is necessary. The
weights assume equal errors in g, and no nuisance is estimated: `joint` does both better. Ours.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.benches.rate_table.bench import RateTable, sensed_motion
from inercal.estimation import Estimate, Gaussian, Problem, least_squares
from inercal.methods.estimator_inputs import refuse_priors
from inercal.methods.ship_consistency import (
    bench_sensitivities,
    comparison_map,
    consistency,
    linearised_rows,
    row_covariance,
)
from inercal.methods.ship_multi_angle.tilted_states import norm_observations, tilted_rows
from inercal.methods.ship_planar import affine_estimate, require_excitation
from inercal.physics.plan import Spin
from inercal.physics.sensors import G0, Sensor
from inercal.physics.sensors.affine import AFFINE_NAMES, IDENTITY_PARAMETERS, AffineModel
from inercal.recordings import Observations


def planar_norm(
    observations: Observations,
    sensor: Sensor,
    bench: RateTable,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the twelve coefficients by untilted states' vectors and tilted ones' norms.

    Arguments as of `damped`, without priors. The covariance includes the effect of the bench's
    errors.

    Raises
    ------
    InputError
        Priors, another sensor, steps that are not those of the rows.
    NotObserved
        Fewer than twelve tilted states, or untilted ones that do not excite an axis.
    """
    refuse_priors(priors, "planar_norm", "joint")
    groups = tilted_rows("planar_norm", observations, sensor, steps)
    rest = [k for k in range(len(steps)) if k not in groups]
    here = [steps[k] for k in rest]
    require_excitation(bench, here)
    a, square = norm_observations(observations, bench, steps, groups)
    plain, f = observations.mean[..., rest, :] / G0, sensed_motion(bench, here, {}).f / G0
    model, gain, converged = fit_vectors_and_norms(plain, f, a, square)
    residual, _ = linearised_rows(model, plain, f, a, square)
    # From errors of M a + p − f of all rows, axes within, to those of the rows as compared.
    map_to = comparison_map(model, observations.mean / G0, rest, groups)
    spread = row_covariance(observations, bench, steps, model.matrix)
    spread = map_to @ spread @ np.swapaxes(map_to, -1, -2)
    agreement = consistency(observations, sensor, bench, steps, model, gain @ map_to, rest, groups)
    return affine_estimate(
        sensor,
        model,
        gain @ spread @ np.swapaxes(gain, -1, -2),
        residual,
        np.diagonal(spread, axis1=-2, axis2=-1),
        (
            *(f"f{axis}[{step.label}]" for step in here for axis in "xyz"),
            *(f"|f|[{steps[k].label}]" for k in groups),
        ),
        agreement,
        bench_sensitivities(bench, steps, gain @ map_to),
        notes=(
            "all directions are determined; the frame is that of the untilted mountings' nominal "
            "axes",
        ),
        converged=converged,
    )


def fit_vectors_and_norms(
    level: Array, f: Array, groups: Array, square: Array
) -> tuple[AffineModel, Array, NDArray[np.bool_]]:
    """Return the model, the derivative of θ by each row, (..., 12, 3 r + s), and converged.

    Arguments as of `linearised_rows`.
    """

    def at(x: Array) -> tuple[Array, Array]:
        lead = np.broadcast_shapes(x.shape[:-1], level.shape[:-2])
        model = AffineModel.of(np.broadcast_to(x, (*lead, 12)))
        return linearised_rows(model, level, f, groups, square)

    m = f.size + len(square)
    fit = least_squares(Problem(AFFINE_NAMES, IDENTITY_PARAMETERS, at, np.ones(m), np.ones(12)))
    _, slope = at(fit.value)
    gain = -np.asarray(np.linalg.pinv(slope), dtype=float)
    return AffineModel.of(fit.value), gain, fit.converged
