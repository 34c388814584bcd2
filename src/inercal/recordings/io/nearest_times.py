"""Samples of two sensors joined by time: to each sample the one of the other nearest in time.

No reading is interpolated: that would filter its noise.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.recordings import Indices

_APART = 0.75  # of the longer median step: how far a sample may be from the one it is joined to


def nearest_samples(times: NDArray[Any], wanted: NDArray[Any]) -> tuple[Indices, NDArray[np.bool_]]:
    """Return the sample nearest to each wanted time, (n,), and whether it is near enough.

    Parameters
    ----------
    times : (m,) array
        In any order.
    wanted : (n,) array
        In the same unit.
    """
    order = np.argsort(times, kind="stable")
    ordered = times[order]
    after = np.clip(np.searchsorted(ordered, wanted), min(1, times.size - 1), times.size - 1)
    before = np.maximum(after - 1, 0)
    closer = wanted - ordered[before] <= ordered[after] - wanted
    near = order[np.where(closer, before, after)]
    reach = _APART * max(_median_step(times), _median_step(wanted))
    return near, np.abs(times[near] - wanted) <= reach


def _median_step(times: NDArray[Any]) -> float:
    steps = np.abs(np.diff(times))
    return float(np.median(steps, overwrite_input=True)) if steps.size else 0.0
