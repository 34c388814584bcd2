"""Individual samples of a run in SI units, for estimators that process them in sequence."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.recordings.samples import Indices
from inercal.recordings.temperature import temperature_varies


class AngleQuality(NamedTuple):
    """Uncertainty of the table's angles at each sample, if a host interpolated its readings.

    `noise_gain` is the sum of the squared interpolation weights: the noise variance of the
    interpolated angle divided by that of one reading. A filter ignores angles with infinite gain.
    `interpolation_sd` is infinite where the table's motion between two readings is not bounded.
    """

    noise_gain: Array  # (n,)
    interpolation_sd: Array  # (n,) rad

    def where(self, rows: "Bools | Indices | slice") -> "AngleQuality":
        """Return the angle quality at some of the samples."""
        return AngleQuality(self.noise_gain[rows], self.interpolation_sd[rows])


@dataclass(frozen=True, eq=False)
class Track:
    """Individual samples of a run in SI units, for estimators that process them in sequence.

    Parameters
    ----------
    time : (n,) array
        Time on the sensor's clock, s.
    reading : (..., n, m) array
        Readings of the sensor's axes after the nominal readout, m/s² or rad/s.
    angles : (..., n, k) array
        Unwrapped angles read back from the table's axes, rad, outermost axis first; k is 0 without
        a table.
    hold : (n,) array of int
        Number of the hold that each sample belongs to, from 0; -1 while the table moves.
    temperature : (..., n) array or None
        Temperature, K.
    angle_quality : AngleQuality or None
        None if every sample has an angle that was read at the same time, with the noise of the
        readback.
    samples_are_means : bool
        Whether each sample is the mean over one sample period centred at its time, as in an IMU
        that integrates its readings, instead of the reading at that time.

    Raises
    ------
    InputError
        The lengths are unequal, or a temperature is not finite.
    """

    time: Array
    reading: Array
    angles: Array
    hold: Indices
    temperature: Array | None = None
    angle_quality: AngleQuality | None = None
    samples_are_means: bool = False

    def __post_init__(self) -> None:
        n = self.time.size
        if self.angle_quality is not None and any(q.shape != (n,) for q in self.angle_quality):
            raise InputError(
                f"track: each array of angle_quality must have shape ({n},), one value per sample",
                key="angle_quality",
            )
        if self.reading.shape[-2] != n or self.angles.shape[-2] != n or self.hold.shape != (n,):
            raise InputError(
                f"track: time has shape ({n},), reading {self.reading.shape}, angles "
                f"{self.angles.shape} and hold {self.hold.shape}; give all the same number of "
                "samples"
            )
        if self.temperature is not None:
            if self.temperature.shape[-1] != n:
                raise InputError(
                    f"track: temperature has shape {self.temperature.shape}; expected (..., {n})",
                    key="temperature",
                )
            bad = np.flatnonzero(~np.isfinite(self.temperature).reshape(-1, n).all(axis=0))
            if bad.size:
                raise InputError(
                    f"track: the temperature at {self.time[bad[0]]:.6g} s is not finite; correct "
                    "or remove the sample",
                    key="temperature",
                )

    def slice(self, start: int, stop: int) -> "Track":
        """Return the samples from start to stop (half open)."""
        return self._select(slice(start, stop))

    @property
    def with_known_angles(self) -> "Track":
        """The samples at which the table's angles are known."""
        if self.angle_quality is None:
            return self
        return self._select(np.isfinite(self.angle_quality.interpolation_sd))

    def _select(self, at: "Bools | slice") -> "Track":
        quality, t = self.angle_quality, self.temperature
        return replace(
            self,
            time=self.time[at],
            reading=self.reading[..., at, :],
            angles=self.angles[..., at, :],
            hold=self.hold[at],
            temperature=None if t is None else t[..., at],
            angle_quality=None if quality is None else quality.where(at),
        )

    def angle_variance(self, variance: float) -> Array:
        """Return the variance of the angle at each sample, (n,) rad².

        The variance is infinite where the angle is not usable.

        Parameters
        ----------
        variance : float
            Noise variance of one reading of the table, rad².
        """
        if self.angle_quality is None:
            return np.full(self.time.size, variance)
        gain, sd = self.angle_quality
        return variance * gain + sd**2

    def trial(self, *index: int) -> "Track":
        """Return a single trial; a temperature without trial axes is shared by all trials."""
        t = self.temperature
        t = t[index] if t is not None and t.ndim > 1 else t
        return replace(self, reading=self.reading[index], angles=self.angles[index], temperature=t)

    def temperature_offset(self, reference: float) -> Array | None:
        """Return each sample's temperature minus a reference, (..., n) K; None if not recorded."""
        return None if self.temperature is None else self.temperature - reference

    @property
    def temperature_varies(self) -> bool:
        """Whether the recorded temperatures vary, by the same criterion as in `Observations`."""
        return temperature_varies(self.temperature)


def join_tracks(tracks: Sequence[Track]) -> Track:
    """Concatenate the tracks of one run; each track has a single trial.

    Temperature and angle quality are omitted if they are missing in any track.
    """
    temperatures = [one.temperature for one in tracks if one.temperature is not None]
    qualities = [one.angle_quality for one in tracks if one.angle_quality is not None]
    complete = len(temperatures) == len(tracks)
    return Track(
        np.concatenate([one.time for one in tracks]),
        np.concatenate([one.reading for one in tracks]),
        np.concatenate([one.angles for one in tracks]),
        np.concatenate([one.hold for one in tracks]),
        np.concatenate(temperatures) if complete else None,
        AngleQuality(*(np.concatenate(column) for column in zip(*qualities, strict=True)))
        if len(qualities) == len(tracks)
        else None,
        tracks[0].samples_are_means,
    )
