"""Determine the noise of sections at rest: its correlation, its scatter, and its changes.

The statistics come from `inercal.estimation.section_statistics`, separately for accelerometers and
gyros. For a hand-held sensor only the accelerometer readings along gravity are analysed. All other
readings contain motion of the hand, whose scatter appears in the residuals
(`inercal.estimation.residual_scatter`).

In a trembling hand, a wobble θ adds g θ to the readings perpendicular to gravity, and batch means
would count this as noise. It is not an error, because the mean reading of a rest defines its mean
attitude. Along gravity, the wobble has no effect to first order. The noise of each axis is
therefore estimated from the scatter of the component along gravity, over rests in many attitudes.
Let w_ia be the component of axis a along gravity at rest i, and d_a the noise density of that axis.
Then

    D_i = Σ_a w_ia² d_a

is solved by non-negative least squares with weights 1/D_i², the variance of a variance.

The mean acceleration of a tremor decreases faster than noise as a section becomes longer. D_i is
the density at zero frequency by Welch's method (1967, IEEE Trans. AU-15, 70–73). It uses means over
overlapping halves with a Hann window, which suppresses tremor above some Hz. If the two halves of a
rest differ by more than the 99 % bound of their noise, which another test reports, only the scatter
within the halves counts, because a step in one rest is not noise of the others.
"""

# pyright: reportMissingTypeStubs=false

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.basics.units import format_quantity
from inercal.estimation import ModelTest
from inercal.estimation.correlation import WHITE, Contrasts, NoiseCorrelation
from inercal.estimation.section_statistics import (
    SectionStatistics,
    analyse_sections,
    haar_contrasts,
)
from inercal.physics.quantities import QUANTITIES
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
    projections = _gravity_projections(sensor, sections)
    found = [(part**2, *_densities(series)) for part, series in projections]
    by_axis, seen, calm, halves = (np.array(one) for one in zip(*found, strict=True))
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


_ALIKE = 3.0  # rests whose scatter differs by a larger factor are reported


class SectionDrift(NamedTuple):
    """Drift of m biases, quadratic in time, estimated from the slopes within sections."""

    rates: Array  # (2, m), per second and per second²
    covariance: Array  # (m, 2, 2)

    def of_channels(self, chosen: Sequence[bool]) -> "SectionDrift":
        """Return the drift with the other channels set to zero."""
        keep = np.array(chosen)
        return SectionDrift(self.rates * keep, self.covariance * keep[:, None, None])

    def course(self, since: Array, length: float) -> tuple[Array, Array]:
        """Return the drift at given times, (s, m), and its covariance between them, (s, s, m).

        The mean of the drift over a run is zero.

        Parameters
        ----------
        since : (s,) array
            Times since the middle of the run, s.
        length : float
            Length of the run, s.
        """
        basis = np.stack([since, 0.5 * (since**2 - length**2 / 12)], axis=-1)
        return basis @ self.rates, np.einsum("si,mij,tj->stm", basis, self.covariance, basis)


class SectionNoise(NamedTuple):
    """Noise of r sections in m channels."""

    scale: Array  # (r, m), each section's variance divided by the mean of all
    correlation: tuple[NoiseCorrelation, ...]  # one for each channel
    drift: SectionDrift
    tests: tuple[ModelTest, ...]
    notes: tuple[str, ...]
    disturbance_variance: Array  # (r, m), variance of each mean due to a change within its section
    drifting: tuple[str, ...] = ()  # what the sensors measure whose drift was detected: "f", "w"

    def factor(self, seconds: Array, lengths: Array, batches: int) -> Array:
        """Return the variance of means relative to that from the pooled batch means, (s, m).

        Parameters
        ----------
        seconds : (s,) array
            Durations of the means, s.
        lengths : (r,) array
            Durations of the sections whose batch means were pooled, s.
        batches : int
            Number of batches in each section.
        """
        parts = [
            noise.mean_variance_ratio(seconds)
            / float(np.mean(noise.batch_variance_ratio(lengths, batches)))
            for noise in self.correlation
        ]
        return np.stack(parts, axis=-1)


def section_noise_statistics(
    sensor: Sensor,
    sections: Callable[[], Iterable[Array]],
    seconds: Array,
    since: Array,
    labels: Sequence[str],
    rounding: Array,
    *,
    by_hand: bool,
) -> SectionNoise:
    """Return the noise statistics of sections.

    Parameters
    ----------
    sensor : Sensor
    sections : callable
        Function that returns the sections, (n, m) each, SI.
    seconds : (r,) array
        Durations of the sections, s.
    since : (r,) array
        Time from the middle of all sections to the middle of each section, s.
    labels : sequence of r str
    rounding : (m,) array
        Variance that coarse steps add to each mean.
    by_hand : bool
    """
    r, m = len(labels), len(sensor.axes)
    scale, disturbance_variance = np.ones((r, m)), np.zeros((r, m))
    drift = SectionDrift(np.zeros((2, m)), np.zeros((m, 2, 2)))
    correlation = [WHITE] * m
    tests: list[ModelTest] = []
    notes: list[str] = []
    drifting: list[str] = []
    if by_hand:
        steps = np.array([rounding[[axis.measures == "f" for axis in sensor.axes]].max()])
        along = _gravity_projections(sensor, sections())
        cut = haar_contrasts((one[:, None] for _, one in along), seconds)
        judged = analyse_sections(cut, labels, ["accelerometers along gravity"], steps)
        # The sign of a drift's effect changes with the attitude; the norms of all rests reveal the
        # drift.
        within = (judged.within,) if judged.within and judged.shape == "change" else ()
        return SectionNoise(scale, (WHITE,) * m, drift, within, (), disturbance_variance)
    for kind, quantity in QUANTITIES.items():
        own = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind]
        if not own:
            continue
        parts = sections() if len(own) == m else (section[:, own] for section in sections())
        cut = haar_contrasts(parts, seconds)
        names = [sensor.axes[k].name for k in own]
        noises = [sensor.axes[k].noise for k in own]
        # Slow noise that the sensor's table states is part of the noise; a trend may exceed it.
        slow = np.array([(one.bias_instability, one.random_walk) for one in noises]).T
        stated = bool(slow.any())
        judged = analyse_sections(cut, labels, names, rounding[own])
        scale[:, own] = judged.scale[:, None]
        if stated:
            cut = cut.relative_to_slow_noise(*slow)
            judged = analyse_sections(cut, labels, names, rounding[own])
        disturbance_variance[:, own] = judged.disturbance_variance
        tests += judged.tests
        drifting += [kind] * judged.drifts
        if judged.drifts or not stated:
            if kind == "w":
                # All sections measure a gyro's bias, so their residuals reveal its drift.
                drift.covariance[own, 0, 0] = judged.significant_trend_sd**2
            elif np.isfinite(judged.slope_sd).all():
                # Only two of six measure an accelerometer's bias, so a drift that no test can
                # detect shifts it.
                steady = np.asarray(~judged.disturbance_variance.any(axis=1))
                drift.rates[:, own], drift.covariance[own] = drift_of_slopes(
                    cut.of(steady), since[steady], judged.slope_sd, rounding[own]
                )
        for k in own:
            correlation[k] = judged.correlation
        notes += _notes(quantity.sensors, judged, seconds, labels, "stated" if stated else "white")
    every = tuple(correlation), drift, tuple(tests), tuple(notes), disturbance_variance
    return SectionNoise(scale, *every, tuple(drifting))


def drift_of_slopes(
    sections: Contrasts, since: Array, slope_sd: Array, rounding: Array
) -> tuple[Array, Array]:
    """Estimate the rate and rate change of a drift, (2, m), and their covariance, (m, 2, 2).

    The estimate is a least-squares fit to the slopes of r sections, which all have the same
    standard deviation in units of their noise.

    Parameters
    ----------
    sections : Contrasts
    since : (r,) array
    slope_sd : (m,) array
        Standard deviation of `Contrasts.slope`.
    rounding : (m,) array
        Variance that coarse steps add to the mean of each half of a section.
    """
    reach = sections.slope_per_trend
    design = reach.T[..., None] * np.stack([np.ones(len(since)), since], axis=-1)  # (m, r, 2)
    across = np.swapaxes(design, -1, -2)
    gram = np.linalg.pinv(across @ design)
    rates = (gram @ across @ sections.slope.T[..., None])[..., 0].T
    # The means of two halves of T seconds are T/2 apart, and both are rounded.
    of_steps = 8 * rounding * np.mean((reach / sections.seconds[:, None]) ** 2, axis=0)
    return rates, (slope_sd**2 + of_steps)[:, None, None] * gram


def drift_notes(sensor: Sensor, noise: SectionNoise, length: float, middle: float) -> list[str]:
    """Return notes about the drift over the run.

    Parameters
    ----------
    sensor : Sensor
    noise : SectionNoise
    length : float
        Duration of the recording, s.
    middle : float
        Middle of the sections at rest, s after the start of the recording.
    """
    notes: list[str] = []
    drift = noise.drift
    each = np.hypot(drift.rates[0], np.sqrt(drift.covariance[:, 0, 0])) * length
    for kind, quantity in QUANTITIES.items():
        own = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind]
        if own and (most := float(each[own].max())) > 0:
            text, words = format_quantity(most, 0.0, quantity.bias_unit, 2), quantity.sensors
            notes.append(
                f"The slopes within the rests suggest that the {words} drift by about {text} over "
                f"the run. Their biases, and the U of these, are valid {middle:.0f} s after its "
                "start."
                if kind in noise.drifting
                else f"A drift of the {words} of up to {text} (1 σ) over the run cannot be "
                "excluded. The uncertainty of the biases includes it."
            )
    return notes


def _notes(
    words: str, judged: SectionStatistics, seconds: Array, labels: Sequence[str], expected: str
) -> list[str]:
    notes = [
        f"The readings change within {labels[k]}. The uncertainty of its mean includes the "
        "effect. Repeat the position."
        for k in np.flatnonzero(judged.disturbance_variance.any(axis=1)).tolist()
    ]
    noise = judged.correlation
    if noise is not WHITE:
        times = float(np.sqrt(np.median(noise.mean_variance_ratio(seconds))))
        notes.append(
            f"The noise of the {words} within sections is correlated over about "
            f"{float(f'{noise.seconds:.1g}'):g} s, so the uncertainty of a mean is {times:.2g} "
            f"times as large as it would be with {expected} noise."
        )
    worst = int(np.argmax(judged.scale))
    ratio = float(np.sqrt(judged.scale[worst] / np.median(judged.scale)))
    if ratio > _ALIKE:
        notes.append(
            f"In section {labels[worst]}, the scatter of the {words} is {ratio:.2g} times as large "
            "as the median of all sections. The uncertainty of its mean is larger accordingly."
        )
    return notes
