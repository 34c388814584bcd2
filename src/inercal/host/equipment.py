"""Chambers and instruments by address; packages register them by entry points.

An entry point in `inercal.chambers` or `inercal.instruments` has the scheme of the addresses as its
name, and is a function of the whole address and of the longest time to wait for a reply, s. Like
`inercal.host.link.open_link`, it raises an `InputError` for a malformed address and a `LinkLost` if
no device answers. The functions of a device also raise `ProtocolError` for a reply that is not
understood.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self

from inercal.basics.registry import Registry


class Reading(NamedTuple):
    """A value and its unit, as the instrument states it: "°C", "V"; "1" for a plain number."""

    value: float
    unit: str


class Instrument(Protocol):
    """An instrument that measures one quantity."""

    def read(self) -> Reading:
        """Return a reading that was taken after this call; an overload is an `InputError`."""
        ...

    def close(self) -> None:
        """Close the connection; a second call does nothing."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...


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


class Chamber(Protocol):
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

    def close(self) -> None:
        """Close the connection; a second call does nothing."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...


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
    "inercal.instruments", "instrument", {}, Callable
)


def open_chamber(address: str, timeout: float = 1.0) -> Chamber:
    """Open the chamber at an address; a reply may take `timeout` s."""
    return CHAMBERS.for_address(address)(address, timeout)


def open_instrument(address: str, timeout: float = 1.0) -> Instrument:
    """Open the instrument at an address; a reply may take `timeout` s."""
    return INSTRUMENTS.for_address(address)(address, timeout)
