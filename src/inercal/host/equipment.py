"""Chambers and instruments by address; packages register them by entry points.

An entry point in `inercal.chambers` or `inercal.instruments` has the scheme of the addresses as its
name, and is a function of the whole address and of the longest time to wait for a reply, s. Like
`inercal.host.link.open_link`, it raises an `InputError` for a malformed address and a `LinkLost` if
no device answers. The functions of a device also raise `ProtocolError` for a reply that is not
understood.

`ChamberPort` connects a run to a chamber in such a way that the chamber never delays the run.
"""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from math import nan
from typing import NamedTuple, Protocol

from inercal.basics.closeable import Closeable
from inercal.basics.errors import InercalError, InputError
from inercal.basics.registry import Registry
from inercal.host.link import DeviceConnection


class Reading(NamedTuple):
    """A value and its unit, as the instrument states it: "°C", "V"; "1" for a plain number."""

    value: float
    unit: str


class Instrument(DeviceConnection, Protocol):
    """An instrument that measures one quantity; a reading after a lost connection reconnects."""

    def identity(self) -> str:
        """Return one line that names the instrument; empty if it does not say what it is."""
        ...

    def read(self) -> Reading:
        """Return a reading that was taken after this call; an overload is an `InputError`."""
        ...


@dataclass(frozen=True)
class ChamberState:
    """The state of a chamber in one reading.

    Parameters
    ----------
    temperature : float
        Measured temperature of the air, K; NaN if its sensor has failed, which is then an alarm.
    door_open : bool or None
        None if the chamber does not report it.
    alarms : tuple of str
        Active alarms, as texts; empty if there are none.
    """

    temperature: float
    door_open: bool | None = None
    alarms: tuple[str, ...] = ()


class Chamber(DeviceConnection, Protocol):
    """A temperature chamber; `close` leaves it as it is, so `stop` it first."""

    def set_temperature(self, temperature: float) -> None:
        """Go to a temperature, K; one that the chamber cannot reach is an `InputError`."""
        ...

    def read(self) -> ChamberState:
        """Return the present state."""
        ...

    def stop(self) -> None:
        """End heating and cooling."""
        ...


CHAMBERS: Registry[Callable[[str, float], Chamber]] = Registry(
    "inercal.chambers",
    "chamber",
    {
        "scpi-chamber": "inercal.host.drivers.scpi_chamber:open_scpi_chamber",
        "watlow-f4t": "inercal.host.drivers.watlow_f4t:open_watlow_f4t",
        "sim": "inercal.host.sim.chamber:open_simulated",
    },
    Callable,
)
INSTRUMENTS: Registry[Callable[[str, float], Instrument]] = Registry(
    "inercal.instruments",
    "instrument",
    {"visa": "inercal.host.drivers.visa:VisaInstrument"},
    Callable,
)


def open_chamber(address: str, timeout: float = 1.0) -> Chamber:
    """Open the chamber at an address; a reply may take `timeout` s."""
    return CHAMBERS.for_address(address)(address, timeout)


def open_instrument(address: str, timeout: float = 1.0) -> Instrument:
    """Open the instrument at an address; a reply may take `timeout` s."""
    return INSTRUMENTS.for_address(address)(address, timeout)


# Longest time without a reading, s. A simulated chamber answers at once. A real one may repeat a
# request, and is no reason to interrupt a step.
_SIMULATED_SILENCE, _SILENCE = 0.8, 5.0


class ChamberPort(Closeable):
    """The connection to a chamber; a lost connection is opened again at the next exchange.

    Parameters
    ----------
    opener : callable
        Function that connects to the chamber.
    synchronous : bool
        Whether `exchange` waits for the reply. If not, a thread waits, so that a slow chamber does
        not delay the run.

    Attributes
    ----------
    target : float or None
        Set temperature, K; None stops the chamber. The next exchange sends it.
    silence : float
        Longest time without a reading, s.

    Raises
    ------
    LinkLost
        No chamber answers.
    """

    def __init__(self, opener: Callable[[], Chamber], *, synchronous: bool):
        self.target: float | None = None
        self.silence = _SIMULATED_SILENCE if synchronous else _SILENCE
        self._open = opener
        self._chamber: Chamber | None = opener()
        self._sent: float | None = nan  # target that the chamber knows; NaN if it is unknown
        self._thread = None if synchronous else ThreadPoolExecutor(1, "chamber")
        self._job: Future[ChamberState] | None = None

    @property
    def is_stopped(self) -> bool:
        """Whether the chamber was stopped and has received no target since then."""
        return self._sent is None

    def exchange(self) -> ChamberState | None:
        """Send a new target and return a reading; None if the reading has not arrived yet.

        Raises
        ------
        InputError
            The chamber cannot reach the target.
        LinkLost, ProtocolError
            The chamber does not answer, or its reply is not understood.
        """
        if self._thread is None:
            return self._talk()
        if self._job is None:
            self._job = self._thread.submit(self._talk)
        if not self._job.done():
            return None
        job, self._job = self._job, None
        return job.result()

    def stop(self) -> None:
        """Stop the chamber and wait for the reply; raises the errors of `exchange`."""
        if self._thread is not None:
            self._thread.shutdown()
        self.target = None
        if self._sent is not None:
            self._talk()

    def close(self) -> None:
        """Close the connection."""
        if self._thread is not None:
            self._thread.shutdown()
        if self._chamber is not None:
            self._chamber.close()

    def _talk(self) -> ChamberState:
        chamber, target = self._chamber, self.target
        if chamber is None:
            self._chamber = chamber = self._open()
            self._sent = nan
        try:
            if target != self._sent:
                chamber.stop() if target is None else chamber.set_temperature(target)
                self._sent = target
            return chamber.read()
        except InputError:
            raise
        except InercalError:
            self._chamber = None
            chamber.close()
            raise
