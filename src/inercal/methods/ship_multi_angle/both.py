"""Untilted states as vectors and tilted ones as norms, all rows alike.

    minimise Σ |M a + p − f|² over untilted states + Σ (|M a + p| − √(A² + 1))² over tilted ones

The vectors tell the rotations that norms leave free, so that nothing has to be damped. The weights
are those of equal errors in g, and no nuisance is estimated: `joint` does both better. Ours.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.benches.rate_table.bench import RateTable, sensed_motion
from inercal.errors import InputError
from inercal.estimate import Estimate, Gaussian, Problem, least_squares
from inercal.methods.ship_consistency import by_stated, compared, consistency, linearised, of_rows
from inercal.methods.ship_multi_angle.states import of_norms, tilted_rows
from inercal.methods.ship_planar import estimate_of, require_excited
from inercal.plan import Spin
from inercal.recording import Observations
from inercal.sensors import G0, Sensor
from inercal.sensors.affine import IDEAL, NAMES, Affine


def planar_norm(
    observations: Observations,
    sensor: Sensor,
    bench: RateTable,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the twelve coefficients by untilted states' vectors and tilted ones' norms.

    Arguments as of `damped`, without priors. The covariance holds what the bench's errors do to the
    result.

    Raises
    ------
    InputError
        Priors, another sensor, steps that are not those of the rows.
    NotObserved
        Fewer than twelve tilted states, or untilted ones that leave an axis unexcited.
    """
    if priors:
        raise InputError("estimator planar_norm takes no priors; joint does")
    groups = tilted_rows("planar_norm", observations, sensor, steps)
    rest = [k for k in range(len(steps)) if k not in groups]
    here = [steps[k] for k in rest]
    require_excited(bench, here)
    a, square = of_norms(observations, bench, steps, groups)
    plain, f = observations.mean[..., rest, :] / G0, sensed_motion(bench, here, {}).f / G0
    model, gain, converged = solve(plain, f, a, square)
    residual, _ = linearised(model, plain, f, a, square)
    # From errors of M a + p − f of all rows, axes within, to those of the rows as compared.
    map_to = compared(model, observations.mean / G0, rest, groups)
    spread = of_rows(observations, bench, steps, model.matrix)
    spread = map_to @ spread @ np.swapaxes(map_to, -1, -2)
    agreement = consistency(observations, sensor, bench, steps, model, gain @ map_to, rest, groups)
    return estimate_of(
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
        by_stated(bench, steps, gain @ map_to),
        notes=("no direction is null; the untilted mountings' nominal axes are the frame",),
        converged=converged,
    )


def solve(
    level: Array, f: Array, groups: Array, square: Array
) -> tuple[Affine, Array, NDArray[np.bool_]]:
    """Return the model, how θ moves with an error of each row, (..., 12, 3 r + s), and converged.

    Arguments as of `linearised`.
    """

    def at(x: Array) -> tuple[Array, Array]:
        lead = np.broadcast_shapes(x.shape[:-1], level.shape[:-2])
        model = Affine.of(np.broadcast_to(x, (*lead, 12)))
        return linearised(model, level, f, groups, square)

    m = f.size + len(square)
    found = least_squares(Problem(NAMES, IDEAL, at, np.ones(m), np.ones(12)))
    _, slope = at(found.value)
    return Affine.of(found.value), -np.asarray(np.linalg.pinv(slope), dtype=float), found.converged
