"""A table that is homed anew in the middle of a run: what it says meanwhile is not an angle."""

import numpy as np
import pytest

from inercal.basics.units import Measured
from inercal.benches.turntable import Turntable
from inercal.host.assembly.table_polls import TablePolls
from inercal.host.drivers.rotary_table import AxisState, TableState, pack_state, unpack_states
from inercal.host.run_log import TABLE, LogFrame

POLL = 0.02  # s


def said(time: float, angle: float, *, homed: bool) -> LogFrame:
    axis = AxisState(angle, 0.0, 0.0, in_position=True, moving=False, enabled=True, homed=homed)
    return LogFrame(TABLE, time, pack_state(TableState(time, (axis,))))


def test_a_state_tells_whether_all_axes_are_homed():
    frames = [said(k * POLL, 0.0, homed=k > 1) for k in range(4)]
    assert unpack_states([one.payload for one in frames]).homed.tolist() == [
        False,
        False,
        True,
        True,
    ]


@pytest.mark.parametrize("found", [0.0, 0.3])
def test_while_the_zero_is_sought_no_angle_is_known_wherever_it_is_found(found: float):
    def homed(time: float) -> bool:
        return not 8.0 <= time < 10.0

    table = TablePolls(POLL, Turntable(Measured(9.8, 0.0), 0.0, axes="z"))
    times = np.arange(0.0, 12.0, POLL)
    table.feed([said(t, found if t >= 10 else 0.0, homed=homed(t)) for t in times.tolist()])
    asked = np.arange(0.0, 11.9, 0.005)
    angles, _, there = table.readback(asked)
    at_rest = (asked < 7.9) | (asked > 10.1)
    assert there[at_rest].all()
    assert not there[(asked > 8.0) & (asked < 10.0)].any()
    np.testing.assert_allclose(angles[there, 0], np.where(asked[there] > 9, found, 0.0), atol=1e-12)
