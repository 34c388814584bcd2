"""The accelerometers' noise while a hand holds the sensor and trembles.

A wobble θ moves gravity across the axes by g θ, and batch means would count it as noise. The mean
reading of a rest defines its mean attitude, so the wobble is no error of it; along gravity the
wobble has no effect to first order. The scatter of that component, over rests in many attitudes,
gives the noise of each axis: with w the part of each axis along gravity at rest i and d the axes'
densities

    D_i = Σ_a w_ia² d_a

solved by non-negative least squares with weights 1/D_i², the variance of a variance.

The mean acceleration of a tremor decreases with the length of a section, faster than noise. D_i is
the density at zero frequency by Welch's method (1967, IEEE Trans. AU-15, 70–73): means over
overlapping halves under a Hann window, which suppresses a tremor above some Hz. Where the halves of
a rest differ beyond the 99 % bound of their noise, which another test reports, only the scatter
within the halves counts: a step in one rest is not noise of the others.
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from collections.abc import Iterable, Iterator

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.physics.sensors import Sensor, inverse

_WINDOWS = 11  # in a rest; in 3 s they pass frequencies below 4 Hz, where a hand's tremor begins
_CHANGED = 6.63  # χ² of one degree of freedom, 99 %
# E (z² − 1) above that bound: share of a density that the choice of halves removes by chance.
_TAKEN = 0.0745
_ROUNDS = 5  # of weighting; the third changes a per cent
_LEAST = 0.05  # of the mean density: with few rests some axes are never along gravity


def density_without_hand_motion(density: Array, sensor: Sensor, sections: Iterable[Array]) -> Array:
    """Return the noise density, for the accelerometers as estimated along gravity.

    Parameters
    ----------
    density : (m, m) array
        From batch means of all channels, SI² times samples.
    sensor : Sensor
        Its accelerometers come first.
    sections : iterable of (n, m) arrays
        Rests, SI.
    """
    a = len(sensor.select_axes("f").axes)
    found: list[tuple[float, float, float]] = []
    parts: list[Array] = []
    for part, series in _gravity_projections(sensor, sections):
        found.append(_densities(series))
        parts.append(part**2)
    by_axis = np.array(parts)
    seen, calm, halves = (np.array(one) for one in zip(*found, strict=True))
    if not seen.any():
        return density
    own = np.full(a, float(seen.mean()))
    for _ in range(_ROUNDS):
        weight = 1 / (by_axis @ own)
        counted: Array = np.where(halves * weight > _CHANGED, calm, seen)
        own, _residual = scipy.optimize.nnls(by_axis * weight[:, None], counted * weight)
        own = np.maximum(own, _LEAST * float(seen.mean()))
    own = _shrink_densities(own, by_axis / (by_axis @ own)[:, None])
    replaced = density.copy()
    replaced[:a, :], replaced[:, :a] = 0.0, 0.0
    replaced[:a, :a] = np.diag(own)
    return replaced


def noise_degrees_of_freedom(rests: int) -> int:
    """Return the degrees of freedom of the accelerometers' noise, if their axes are equal."""
    return (_WINDOWS - 1) * rests


def _shrink_densities(own: Array, weighted: Array) -> Array:
    """Return densities (a,) moved to their mean as far as chance explains their differences.

    Attitudes that mix the axes determine the sum of the densities well and their differences less:
    with the rows (r, a) weighted as for `own`, whose errors have variance 2/ν each, their
    covariance is that of least squares. Logarithms that scatter by more keep the excess: the
    shrinkage of Smyth 2004 (`inercal.estimation.correlation`) without the freedom of its prior.
    """
    a = own.size
    if a < 2:
        return own
    log, apart = np.log(own), np.eye(a) - 1 / a
    covariance = 2 / (_WINDOWS - 1) * np.linalg.pinv(weighted.T @ weighted)
    of_logs = apart @ (covariance / np.outer(own, own)) @ apart
    by_chance, seen = float(np.trace(of_logs)) / (a - 1), float(np.var(log, ddof=1))
    kept = max(0.0, 1 - by_chance / seen) if seen > 0 else 0.0
    drawn = np.exp(kept * (log - log.mean()))
    return np.asarray(own.mean() * drawn / drawn.mean(), dtype=np.float64)


def readings_along_gravity(sensor: Sensor, sections: Iterable[Array]) -> list[Array]:
    """Return the accelerometers' readings along the mean specific force of each section, (n,) each.

    Parameters
    ----------
    sensor : Sensor
        Its accelerometers come first.
    sections : iterable of (n, m) arrays
        Rests, SI.
    """
    return [series for _, series in _gravity_projections(sensor, sections)]


def _gravity_projections(
    sensor: Sensor, sections: Iterable[Array]
) -> Iterator[tuple[Array, Array]]:
    """Yield the share of each axis in the mean force of a section, (a,), and readings along it."""
    force = sensor.select_axes("f")
    a = len(force.axes)
    back = inverse(Sensor(force.name, force.axes), np.eye(a), np.zeros(0)).f
    for section in sections:
        up = section[:, :a].mean(axis=0) @ back
        part = back @ up / float(np.linalg.norm(up))
        yield part, section[:, :a] @ part


def _densities(y: Array) -> tuple[float, float, float]:
    """Return the density of (n,) samples at zero frequency, without their mean, in three ways.

    From all of the scatter; without the change from half to half; from that change alone. The first
    two are raised by the average loss of white noise from choosing between them.
    """
    n, y = y.size, y - y[0]  # exactly zero where nothing changes
    step = np.where(np.arange(n) < n // 2, 1 / (n // 2), -1 / (n - n // 2))
    step /= float(np.linalg.norm(step))
    change, share = float(step @ y), _density(step)
    raised = 1 / (1 - _TAKEN * share)
    calm = _density(y - change * step) / (1 - share)
    return raised * _density(y), raised * calm, change**2


def _density(y: Array) -> float:
    """Return the density of (n,) samples at zero frequency, without their mean."""
    hop = max(y.size // (_WINDOWS + 1), 2)
    starts = np.arange(0, y.size - 2 * hop + 1, hop)
    window = np.hanning(2 * hop + 1)[:-1]
    weight = window / window.sum()
    means = np.array([weight @ y[start : start + 2 * hop] for start in starts.tolist()])
    # Neighbouring windows share half their samples; their correlation is 1/6.
    shared = 1 - 1 / (3 * means.size)
    return float(means.var(ddof=1)) / (float(weight @ weight) * shared)
