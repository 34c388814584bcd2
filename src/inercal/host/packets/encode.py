"""Converts readings to the bytes that a device would send, for the simulator."""

from string import Formatter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inercal.basics.errors import InputError
from inercal.host.packets.layout import PacketLayout
from inercal.host.packets.packet_format import AXES, BinaryFrame, Field, TextLine

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
