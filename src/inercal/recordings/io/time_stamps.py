"""Convert time stamps to sample times: in a unit of time, as ISO 8601 text, or a packet counter.

A wrong unit of time changes integrals but not means, so no later check detects it. Stamps that look
like a different unit from the one in use are therefore refused, and the message names the key to
set. No unit is guessed.

Samples of two sensors are joined by time: each sample is combined with the nearest sample of the
other sensor. Readings are not interpolated, because that would filter their noise.
"""

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from fractions import Fraction
from functools import partial
from math import floor, isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.recordings import Indices
from inercal.recordings.io.column_table import Array, Table, shorten
from inercal.recordings.io.wrapped_numbers import Stamps, unwrap_stamps

SLOWEST_HZ, FASTEST_HZ = 1.0, 50e3  # of recordings; at other rates the unit is wrong
SAME_RATE = 0.2  # relative; stated rates are nominal
_UNSTATED_HZ = 5.0  # if no unit is stated: 1 to 5 kHz in ms would be taken for 1 to 5 Hz
_ROUNDING = 1e-6  # of a rate, for stamps with few digits
_UNITS = ("s", "ms", "us", "ns")  # units that loggers write
_NAMED = re.compile(
    r"(?:^|[\W_])(?:(?P<s>s|secs?|seconds?)|(?P<ms>ms|msec|millis|milliseconds?)"
    r"|(?P<us>us|µs|μs|usec|micros|microseconds?)"
    r"|(?P<ns>ns|nsec|nanos|nanoseconds?))[\W_]*$",
    re.IGNORECASE,
)
# Stamps since 1970 in s, ms, µs and ns, for dates from 2001 to 2096.
_EPOCH = {"s": (1e9, 4e9), "ms": (1e12, 4e12), "us": (1e15, 4e15), "ns": (1e18, 4e18)}
_ISO = re.compile(
    r"(?:(?P<day>\d{4}([-/]?)\d\d\2\d\d)[T ]\s*)?(?P<minute>\d\d:?\d\d)(?P<second>:?\d\d)?"
    r"(?:[.,:](?P<fraction>\d{1,18}))?\s*(?P<zone>Z|z|[+-]\d\d(?::?\d\d)?)?"
)
_CLOCK = re.compile(r"\d\d:\d\d:\d\d.*")  # a time of day needs its colons and seconds
_NS = 10**9
_DAY = 86_400 * _NS
_INT64_ORIGIN = 2**62  # with a smaller origin, differences from it do not overflow


def times_from_origin(
    stamps: Stamps, size: float, origin: Fraction | int | None = None
) -> tuple[Array, Fraction]:
    """Convert stamps to times counted from an origin, and return the origin too.

    The origin is subtracted before anything is rounded, because float64 resolves a stamp since 1970
    only to 0.2 µs.

    Parameters
    ----------
    stamps : (n,) array of float64 or int64
    size : float
        Unit of the stamps, s.
    origin : Fraction, optional
        Time 0 on the clock of the stamps, ns; by default the first finite stamp.

    Returns
    -------
    time : (n,) array
        Times, s.
    origin : Fraction

    >>> times_from_origin(np.array([1700000000123456789, 1700000000123456790]), 1e-9)[0].tolist()
    [0.0, 1e-09]
    """
    unit = Fraction(str(size))  # 1e-9 means the decimal fraction
    if origin is None:
        first = stamps[int(np.argmax(np.isfinite(stamps)))].item()
        origin = Fraction(first) * unit * _NS if isfinite(first) else 0
    start = Fraction(origin) / (unit * _NS)
    whole = floor(start)
    if stamps.dtype.kind == "i" and abs(whole) < _INT64_ORIGIN:
        time, rest = (stamps - whole).astype(np.float64), start - whole
    else:
        time, rest = stamps.astype(np.float64) - float(start), start - Fraction(float(start))
    if rest:
        time = time - float(rest)
    # Division by 1000 is rounded once, but multiplication by 0.001 twice.
    time = time / unit.denominator if unit.numerator == 1 else time * size
    return time, Fraction(origin)


def require_unit(
    stamps: Stamps, column: str, unit: str | None, source: str, keys: tuple[str, str | None]
) -> None:
    """Refuse stamps that seem to be in a different unit of time from the one in use.

    Parameters
    ----------
    stamps : (n,) array
        Values of the column.
    column, source : str
        Names of the column and of its file, for the message.
    unit : str or None
        The stated unit; None if no unit is stated, in which case s is used.
    keys : (str, str or None)
        Run-file keys: the key for the unit of the stamps, and the key for the rate that can replace
        them, if any.

    Raises
    ------
    InputError
        The rate is below 1 Hz or above 50 kHz. If neither the unit nor the column's name states s,
        the error is also raised for a rate below 5 Hz, a column whose name ends in another unit,
        and stamps since 1970 in another unit.
    """
    unit_key, rate_key = keys
    error = partial(InputError, file=source, key=unit_key, names=(column,))
    rate = _rate(stamps)
    # The unit at the end of the column's name.
    named = found.lastgroup if (found := _NAMED.search(column)) is not None else None
    if unit is None:
        if named not in (None, "s"):
            raise error(
                f"{source}: column {column!r} has {named} in its name, but without a stated "
                f'unit it is read in s: state {unit_key} = "{named}"'
            )
        since = _epoch_unit(stamps)
        if since not in (None, "s"):
            raise error(
                f"{source}: times of {stamps[np.isfinite(stamps)][0]:.6g} in column {column!r}"
                f" look like {since} since 1970, but without a stated unit they are read in s: "
                f'state {unit_key} = "{since}"'
            )
    if rate is None:
        return
    in_force = "s" if unit is None else unit
    hz = rate / si_factor(in_force, like="s")
    slowest = _UNSTATED_HZ if unit is None and named is None else SLOWEST_HZ
    if slowest * (1 - _ROUNDING) <= hz <= FASTEST_HZ * (1 + _ROUNDING):
        return
    if hz > FASTEST_HZ and mean_rate(stamps) / si_factor(in_force, like="s") < FASTEST_HZ:
        return  # these are bursts, which the audit reports
    others = [
        (other, rate / si_factor(other, like="s"))
        for other in _UNITS
        if SLOWEST_HZ <= rate / si_factor(other, like="s") <= FASTEST_HZ
    ]
    if others:
        advice = "state the unit of the stamps: " + " or ".join(
            f'{unit_key} = "{other}" ({there:.4g} Hz)' for other, there in others
        )
    else:
        advice = f"state the unit of the stamps, {unit_key}"
    if rate_key is not None:
        advice += f'; if {hz:.3g} Hz is right, remove the column and state {rate_key} = "…"'
    raise error(
        f"{source}: column {column!r} in {in_force} gives {hz:.3g} samples per second, outside "
        f"{slowest:g} Hz to {FASTEST_HZ / 1e3:g} kHz: {advice}"
    )


def require_counter(stamps: Stamps, column: str, rate_hz: float, source: str, key: str) -> None:
    """Refuse times that were stated to be a sample counter.

    A column is refused if its steps are not 1 but, read in a unit of time, give about the stated
    rate.

    Parameters
    ----------
    stamps : (n,) array
        Values of the column.
    column, source : str
        Names of the column and of its file, for the message.
    rate_hz : float
        Stated rate of the counter, Hz.
    key : str
        Run-file key for the unit of the stamps, for the message.

    Raises
    ------
    InputError
        The message names the unit.
    """
    rate = _rate(stamps)
    if rate is None or rate == 1:
        return
    for unit in _UNITS:
        if abs(rate / si_factor(unit, like="s") / rate_hz - 1) < SAME_RATE:
            steps = np.diff(stamps)
            mean = float(np.mean(steps[np.abs(steps * rate - 1) < 0.5]))
            hz = 1 / (mean * si_factor(unit, like="s"))
            raise InputError(
                f"{source}: column {column!r} advances by about {float(f'{mean:.3g}'):.12g} per "
                f"row, so it does not count samples; in {unit} it gives {hz:.4g} Hz: state {key} = "
                f'"{unit}" and remove rate, or, if only some of the counted samples are stored, '
                "remove the column and state the rate of the rows",
                file=source,
                key=key,
                names=(column,),
            )


def _rate(stamps: Stamps) -> float | None:
    """Return the samples per unit of the stamps, from the median nonzero step."""
    steps = np.abs(np.diff(stamps))
    steps = steps[np.isfinite(steps) & (steps > 0)]
    return 1 / float(np.median(steps, overwrite_input=True)) if steps.size else None


def mean_rate(stamps: Stamps) -> float:
    """Return the samples per unit of the stamps, (n,), from the first and the last stamp."""
    finite = stamps[np.isfinite(stamps)]
    return (finite.size - 1) / float(np.ptp(finite))


def _epoch_unit(stamps: Stamps) -> str | None:
    finite = stamps[np.isfinite(stamps)]
    if not finite.size or finite.max() < _EPOCH["s"][0]:
        return None
    middle = float(np.median(finite, overwrite_input=True))
    return next((unit for unit, (low, high) in _EPOCH.items() if low <= middle <= high), None)


def is_iso_time(cell: str) -> bool:
    """Return whether a cell of text looks like an ISO 8601 date with a time, or a time of day."""
    return _match(cell) is not None


def _match(cell: str) -> re.Match[str] | None:
    match = _ISO.fullmatch(cell.strip())
    return match if match and (match["day"] or _CLOCK.fullmatch(match[0])) else None


def times_from_iso(
    cells: Sequence[str], column: str, table: Table, origin: Fraction | int | None = None
) -> tuple[Array, Fraction]:
    """Return the times of ISO 8601 stamps, such as 2026-11-23T03:10:09.123Z.

    Stamps without a date are times of day, 03:10:09.123, and go on after midnight.

    Parameters
    ----------
    cells : sequence of n str
        Date and time, fraction of a second, and time zone: Z or an offset from UTC, which may
        change from row to row. Either all rows or no rows state a zone.
    column : str
        Name of the column, for messages.
    table : Table
        Table with these cells, for messages.
    origin : Fraction, optional
        Time 0, ns since 1970; by default the first stamp.

    Returns
    -------
    time : (n,) array
        Times, s.
    origin : Fraction

    Raises
    ------
    InputError
        A cell is not such a time, or only some of the rows state a zone.
    """
    ns = np.empty(len(cells), np.int64)
    known: dict[tuple[str, str], int] = {}  # times to the minute, which most rows share

    def refusal(k: int, problem: str) -> InputError:
        return InputError(
            f"{table.source} {table.place(k)}, column {column!r}: {shorten(cells[k])!r} {problem}",
            file=table.source,
            line=table.line(k),
            names=(column,),
        )

    zoned: bool | None = None
    for k, cell in enumerate(cells):
        match = _match(cell)
        if match is None:
            raise refusal(k, "is not an ISO 8601 time such as 2026-11-23T03:10:09Z")
        zone = match["zone"] or ""
        if zoned is not None and zoned != bool(zone):
            raise refusal(
                k,
                f"has {'a' if zone else 'no'} time zone, unlike the row before: write a time "
                "zone in all rows or in none",
            )
        zoned = bool(zone)
        minute = f"{(match['day'] or '1970-01-01').replace('/', '-')}T{match['minute']}"
        second = int((match["second"] or "0").lstrip(":"))
        if (minute, zone) not in known:
            try:
                at = datetime.fromisoformat(minute + zone.upper())
            except ValueError as error:
                raise refusal(k, f"is not a time: {error}") from None
            at = at if zone else at.replace(tzinfo=UTC)
            known[minute, zone] = round(at.timestamp())
        if second > 59:
            raise refusal(k, "is not a time: seconds run from 0 to 59")
        fraction = (match["fraction"] or "0").ljust(9, "0")[:9]
        ns[k] = (known[minute, zone] + second) * _NS + int(fraction)
    if len(cells) and (first := _match(cells[0])) is not None and not first["day"]:
        ns[1:] += _DAY * np.cumsum(np.diff(ns) < -_DAY // 2)
    return times_from_origin(ns, 1 / _NS, origin)


def times_from_counter(counter: ArrayLike, modulus: float, rate_hz: float) -> Array:
    """Return the times of samples from a packet counter; lost packets become gaps.

    Parameters
    ----------
    counter : (n,) array of int
        Counter values from 0 to modulus − 1, or as many with a sign; each sent packet
        increases the counter by 1.
    modulus : float
        Number of values after which the counter wraps around to 0; at least 3. If half of them or
        more are lost between two packets, this is not recognised.
    rate_hz : float

    Returns
    -------
    (n,) array
        Times from 0, s.

    Raises
    ------
    InputError
        A value is not a whole number below the modulus, or a packet is repeated or late.

    >>> times_from_counter([254, 255, 0, 3], 256, 100.0).tolist()
    [0.0, 0.01, 0.02, 0.05]
    """
    read = np.asarray(counter, dtype=float)
    if modulus < 3 or not rate_hz > 0:
        raise InputError(
            f"counter: modulus {modulus:.12g} and rate {rate_hz:g} Hz; the modulus must be at "
            "least 3 and the rate greater than 0",
            key="modulus",
        )
    possible = (read >= -0.5 * modulus) & (read < modulus) & (read == np.round(read))
    off = np.flatnonzero(~possible)
    if off.size:
        raise InputError(
            f"counter: sample {off[0]} has {read[off[0]]:g}, but the counter can only have "
            f"whole numbers from 0 to {modulus - 1:.12g}; check its column and its modulus"
        )
    step = np.diff(read) % modulus
    bad = np.flatnonzero((step == 0) | (2 * step >= modulus))
    if bad.size:
        k, most = int(bad[0]), float(read.max())
        if most + 1 < modulus and (read[bad] == most).all() and (read[bad + 1] == read.min()).all():
            raise InputError(
                f"counter: after {most:g} it restarts at {read.min():g} (sample {k + 1}), so "
                f"its modulus is {most + 1:g}, not {modulus:.12g}",
                key="modulus",
            )
        what = "appears twice" if step[k] == 0 else f"follows {read[k]:g}: packets out of order"
        raise InputError(
            f"counter: {read[k + 1]:g} at sample {k + 1} {what}, or {modulus // 2:.12g} packets or "
            f"more were lost; remove repeated packets and sort late packets ({bad.size} in all)"
        )
    return (unwrap_stamps(read, modulus) - read[0]) / rate_hz


_APART = 0.75  # longest distance between joined samples, in units of the longer median step


def nearest_samples(times: NDArray[Any], wanted: NDArray[Any]) -> tuple[Indices, NDArray[np.bool_]]:
    """Return the sample nearest to each wanted time, (n,), and whether it is near enough.

    Parameters
    ----------
    times : (m,) array
        Times of the samples, in any order.
    wanted : (n,) array
        Wanted times, in the same unit.
    """
    order = np.argsort(times, kind="stable")
    ordered = times[order]
    after = np.clip(np.searchsorted(ordered, wanted), min(1, times.size - 1), times.size - 1)
    before = np.maximum(after - 1, 0)
    closer = wanted - ordered[before] <= ordered[after] - wanted
    near = order[np.where(closer, before, after)]
    reach = _APART * max(_median_step(times), _median_step(wanted))
    return near, np.abs(times[near] - wanted) <= reach


def _median_step(times: NDArray[Any]) -> float:
    steps = np.abs(np.diff(times))
    return float(np.median(steps, overwrite_input=True)) if steps.size else 0.0
