"""Links, chambers and instruments of other packages, by the scheme of their address."""

from time import monotonic
from typing import Any, Self

import pytest
from tests.refusals import refused

from inercal.host.addresses import allows_second_connection, open_imu, open_table, table_places
from inercal.host.drivers.motor import Motor
from inercal.host.equipment import (
    CHAMBERS,
    INSTRUMENTS,
    ChamberState,
    Reading,
    open_chamber,
    open_instrument,
)
from inercal.host.link import LINKS, open_link
from inercal.host.packets import encode, read_layout
from inercal.host.sim.motor import SimulatedMotor


class Oven:
    """A chamber that is at once as warm as commanded."""

    def __init__(self, address: str, timeout: float):
        self.address, self.timeout, self._temperature = address, timeout, 293.0

    def set_temperature(self, temperature: float) -> None:
        self._temperature = temperature

    def read(self) -> Any:
        return ChamberState(self._temperature, door_open=False)

    def stop(self) -> None:
        self._temperature = 293.0

    def close(self) -> None:
        pass

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass


class Thermometer(Oven):
    def identity(self) -> str:
        return "PT 100"

    def read(self) -> Reading:
        return Reading(self._temperature - 273.0, "°C")


def test_a_chamber_and_an_instrument_are_opened_by_their_scheme():
    with CHAMBERS.with_("oven", Oven), open_chamber("oven:serial:/dev/ttyS0", 0.5) as oven:
        oven.set_temperature(350.0)
        assert oven.read() == ChamberState(350.0, False, ())
        oven.stop()
        assert oven.read().temperature == 293.0
    with INSTRUMENTS.with_("pt", Thermometer), open_instrument("PT://h:1") as thermometer:
        assert thermometer.read() == (20.0, "°C")


def test_an_unknown_scheme_is_refused():
    with refused(names=("oven://h:1",)):
        open_chamber("oven://h:1")
    with refused(names=("dmm",)):
        open_instrument("dmm")


def test_an_imu_and_a_table_use_the_link_of_another_package(scripted: Any):
    asked: list[tuple[str, float]] = []
    layout = read_layout("fixed")
    packet = encode(layout, [[0.0, 0.0, 9.8, 0.0, 0.0, 0.0]], temperature=[300.0])

    def opener(address: str, timeout: float) -> Any:
        asked.append((address, timeout))
        return scripted(SimulatedMotor().session().feed)

    with LINKS.with_("relay", opener):
        with open_imu("relay:7?preset=fixed&slot=2", monotonic, 0.5, synchronous=True) as port:
            port._link._waiting = packet  # pyright: ignore[reportPrivateUsage, reportAttributeAccessIssue]
            assert port.take() == [(pytest.approx(monotonic(), abs=60), packet)]
        with open_table("motor:relay:7?slot=1", None) as table:
            assert isinstance(table, Motor)
            assert table.read().axes[0].rate == 0.0
        # Nothing is known about this link, so only one program opens it.
        assert not allows_second_connection("motor:relay:7?slot=1")
        assert table_places("motor:relay:7?slot=1") == ("relay:7",)
    assert [address for address, _ in asked] == ["relay:7?slot=2", "relay:7?slot=1"]
    with refused():
        open_link("relay:7")
