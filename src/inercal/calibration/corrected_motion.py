"""Check readings, and compute the motion that a sensor with any number of axes measures.

One or two axes measure only the components along them. More than three axes of a kind measure a
vector, by least squares with equal weights, because all axes of a kind have the same stated noise.
Their readings minus those that the vector explains are the parity residual. It contains noise and
errors of single axes, but no motion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.physics.motion import Motion
from inercal.physics.quantities import KINDS, Measures
from inercal.physics.sensors import Sensor, inverse
from inercal.recordings import Recording


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
