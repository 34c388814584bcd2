"""Estimate the noise of accelerometers that are held in a trembling hand.

A wobble θ adds g θ to the readings perpendicular to gravity, and batch means would count this as
noise. It is not an error, because the mean reading of a rest defines its mean attitude. Along
gravity, the wobble has no effect to first order. The noise of each axis is therefore estimated from
the scatter of the component along gravity, over rests in many attitudes. Let w_ia be the component
of axis a along gravity at rest i, and d_a the noise density of that axis. Then

    D_i = Σ_a w_ia² d_a

is solved by non-negative least squares with weights 1/D_i², the variance of a variance.

The mean acceleration of a tremor decreases faster than noise as a section becomes longer. D_i is
the density at zero frequency by Welch's method (1967, IEEE Trans. AU-15, 70–73). It uses means over
overlapping halves with a Hann window, which suppresses tremor above some Hz. If the two halves of a
rest differ by more than the 99 % bound of their noise, which another test reports, only the scatter
within the halves counts, because a step in one rest is not noise of the others.
"""

# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from collections.abc import Iterable, Iterator

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.physics.sensors import Sensor, nominal_inverse

_WINDOWS = 11  # in each rest; in 3 s they pass frequencies below 4 Hz, where a hand's tremor begins
_CHANGED = 6.63  # 99 % quantile of χ² with one degree of freedom
# E (z² − 1) above that bound: fraction of a density that choosing the halves removes by chance.
_TAKEN = 0.0745
_ROUNDS = 5  # of weighting; the third round changes the result by one per cent
_LEAST = 0.05  # of the mean density; with few rests some axes are never along gravity


def density_without_hand_motion(density: Array, sensor: Sensor, sections: Iterable[Array]) -> Array:
    """Return the noise density, using only readings along gravity for the accelerometers.

    Parameters
    ----------
    density : (m, m) array
        Noise density from batch means of all channels, SI² times samples.
    sensor : Sensor
        Sensor whose accelerometers come first.
    sections : iterable of (n, m) arrays
        Readings during rests, SI.
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
    """Return the degrees of freedom of the accelerometers' noise, which all axes share."""
    return (_WINDOWS - 1) * rests


def _shrink_densities(own: Array, weighted: Array) -> Array:
    """Shrink densities (a,) towards their mean as far as chance explains their differences.

    Attitudes that mix the axes determine the sum of the densities well but their differences
    poorly. The rows (r, a) are weighted as for `own`, so their errors have variance 2/ν each, and
    the covariance of the densities is that of least squares. If the logarithms scatter by more than
    chance predicts, the excess is kept. This is the shrinkage of Smyth 2004
    (`inercal.estimation.correlation`) without the degrees of freedom of its prior.
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
    """Return the accelerometers' readings along each section's mean specific force, (n,) each.

    Parameters
    ----------
    sensor : Sensor
        Sensor whose accelerometers come first.
    sections : iterable of (n, m) arrays
        Readings during rests, SI.
    """
    return [series for _, series in _gravity_projections(sensor, sections)]


def _gravity_projections(
    sensor: Sensor, sections: Iterable[Array]
) -> Iterator[tuple[Array, Array]]:
    """Yield each axis's share of a section's mean force, (a,), and the readings along it."""
    force = sensor.select_axes("f")
    a = len(force.axes)
    back = nominal_inverse(force.axes)[:, :3]
    for section in sections:
        up = section[:, :a].mean(axis=0) @ back
        part = back @ up / float(np.linalg.norm(up))
        yield part, section[:, :a] @ part


def _densities(y: Array) -> tuple[float, float, float]:
    """Return three estimates of the density of (n,) samples at zero frequency, without their mean.

    The first uses all of the scatter, the second omits the change between the two halves, and the
    third uses only that change. The first two are increased by the average loss for white noise
    that results from choosing between them.
    """
    n, y = y.size, y - y[0]  # becomes exactly zero if nothing changes
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
