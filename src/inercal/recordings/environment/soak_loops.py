"""Hysteresis over soaks: biases at one temperature, reached from below and from above."""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.recordings import Observations
from inercal.recordings.environment.soaks import SOAK_SPREAD, soak_numbers, soak_temperatures


class SoakLoop(NamedTuple):
    """Half of the difference of two soaks at one temperature, rising minus falling.

    Parameters
    ----------
    temperature : float
        K.
    half : (m,) array
        Of the mean residual of each axis, SI.
    """

    temperature: float
    half: Array


def soak_loops(observations: Observations, residual: Array) -> tuple[SoakLoop, ...]:
    """Return the loops of a run that comes to a temperature from below and from above.

    Parameters
    ----------
    observations : Observations
        Of r rows and m axes, one trial.
    residual : (r m,) array
        Of a fit to them, SI; of another size there are no loops.
    """
    r, m = observations.mean.shape[-2:]
    if residual.shape != (r * m,):
        return ()
    number, kelvin = soak_numbers(observations), soak_temperatures(observations)
    mean = np.stack([residual.reshape(r, m)[number == k].mean(axis=0) for k in range(kelvin.size)])
    rising = np.diff(kelvin, prepend=kelvin[0]) > 0
    falling = np.diff(kelvin, prepend=kelvin[0]) < 0
    found: list[SoakLoop] = []
    for k in np.flatnonzero(falling).tolist():
        near = np.flatnonzero(rising & (np.abs(kelvin - kelvin[k]) < SOAK_SPREAD)).tolist()
        if near:
            found.append(SoakLoop(float(kelvin[k]), 0.5 * (mean[near].mean(axis=0) - mean[k])))
    return tuple(found)
