"""Makes the same bytes as `inercal.host.packets.encode`, but faster for a few readings.

The fields of the layout are only looked up once, and a compiled loop writes the numbers. For lines
of text, `encode` is used.
"""
# Numba's decorator is not typed.
# pyright: reportUntypedFunctionDecorator=false

from math import isnan, nan

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array, Bools, Indices
from inercal.estimation.kernel_options import njit
from inercal.host.packets import PacketLayout, encode
from inercal.host.packets.packet_format import AXES, ROLES, BinaryFrame

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
