"""Convert and check recorded temperatures, and correct them for the lag of the thermometer.

No temperature is below 0 K, and nobody calibrates an inertial sensor outside −100 to 300 °C. A
number outside this range is a raw count of a thermometer, a value in °C that was declared as K, or
a value that lost its decimal point.

A temperature sensor with the lag τ reads R when the sensing element is at T = R + τ dR/dt.
"""

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError, error_location
from inercal.basics.units import ZERO_CELSIUS, format_count, parse_quantity, to_si
from inercal.recordings.samples import GAP_FACTOR, Finding, Recording

LOWEST, HIGHEST = ZERO_CELSIUS - 100.0, ZERO_CELSIUS + 300.0  # K
_LEAST_KELVIN = 213.0
COUNTS = ("LSB", "V")  # units of an unscaled thermometer
ALLOW = "[data] allow_temperature = true"


class TemperatureReadout(NamedTuple):
    """Conversion of a temperature column to kelvin: T = zero + size · value.

    Parameters
    ----------
    unit : str
        Unit of the values.
    size : float
        Size of one unit, K.
    zero : float
        Temperature at value 0, K.
    allowed : bool
        Whether temperatures outside −100 to 300 °C are accepted.
    """

    unit: str = "°C"
    size: float = 1.0
    zero: float = ZERO_CELSIUS
    allowed: bool = False

    def kelvin(self, values: Array) -> Array:
        """Convert values of the column to K."""
        return self.zero + self.size * values

    def values(self, kelvin: Array) -> Array:
        """Convert temperatures from K to the unit of the column."""
        return (kelvin - self.zero) / self.size

    def possible_kelvin(
        self, values: Array, column: str, place: Callable[[int], str], file: str = ""
    ) -> Array:
        """Convert values of a column, (n,), to K; values that are not finite stay as they are.

        Parameters
        ----------
        values : (n,) array
        column : str
        place : callable
            Function that returns the place of a row, given its number, in words.
        file : str, optional

        Raises
        ------
        InputError
            A temperature is impossible; the message states its place.
        """
        kelvin = self.kelvin(values)
        row = first_impossible(kelvin, allowed=self.allowed)
        if row is None:
            return kelvin
        where = f"{file} {place(row)}" if file else place(row)
        own = "" if self.unit == "°C" else f"{values[row]:.6g} {self.unit}, which is "
        raise InputError(
            f"{where}: column {column!r} reads {own}"
            f"{impossible_text(float(kelvin[row]))}: {self._advice(values)}",
            file=file or None,
            key="[data] temperature",
            names=(column,),
        )

    def _advice(self, values: Array) -> str:
        """Return a hint on what may be wrong with the values of a column."""
        finite = values[np.isfinite(values)]
        if first_impossible(finite + ZERO_CELSIUS) is None and self.unit != "°C":
            return 'the values are possible in °C: state temperature_unit = "°C"'
        if self.unit in COUNTS:
            return "check temperature_scale and temperature_zero"
        if np.all(finite == np.rint(finite)):
            return (
                'raw counts need temperature_unit = "LSB", with temperature_scale, such as '
                '"340 LSB/K", and temperature_zero, such as "36.53 °C"'
            )
        return "check its decimal point, and temperature_unit"


CELSIUS = TemperatureReadout()
_NAMED_UNITS = {
    "°F": re.compile(r"(?i:°f|℉|fahrenheit|deg[ _]?f)(?![A-Za-z])|[ _.(\[][Ff]\W*$|[a-z]F$"),
    "K": re.compile(r"(?i:kelvin)(?![A-Za-z])|[ _.(\[]K\W*$|[a-z]K$"),
}


def named_unit(column: object) -> str:
    """Return the unit that the name of a temperature column states, "°C" if it states none.

    >>> named_unit("temp_F"), named_unit("T [K]"), named_unit("temp_filtered")
    ('°F', 'K', '°C')
    """
    found = (unit for unit, ends in _NAMED_UNITS.items() if ends.search(str(column)))
    return next(found, CELSIUS.unit)


def temperature_readout(
    unit: str = "°C",
    scale: str | None = None,
    zero: str | None = None,
    *,
    allowed: bool = False,
) -> TemperatureReadout:
    """Return the readout of a temperature column.

    Parameters
    ----------
    unit : str
    scale, zero : str or None
        Only for raw counts or volts: the scale, "340 LSB/K", and the temperature at 0, "36.53 °C".
    allowed : bool

    Raises
    ------
    InputError
        The unit is not a temperature unit, or raw counts have no scale or no zero.
    """
    if unit not in COUNTS:
        for key, value in (("temperature_scale", scale), ("temperature_zero", zero)):
            if value is not None:
                raise InputError(
                    f"[data] {key} is for raw counts: state temperature_unit = "
                    f'"LSB" or "V", or remove {key}',
                    key=f"[data] {key}",
                )
        at_zero, one = to_si(np.array([0.0, 1.0]), unit, "K").tolist()
        return TemperatureReadout(unit, one - at_zero, at_zero, allowed)
    if scale is None or zero is None:
        key = "[data] temperature_scale" if scale is None else "[data] temperature_zero"
        raise InputError(
            f"{key} is missing: a thermometer in {unit} needs temperature_scale, such as "
            f'"340 {unit}/K", and temperature_zero, the temperature at 0, such as "36.53 °C"',
            key=key,
        )
    per_kelvin = _value(scale, f"{unit}/K", "temperature_scale")
    if per_kelvin == 0:
        raise InputError(
            "[data] temperature_scale is 0; give another number", key="[data] temperature_scale"
        )
    return TemperatureReadout(unit, 1 / per_kelvin, _value(zero, "°C", "temperature_zero"), allowed)


def _value(text: str, like: str, key: str) -> float:
    with error_location(f"[data] {key}", key=f"[data] {key}"):
        return parse_quantity(text, like).value


def first_impossible(kelvin: Array, *, allowed: bool = False) -> int | None:
    """Return the index of the first impossible temperature in (n,) K; None if all are possible.

    Parameters
    ----------
    kelvin : (n,) array
        Temperatures; values that are not finite are ignored.
    allowed : bool
        Whether temperatures outside −100 to 300 °C are accepted; values below 0 K never are.
    """
    bad = is_impossible(kelvin, allowed=allowed)
    return int(np.argmax(bad)) if bad.any() else None


def is_impossible(kelvin: Array, *, allowed: bool = False) -> Bools:
    """Return a mask of the impossible temperatures, (n,); see `first_impossible`."""
    bad = kelvin < 0
    if not allowed:
        bad |= (kelvin < LOWEST) | (kelvin > HIGHEST)
    return bad & np.isfinite(kelvin)


def seems_kelvin(values: Array) -> bool:
    """Return whether temperatures, (n,), look like bench temperatures in K (−60 °C and above)."""
    finite = values[np.isfinite(values)]
    if not finite.size or first_impossible(finite) is not None:
        return False
    return float(finite.min()) >= _LEAST_KELVIN


def impossible_text(kelvin: float, remedy: str = ALLOW) -> str:
    """State a temperature, why it is impossible, and which option accepts it."""
    celsius = f"{kelvin - ZERO_CELSIUS:.6g} °C"
    if kelvin < 0:
        return f"{celsius}, below absolute zero"
    return f"{celsius}, outside −100 to 300 °C ({remedy} accepts it)"


TEMPERATURE_UNIT = "temperature unit"
"""`Finding.what` for temperatures that seem to be in another unit."""
_SELF_HEATING = -3.0, 15.0  # K; of a sensor without a heater, above the stated room


def ambient_findings(
    kelvin: tuple[float, float], ambient: str, unit: str, *, stated: bool
) -> tuple[Finding, ...]:
    """Return a warning if temperatures would fit the room in another unit; none if in doubt.

    Nothing is said about a sensor that is at several temperatures, or that may be heated.

    Parameters
    ----------
    kelvin : (float, float)
        Lowest and highest temperature of the data, K.
    ambient : str
        Stated temperature of the room, such as "22.3 °C ± 0.5 °C"; other texts are ignored.
    unit : str
        Unit of the temperature column.
    stated : bool
        Whether the run file states this unit.
    """
    room = np.nan
    with suppress(InputError):
        room = parse_quantity(ambient, "°C").value
    low, high = np.array(kelvin) - room
    if stated or unit in COUNTS or not high - low < _SELF_HEATING[1]:
        return ()
    if min(abs(low), abs(high)) <= _SELF_HEATING[1]:
        return ()
    values = temperature_readout(unit).values(np.array(kelvin))
    for other in (one for one in ("°F", "K", "°C") if one != unit):
        above = temperature_readout(other).kelvin(values) - room
        if _SELF_HEATING[0] <= above.min() and above.max() <= _SELF_HEATING[1]:
            text = (
                f"the sensor is at {values.mean():.0f} {unit} in a room at "
                f"{room - ZERO_CELSIUS:.0f} °C, as if its column were in {other}; state "
                f'temperature_unit in [data]: "{other}", or "{unit}" if it was so'
            )
            return (Finding("warning", TEMPERATURE_UNIT, text),)
    return ()


_LEAST_REACH = 4.0  # s; the longest that does not bias a lag of 20 s
_CELLS = 16  # in the reach of a slope; slopes are computed from the means of these cells
_COARSE = 0.1  # K; with larger steps, slopes need the whole lag
_STRAIGHT = 0.5, 1.3  # steps, or standard deviations of noise, from a line (rms)
_MEDIAN_CHANGE = 0.954  # median difference of neighbours, in standard deviations of white noise
_BRIDGED = 0.25  # of the lag; a longer interruption hides what the temperature did
_STEP_IN_SLOPE = 1.5  # steps per time: largest error of a least-squares slope from one step
FOUND_LAG = "lag of the temperature"
"""Key in the conditions of a calibration."""
TEMPERATURE_VARIATION = 0.5  # K; a smaller variation counts as constant temperature


def temperature_varies(kelvin: Array | None) -> bool:
    """Return whether temperatures, (..., n) K, differ by more than `TEMPERATURE_VARIATION`."""
    if kelvin is None:
        return False
    return float(np.ptp(kelvin, axis=-1).max(initial=0.0)) > TEMPERATURE_VARIATION


def temperature_rate(time: Array, kelvin: Array) -> Array:
    """Return the time derivative of a temperature, (..., n) K/s.

    It is the least-squares slope of the temperatures around each sample; at least the neighbours
    of the sample are used, and it is never taken across a long gap.

    Parameters
    ----------
    time : (n,) array
        Times, s.
    kelvin : (..., n) array
        Temperatures, K.
    """
    return _slopes(time, kelvin, _LEAST_REACH)[0]


def _slopes(time: Array, kelvin: Array, reach: float) -> tuple[Array, Array]:
    """Return the rates of `temperature_rate`, and the rms distance from each line, (..., n) K."""
    if time.size < 2:
        return np.zeros(kelvin.shape), np.zeros(kelvin.shape)
    reach = max(reach, GAP_FACTOR * float(np.median(np.diff(time))))
    cell = np.floor((time - time[0]) / (reach / _CELLS))
    first = np.flatnonzero(np.diff(cell, prepend=-1.0))
    count = np.diff(first, append=time.size)
    at = np.add.reduceat(time, first) / count
    mean = np.add.reduceat(kelvin, first, axis=-1) / count
    weight, x, xx = np.zeros((3, at.size))
    y, xy, yy = np.zeros((3, *mean.shape))
    for k in range(-_CELLS, _CELLS + 1):
        other = np.arange(at.size) + k
        inside = (other >= 0) & (other < at.size)
        other = np.where(inside, other, 0)
        away, higher = at[other] - at, mean[..., other] - mean
        w = count[other] * (inside & (np.abs(away) <= reach))
        weight, x, xx = weight + w, x + w * away, xx + w * away**2
        y, xy, yy = y + w * higher, xy + w * away * higher, yy + w * higher**2
    spread, product = xx - x**2 / weight, xy - x * y / weight
    slope = product / np.where(spread > 0, spread, np.inf)
    square = np.maximum(yy - y**2 / weight - slope * product, 0) / weight
    return np.repeat(slope, count, axis=-1), np.repeat(np.sqrt(square), count, axis=-1)


def _rate_of_reading(time: Array, kelvin: Array, lag: float, step: float, straight: float) -> Array:
    """Return dR/dt, (..., n) K/s, from the longest lines that are within `straight`, K.

    The lines reach up to `lag` before and after each sample; less if the steps are small, because
    the lines then need not be as long.
    """
    reach = max(_LEAST_REACH, lag * min(1.0, float(np.sqrt(step / _COARSE))))
    rate, away = _slopes(time, kelvin, reach)
    while (bent := away > straight).any() and (reach := reach / 2) >= _LEAST_REACH:
        shorter, distance = _slopes(time, kelvin, reach)
        rate, away = np.where(bent, shorter, rate), np.where(bent, distance, away)
    return rate


def ahead_of_lag(recording: Recording, lag: float) -> Recording:
    """Convert the temperature R to that of the sensing element, T, for a lag τ in s.

    If R lags, T = R + τ dR/dt. If R leads, τ < 0, T is R behind a low-pass filter: R = T − τ dT/dt.
    Each part between interruptions is converted by itself. dR/dt is the slope of a line through the
    readings up to τ before and after, so that a step of a coarse thermometer changes T by about a
    step. Parts that are too short for this keep their temperature R, and the recording gets a
    warning.
    """
    kelvin, time = recording.temperature, recording.time
    if kelvin is None or not lag or time.size < 2:
        return recording
    bridged = _BRIDGED * max(abs(lag), _LEAST_REACH)
    apart = np.diff(time) > max(bridged, GAP_FACTOR * recording.median_step)
    if recording.labels is not None and any(f.what == "sections" for f in recording.findings):
        apart |= recording.labels[1:] != recording.labels[:-1]  # by an unknown time
    changes = np.abs(np.diff(kelvin, axis=-1)[..., ~apart])
    step = float(np.median(changes[changes > 0])) if changes.any() else 0.0
    noise = float(np.median(changes)) / _MEDIAN_CHANGE if changes.size else 0.0
    straight = max(_STRAIGHT[0] * step, _STRAIGHT[1] * noise)
    result, short = kelvin.copy(), list[tuple[float, int, int]]()
    for start, stop in pairwise([0, *(np.flatnonzero(apart) + 1).tolist(), time.size]):
        t, part, span = time[start:stop], kelvin[..., start:stop], recording.span(start, stop)
        if lag < 0:
            result[..., start:stop] = first_order_response(part, -lag, span / t.size)
        elif span < lag and _STEP_IN_SLOPE * step * lag / span > TEMPERATURE_VARIATION:
            short.append((span, start, stop))
        else:
            rate = _rate_of_reading(t, part, lag, step, straight)
            result[..., start:stop] = part + lag * rate
    found = (_not_corrected(recording, lag, step, short),) if short else ()
    return replace(recording, temperature=result, findings=(*recording.findings, *found))


def _not_corrected(
    recording: Recording, lag: float, step: float, short: list[tuple[float, int, int]]
) -> Finding:
    """Return the warning about parts that are too short to see how fast the temperature changed."""
    span, start, stop = max(short)
    first, last = recording.stamps[[start, stop - 1]]
    text = (
        f"the temperature of {format_count(len(short), 'part')} of the recording is not corrected "
        f"for the lag of {lag:g} s, because the time between two interruptions is too short: even "
        f"in the longest of these parts, {first:.6g} to {last:.6g} s, steps of {step:.2g} K make "
        f"the correction uncertain by {_STEP_IN_SLOPE * step * lag / span:.2g} K; record without "
        "interruptions"
    )
    return Finding("warning", "lag", text)


def first_order_response(driving: Array, time_constant: float, step: float) -> Array:
    """Return the first-order response to an input, (..., n), from the input's first value on.

    Parameters
    ----------
    driving : (..., n) array
        Input, which is linear between samples.
    time_constant : float
        s; the response is the input if it is not positive.
    step : float
        Time between samples, s.
    """
    if time_constant <= 0:
        return driving
    # This module takes long to import, and few runs need it.
    from scipy.signal import lfilter  # pyright: ignore

    keep = float(np.exp(-step / time_constant))
    # Each step is a weighted sum of the values before and after it.
    after = 1 - (1 - keep) * time_constant / step
    before = 1 - keep - after
    start = (1 - after) * driving[..., :1]
    result = lfilter([after, before], [1.0, -keep], driving, zi=start)[0]
    return np.asarray(result, dtype=float)
