"""The address of a table, from which a driver takes its parameters one by one.

The drivers of tables by the scheme of their addresses; other packages add theirs.

A package registers a driver with an entry point, whose name is the scheme of the addresses::

    [project.entry-points."inercal.tables"]
    spindle = "spindle:DRIVER"

Both forms of an address open this driver: `spindle://HOST:PORT?…` and, over any link,
`spindle:serial:/dev/ttyUSB0?…`.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl, urlencode, urlsplit

from inercal.basics.errors import InputError
from inercal.basics.registry import Registry
from inercal.host.drivers.rotary_table import RotaryTable
from inercal.host.link import LINKS, host_and_port

if TYPE_CHECKING:
    from inercal.benches.motion_control import ControlledBench


def address_parameters(address: str) -> dict[str, str]:
    """Return the parameters after the `?` of an address, each of which may occur once."""
    pairs = parse_qsl(urlsplit(address).query, keep_blank_values=True)
    if len(dict(pairs)) < len(pairs):
        raise InputError(f"{address!r} gives a parameter twice; give each parameter once")
    return dict(pairs)


def with_parameters(address: str, parameters: dict[str, str]) -> str:
    """Return an address with these parameters instead of its own."""
    query = f"?{urlencode(parameters, safe='/')}" if parameters else ""
    return address.partition("?")[0] + query


class TableAddress:
    """The address of a table; each parameter is removed when it is taken.

    Every method raises an `InputError` that says what the address must contain.

    Parameters
    ----------
    text : str
        The whole address, such as "pmac://10.0.0.5?motors=1,2,3&counts=3600000".
    example : str
        A possible address, for messages.
    port : int or None
        TCP port of an address that states none.
    """

    def __init__(self, text: str, example: str, port: int | None = None):
        self.text, self._example, self._port = text, example, port
        self._left = address_parameters(text)

    def __str__(self) -> str:
        return self.text

    def take(self, key: str, example: str, default: str | None = None) -> str:
        """Return the text of a parameter, or `default`; without one, the error shows `example`."""
        if key not in self._left:
            if default is not None:
                return default
            raise InputError(f"{self.text!r} has no parameter {key}; add it, such as {example}")
        return self._left.pop(key)

    def number(self, key: str, most: int, default: int | None = None) -> int:
        """Return the whole number in a parameter, 1 to `most`, or `default`."""
        text = self.take(key, f"{key}=1", "" if default is None else str(default))
        if text == str(default):
            return int(text)
        if not (re.fullmatch("[1-9][0-9]{0,3}", text) and int(text) <= most):
            raise InputError(f"{key}={text!r} in {self.text!r}; possible: 1 to {most}", key=key)
        return int(text)

    def axis_numbers(self, key: str, most: int) -> list[int]:
        """Return the axis numbers in a parameter: 1 to `most`, and each at most once."""
        text = self.take(key, f"{key}=1,2,3")
        parts = text.split(",")
        if not all(re.fullmatch(r"[0-9]{1,2}", part) for part in parts):
            raise InputError(f"{key}={text!r} in {self.text!r}; give numbers as {key}=1,2,3")
        numbers = [int(part) for part in parts]
        if len(set(numbers)) < len(numbers) or not all(1 <= n <= most for n in numbers):
            raise InputError(f"{key}={text!r} in {self.text!r}; possible: 1 to {most}, each once")
        return numbers

    def counts(self, axes: int) -> list[float]:
        """Return the counts per turn of each axis."""
        text = self.take("counts", "counts=3600000")
        try:
            values = [float(part) for part in text.split(",")]
        except ValueError:
            values = []
        if len(values) not in (1, axes) or not all(isfinite(v) and v for v in values):
            raise InputError(
                f"counts={text!r} in {self.text!r}; give the counts per turn, not 0: one "
                f"number for all axes, or {axes} numbers"
            )
        return values if len(values) == axes else values * axes

    def axis_names(
        self, key: str, numbers: Sequence[int], bench: "ControlledBench | None"
    ) -> tuple[str, ...]:
        """Return the names of the axes from the bench, or else their numbers.

        `key` is the word for the axes of the controller, such as "motors".
        """
        if bench is None:
            return tuple(str(n) for n in numbers)
        if len(bench.names) != len(numbers):
            raise InputError(
                f"{self.text!r} gives {len(numbers)} {key}, but the bench has the axes "
                f"{', '.join(bench.names)}; give one for each axis"
            )
        return bench.names

    def tcp(self) -> str:
        """Return the address of a TCP link to host and port; no parameters may remain.

        Both `scheme://HOST:PORT` and `scheme:tcp://HOST:PORT` are possible.
        """
        if self._left:
            raise InputError(
                f"unknown parameter {next(iter(self._left))!r} in {self.text!r}; "
                f"possible: {self._example}"
            )
        at = self.text.partition(":")[2]
        parts = urlsplit(at if at.lower().startswith("tcp:") else self.text)
        place = host_and_port(parts, self._port)
        if place is None or parts.path not in ("", "/") or parts.username:
            raise InputError(f"{self.text!r} has no valid host and port; possible: {self._example}")
        host, port = place
        host = f"[{host}]" if ":" in host else host
        return f"tcp://{host}:{port}"

    def link(self) -> str:
        """Return the address of the link, over TCP or as stated; remaining parameters are its own.

        The link is stated after the scheme of the driver: `motor:serial:/dev/ttyUSB0?baud=9600`.
        """
        scheme, _, at = self.text.partition(":")
        if at.startswith("//"):
            return self.tcp()
        if at.partition(":")[0].lower() not in LINKS:
            raise InputError(
                f"{self.text!r} has no link after '{scheme}:'; possible: {self._example} or "
                f"{scheme}:tcp://HOST:PORT"
            )
        return with_parameters(at, self._left)


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
