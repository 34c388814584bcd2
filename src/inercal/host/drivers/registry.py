"""The drivers of tables by the scheme of their addresses; other packages add theirs.

A package registers a driver with an entry point, whose name is the scheme of the addresses::

    [project.entry-points."inercal.tables"]
    spindle = "spindle:DRIVER"

Both forms of an address open this driver: `spindle://HOST:PORT?…` and, over any link,
`spindle:serial:/dev/ttyUSB0?…`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from inercal.basics.registry import Registry
from inercal.host.drivers.rotary_table import RotaryTable
from inercal.host.drivers.table_address import TableAddress

if TYPE_CHECKING:  # the guard opens a table and must start quickly
    from inercal.benches.motion_control import ControlledBench


@dataclass(frozen=True)
class Driver:
    """A driver of tables, as a package registers it.

    Parameters
    ----------
    open : callable
        Function that connects to the table at an address and returns it. Its other arguments are
        the bench, which names the axes and states their limits, or None, and the longest time to
        wait for a reply, s. It raises the errors of `inercal.host.addresses.open_table`.
    example : str
        An address with all parameters that are needed, for messages.
    port : int or None
        TCP port of an address that states none; None if it must be stated.
    shared : bool
        Whether the controller serves several connections at once. If not, the watchdog only
        connects when it must stop the table.
    """

    open: "Callable[[TableAddress, ControlledBench | None, float], RotaryTable]"
    example: str
    port: int | None = None
    shared: bool = True


DRIVERS: Registry[Driver] = Registry(
    "inercal.tables",
    "table",
    {name: f"inercal.host.drivers.{name}:DRIVER" for name in ("pmac", "acutrol", "motor")},
    Driver,
)
