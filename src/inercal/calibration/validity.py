"""Record which rates, forces, temperatures and magnetic fields the data of a run cover.

Temperatures of readings are checked against the range in which a calibration was made.

Readings are checked, and corrected to the motion that a sensor with any number of axes measures.
One or two axes measure only the components along them. More than three axes of a kind measure a
vector, by least squares with equal weights, because all axes of a kind have the same stated noise.
Their readings minus those that the vector explains are the parity residual. It contains noise and
errors of single axes, but no motion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS, si_factor
from inercal.physics.motion import Motion
from inercal.physics.quantities import KINDS, Measures
from inercal.physics.sensors import Sensor, inverse
from inercal.recordings import Recording, temperature_rate
from inercal.recordings.temperature import first_impossible, impossible_text

Range = tuple[float, float]
READING_MARGIN = 0.01  # fraction of a range by which readings may be outside, because they scatter


def distance_outside(limits: Range, values: Array, margin: float) -> Array:
    """Return how far values are outside a range, in their unit; 0 within the margin."""
    low, high = limits
    away = np.maximum(low - values, values - high)
    return np.where(away > margin, away, 0.0)


@dataclass(frozen=True)
class Validity:
    """Smallest and largest values of any axis in the data that were used; None if unknown.

    Parameters
    ----------
    rate : (float, float) or None
        Angular rate in rad/s, from the nominal readout of the gyros.
    force : (float, float) or None
        Specific force in m/s², from the nominal readout of the accelerometers.
    temperature : (float, float) or None
        Temperature in K.
    field : (float, float) or None
        Magnetic flux density in T, from the nominal readout of the magnetometers.

    Raises
    ------
    InputError
        If a range is not finite, or its upper limit is below its lower limit.
    """

    rate: Range | None = None
    force: Range | None = None
    temperature: Range | None = None
    field: Range | None = None

    def __post_init__(self) -> None:
        for name, (least, largest) in self.ranges.items():
            if not (isfinite(least) and isfinite(largest) and least <= largest):
                raise InputError(
                    f"validity: {name} is {least} to {largest}; give finite limits, the lower "
                    "first",
                    names=(name,),
                )

    @property
    def ranges(self) -> dict[str, Range]:
        """The ranges that are known, by name."""
        return {name: value for name, value in vars(self).items() if value is not None}


TEMPERATURE_MARGIN = 1.0  # K outside the calibration's range that are still accepted


def require_inside(
    sensor: Sensor,
    validity: Validity | None,
    kelvin: Array,
    remedy: str,
    *,
    key: str = "temperature",
) -> None:
    """Raise an error if temperatures, (..., n) K, are outside the range of the data.

    Parameters
    ----------
    sensor : Sensor
    validity : Validity or None
        Validity of the calibration.
    kelvin : array
    remedy : str
        What the user can do; the message contains this text.
    key : str, optional
        The run-file key or option that the error names.

    Raises
    ------
    InputError
        If a temperature is outside the range; the message states both ranges.
    """
    outside = temperatures_outside(sensor, validity, kelvin)
    if outside.any():
        assert validity is not None
        assert validity.temperature is not None
        low, high = (t - ZERO_CELSIUS for t in validity.temperature)
        beyond = float(kelvin[outside][0]) - ZERO_CELSIUS
        raise InputError(
            f"{beyond:.2f} °C is outside the temperatures of the calibration, {low:.2f} to "
            f"{high:.2f} °C, where its polynomials are valid; {remedy}",
            key=key,
        )


def checked_temperatures(
    sensor: Sensor,
    validity: Validity | None,
    recording: Recording | Array,
    dT: Array | float | None,
    dTdt: Array | float | None,
    *,
    extrapolate: bool,
) -> tuple[Array | float, Array | float]:
    """Return dT, K, and dTdt, K/s, as passed or from the recording; zero if neither is needed.

    Parameters
    ----------
    sensor : Sensor
    validity : Validity or None
        Validity of the calibration.
    recording, dT, dTdt
        See `Calibration.correct`.
    extrapolate : bool
        Whether temperatures outside the range of the calibration are accepted. Temperatures below 0
        K are never accepted.

    Raises
    ------
    InputError
        If a temperature is missing, impossible, or outside the range of the calibration.
    """
    if isinstance(recording, Recording) and recording.temperature is not None and dT is None:
        dT = recording.temperature - sensor.reference_temperature
        if dTdt is None and sensor.uses("dTdt"):
            dTdt = temperature_rate(recording.time, recording.temperature)
    for key, value, needed in (
        ("dT", dT, "temperature: pass dT, in K above the reference temperature"),
        ("dTdt", dTdt, "the rate of change of the temperature: pass dTdt in K/s"),
    ):
        if value is None and sensor.uses(key):
            raise InputError(
                f"the model depends on {needed}, or a recording that contains temperatures", key=key
            )
    rate = 0.0 if dTdt is None else dTdt
    if dT is None:
        return 0.0, rate
    if not np.isfinite(dT).all():
        raise InputError(
            "dT has temperatures that are not finite; remove those samples first", key="dT"
        )
    if sensor.uses("dT", "dTdt"):
        kelvin = np.atleast_1d(sensor.reference_temperature + np.asarray(dT, dtype=float))
        if not extrapolate:
            remedy = "give temperatures in this range, or pass extrapolate=True"
            require_inside(sensor, validity, kelvin, remedy, key="dT")
        flat = kelvin.reshape(-1)
        known = None if validity is None else validity.temperature
        bad = first_impossible(flat, allowed=extrapolate or known is not None)
        if bad is not None:
            raise InputError(
                f"dT of {float(flat[bad]) - sensor.reference_temperature:.6g} K is "
                f"{impossible_text(float(flat[bad]), 'extrapolate=True')}",
                key="dT",
            )
    return dT, rate


def temperatures_outside(
    sensor: Sensor, validity: Validity | None, kelvin: Array
) -> NDArray[np.bool_]:
    """Return a mask of the temperatures, (..., n) K, outside the range of a calibration's data.

    The range is extended by one kelvin at both ends. No temperature is outside if the model does
    not depend on temperature or if the calibration file states no range.
    """
    limits = None if validity is None else validity.temperature
    if limits is None or not sensor.uses("dT", "dTdt"):
        return np.zeros(kelvin.shape, dtype=np.bool_)
    low, high = limits
    return (kelvin < low - TEMPERATURE_MARGIN) | (kelvin > high + TEMPERATURE_MARGIN)


@dataclass(frozen=True, eq=False)
class CorrectedMotion(Motion):
    """A motion that was computed from readings.

    Parameters
    ----------
    parity : mapping of "f", "w" or "m" to (..., n) array
        Norm of the parity residual, m/s², rad/s or T, only for kinds with redundant axes.
    """

    parity: dict[Measures, Array] = field(default_factory=dict["Measures", Array])


def checked_readings(sensor: Sensor, recording: Recording | Array) -> Array:
    """Return the readings of the sensor's axes in SI, (..., n, m).

    Raises
    ------
    InputError
        If a channel is missing or has another unit, or if readings are not finite.
    """
    if isinstance(recording, Recording):
        source = recording.source or "recording"
        data = recording.data[
            ..., channel_columns(sensor, recording.channels, recording.units, source)
        ]
    else:
        data = np.asarray(recording, dtype=np.float64)
    if data.ndim < 2:
        raise InputError(f"readings have shape {data.shape}; expected (..., samples, axes)")
    if data.shape[-1] != len(sensor.axes):
        raise InputError(
            f"readings have {data.shape[-1]} columns; the axes are {', '.join(sensor.channels)}",
            names=sensor.channels,
        )
    bad = ~np.isfinite(data).reshape(-1, data.shape[-1]).all(axis=0)
    if bad.any():
        names = tuple(np.array(sensor.channels)[bad].tolist())
        raise InputError(
            f"readings of {', '.join(names)} are not finite; remove those samples first",
            names=names,
        )
    return sensor.to_si(data)


def channel_columns(
    sensor: Sensor, channels: Sequence[str], units: Sequence[str], source: str
) -> list[int]:
    """Return the positions of the sensor's axes, in order, among the channels of `source`.

    Raises
    ------
    InputError
        If a channel is missing or has another unit.
    """
    missing = tuple(name for name in sensor.channels if name not in channels)
    if missing:
        raise InputError(
            f"{source}: channel {missing[0]!r} of the calibration is missing; the recording has "
            f"{', '.join(channels)}: name the column of this axis in the run file, or "
            "use a calibration of these axes",
            names=missing,
        )
    columns = [channels.index(name) for name in sensor.channels]
    for axis, k in zip(sensor.axes, columns, strict=True):
        if not _same_unit(axis.readout.unit, units[k]):
            raise InputError(
                f"{source}: channel {axis.name} is in {units[k]}; this calibration is "
                f"for {axis.readout.unit}; convert the channel",
                names=(axis.name,),
            )
    return columns


def _same_unit(first: str, second: str) -> bool:
    try:
        return first == second or si_factor(first) == si_factor(second, like=first)
    except InputError:
        return False


def corrected_motion(
    sensor: Sensor,
    y: Array,
    c: Array,
    passed: Mapping[Measures, Array | None],
    dw: Array | None,
    dT: Array | float,
    dTdt: Array | float,
    time: Array | None,
    *,
    refuse: bool = True,
) -> CorrectedMotion:
    """Return the motion that corresponds to readings; see `Calibration.correct`.

    Parameters
    ----------
    sensor : Sensor
    y : (..., n, m) array
        Readings in SI.
    c : (p,) array
        Coefficients.
    passed : mapping of "f", "w" and "m" to (..., n, 3) array or None
        Motion that the sensor does not measure. If nothing is passed for a kind whose axes measure
        only one or two components, the result has one column per axis, along its input axis.
    dw, dT, dTdt
        See `Calibration.correct`.
    time : (n,) array or None
        Times of the samples, from which a missing `dw` is computed, s.
    refuse : bool
        Whether to raise an error for readings that no motion gives; otherwise their motion is NaN.
    """
    in_part: list[Measures] = [
        kind for kind in KINDS if passed[kind] is None and 0 < sensor.rank(kind) < len("xyz")
    ]
    f, w, m = (np.zeros((1, 3)) if kind in in_part else passed[kind] for kind in KINDS)
    if dw is None and sensor.uses("ai", "ap", "ao"):
        if time is None:
            raise InputError(
                "the model has lever arms: pass dw, the angular acceleration in rad/s², or a "
                "Recording, from which it can be computed",
                key="dw",
            )
        rough = inverse(sensor, y, c, f=f, w=w, m=m, dT=dT, dTdt=dTdt)
        dw = np.gradient(rough.w, time, axis=-2)
    motion = inverse(sensor, y, c, f=f, w=w, m=m, dw=dw, dT=dT, dTdt=dTdt, refuse=refuse)
    parity: dict[Measures, Array] = {}
    rest: Array | None = None
    for kind in KINDS:
        rows = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind]
        if len(rows) > max(sensor.rank(kind), 1):
            rest = y - sensor.forward(motion, c) if rest is None else rest
            parity[kind] = np.linalg.norm(rest[..., rows], axis=-1)
    sensed = {kind: getattr(motion, kind) @ sensor.input_axes(kind).T for kind in in_part}
    return CorrectedMotion(**vars(replace(motion, **sensed)), parity=parity)
