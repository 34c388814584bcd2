"""Average magnetometer readings over the rests of a recording and over pieces of motion."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.arrays import Array, Indices


@dataclass(frozen=True, eq=False)
class MagneticPieces:
    """Mean readings over p short pieces of the motion between rests.

    Parameters
    ----------
    transition : (p,) array of int
        Index of each piece's transition in `Observations.transitions`.
    time : (p,) array
        Time of the mean attitude, s, on the clock of the transitions.
    mean : (p, m) array
        Mean readings in SI units, after the nominal readout is applied.
    samples : (p,) array of int
        Number of fresh values in each mean.
    temperature : (p,) array or None
        Mean temperature, K.
    """

    transition: Indices
    time: Array
    mean: Array
    samples: Indices
    temperature: Array | None = None


@dataclass(frozen=True, eq=False)
class MagneticReadings:
    """Mean readings of m magnetometers over r rests, in the order of time.

    Parameters
    ----------
    channels : tuple of m str
        Names of the axes.
    rest : (r,) array of int
        Row of the observations for each rest. A row has no entry if the magnetometers cannot be
        used there.
    mean : (r, m) array
        Mean readings in SI units, after the nominal readout is applied.
    covariance : (r, m, m) array
        Covariance of each mean, from noise and rounding.
    time : (r,) array
        Time of each mean, s; the order of the rows for a table of means.
    samples : (r,) array
        Effective number of fresh values in each mean, because values that a slow magnetometer
        repeats count once.
    noise : (m, m) array
        Covariance of a single value, for the pieces of motion; zero for a table of means.
    temperature : (r,) array or None
        Mean temperature, K.
    pieces : MagneticPieces or None
        Readings during the motion, if the gyros show how the sensor moved.
    """

    channels: tuple[str, ...]
    rest: Indices
    mean: Array
    covariance: Array
    time: Array
    samples: Array
    noise: Array
    temperature: Array | None = None
    pieces: MagneticPieces | None = None

    @property
    def parts(self) -> tuple[Array, ...]:
        """Mean readings of the rests, (r, m), followed by those of the pieces of motion, (p, m)."""
        return (self.mean,) if self.pieces is None else (self.mean, self.pieces.mean)

    def rows(self, kept: Sequence[int]) -> "MagneticReadings":
        """Return the rests in some rows of the observations, without the pieces of motion."""
        place = {row: k for k, row in enumerate(kept)}
        at = [k for k, row in enumerate(self.rest.tolist()) if row in place]
        rest = np.array([place[int(self.rest[k])] for k in at], dtype=np.int64)
        names = ("mean", "covariance", "time", "samples", "temperature")
        own = {name: getattr(self, name)[at] for name in names if getattr(self, name) is not None}
        return replace(self, rest=rest, pieces=None, **own)
