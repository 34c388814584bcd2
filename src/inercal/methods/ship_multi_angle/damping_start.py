"""The start of the damped iteration, and the uncertainty of the result along free directions."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.benches.rate_table.bench import RateTable, sensed_motion
from inercal.estimation import Gaussian
from inercal.methods.ship_multi_angle.free_norm_directions import (
    FreeDirections,
    free_directions,
    undetermined_rotations,
)
from inercal.methods.ship_planar import fit_level_states, require_excitation
from inercal.physics.plan import Spin
from inercal.physics.sensors import G0, Sensor
from inercal.physics.sensors.affine import IDENTITY_PARAMETERS, AffineModel, to_affine
from inercal.recordings import Observations


class StartingPoint(NamedTuple):
    """The start of the damped iteration, and the source of its uncertainty."""

    model: AffineModel
    uncertainty_source: str
    gain: Array | None = None  # (..., 12, 3 r) of r untilted states
    prior_covariance: Array | None = None  # (12, 12) of priors


def starting_point(
    observations: Observations,
    sensor: Sensor,
    bench: RateTable,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian],
    groups: Sequence[int],
) -> StartingPoint:
    """Return the start: nominal where the frame fixes all else, or by untilted states or priors.

    Raises
    ------
    InputError, NotObserved
        As of `damped`.
    """
    rest = [k for k in range(len(steps)) if k not in groups]
    if sensor.frame == "symmetric":
        if priors:
            raise InputError(
                'estimator damped takes no priors together with [sensor] frame = "symmetric": '
                "norms and frame determine all coefficients; remove the priors or the frame",
                key="priors",
            )
        if not _nominal_free_directions(sensor, bench, steps, groups).unobserved:
            return StartingPoint(AffineModel.of(IDENTITY_PARAMETERS), "")
    if not rest:
        return _start_from_priors(sensor, priors, bench, groups, steps)
    if priors:
        raise InputError(
            "estimator damped takes priors or untilted states, not both; remove the priors, or use "
            "estimator joint",
            key="priors",
        )
    here = [steps[k] for k in rest]
    require_excitation(bench, here)
    model, gain = fit_level_states(
        observations.mean[..., rest, :] / G0, sensed_motion(bench, here, {}).f / G0
    )
    return StartingPoint(model, "the untilted states", gain)


def require_convergence(
    converged: NDArray[np.bool_],
    sensor: Sensor,
    bench: RateTable,
    steps: Sequence[Spin],
    groups: Sequence[int],
) -> None:
    """Refuse a solution that does not converge because these tilts do not show a direction.

    Then only accidental deviations of the mountings show it, and move the solution far along it.

    Raises
    ------
    NotObserved
        Naming the directions and what to add.
    """
    if converged.ndim or converged:  # each of many trials has its own flag
        return
    blind = tuple(
        one.words for one in _nominal_free_directions(sensor, bench, steps, groups).unobserved
    )
    if blind:
        raise NotObserved(
            f"not observed: norms of these {len(groups)} tilted states do not determine "
            f"{'; '.join(blind)}: the damped iteration does not converge; add tilts of a second "
            "kind, such as XY 135 + 45, or use estimator joint",
            blind,
        )


def _start_from_priors(
    sensor: Sensor,
    priors: Sequence[Gaussian],
    bench: RateTable,
    groups: Sequence[int],
    steps: Sequence[Spin],
) -> StartingPoint:
    """Return θ and its covariance by the priors; refuse coefficients without a prior."""
    names = sensor.coefficients
    without = tuple(name for name in names if not any(name in prior.names for prior in priors))
    if without:
        left = _nominal_free_directions(sensor, bench, steps, groups)
        words = tuple(
            one.words for one in (*undetermined_rotations(sensor, left), *left.unobserved)
        )
        others = (
            "priors on all twelve coefficients"
            if sensor.frame == "mount"
            else "tilts of a second kind, such as XY 135 + 45"
        )
        raise NotObserved(
            f"not observed: these norms do not determine {'; '.join(words)}; add the untilted "
            f"states XY, YX and ZY, or {others}, or use estimator joint",
            words,
            names=without,
        )
    rows = [prior.rows(names) for prior in priors]
    root = np.concatenate([b for b, _ in rows])
    covariance = np.asarray(np.linalg.inv(root.T @ root), dtype=float)
    mean = np.concatenate([target for _, target in rows], axis=-1) @ root @ covariance
    model, slope = to_affine(sensor, mean)
    stated = slope @ covariance @ np.swapaxes(slope, -1, -2)
    return StartingPoint(model, "the stated priors", prior_covariance=stated)


def _nominal_free_directions(
    sensor: Sensor, bench: RateTable, steps: Sequence[Spin], groups: Sequence[int]
) -> FreeDirections:
    """Return the free directions of an ideal sensor without noise."""
    f = sensed_motion(bench, [steps[k] for k in groups], {}).f / G0
    return free_directions(
        sensor, AffineModel.of(IDENTITY_PARAMETERS), f, np.zeros((f.size, f.size))
    )
