"""The rows of tilted states, their norms, and the columns of their axes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import NotObserved
from inercal.benches.rate_table.bench import RateTable, sensed_motion
from inercal.benches.rate_table.fixture import is_tilted
from inercal.methods.estimator_inputs import refuse_temperature_terms, require_matching_rows
from inercal.physics.plan import Spin
from inercal.physics.sensors import G0, Sensor
from inercal.physics.sensors.affine import require_affine_triad
from inercal.recordings import Observations

MIN_TILTED_STATES = 12  # groups


def tilted_rows(
    name: str, observations: Observations, sensor: Sensor, steps: Sequence[Spin]
) -> list[int]:
    """Return the rows of the tilted states, or refuse too few."""
    refuse_temperature_terms(sensor, name, "joint")
    require_affine_triad(sensor)
    require_matching_rows(observations, sensor, steps)
    groups = [k for k, step in enumerate(steps) if is_tilted(step)]
    if len(groups) < MIN_TILTED_STATES:
        raise NotObserved(
            f"not observed: {len(groups)} tilted states make {len(groups)} norms for "
            f"{MIN_TILTED_STATES} coefficients; add tilted states until there are "
            f"{MIN_TILTED_STATES} for estimator {name}, or use estimator joint",
            key="steps",
        )
    return groups


def norm_observations(
    observations: Observations, bench: RateTable, steps: Sequence[Spin], groups: Sequence[int]
) -> tuple[Array, Array]:
    """Return readings of the groups, (..., r, 3) g, and A² + 1, (r,) g²."""
    f = sensed_motion(bench, [steps[k] for k in groups], {}).f / G0
    return observations.mean[..., groups, :] / G0, (f**2).sum(-1)


def axis_columns(rows: Sequence[int]) -> NDArray[np.intp]:
    """Return the columns of the three axes of each row."""
    return (3 * np.asarray(rows, dtype=np.intp)[:, None] + np.arange(3)).ravel()
