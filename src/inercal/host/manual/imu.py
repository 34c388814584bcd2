"""The IMU during manual operation: shows its readings, and uses its gyros as an interlock."""

import json
from collections.abc import Callable
from functools import partial
from math import inf, isfinite

from inercal.basics.closeable import Closeable
from inercal.host.addresses import layout_of_address, open_imu
from inercal.host.assembly import SampleAssembler
from inercal.host.clock import Tick
from inercal.host.drivers.rotary_table import TableState, pack_state
from inercal.host.imu_port import ImuReceiver
from inercal.host.interlocks import Interlocks
from inercal.host.run_log import EVENT, IMU, TABLE, LogFrame
from inercal.runfile import Run

_WORK_INTERVAL = 0.2  # s between two comparisons of gyros and table


class ManualImu(Closeable):
    """An IMU on the table; its readings are shown but not recorded.

    Parameters
    ----------
    address : str
    run : Run
        Run that states the sensor and the bench.
    interlocks : Interlocks
        Interlocks that check the gyros.
    now : callable
        Function that returns the session time, s.
    tick : Tick
        Tick of the bench at which the port is opened.
    wraps : float
        Time after which the table's clock wraps around, s.

    Attributes
    ----------
    receiver : ImuReceiver
        Receives the bytes, and reports problems with the port.
    assembly : SampleAssembler
        Converts the received data to samples.

    Raises
    ------
    InputError
        The packets do not match the sensor.
    LinkLost
        The IMU does not answer.
    """

    def __init__(
        self,
        address: str,
        run: Run,
        interlocks: Interlocks,
        now: Callable[[], float],
        tick: Tick,
        wraps: float = inf,
    ):
        self._wraps = wraps
        self._new_assembly = partial(SampleAssembler, run, layout_of_address(address))
        self.assembly = self._new_assembly()
        self._interlocks = interlocks
        self._work_time = tick.time
        self.receiver = ImuReceiver(
            lambda timeout: open_imu(
                address, now, timeout, synchronous=tick.bytes_sent is not None
            ),
            tick,
        )
        self._begin(tick.time)

    def take(self, tick: Tick) -> None:
        """Take the bytes that arrived before a tick."""
        heard = self.receiver.take(tick)
        if heard.reopened:
            self._begin(tick.time)
        for time, data in heard.pieces:
            self.assembly.feed(LogFrame(IMU, time, data))

    def take_table(self, time: float, state: TableState) -> None:
        """Take a reading of the table at a session time, s."""
        self.assembly.feed(LogFrame(TABLE, time, pack_state(state)))

    def check_gyros(self, time: float) -> str | None:
        """Describe how the gyros' rates differ from the readback; None if they agree.

        Raises
        ------
        InputError
            The table has reset its clock.
        """
        if time - self._work_time < _WORK_INTERVAL:
            return None
        self._work_time = time
        block = self.assembly.take()
        if self.assembly.imu.mismatch is not None:
            # The IMU may have been switched off and on. Here, its clock may be related again.
            self.assembly = self._new_assembly()
            self._begin(time)
        return (
            None if block is None else self._interlocks.check_gyros(block.track.with_known_angles)
        )

    def close(self) -> None:
        """Close the port."""
        self.receiver.close()

    def _begin(self, time: float) -> None:
        """Begin a new comparison, which does not continue the earlier data."""
        known = {"wraps": self._wraps} if isfinite(self._wraps) else {}
        session = {"what": "session", "next": 0, **known}
        # One section without an end is used, because samples outside sections are omitted.
        section = {"what": "section", "number": 0, "label": "", "state": "begun", "hold": False}
        for event in (session, section | {"time": -1e9}):
            self.assembly.feed(LogFrame(EVENT, time, json.dumps(event).encode()))
