"""Readings against the angle of the head: with its errors as nuisances, or taken as exact."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inercal.benches.dividing_head import DividingHead, Index, felt
from inercal.estimate import Gaussian, Problem
from inercal.methods.dual_orthogonal.square import require_mounted
from inercal.motion import Motion
from inercal.observe import vector
from inercal.recording import Observations
from inercal.sensors import G0, Sensor

Array = NDArray[np.float64]
_ROUNDING = 2.0**-50
_NATURAL = {"m/s²": G0, "rad": 1.0}


def problem(
    observations: Observations,
    sensor: Sensor,
    bench: DividingHead,
    steps: Sequence[Index],
    priors: Sequence[Gaussian] = (),
    *,
    exact: bool = False,
) -> Problem:
    """Return the problem of both accelerometers' readings.

    Parameters
    ----------
    observations : Observations
        (..., r, 2), m/s².
    sensor : Sensor
    bench : DividingHead
    steps : sequence of r Index
    priors : sequence of Gaussian
        On coefficients.
    exact : bool
        Whether the bench is taken at its declared values, without nuisances.
    """
    require_mounted(sensor)
    p = len(sensor.coefficients)
    loose = {n: q for n, q in bench.nuisances(steps).items() if q.sd > 0 and not exact}

    def linearise(x: Array) -> tuple[Array, Array]:
        made = felt(bench, steps, {n: x[..., p + k] for k, n in enumerate(loose)})
        df = np.zeros((*made.f.shape, len(loose)))
        for k, name in enumerate(loose):
            df[..., k] = made.by[name]
        return vector(sensor, observations.mean, x[..., :p], Motion(made.f), df, None)

    noise = observations.full_covariance
    largest = np.abs(observations.mean).max() / np.sqrt(
        np.diagonal(noise, axis1=-2, axis2=-1).min()
    )
    values = np.array([q.value for q in loose.values()])
    told = [Gaussian.independent(tuple(loose), values, [q.sd for q in loose.values()])]
    return Problem(
        names=(*sensor.coefficients, *loose),
        start=np.concatenate([np.zeros(p), values]),
        linearise=linearise,
        noise=noise,
        scale=np.concatenate([sensor.natural, [_NATURAL[q.unit] for q in loose.values()]]),
        priors=(*(told if loose else ()), *priors),
        wanted=sensor.coefficients,
        observations=tuple(f"{a}[{row}]" for row in observations.labels for a in sensor.channels),
        rounding=float(largest) * _ROUNDING,
    )


def by_bench(sensor: Sensor, bench: DividingHead, steps: Sequence[Index]) -> Array:
    """Return the covariance that the bench gives to all readings, (2r, 2r), at the nominal sensor.

    In (m/s²)², row after row as `Observations.full_covariance`.
    """
    made = felt(bench, steps, {})
    slope = sensor.slope(Motion(made.f), np.zeros(len(sensor.coefficients)))[..., :3]
    columns = [
        q.sd * (slope @ made.by[name][..., None]).ravel()
        for name, q in bench.nuisances(steps).items()
        if q.sd > 0
    ]
    size = 2 * len(steps)
    return sum((np.outer(column, column) for column in columns), np.zeros((size, size)))
