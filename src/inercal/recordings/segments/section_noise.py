"""Determine the noise of sections at rest: its correlation, its scatter, and its changes.

The statistics come from `inercal.estimation.section_statistics`, separately for accelerometers and
gyros. For a hand-held sensor only the accelerometer readings along gravity are analysed. All other
readings contain motion of the hand, whose scatter appears in the residuals
(`inercal.estimation.residual_scatter`).
"""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

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
from inercal.physics.sensors import Sensor
from inercal.recordings.segments.hand_motion_noise import readings_along_gravity

_ALIKE = 3.0  # rests whose scatter differs by a larger factor are reported


class SectionDrift(NamedTuple):
    """Drift of m biases, quadratic in time, estimated from the slopes within sections."""

    rates: Array  # (2, m), per second and per second²
    covariance: Array  # (m, 2, 2)

    @classmethod
    def zero(cls, m: int) -> "SectionDrift":
        """Return a drift that is known to be exactly zero."""
        return cls(np.zeros((2, m)), np.zeros((m, 2, 2)))

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
    drift = SectionDrift.zero(m)
    correlation = [WHITE] * m
    tests: list[ModelTest] = []
    notes: list[str] = []
    drifting: list[str] = []
    if by_hand:
        steps = np.array([rounding[[axis.measures == "f" for axis in sensor.axes]].max()])
        series = readings_along_gravity(sensor, sections())
        cut = haar_contrasts((one[:, None] for one in series), seconds)
        judged = analyse_sections(cut, labels, ["accelerometers along gravity"], steps)
        # The sign of a drift's effect changes with the attitude; the norms of all rests reveal the
        # drift.
        within = (judged.within,) if judged.within and judged.shape == "change" else ()
        return SectionNoise(scale, (WHITE,) * m, drift, within, (), disturbance_variance)
    for kind, quantity in QUANTITIES.items():
        own = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind]
        if not own:
            continue
        cut = haar_contrasts((section[:, own] for section in sections()), seconds)
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
