"""Compute the errors that coarse steps of the readings cause in means, and their correlation.

The error of a mean has the variance β² from `inercal.estimation.uncertainty.rounding`. If the means
of two rows i and j differ by much less than the step q, both lie at nearly the same place between
two steps; d is their difference. The covariance of their errors is

    cov = β² exp(−d²/2q²)

which is a valid covariance for any means. A row whose mean is close to others also has an
independent error of up to the same size, because true values that differ by a fraction of a step
(due to the earth's rate, drift or sensitivity to acceleration) give the same reading. If a channel
crosses many steps in a row, their errors average out: the error of each step has the weight of the
share p of the samples that read this step, and the mean has the variance β² Σp². In a turn at a
constant rate a gyro crosses few steps, and its row is like a rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.units import format_number, format_quantity
from inercal.basics.units.expression import read_unit
from inercal.estimation.uncertainty.rounding import mean_rounding_variance
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import Sensor

_CROSSED = 4.0  # steps: where a row crosses more, their errors average out
_NEAR = 1.0  # steps: readings so close to those at rest have the same error
NOISY = 0.6  # steps: with more noise than this, rounding leaves no error in a mean


@dataclass(frozen=True, eq=False)
class ReadingSteps:
    """How the readings of m channels are rounded.

    Parameters
    ----------
    step : (m,) array
        Step of the readings in SI units; 0 where rounding has no effect on a mean. For a channel
        with a dead band about zero, in which the reading does not change, the width of that band.
    noise : (m,) array
        Lower bound of the standard deviation of the noise, divided by the step.
    dead_band : (m,) array of bool
        Whether the step is such a dead band.
    text : (m,) array
        Standard deviation of the error due to the number of digits in which the steps are written,
        SI. For example, steps of .02 °/s written in rad/s with four decimals are uneven by a third.
    """

    step: Array
    noise: Array
    dead_band: Bools
    text: Array

    @property
    def variance(self) -> Array:
        """Variance of the rounding error of a mean at rest, (m,) SI."""
        shares = [
            mean_rounding_variance(noise) if step else 0.0
            for step, noise in zip(self.step.tolist(), self.noise.tolist(), strict=True)
        ]
        return self.step**2 * np.array(shares) + self.text**2

    def crossed(self, rows: Sequence[Array]) -> Array:
        """Return how many steps the readings of each row cross, (r, m): 1/Σp².

        Parameters
        ----------
        rows : sequence of r (n, m) array
            Readings of the samples in SI units.
        """
        number = np.ones((len(rows), self.step.size))
        for k in np.flatnonzero(self.step).tolist():
            for r, readings in enumerate(rows):
                level = np.rint(readings[:, k] / self.step[k])
                count = np.unique_counts(level).counts
                number[r, k] = len(readings) ** 2 / float(count @ count)
        return number

    def errors_of_means(self, mean: Array, crossed: Array | None = None) -> "RoundingErrors | None":
        """Return the rounding errors of the means of r rows; None if rounding leaves no error.

        Parameters
        ----------
        mean : (..., r, m) array
            Means in SI units. With several trials, the first one decides which rows are close to
            each other.
        crossed : (r, m) array, optional
            Number of steps that the readings of each row cross. If omitted, all rows are at rest.
        """
        variance = self.variance
        if not variance.any():
            return None
        one: Array = mean.reshape(-1, *mean.shape[-2:])[0]
        between = np.zeros((len(one), len(one), variance.size))
        over = np.ones(one.shape) if crossed is None else crossed
        moving = over > _CROSSED
        for k in np.flatnonzero(variance).tolist():
            apart = (one[:, None, k] - one[:, k]) / self.step[k]
            near: Array = np.exp(-0.5 * apart**2) * (1 - np.eye(len(one)))
            near[moving[:, k]] = near[:, moving[:, k]] = 0.0
            own = np.where(moving[:, k], 1 / over[:, k], 1 + near.max(axis=1, initial=0.0))
            between[..., k] = variance[k] * (near + np.diag(own))
        return RoundingErrors(between, self)

    def as_at_rest(self, off: Array, first: int) -> Bools:
        """Return which readings may have the same rounding error as the rests.

        Parameters
        ----------
        off : (n, k) array
            Readings of the channels from index `first` on, minus their readings at rest, SI.
        first : int
        """
        near = np.where(self.dead_band, 0.5, _NEAR) * self.step
        return np.asarray(np.abs(off) < near[first:], dtype=np.bool_)


class RoundedChannel(NamedTuple):
    """A channel whose reading steps cause more error than noise in the means of its rests.

    Parameters
    ----------
    channel : str
    step : float
        Step in SI units; for a dead band, its width.
    noise : float
        Lower bound of the standard deviation of the noise, divided by the step.
    dead_band : bool
    std : float
        Standard deviation of the error that all rests share, SI.
    """

    channel: str
    step: float
    noise: float
    dead_band: bool
    std: float


@dataclass(frozen=True, eq=False)
class RoundingErrors:
    """Rounding errors of the means of r rows of m channels.

    Parameters
    ----------
    covariance : (r, r, m) array
        Covariance between rows for each channel, SI. The diagonal is part of the means' own
        covariance.
    steps : ReadingSteps
    channels : tuple of RoundedChannel
        Channels whose rounding error is not negligible compared with the noise of the means.
    """

    covariance: Array
    steps: ReadingSteps
    channels: tuple[RoundedChannel, ...] = ()

    @property
    def variances(self) -> Array:
        """Variance of the rounding error of each mean, (r, m)."""
        return np.diagonal(self.covariance, axis1=0, axis2=1).T

    @property
    def shared(self) -> Array:
        """The covariance without the diagonal, (r, r, m)."""
        return self.covariance * (1 - np.eye(len(self.covariance)))[..., None]

    def with_independent(self, variance: Array) -> "RoundingErrors":
        """Return the errors after adding an independent error with variances (m,) to each mean."""
        added = np.eye(len(self.covariance))[..., None] * variance
        return replace(self, covariance=self.covariance + added)

    def rows(self, at: Sequence[int]) -> "RoundingErrors":
        """Return the rounding errors of some of the rows."""
        return replace(self, covariance=self.covariance[np.ix_(at, at)])


def _rounded_channels(
    sensor: Sensor, steps: ReadingSteps, covariance: Array, variance: Array
) -> tuple[RoundedChannel, ...]:
    """Return the channels whose steps cause more error than noise in a mean.

    Parameters
    ----------
    sensor : Sensor
    steps : ReadingSteps
    covariance : (r, m, m) array
        Covariance of the means, without rounding errors.
    variance : (m,) array
        Variance of the rounding error of a mean, SI.
    """
    noise = np.median(
        np.diagonal(covariance, axis1=-2, axis2=-1).reshape(-1, variance.size), axis=0
    )
    return tuple(
        RoundedChannel(
            axis.name,
            float(steps.step[k]),
            float(steps.noise[k]),
            bool(steps.dead_band[k]),
            float(variance[k]) ** 0.5,
        )
        for k, axis in enumerate(sensor.axes)
        if variance[k] > noise[k]
    )


def add_rounding(
    sensor: Sensor, rounding: RoundingErrors | None, covariance: Array, variance: Array
) -> tuple[RoundingErrors | None, Array, tuple[str, ...]]:
    """Return the errors with their channels, the covariance including the errors, and notes.

    Parameters
    ----------
    sensor : Sensor
    rounding : RoundingErrors or None
        None if rounding leaves no error; the covariance is then returned unchanged.
    covariance : (..., r, m, m) array
        Covariance of the means, without rounding errors.
    variance : (m,) array
        Variance of the rounding error of a mean, SI.
    """
    if rounding is None:
        return None, covariance, ()
    channels = _rounded_channels(sensor, rounding.steps, covariance, variance)
    added = rounding.variances[:, :, None] * np.eye(variance.size)
    notes = _rounding_notes(sensor, channels)
    return replace(rounding, channels=channels), covariance + added, notes


def join_rounding_errors(
    one: RoundingErrors | None, other: RoundingErrors | None, r: int, s: int
) -> RoundingErrors | None:
    """Join the errors of r rows of one recording and s rows of another; they are independent."""
    known = [errors for errors in (one, other) if errors is not None]
    covariance = join_covariances(one and one.covariance, other and other.covariance, r, s)
    if covariance is None:
        return None
    coarser = max(known, key=lambda errors: float(errors.steps.variance.sum()))
    return RoundingErrors(covariance, coarser.steps, coarser.channels)


def join_covariances(one: Array | None, other: Array | None, r: int, s: int) -> Array | None:
    """Join the covariances of r and s independent rows, (r + s, r + s, m); None if both are None.

    If only one covariance is None, its rows get the covariance 0.
    """
    known = other if one is None else one
    if known is None:
        return None
    joined = np.zeros((r + s, r + s, known.shape[-1]))
    if one is not None:
        joined[:r, :r] = one
    if other is not None:
        joined[r:, r:] = other
    return joined


def _rounding_notes(sensor: Sensor, channels: Sequence[RoundedChannel]) -> tuple[str, ...]:
    """Return one line for each kind of channel that is rounded, and one for dead bands."""
    kinds = {axis.name: axis.measures for axis in sensor.axes}
    notes: list[str] = []
    for kind, quantity in QUANTITIES.items():
        for dead in (False, True):
            some = [c for c in channels if kinds[c.channel] == kind and c.dead_band == dead]
            if not some:
                continue
            sizes = ", ".join(
                dict.fromkeys(format_quantity(c.step, 0.0, quantity.reading_unit) for c in some)
            )
            names = ", ".join(c.channel for c in some)
            size = read_unit(quantity.bias_unit).size
            errors = ", ".join(f"{c.channel} ± {format_number(2 * c.std / size, 2)}" for c in some)
            what = (
                f"{quantity.sensors} give the same reading within a band of {sizes} ({names})"
                if dead
                else f"{quantity.sensor} readings change in steps of {sizes}, more than their "
                f"noise ({names})"
            )
            effect = (
                "the bias cannot be determined from rests better than this (k = 2)"
                if kind == "w"
                else "each mean has this rounding error (k = 2)"
            )
            notes.append(f"{what}; {effect}: {errors} {quantity.bias_unit}")
    return tuple(notes)
