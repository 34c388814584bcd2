"""Correct samples block by block while they arrive, with everything prepared once.

An affine model f = B (y − o) needs one matrix product per block. A model with temperature or
nonlinear terms is inverted for each sample. Both give the same numbers as `inercal.pipeline.apply`.

A term that needs later samples cannot be applied while samples arrive: the rate of change of the
temperature, the lag of a thermometer and the angular acceleration of lever arms. Calibrations with
such terms are refused.
"""

from enum import IntFlag
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError, NotInvertible
from inercal.calibration import Calibration
from inercal.calibration.validity import channel_columns, corrected_motion, temperatures_outside
from inercal.physics.motion import Motion
from inercal.physics.quantities import KINDS
from inercal.physics.sensors.inverse import SINGULAR_TEXT
from inercal.pipeline import correction
from inercal.recordings.data.recording_loader import range_limits
from inercal.recordings.temperature import TemperatureReadout
from inercal.runfile import Run, read


class SampleFlag(IntFlag):
    """What the user of a corrected sample has to know about it; 0 if nothing is wrong."""

    SATURATED = 1  # a reading is at an end of the range that [sensor] full_scale states
    TEMPERATURE = 2  # the temperature is outside the range of the calibration
    RATE = 4  # a rate is outside the range of a calibration at constant rates
    NO_MOTION = 8  # the model gives no unique motion for the readings; the sample has no values


class CorrectedBlock(NamedTuple):
    """Corrected samples.

    Parameters
    ----------
    time : (n,) array
        Times, s.
    values : (n, q) array
        The values of `LiveCorrector.names`; NaN if a sample cannot be corrected.
    flags : (n,) array of uint8
        Bits of `SampleFlag`.
    """

    time: Array
    values: Array
    flags: NDArray[np.uint8]


class LiveCorrector:
    """Corrects blocks of readings from one sensor.

    Parameters
    ----------
    calibration : Calibration
    run : Run or path
        Run file with the readout of the sensor and the columns of the readings.
    extrapolate : bool
        Whether samples outside the temperature range of the calibration are also corrected.
        Otherwise their values are NaN. They have a flag in both cases.

    Attributes
    ----------
    names : tuple of str
        What the columns of the values contain: fx, fy, fz in m/s² and wx, wy, wz in rad/s, or the
        components that the sensor measures; the temperature in the unit of the run file, if it
        names a temperature column; and the parity residuals of redundant axes.
    channels : tuple of str
        The axes whose readings `correct` needs, in order.

    Raises
    ------
    InputError
        The run and the calibration do not belong together, or a term needs later samples.
    """

    def __init__(
        self, calibration: Calibration, run: Run | str | Path, *, extrapolate: bool = False
    ):
        run = run if isinstance(run, Run) else read(run)
        correction.require_same_readout(calibration, run)
        self.run = run = run.with_all_axes
        correction.require_same_corrections(calibration, "", str(run.path), run)
        self._calibration, self._extrapolate = calibration, extrapolate
        sensor = self._sensor = calibration.sensor
        self.channels = run.sensor.channels
        units = [axis.readout.unit for axis in run.sensor.axes]
        self._columns = channel_columns(sensor, self.channels, units, str(run.path))
        self._heated = sensor.uses("dT", "dTdt")
        self._require_no_later_samples()
        limits = range_limits(run.sensor)
        ends = [limits.get(name, (-np.inf, np.inf)) for name in self.channels]
        self._ends = np.array(ends).reshape(-1, 2).T if limits else None
        self._rate_limits = correction.rate_limits(calibration)
        self._gyros = [k for k, axis in enumerate(sensor.axes) if axis.measures == "w"]
        self._kinds = tuple(dict.fromkeys(sensor.sensed.measures))
        redundant = [
            kind for kind in KINDS if len(sensor.input_axes(kind)) > max(sensor.rank(kind), 1)
        ]
        heat = (
            () if run.data.temperature is None else (f"temperature [{run.data.temperature_unit}]",)
        )
        self.names = (*sensor.sensed.names, *heat, *(f"parity_{kind}" for kind in redundant))
        readouts = [axis.readout for axis in sensor.axes]
        self._zero = np.array([one.offset for one in readouts])
        self._scale = np.array([one.scale for one in readouts])
        self._in_order = self._columns == list(range(len(self.channels)))
        self._complete = np.array_equal(sensor.sensed.basis, np.eye(6))
        self._affine = None if redundant or not sensor.affine else self._affine_parts()

    def _require_no_later_samples(self) -> None:
        sensor, run = self._sensor, self.run
        lag = None if run.environment is None else run.environment.lag
        reason = None
        if sensor.uses("dTdt"):
            reason = "the rate of change of the temperature"
        elif sensor.uses("ai", "ap", "ao"):
            reason = "the angular acceleration for its lever arms"
        elif self._heated and lag is not None:
            reason = "the lag of the thermometer ([environment] lag)"
        if reason is not None:
            reason += ", which needs later samples; record them and use --out"
        elif self._heated and run.data.temperature is None:
            reason = "the temperature; name its column in [data] temperature"
        if reason is not None:
            raise InputError(f"{run.path}: the calibration uses {reason}", file=run.path)

    def _affine_parts(self) -> tuple[Array, Array]:
        """Return the offset, (1, m), and the inverse of the slope, (k, m)."""
        sensor, c = self._sensor, self._calibration.values
        rest, sensed = Motion(np.zeros((1, 3)), np.zeros((1, 3))), sensor.sensed
        slope = (sensor.slope(rest, c) @ sensed.basis)[0]
        if np.linalg.matrix_rank(slope) < sensed.basis.shape[1]:
            raise NotInvertible(f"sensor {sensor.name}: {SINGULAR_TEXT}")
        back = np.asarray(np.linalg.pinv(slope), dtype=np.float64)
        return sensor.forward(rest, c), back

    def correct(self, time: Array, readings: Array, kelvin: Array | None = None) -> CorrectedBlock:
        """Correct the next samples.

        Parameters
        ----------
        time : (n,) array
            Times, s.
        readings : (n, m) array
            Finite readings of `channels` in output units.
        kelvin : (n,) array, optional
            Temperatures, K, if the run file names a temperature column.
        """
        n = len(readings)
        flags = np.zeros(n, np.uint8)
        if self._ends is not None:
            lowest, highest = self._ends
            beyond = (readings <= lowest) | (readings >= highest)
            flags |= _flagged(np.asarray(beyond.any(axis=1)), SampleFlag.SATURATED)
        if n == 1:
            # The product of one row is rounded differently, so it is computed as one of two.
            readings = np.repeat(readings, 2, axis=0)
            kelvin = None if kelvin is None else np.repeat(kelvin, 2)
        own = readings if self._in_order else readings[:, self._columns]
        y = (own - self._zero) / self._scale
        values = self._values(y, kelvin)[:n]
        q = len(self._sensor.sensed.names)
        if self._rate_limits is not None:
            beyond = correction.rates_outside(self._rate_limits, y[:n, self._gyros])
            flags |= _flagged(beyond, SampleFlag.RATE)
        if self._affine is None:
            missing = np.asarray(np.isnan(values[:, :q]).any(axis=1))
            flags |= _flagged(missing, SampleFlag.NO_MOTION)
            values[missing, :q] = np.nan
        if kelvin is not None and self._heated:
            outside = temperatures_outside(self._sensor, self._calibration.validity, kelvin[:n])
            flags |= _flagged(outside, SampleFlag.TEMPERATURE)
            if not self._extrapolate:
                values[outside, :q] = np.nan
        return CorrectedBlock(time, values, flags)

    def _values(self, y: Array, kelvin: Array | None) -> Array:
        """Return the values for readings in SI, (n, m)."""
        sensor = self._sensor
        columns: list[Array] = []
        parity: list[Array] = []
        if self._affine is not None:
            offset, back = self._affine
            values = (y - offset) @ back.T
            sensed = sensor.sensed
            columns.append(values if self._complete else values @ sensed.basis.T @ sensed.rows.T)
        else:
            dT = 0.0 if kelvin is None else kelvin - sensor.reference_temperature
            c, passed = self._calibration.values, dict.fromkeys(KINDS)
            try:
                motion = corrected_motion(sensor, y, c, passed, None, dT, 0.0, None, refuse=False)
            except NotInvertible:
                # One sample has a singular slope, and this error does not say which one.
                return np.full((len(y), len(self.names)), np.nan)
            columns += [getattr(motion, kind) for kind in self._kinds]
            parity += [values[:, None] for values in motion.parity.values()]
        if kelvin is not None and self.run.data.temperature is not None:
            thermometer: TemperatureReadout = self.run.data.thermometer
            own = np.round(thermometer.values(kelvin), correction.TEMPERATURE_DECIMALS)
            columns.append(np.asarray(own, np.float64)[:, None])
        return columns[0] if len(columns) == 1 and not parity else np.hstack([*columns, *parity])


def _flagged(where: Bools, flag: SampleFlag) -> NDArray[np.uint8]:
    return where * np.uint8(flag)
