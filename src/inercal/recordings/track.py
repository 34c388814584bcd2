"""The samples of a run in SI, for estimators that follow them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.recordings.samples import Indices
from inercal.recordings.temperature import temperature_varies


class AngleQuality(NamedTuple):
    """Uncertainty of a table's angles at each sample, where a host interpolated its readings.

    `noise_gain` is the sum of the squares of the interpolation's weights: the variance of the
    angles' noise over that of one reading. A filter uses no angle whose gain is infinite.
    `interpolation_sd` is infinite where nothing bounds the table's motion between two readings.
    """

    noise_gain: Array  # (n,)
    interpolation_sd: Array  # (n,) rad

    def where(self, rows: "NDArray[np.bool_] | Indices | slice") -> "AngleQuality":
        """Return the quality at some of the samples."""
        return AngleQuality(self.noise_gain[rows], self.interpolation_sd[rows])


@dataclass(frozen=True, eq=False)
class Track:
    """The samples of a run in SI, for estimators that follow them.

    Parameters
    ----------
    time : (n,) array
        s, by the sensor's clock.
    reading : (..., n, m) array
        Readings of the sensor's axes after the nominal readout, m/s² or rad/s.
    angles : (..., n, k) array
        Readback of the table's axes, rad, the outermost first, unwrapped; k is 0 without a table.
    hold : (n,) array of int
        Number of the hold of each sample, from 0; -1 while the table moves.
    temperature : (..., n) array or None
        K.
    angle_quality : AngleQuality or None
        None where each sample has an angle that was read at its time, with the readback's noise.
    samples_are_means : bool
        Whether a sample is the mean of its reading over one period about its time, as of an IMU
        that integrates, and not the reading at its time.

    Raises
    ------
    InputError
        Unequal lengths, or a temperature that is not finite.
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
        """Return samples start to stop (half open)."""
        return self._select(slice(start, stop))

    @property
    def with_known_angles(self) -> "Track":
        """The samples at which the table's angles are known."""
        if self.angle_quality is None:
            return self
        return self._select(np.isfinite(self.angle_quality.interpolation_sd))

    def _select(self, at: "NDArray[np.bool_] | slice") -> "Track":
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
        """Return the variance of the angles at each sample, (n,) rad².

        Infinite where the angles are not usable.

        Parameters
        ----------
        variance : float
            Of the noise of one reading of the table, rad².
        """
        if self.angle_quality is None:
            return np.full(self.time.size, variance)
        gain, sd = self.angle_quality
        return variance * gain + sd**2

    def trial(self, *index: int) -> "Track":
        """Return a single trial; all trials share a temperature without axes of trials."""
        t = self.temperature
        t = t[index] if t is not None and t.ndim > 1 else t
        return replace(self, reading=self.reading[index], angles=self.angles[index], temperature=t)

    def temperature_offset(self, reference: float) -> Array | None:
        """Return the temperature of each sample minus a reference, (..., n) K; None without one."""
        return None if self.temperature is None else self.temperature - reference

    @property
    def temperature_varies(self) -> bool:
        """Whether the recorded temperatures differ, as of `Observations`."""
        return temperature_varies(self.temperature)


def join_tracks(tracks: Sequence[Track]) -> Track:
    """Return the tracks of one run one after the other, each of one trial.

    Temperature and quality of the angles are left out where a track lacks them.
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
