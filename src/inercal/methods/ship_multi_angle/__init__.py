"""Calibrate a triad that is tilted by known angles on a rate table, as for ship models.

* `joint`: uses all states, untilted and tilted, and compares each axis with the force that it
  sensed. The angles and radius of each mounting, the speeds, the lean at each rest, the common
  radius and gravity are nuisances with their stated deviations.
* `planar`: uses only the untilted states and is linear (`inercal.methods.ship_planar`).
* `planar_norm`: uses the untilted states as vectors and the tilted ones as norms, with equal
  weights.
* `damped`: the source's Levenberg–Marquardt iteration on the norms of the tilted states, starting
  from `planar`.
* `global`: the source's optimisation of the same norms, by differential evolution.

Norms do not observe a rotation of the triad. The rotation that results from damping or a search is
therefore not a measurement. Both estimators name the free directions and the source of their
uncertainty. If both estimators reach the same sum of squares, this validates neither of them.

`planar_norm` uses untilted states as vectors and tilted ones as norms, with equal weights::

    minimise Σ |M a + p − f|² over untilted states + Σ (|M a + p| − √(A² + 1))² over tilted ones

The vectors determine the rotations that norms leave free, so no damping is necessary. The weights
assume equal errors in g, and no nuisance is estimated; `joint` is better in both respects. The
estimator is our own.

Source: Xiao Changrun, Liu Yang, Liu Ruijie, Transducer and Microsystem Technologies 33(10), 2014,
10.13873/J.1000-9787(2014)10-0021-04. Its equations are illegible in our copy and were reconstructed
from its text. `joint`, `planar_norm` and all covariances are our own.
"""

from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import NotObserved
from inercal.benches.rate_table.bench import RateTable, mounting_names, sensed_motion
from inercal.benches.rate_table.fixture import TiltConvention, multi_angle_plan, planar_plan
from inercal.estimation import Estimate, Problem, least_squares
from inercal.methods import Method, Priors, ship_consistency, solving
from inercal.methods.observability import require_observed
from inercal.methods.ship_multi_angle.norm_equations import norm_observations, tilted_rows
from inercal.methods.ship_multi_angle.norm_estimators import damped, global_
from inercal.methods.ship_planar import affine_estimate, planar, remarks, require_excitation
from inercal.methods.solving import refuse_priors, require_matching_rows
from inercal.physics.plan import Spin, Spins
from inercal.physics.sensors import G0, Sensor
from inercal.physics.sensors.affine import AFFINE_NAMES, IDENTITY_PARAMETERS, AffineModel
from inercal.recordings import Observations


def planar_norm(
    observations: Observations, sensor: Sensor, bench: RateTable, steps: Spins, priors: Priors = ()
) -> Estimate:
    """Return the twelve coefficients from vectors of untilted states and norms of tilted ones.

    The arguments are as for `damped`, without priors. The covariance includes the effect of the
    bench's errors.

    Raises
    ------
    InputError
        There are priors, the sensor is unsuitable, or the steps do not match the rows.
    NotObserved
        There are fewer than twelve tilted states, or the untilted ones do not excite an axis.
    """
    refuse_priors(priors, "planar_norm", "joint")
    groups = tilted_rows("planar_norm", observations, sensor, steps)
    rest = [k for k in range(len(steps)) if k not in groups]
    here = [steps[k] for k in rest]
    require_excitation(bench, here)
    a, square = norm_observations(observations, bench, steps, groups)
    plain, f = observations.mean[..., rest, :] / G0, sensed_motion(bench, here, {}).f / G0
    model, gain, converged = fit_vectors_and_norms(plain, f, a, square)
    residual, _ = ship_consistency.linearised_rows(model, plain, f, a, square)
    # From errors of M a + p − f in all rows (axis index fastest) to errors of the compared rows.
    map_to = ship_consistency.comparison_map(model, observations.mean / G0, rest, groups)
    spread = ship_consistency.row_covariance(observations, bench, steps, model.matrix)
    spread = map_to @ spread @ map_to.mT
    agreement = ship_consistency.consistency(
        observations, sensor, bench, steps, model, gain @ map_to, rest, groups
    )
    return affine_estimate(
        sensor,
        model,
        gain @ spread @ gain.mT,
        residual,
        np.linalg.diagonal(spread),
        (
            *(f"f{axis}[{step.label}]" for step in here for axis in "xyz"),
            *(f"|f|[{steps[k].label}]" for k in groups),
        ),
        agreement,
        notes=(
            "All directions are determined. The frame is that of the nominal axes of the untilted "
            "mountings.",
        ),
        converged=converged,
    )


def fit_vectors_and_norms(
    level: Array, f: Array, groups: Array, square: Array
) -> tuple[AffineModel, Array, Bools]:
    """Return the model, the sensitivity of θ to each row, (..., 12, 3 r + s), and convergence.

    The arguments are as for `linearised_rows`.
    """

    def at(x: Array) -> tuple[Array, Array]:
        lead = np.broadcast_shapes(x.shape[:-1], level.shape[:-2])
        model = AffineModel.of(np.broadcast_to(x, (*lead, 12)))
        return ship_consistency.linearised_rows(model, level, f, groups, square)

    m = f.size + len(square)
    fit = least_squares(Problem(AFFINE_NAMES, IDENTITY_PARAMETERS, at, np.ones(m), np.ones(12)))
    _, slope = at(fit.value)
    gain = -np.asarray(np.linalg.pinv(slope), dtype=float)
    return AffineModel.of(fit.value), gain, fit.converged


def plan(
    seconds: float = 150.0, reading: TiltConvention = "azimuth", one_speed: bool = False
) -> tuple[Spin, ...]:
    """Return the nine untilted states, followed by the sixteen groups of tilted ones.

    Parameters
    ----------
    seconds : float
        Duration of each dwell, s.
    reading : "azimuth", "dihedral" or "successive"
        How to interpret a pose with two tilts (`inercal.benches.rate_table.fixture`).
    one_speed : bool
        Whether all groups are at the same speed, as in the source.
    """
    return (
        *planar_plan(seconds=seconds),
        *multi_angle_plan(reading, one_speed=one_speed, seconds=seconds),
    )


def joint(
    observations: Observations, sensor: Sensor, bench: RateTable, steps: Spins, priors: Priors = ()
) -> Estimate:
    """Return the most probable coefficients and bench errors, given all readings and priors.

    Parameters
    ----------
    observations : Observations
        One row per state, (..., r, 3) m/s².
    sensor : Sensor
        Three accelerometers, with the coefficients to estimate.
    bench : RateTable
    steps : sequence of r Spin
        The steps of the rows, in known attitudes.
    priors : sequence of Gaussian
        Priors on coefficients, from other measurements.

    Raises
    ------
    InputError
        The steps do not match the rows.
    NotObserved
        These states do not determine all coefficients.
    """
    require_matching_rows(observations, sensor, steps)
    try:
        estimate = solving.solve(
            observations,
            priors,
            lambda some, own: ship_consistency.joint_problem(some, sensor, bench, steps, own),
        )
        require_observed(estimate, sensor, missing=())
    except NotObserved:
        if not priors:
            # If the states are the cause, this error names the mounting to add.
            require_excitation(bench, steps)
        raise
    return replace(estimate, notes=(_state_note(estimate, steps), *estimate.notes))


def _state_note(estimate: Estimate, steps: Spins) -> str:
    """Return a note on the determined coefficients, the influence of priors, and the frame."""
    text = f"The states determine {estimate.rank} of {len(estimate.wanted)} coefficients."
    if left := [one.words for one in estimate.null_directions]:
        text += f" Warning: only priors decided {'; '.join(left)}."
    frame = f"the mean of {len(set(mounting_names(steps)))} mountings by their stated angles"
    return f"{text} The frame is {frame}."


METHOD = Method(
    name="ship_multi_angle",
    bench=RateTable,
    default_coefficients={"f": ("k0", "k1", "delta_o", "delta_p")},
    also={"f": ("temperature",)},
    needs=("f",),
    plan=plan,
    estimators={
        "joint": joint,
        "planar": planar,
        "planar_norm": planar_norm,
        "damped": damped,
        "global": global_,
    },
    norm_only_estimators=("damped", "global"),
    remarks=remarks,
    weighs_common_errors=True,
    source="Xiao, Liu and Liu, Transducer and Microsystem Technologies 33(10), 2014",
)
