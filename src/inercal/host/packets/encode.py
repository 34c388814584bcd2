"""Converts readings to the bytes that a device would send, for the simulator.

`PacketPacker` makes the same bytes as `encode`, but faster for a few readings. The fields of the
layout are only looked up once, and a compiled loop writes the numbers.
"""
# Numba's decorator is not typed.
# pyright: reportUntypedFunctionDecorator=false

from math import isnan, nan
from string import Formatter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import InputError
from inercal.estimation.kernel_options import njit
from inercal.host.packets.layout import PacketLayout
from inercal.host.packets.packet_format import AXES, ROLES, BinaryFrame, Field, TextLine

_INTEGER_RANGE = {"d": (-(10**18) + 1, 10**18 - 1), "x": (0, 2**32 - 1)}


def encode(
    layout: PacketLayout,
    readings: ArrayLike,
    counter: ArrayLike | None = None,
    time: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    status: ArrayLike = 0,
) -> bytes:
    """Return the packets with readings, rounded as the layout states.

    If a reading exceeds the full scale or the range of its type, the limit is sent. Counter and
    time wrap around to 0.

    Parameters
    ----------
    layout : PacketLayout
    readings : (n, 6) array
        Readings in m/s² and rad/s. In the channels of the layout, they must be finite.
    counter : (n,) array of int, optional
        Values of the counter; by default, it counts from 0 with the step of the layout.
    time : (n,) array, optional
        Times in s; required if the packets contain them.
    temperature : (n,) array, optional
        Temperatures in K; required if all packets contain them. For NaN, a packet without
        temperature is used.
    status : (n,) array of int or int

    Raises
    ------
    InputError
        The shape is not (n, 6), or values for a channel of the packets are missing.
    """
    readings = np.asarray(readings, np.float64)
    if readings.ndim != 2 or readings.shape[1] != len(AXES):
        raise InputError(
            f"readings have shape {readings.shape}; give (n, {len(AXES)}): {', '.join(AXES)}",
            key="readings",
        )
    n = len(readings)
    given: dict[str, NDArray[Any]] = {role: readings[:, k] for k, role in enumerate(AXES)}
    given["status"] = np.broadcast_to(np.asarray(status, np.int64), n)
    counted = np.arange(n) * int(layout.step) if counter is None else np.asarray(counter, np.int64)
    wraps = int(layout.wraps["counter"])
    given["counter"] = counted % wraps if wraps else counted
    for role, values in {"time": time, "temperature": temperature}.items():
        if values is not None:
            given[role] = np.broadcast_to(np.asarray(values, np.float64), n)
    warm = np.isfinite(given["temperature"]) if "temperature" in given else np.zeros(n, bool)
    first = layout.frames[0]
    if isinstance(first, TextLine):
        return _text_lines(layout, first, given, n)
    frames = [frame for frame in layout.frames if isinstance(frame, BinaryFrame)]
    carries = ["temperature" in frame.byte_orders for frame in frames]
    without, with_it = (carries.index(has) if has in carries else 0 for has in (False, True))
    kind = np.where(warm, with_it, without)
    lengths = np.array([frame.length for frame in frames])[kind]
    begins = np.cumsum(lengths) - lengths
    out = np.zeros(int(lengths.sum()), np.uint8)
    for k, frame in enumerate(frames):
        rows = np.flatnonzero(kind == k)
        if rows.size:
            out[begins[rows][:, None] + np.arange(frame.length)] = _records(
                layout, frame, {role: values[rows] for role, values in given.items()}, rows.size
            )
    return out.tobytes()


def _raw_values(layout: PacketLayout, field: Field, given: dict[str, NDArray[Any]]) -> NDArray[Any]:
    """Return the raw values of a field; integer fields are rounded."""
    if field.role not in given:
        raise InputError(
            f"the packets of {layout.name!r} contain {field.role}, which is not given; pass it",
            key=field.role,
            names=(layout.name,),
        )
    values, scale = given[field.role], layout.scale(field.role)
    if field.role in ("counter", "status"):
        return values * int(field.sign)
    if not np.isfinite(values).all():
        raise InputError(
            f"the packets of {layout.name!r} contain {field.role}, which has values that are not "
            "finite; pass finite values",
            key=field.role,
            names=(layout.name,),
        )
    raw = (np.clip(values, -scale.full_scale, scale.full_scale) - scale.zero) / scale.size
    raw = raw * field.sign
    if field.role == "time" and layout.wraps["time"]:
        raw = (np.rint(raw) if field.bits else raw) % layout.wraps["time"]
    if field.type[-1] == "d":
        return np.clip(np.rint(raw), *_INTEGER_RANGE["d"]).astype(np.int64)
    if not field.bits:
        return raw
    return np.clip(np.rint(raw), *field.limits)


def _records(
    layout: PacketLayout, frame: BinaryFrame, given: dict[str, NDArray[Any]], n: int
) -> NDArray[np.uint8]:
    """Return packets of one kind as an array of bytes, (n, length)."""
    rows = np.zeros((n, frame.length), np.uint8)
    for offset, value in frame.constants:
        rows[:, offset] = value
    records = rows.view(frame.dtype)[:, 0]
    for field in frame.fields:
        raw = _raw_values(layout, field, given)
        if field.bits == 24:
            whole = raw.astype(np.int64)
            shifts = (16, 8, 0) if frame.byte_orders[field.role] == "big" else (0, 8, 16)
            raw = np.stack([whole >> shift & 0xFF for shift in shifts], axis=-1)
        records[field.role] = raw
    for check in frame.checks:
        starts = np.arange(n) * frame.length
        value = check.kind.span_checks(rows.reshape(-1), starts + check.start, starts + check.at)
        size = check.kind.bits // 8
        for k in range(size):
            place = size - 1 - k if check.order == "big" else k
            rows[:, check.at + place] = value >> np.uint32(8 * k) & np.uint32(0xFF)
    return rows


def _text_lines(
    layout: PacketLayout, line: TextLine, given: dict[str, NDArray[Any]], n: int
) -> bytes:
    """Return the readings as lines of text."""
    columns = {field.role: _raw_values(layout, field, given).tolist() for field in line.fields}
    parts = list(Formatter().parse(line.text))
    lines = list[str]()
    for k in range(n):
        text = ""
        for literal, name, spec, _ in parts:
            if name is None or name == "_":
                text += literal + (spec or "")
            elif "@" in name:
                text += literal + format(_line_check(line, text), str(spec))
            else:
                role = name.removeprefix("-")
                text += literal + format(columns[role][k], str(spec))
        lines.append(text)
    return "".join(f"{text}\r\n" for text in lines).encode()


def _line_check(line: TextLine, text: str) -> int:
    """Return the checksum for a line that is otherwise complete."""
    (check,) = line.checks
    data = np.frombuffer(text.encode(), np.uint8)
    ends = np.array([check.start]), np.array([data.size])
    return int(check.kind.span_checks(data, *ends)[0])


_TEMPERATURE = 293.15  # K; the temperature of a simulated IMU without a chamber
_MAX_INTEGER = float(np.nextafter(2.0**63, 0))  # largest signed integer; no device counts further
_TEMPERATURE_AT, _COUNTER_AT, _TIME_AT, _STATUS_AT = range(len(AXES), len(ROLES))


@njit(cache=True, nogil=True)
def _write_fields(
    given: Array,
    columns: Indices,
    scales: Array,
    whole: Bools,
    at: Indices,
    sizes: Indices,
    big: Bools,
    out: NDArray[np.uint8],
) -> None:
    """Write values, (n, given), to the fields of packets, (n, length).

    `columns`, (fields,), states the column of each field. `scales`, (fields, 7), contains the size
    of a unit, zero, sign, full scale, the smallest and largest raw value, and the value at which
    the field wraps.
    """
    single, double = np.empty(1, np.float32), np.empty(1, np.float64)
    bytes_single, bytes_double = single.view(np.uint8), double.view(np.uint8)
    for n in range(given.shape[0]):
        for j in range(columns.size):
            size, zero, sign, full, low, high, wraps = scales[j]
            raw = (min(max(given[n, columns[j]], -full), full) - zero) / size * sign
            width = sizes[j]
            if whole[j]:
                raw = np.rint(raw)
            if wraps:
                raw = raw % wraps
            if whole[j]:
                number = np.int64(min(max(raw, low), high))
                for k in range(width):
                    place = at[j] + (width - 1 - k if big[j] else k)
                    out[n, place] = np.uint8((number >> (8 * k)) & 0xFF)
                continue
            single[0], double[0] = raw, raw
            for k in range(width):
                place = at[j] + (width - 1 - k if big[j] else k)
                out[n, place] = bytes_single[k] if width == 4 else bytes_double[k]


@njit(cache=True, nogil=True)
def _write_checks(
    value: NDArray[np.uint32], at: int, size: int, big: bool, out: NDArray[np.uint8]
) -> None:
    """Write the checksum of each packet at its position."""
    for n in range(value.size):
        for k in range(size):
            out[n, at + (size - 1 - k if big else k)] = np.uint8((value[n] >> (8 * k)) & 0xFF)


class PacketPacker:
    """Makes packets from numbered readings, (n, 6), in m/s² and rad/s.

    Parameters
    ----------
    layout : PacketLayout
    rate_hz : float
        Packet rate. If not all packets contain the temperature, one packet per second contains it.
    """

    def __init__(self, layout: PacketLayout, rate_hz: float):
        self._layout, self._rate = layout, rate_hz
        frames = [frame for frame in layout.frames if isinstance(frame, BinaryFrame)]
        carries = ["temperature" in frame.byte_orders for frame in frames]
        kinds = [frames[carries.index(has)] for has in (False, True) if has in carries]
        self._frame_packers = [_FramePacker(layout, frame) for frame in kinds]
        self._packets_per_second = max(round(rate_hz), 1)
        self(0, np.zeros((1, len(AXES))))

    def __call__(self, first: int, readings: Array, kelvin: float = nan) -> list[bytes]:
        """Return the packets with some readings; the first reading has the number `first`.

        `kelvin` is the temperature of the IMU, K; NaN if the bench has no chamber.
        """
        kelvin = _TEMPERATURE if isnan(kelvin) else kelvin
        numbers = np.arange(first, first + len(readings))
        counted = numbers * int(self._layout.step)
        time = (numbers + 1) / self._rate
        if not self._frame_packers:
            temperature = np.full(len(readings), kelvin)
            text = encode(self._layout, readings, counted, time, temperature)
            return text.splitlines(keepends=True)
        given = np.empty((len(readings), len(ROLES)))
        given[:, : len(AXES)] = readings
        given[:, _TEMPERATURE_AT] = kelvin
        given[:, _COUNTER_AT] = counted
        given[:, _TIME_AT] = time
        given[:, _STATUS_AT] = 0.0
        packets = self._frame_packers[0].packets(given)
        if len(self._frame_packers) > 1:
            for n in np.flatnonzero(numbers % self._packets_per_second == 0).tolist():
                packets[n] = self._frame_packers[1].packets(given[n : n + 1])[0]
        return packets


class _FramePacker:
    """Makes packets of one kind."""

    def __init__(self, layout: PacketLayout, frame: BinaryFrame):
        self._frame = frame
        scales: list[tuple[float, ...]] = []
        for field in frame.fields:
            scale = layout.scale(field.role)
            low, high = field.limits
            high = min(high, _MAX_INTEGER)
            wraps = layout.wraps.get(field.role, 0.0)
            scales.append((scale.size, scale.zero, field.sign, scale.full_scale, low, high, wraps))
        self._fields = (
            np.array([ROLES.index(field.role) for field in frame.fields]),
            np.array(scales),
            np.array([field.bits > 0 for field in frame.fields]),
            np.array([field.at for field in frame.fields]),
            np.array([int(field.type[1:]) // 8 for field in frame.fields]),
            np.array([frame.byte_orders[field.role] == "big" for field in frame.fields]),
        )
        self._template = np.zeros(frame.length, np.uint8)
        for offset, value in frame.constants:
            self._template[offset] = value

    def packets(self, given: Array) -> list[bytes]:
        """Return the packets with given values, (n, roles)."""
        n, length = len(given), self._frame.length
        rows = np.empty((n, length), np.uint8)
        rows[:] = self._template
        _write_fields(given, *self._fields, rows)
        for check in self._frame.checks:
            starts = np.arange(check.start, n * length, length)
            ends = starts + (check.at - check.start)
            value = check.kind.span_checks(rows.reshape(-1), starts, ends)
            _write_checks(value, check.at, check.kind.bits // 8, check.order == "big", rows)
        data = rows.tobytes()
        return [data[i : i + length] for i in range(0, n * length, length)]
