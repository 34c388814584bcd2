"""Fixtures of the bench host: simulated tables at the end of real connections, at granted time."""

from collections.abc import Callable, Iterator
from typing import Any
from unittest.mock import patch

import pytest

from inercal.host.drivers.pmac import Pmac, PmacAxis
from inercal.host.link import LinkLost
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.server import SimulatorServer

COUNTS = 3_600_000
AXES = tuple(PmacAxis(name, i, COUNTS) for i, name in enumerate(("outer", "middle", "inner"), 1))


@pytest.fixture
def pmac() -> Iterator[SimulatorServer[SimulatedPmac]]:
    with SimulatorServer(SimulatedPmac(counts_per_turn=COUNTS)) as server:
        yield server


@pytest.fixture
def table(pmac: SimulatorServer[SimulatedPmac]) -> Iterator[Pmac]:
    with Pmac(pmac.address, AXES, timeout=5.0) as table:
        table.enable()
        yield table


def opened_by(opener: Callable[[str], Any]) -> Any:
    """Return a context manager in which devices are opened by a function of their address."""
    return patch("inercal.host.link.open_link", opener)


class ScriptedLink:
    """A link whose other end is a function of what is written; it hands on `size` bytes a time."""

    def __init__(self, answer: Callable[[bytes], bytes], size: int = 1 << 16):
        self.address = "tcp://scripted:1025"
        self.written: list[bytes] = []
        self._answer, self._size, self._waiting, self._closed = answer, size, b"", False

    def write(self, data: bytes) -> None:
        if self._closed:
            raise LinkLost("closed")
        self.written.append(data)
        self._waiting += self._answer(data)

    def read(self, most: int, timeout: float) -> bytes:
        size = min(most, self._size)
        data, self._waiting = self._waiting[:size], self._waiting[size:]
        return data

    def close(self) -> None:
        self._closed = True

    def __enter__(self) -> "ScriptedLink":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@pytest.fixture
def scripted() -> type[ScriptedLink]:
    return ScriptedLink
