"""Converts the state of a table to the payload of a log frame, and back.

The payload is little-endian. It contains time and span as float64, and then for each axis: angle,
rate and following error as float64, and one byte of flags. One flag means that the axis has a
fault; an event in the journal names the fault.
"""

from collections.abc import Sequence
from functools import cache
from struct import Struct
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import InputError
from inercal.host.drivers.rotary_table import TableState

_HEAD = Struct("<dd")
_AXIS = Struct("<dddB")
_FLAGS = _IN_POSITION, _MOVING, _ENABLED, _HOMED, _FAULT = 1, 2, 4, 8, 16


class StateArrays(NamedTuple):
    """A series of table states in s, rad and rad/s."""

    time: Array  # (n,) by the clock of the table's controller
    span: Array  # (n,)
    angle: Array  # (n, k)
    rate: Array  # (n, k)
    following_error: Array  # (n, k)
    settled: Bools  # (n,), all axes
    homed: Bools  # (n,), all axes


def pack_state(state: TableState) -> bytes:
    """Convert a state to the payload of a log frame."""
    parts = [_HEAD.pack(state.time, state.span)]
    for a in state.axes:
        states = (a.in_position, a.moving, a.enabled, a.homed, bool(a.faults))
        flags = sum(flag for flag, on in zip(_FLAGS, states, strict=True) if on)
        parts.append(_AXIS.pack(a.angle, a.rate, a.following_error, flags))
    return b"".join(parts)


def unpack_states(payloads: Sequence[bytes]) -> StateArrays:
    """Convert several payloads to arrays of states.

    Parameters
    ----------
    payloads : sequence of bytes
        One or more payloads.

    Raises
    ------
    InputError
        The length of a payload does not match a state or differs from the length of the first.
    """
    k = _axis_count(payloads[0])
    if any(len(one) != len(payloads[0]) for one in payloads):
        raise InputError(
            "the log contains states of tables with different numbers of axes; read each run's log "
            "separately",
            key="payloads",
        )
    rows = np.frombuffer(b"".join(payloads), _record_dtype(k))
    of = rows["axes"]
    settled = (of["flags"] & (_IN_POSITION | _MOVING) == _IN_POSITION).all(axis=-1)
    homed = (of["flags"] & _HOMED != 0).all(axis=-1)
    return StateArrays(
        rows["time"], rows["span"], of["angle"], of["rate"], of["error"], settled, homed
    )


@cache
def _record_dtype(k: int) -> np.dtype[Any]:
    axis = np.dtype([("angle", "<f8"), ("rate", "<f8"), ("error", "<f8"), ("flags", "u1")])
    return np.dtype([("time", "<f8"), ("span", "<f8"), ("axes", axis, (k,))])


def _axis_count(payload: bytes) -> int:
    """Return the number of axes in a payload."""
    k, rest = divmod(len(payload) - _HEAD.size, _AXIS.size)
    if k < 1 or rest:
        raise InputError(
            f"the log has a table state of {len(payload)} bytes; a state has {_HEAD.size} bytes "
            f"and {_AXIS.size} more per axis: the log is of another version",
            key="payload",
        )
    return k
