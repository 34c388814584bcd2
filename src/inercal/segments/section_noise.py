"""The noise of sections at rest: its correlation, its scatter, and changes within sections.

The statistics are those of `inercal.estimate.section_statistics`, separately for accelerometers and
gyros. For a sensor in a hand only the accelerometers along gravity are analysed: all else is motion
of the hand, whose scatter the residuals show (`inercal.estimate.residual_scatter`).
"""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from inercal.arrays import Array
from inercal.estimate import ModelTest
from inercal.estimate.correlation import WHITE, NoiseCorrelation
from inercal.estimate.section_statistics import SectionStatistics, analyse_sections, haar_contrasts
from inercal.segments.hand_motion_noise import readings_along_gravity
from inercal.sensors import G0, Noise, Sensor

_KINDS = {"f": "accelerometers", "w": "gyros"}
_ALIKE = 3.0  # times in scatter: rests that differ by more are reported


class SectionNoise(NamedTuple):
    """Noise of r sections of m channels."""

    scale: Array  # (r, m), each section's variance over the mean of all
    correlation: tuple[NoiseCorrelation, ...]  # of each channel
    trend: Array  # (m,) per second, sd of the drift of a kind's channels beyond noise
    slope: Array  # (m,) per second, mean slope of accelerometers within the sections, or 0
    slope_sd: Array  # (m,) per second
    tests: tuple[ModelTest, ...]
    notes: tuple[str, ...]
    disturbance_variance: Array  # (r, m), variance of each mean by a change within its section

    def factor(self, seconds: Array, lengths: Array, batches: int) -> Array:
        """Return the variance of means over that from the pooled batch means, (s, m).

        Parameters
        ----------
        seconds : (s,) array
            Durations of the means.
        lengths : (r,) array
            Durations of the sections whose batch means were pooled.
        batches : int
            Number in each section.
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
    labels: Sequence[str],
    rounding: Array,
    *,
    by_hand: bool,
) -> SectionNoise:
    """Return the noise of sections.

    Parameters
    ----------
    sensor : Sensor
    sections : callable
        Returns the sections, (n, m) each, SI.
    seconds : (r,) array
        Their durations.
    labels : sequence of r str
    rounding : (m,) array
        Variance that coarse steps add to each mean.
    by_hand : bool
    """
    r, m = len(labels), len(sensor.axes)
    scale, trend, disturbance_variance = np.ones((r, m)), np.zeros(m), np.zeros((r, m))
    slope, slope_sd = np.zeros(m), np.zeros(m)
    correlation = [WHITE] * m
    tests: list[ModelTest] = []
    notes: list[str] = []
    if by_hand:
        steps = np.array([rounding[[axis.measures == "f" for axis in sensor.axes]].max()])
        series = readings_along_gravity(sensor, sections())
        cut = [haar_contrasts(s[:, None], t) for s, t in zip(series, seconds.tolist(), strict=True)]
        judged = analyse_sections(cut, labels, ["accelerometers along gravity"], steps)
        # The effect of a drift changes its sign with the attitude: the norms of all rests show it.
        within = (judged.within,) if judged.within and judged.shape == "change" else ()
        return SectionNoise(
            scale, (WHITE,) * m, trend, slope, slope_sd, within, (), disturbance_variance
        )
    for kind, words in _KINDS.items():
        own = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind]
        if not own:
            continue
        cut = [
            haar_contrasts(section[:, own], t)
            for section, t in zip(sections(), seconds.tolist(), strict=True)
        ]
        names = [sensor.axes[k].name for k in own]
        # Slow noise that the sensor's table states enters as stated.
        stated = any(_has_slow_noise(sensor.axes[k].noise) for k in own)
        judged = analyse_sections(cut, labels, names, rounding[own], coloured=stated)
        scale[:, own] = judged.scale[:, None]
        disturbance_variance[:, own] = judged.disturbance_variance
        tests += judged.tests
        if not stated:
            trend[own] = judged.significant_trend_sd
            if kind == "f":
                # All sections measure the bias of a gyro, and their residuals show its drift. Two
                # of six measure that of an accelerometer: a drift below any test changes it.
                trend[own] = np.maximum(trend[own], judged.undetectable_trend_sd)
                slope[own] = np.nan_to_num(judged.trend)
                slope_sd[own] = np.nan_to_num(judged.trend_sd)
            for k in own:
                correlation[k] = judged.correlation
        notes += _notes(words, judged, seconds, labels, stated)
    return SectionNoise(
        scale,
        tuple(correlation),
        trend,
        slope,
        slope_sd,
        tuple(tests),
        tuple(notes),
        disturbance_variance,
    )


def drift_notes(sensor: Sensor, reach: Array) -> list[str]:
    """Return notes on the drift over the run that the uncertainty contains, (m,) SI."""
    notes: list[str] = []
    for kind, words in _KINDS.items():
        own = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind]
        if own and (most := float(reach[own].max())) > 0:
            text = f"{most / G0 * 1e3:.2g} mg" if kind == "f" else f"{np.degrees(most):.2g} °/s"
            notes.append(
                f"the slopes within the rests leave a drift of about {text} over the run open "
                f"({words}, k = 1): it is in the uncertainty of the biases"
            )
    return notes


def _has_slow_noise(noise: Noise) -> bool:
    return bool(noise.bias_instability or noise.random_walk)


def _notes(
    words: str, judged: SectionStatistics, seconds: Array, labels: Sequence[str], stated: bool
) -> list[str]:
    notes = [
        f"the readings change within {labels[k]}: the uncertainty of its mean includes the "
        "effect; repeat the position"
        for k in np.flatnonzero(judged.disturbance_variance.any(axis=1)).tolist()
    ]
    noise = judged.correlation
    if noise is not WHITE and not stated:
        times = float(np.sqrt(np.median(noise.mean_variance_ratio(seconds))))
        notes.append(
            f"the noise of the {words} within rests is correlated over about "
            f"{noise.seconds:.1g} s: the uncertainty of a mean is {times:.2g} times that of its "
            "uncorrelated part"
        )
    worst = int(np.argmax(judged.scale))
    ratio = float(np.sqrt(judged.scale[worst] / np.median(judged.scale)))
    if ratio > _ALIKE:
        notes.append(
            f"the {words} scatter {ratio:.2g} times as much in {labels[worst]} as in the median "
            "rest: the uncertainty of its mean is larger accordingly"
        )
    return notes
