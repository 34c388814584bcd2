"""Do what all checks of a driver need: open the device, wait, and expect an error."""

import re
from collections.abc import Callable
from contextlib import suppress
from math import degrees
from time import monotonic
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from inercal.basics.closeable import on_failure
from inercal.host.addresses import open_table
from inercal.host.driver_check.relay import Relay
from inercal.host.drivers.rotary_table import ProtocolError, RotaryTable, TableFault, TableState
from inercal.host.equipment import Chamber
from inercal.host.link import LinkLost

if TYPE_CHECKING:
    from inercal.benches.motion_control import ControlledBench

GRACE = 3.0  # s, in addition to the time of a motion
_DETECTION_TIME = 1.0  # s, in addition to twice the timeout, as a driver may connect again
_ATTEMPTS = 3  # readings after an error, of which one must work


class CheckFailed(Exception):
    """A driver does not do what a check expects; `str(error)` says what it did instead."""


def require(condition: bool, otherwise: str) -> None:
    """Raise a `CheckFailed` if a condition is not true."""
    if not condition:
        raise CheckFailed(otherwise)


D = TypeVar("D", RotaryTable, Chamber)


class LinkProbe(Generic[D]):
    """A driver whose link to the simulator the checks can break.

    `opener` opens the device at an address. For the other arguments, see `check_driver`.
    """

    def __init__(
        self,
        address: str,
        timeout: float,
        now: Callable[[], float],
        relay: Relay,
        opener: Callable[[str, float], D],
    ):
        self.timeout, self.now, self.relay, self._opener = timeout, now, relay, opener
        self._address = re.sub(r"//[^/?#]*", f"//127.0.0.1:{relay.port}", address, count=1)

    def open(self) -> D:
        """Open the device through the relay."""
        return self._opener(self._address, self.timeout)

    def bring_to_rest(self) -> None:
        """Mend the link, and stop the device, as far as the driver can."""
        raise NotImplementedError

    def expect_error(self, act: Callable[[], object], what: str) -> float:
        """Return the wall time in which a call raised a documented error, s."""
        begun = monotonic()
        try:
            act()
        except (LinkLost, ProtocolError, TableFault):
            took = monotonic() - begun
            limit = 2 * self.timeout + _DETECTION_TIME
            require(took < limit, f"{what}: the error came only after {took:.2f} s")
            return took
        raise CheckFailed(f"{what}: no error was raised")

    def read_again(self, device: D, after: str) -> Any:
        """Return a reading after an error; the first ones may fail."""
        for left in reversed(range(_ATTEMPTS)):
            try:
                return device.read()
            except (LinkLost, ProtocolError, TableFault) as error:
                require(left > 0, f"{after}: {_ATTEMPTS} readings failed: {error}")
        raise AssertionError


class Probe(LinkProbe[RotaryTable]):
    """A driver of a table; `bench` names its axes."""

    def __init__(
        self,
        address: str,
        bench: "ControlledBench | None",
        timeout: float,
        now: Callable[[], float],
        relay: Relay,
    ):
        self.bench = bench
        super().__init__(address, timeout, now, relay, lambda at, s: open_table(at, bench, s))

    def open_enabled(self) -> RotaryTable:
        """Open the table, and switch on its servos."""
        table = self.open()
        with on_failure(table.close):
            table.enable()
            self.wait(table, lambda now: all(a.enabled for a in now.axes), 0.0, "is not enabled")
        return table

    def wait(
        self, table: RotaryTable, done: Callable[[TableState], bool], seconds: float, otherwise: str
    ) -> TableState:
        """Read the table until `done`; it may take `seconds` and `GRACE` longer."""
        end = self.now() + seconds + GRACE
        while True:
            late = self.now() > end
            state = table.read()
            if done(state):
                return state
            if late:
                at = ", ".join(f"{degrees(a.angle):.3f}° ({a.status_text})" for a in state.axes)
                raise CheckFailed(f"the table {otherwise} within {seconds + GRACE:.1f} s: {at}")

    def bring_to_rest(self) -> None:
        """See `LinkProbe.bring_to_rest`."""
        self.relay.mend()
        # The check of `stop` reports what fails here.
        with suppress(Exception), self.open() as table:
            table.stop()
            self.wait(table, lambda state: all(a.rests for a in state.axes), 0.0, "turns")
