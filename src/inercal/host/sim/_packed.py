"""Packets of a few readings, the same bytes as `inercal.host.packets.encode` makes, in less time.

What a layout says of its fields is looked up once, and numbers are written by a compiled loop.
Lines of text are left to `encode`.
"""
# Numba's decorator has no types.
# pyright: reportUntypedFunctionDecorator=false

from collections.abc import Mapping
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from inercal.host.packets import Layout, encode
from inercal.host.packets.picture import AXES, Frame

Array = NDArray[np.float64]

_TEMPERATURE = 293.15  # K, in which the IMU stands


@njit(cache=True, nogil=True)
def _fill(
    values: Array,
    scales: Array,
    whole: NDArray[np.bool_],
    at: NDArray[np.int64],
    sizes: NDArray[np.int64],
    big: NDArray[np.bool_],
    out: NDArray[np.uint8],
) -> None:
    """Write raw values of fields, (n, fields), into packets (n, length).

    `scales` (fields, 6) are the size of a unit, zero, sign, full scale, and the least and the
    greatest raw value.
    """
    single, double = np.empty(1, np.float32), np.empty(1, np.float64)
    bytes_single, bytes_double = single.view(np.uint8), double.view(np.uint8)
    for n in range(values.shape[0]):
        for j in range(values.shape[1]):
            size, zero, sign, full, low, high = scales[j]
            raw = (min(max(values[n, j], -full), full) - zero) / size * sign
            width = sizes[j]
            if whole[j]:
                number = np.int64(min(max(np.rint(raw), low), high))
                for k in range(width):
                    place = at[j] + (width - 1 - k if big[j] else k)
                    out[n, place] = np.uint8((number >> (8 * k)) & 0xFF)
                continue
            single[0], double[0] = raw, raw
            for k in range(width):
                place = at[j] + (width - 1 - k if big[j] else k)
                out[n, place] = bytes_single[k] if width == 4 else bytes_double[k]


class Packer:
    """Makes the packets of readings (n, 6), m/s² and rad/s, from their numbers on.

    Parameters
    ----------
    layout : Layout
    rate_hz : float
        Of the packets. Where some of them carry the temperature and some do not, one a second does.
    """

    def __init__(self, layout: Layout, rate_hz: float):
        self._layout, self._rate = layout, rate_hz
        frames = [frame for frame in layout.frames if isinstance(frame, Frame)]
        warm = [any(f.role == "temperature" for f in frame.fields) for frame in frames]
        self._kinds = [
            _Kind(layout, next(f for f, w in zip(frames, warm, strict=True) if w == wanted))
            for wanted in (False, True)
            if wanted in warm
        ]
        self._second = max(round(rate_hz), 1)
        self(0, np.zeros((1, len(AXES))))

    def __call__(self, first: int, readings: Array) -> list[bytes]:
        """Return the packets of readings number `first` and the following."""
        numbers = np.arange(first, first + len(readings))
        counted = numbers * int(self._layout.step)
        time = (numbers + 1) / self._rate
        if not self._kinds:
            temperature = np.full(len(readings), _TEMPERATURE)
            text = encode(self._layout, readings, counted, time, temperature)
            return text.splitlines(keepends=True)
        if wraps := int(self._layout.wraps["counter"]):
            counted %= wraps
        given = {"counter": counted, "time": time, "status": 0, "temperature": _TEMPERATURE}
        packets = self._kinds[0].packets(given, readings)
        if len(self._kinds) > 1:
            for n in np.flatnonzero(numbers % self._second == 0).tolist():
                now = {"counter": counted[n : n + 1], "time": time[n : n + 1]}
                packets[n] = self._kinds[1].packets(given | now, readings[n : n + 1])[0]
        return packets


class _Kind:
    """Packets of one kind."""

    def __init__(self, layout: Layout, frame: Frame):
        self._frame, self._layout = frame, layout
        self._roles = [field.role for field in frame.fields]
        self._columns = [AXES.index(role) if role in AXES else -1 for role in self._roles]
        self._taken = [j for j, column in enumerate(self._columns) if column >= 0]
        self._axes = [column for column in self._columns if column >= 0]
        self._others = [(j, role) for j, role in enumerate(self._roles) if role not in AXES]
        self._whole = np.array([field.bits > 0 for field in frame.fields])
        self._at = np.array([field.at for field in frame.fields])
        self._sizes = np.array([int(field.type[1:]) // 8 for field in frame.fields])
        self._big = np.array([frame.orders[role] == "big" for role in self._roles])
        scales: list[tuple[float, ...]] = []
        for field in frame.fields:
            scale = layout.scale(field.role)
            low, high = -(2.0 ** (field.bits - 1)), 2.0 ** (field.bits - 1) - 1
            if field.type[0] == "u":
                low, high = 0.0, 2.0**field.bits - 1
            if field.bits == 64:
                # What a signed integer holds; no device has counted further.
                high = float(np.nextafter(2.0**63, 0))
            scales.append((scale.size, scale.zero, field.sign, scale.full_scale, low, high))
        self._scales = np.array(scales)
        self._blank = np.zeros(frame.length, np.uint8)
        for offset, value in frame.constants:
            self._blank[offset] = value
        self._time = layout.wraps["time"] * layout.time.size

    def packets(self, given: Mapping[str, Any], readings: Array) -> list[bytes]:
        n, length = len(readings), self._frame.length
        values = np.empty((n, len(self._roles)))
        values[:, self._taken] = readings[:, self._axes]
        for j, role in self._others:
            values[:, j] = given[role]
            if role == "time" and self._time:
                values[:, j] %= self._time
        rows = np.empty((n, length), np.uint8)
        rows[:] = self._blank
        _fill(values, self._scales, self._whole, self._at, self._sizes, self._big, rows)
        for check in self._frame.checks:
            starts = np.arange(n) * length
            value = check.kind.of_spans(rows.reshape(-1), starts + check.start, starts + check.at)
            size = check.kind.bits // 8
            for k in range(size):
                place = size - 1 - k if check.order == "big" else k
                rows[:, check.at + place] = value >> np.uint32(8 * k) & np.uint32(0xFF)
        data = rows.tobytes()
        return [data[i : i + length] for i in range(0, n * length, length)]
