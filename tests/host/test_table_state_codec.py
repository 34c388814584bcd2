"""The state of a table as bytes of the log."""

from math import inf, nan
from struct import Struct

import numpy as np
import pytest
from tests.refusals import refused

from inercal.host.drivers.rotary_table import AxisState, TableState, pack_state, unpack_states

STATE = TableState(
    12.5,
    (
        AxisState(0.1, -0.2, 1e-6, True, False, True, True),
        AxisState(1e9, inf, nan, False, True, True, False, ("amplifier fault", "and more")),
    ),
    3e-4,
)


def unpack(payload: bytes) -> TableState:
    """Read the bytes as the module describes them; of faults only that there are some."""
    time, span = Struct("<dd").unpack_from(payload)
    axes: list[AxisState] = []
    for angle, rate, error, flags in Struct("<dddB").iter_unpack(payload[16:]):
        in_position, moving, enabled, homed, fault = (bool(flags >> bit & 1) for bit in range(5))
        faults = ("a fault",) if fault else ()
        axes.append(AxisState(angle, rate, error, in_position, moving, enabled, homed, faults))
    return TableState(time, tuple(axes), span)


def test_a_state_comes_back_to_the_last_bit_with_its_faults_as_a_flag():
    back = unpack(pack_state(STATE))
    assert (back.time, back.span) == (12.5, 3e-4)
    assert back.axes[0] == STATE.axes[0]
    one = back.axes[1]
    assert (one.angle, one.rate) == (1e9, inf)
    assert np.isnan(one.following_error)
    assert (one.in_position, one.moving, one.enabled, one.homed) == (False, True, True, False)
    assert one.faults
    assert len(pack_state(STATE)) == 16 + 2 * 25


def test_many_states_are_what_each_of_them_is():
    rng = np.random.default_rng(0)
    states = [
        TableState(
            k,
            tuple(
                AxisState(*rng.standard_normal(3).tolist(), *(rng.random(4) < 0.5).tolist())
                for _ in range(3)
            ),
        )
        for k in range(50)
    ]
    many = unpack_states([pack_state(one) for one in states])
    assert many.time.tolist() == list(range(50))
    for k, one in enumerate(states):
        assert many.angle[k].tolist() == [axis.angle for axis in one.axes]
        assert many.rate[k].tolist() == [axis.rate for axis in one.axes]
        assert many.following_error[k].tolist() == [axis.following_error for axis in one.axes]
        assert many.settled[k] == all(axis.settled for axis in one.axes)


@pytest.mark.parametrize("length", [0, 15, 16, 40, 42])
def test_what_is_no_state_is_refused(length: int):
    with refused(key="payload"):
        unpack_states([b"\0" * length])


def test_states_of_two_tables_do_not_go_together():
    one = TableState(0.0, STATE.axes[:1])
    with refused(key="payloads"):
        unpack_states([pack_state(STATE), pack_state(one)])
