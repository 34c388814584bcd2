"""The check of a chamber's driver: the drivers pass, and each planted fault is found."""

from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from math import isfinite
from typing import Any, NamedTuple

import pytest
from tests.base_seeds import evidence
from tests.host.chamber.simulated_f4t import SimulatedF4t
from tests.refusals import refused

from inercal.host.driver_check import CHAMBER_CHECKS, CheckResult, check_driver
from inercal.host.drivers.scpi_chamber import ScpiChamber, open_scpi_chamber
from inercal.host.equipment import CHAMBERS, ChamberState
from inercal.host.link import LinkLost, open_link
from inercal.host.sim.chamber import SimulatedScpiChamber
from inercal.host.sim.server import SimulatorServer, SteppingClock

TIMEOUT = 0.4  # s; a busy machine keeps a reply waiting


class Chosen(ScpiChamber):
    """The SCPI driver as it is, of which a subclass makes one mistake."""

    @classmethod
    def open(cls, address: str, timeout: float) -> ScpiChamber:
        opened = open_scpi_chamber(address.replace("own:", "scpi-chamber:"), timeout)
        opened.__class__ = cls
        return opened


class InCelsius(Chosen):
    def read(self) -> ChamberState:
        state = super().read()
        return ChamberState(state.temperature - 273.15, state.door_open, state.alarms)


class NoLimits(Chosen):
    def set_temperature(self, temperature: float) -> None:
        if isfinite(temperature):
            self.low, self.high = 0.0, 1e9
        super().set_temperature(temperature)


class InKelvin(Chosen):
    def set_temperature(self, temperature: float) -> None:
        super().set_temperature(temperature)
        with suppress(Exception):
            super().set_temperature(temperature + 5.0)


class NeverStops(Chosen):
    def stop(self) -> None:
        self.read()


class StopsOnlyWithReplies(Chosen):
    def stop(self) -> None:
        self.read()
        super().stop()


class RemembersReadings(Chosen):
    def read(self) -> ChamberState:
        try:
            self.last = super().read()
        except LinkLost:
            if not hasattr(self, "last"):
                raise
        return self.last


class OpensOnce(Chosen):
    broken = False

    def read(self) -> ChamberState:
        if self.broken:
            raise LinkLost("the link was lost")
        try:
            return super().read()
        except Exception:
            self.broken = True
            raise


class AnswersWithZero(Chosen):
    def read(self) -> ChamberState:
        try:
            return super().read()
        except Exception as error:
            if "replied" not in str(error) and "ASCII" not in str(error):
                raise
            return ChamberState(273.15)


class KeepsTheLink(Chosen):
    """It takes whatever line comes next, and never opens a new link."""

    def read(self) -> ChamberState:
        if not hasattr(self, "raw"):
            super().close()
            address = self._dialogue.address
            self.raw, self.rest = open_link(address), b""
        self.raw.write(b":SOURCE:CLOOP1:PVALUE?\n")
        while b"\n" not in self.rest:
            if not (data := self.raw.read(100, TIMEOUT)):
                raise LinkLost("no reply")
            self.rest += data
        line, _, self.rest = self.rest.partition(b"\n")
        try:
            return ChamberState(float(line.decode("ascii")) + 273.15)
        except ValueError as error:
            raise LinkLost("no number") from error

    def close(self) -> None:
        if hasattr(self, "raw"):
            self.raw.close()
        super().close()


LEFT_OPEN: list[ScpiChamber] = []


class NeverCloses(Chosen):
    def close(self) -> None:
        LEFT_OPEN.append(self)


class Fault(NamedTuple):
    """A driver with a mistake, and the checks that find it."""

    driver: type[Chosen]
    found_by: set[str]


FAULTS = [
    Fault(InCelsius, {"state", "set point", "stop"}),
    Fault(NoLimits, {"limits"}),
    Fault(InKelvin, {"set point"}),
    Fault(NeverStops, {"stop"}),
    Fault(StopsOnlyWithReplies, {"stop"}),
    Fault(RemembersReadings, {"lost link"}),
    Fault(OpensOnce, {"reconnection"}),
    Fault(AnswersWithZero, {"malformed replies"}),
    Fault(KeepsTheLink, {"late reply", "reconnection"}),
    Fault(NeverCloses, {"close"}),
]
# `make slow` plants the others.
REPRESENTATIVE = (NoLimits, NeverStops)


def failed(results: tuple[CheckResult, ...]) -> set[str]:
    assert [one.name for one in results] == list(CHAMBER_CHECKS)
    return {one.name for one in results if not one.passed}


@contextmanager
def served(device: Any) -> Generator[SimulatorServer[Any]]:
    with SimulatorServer(device, SteppingClock(5.0)) as server:
        yield server


def check(server: SimulatorServer[Any], address: str) -> tuple[CheckResult, ...]:
    return check_driver(address, timeout=TIMEOUT, now=lambda: server.device.time)


@pytest.mark.parametrize("unit", [15, pytest.param(30, marks=pytest.mark.slow)])
def test_the_driver_of_the_f4t_passes(unit: int):
    with served(SimulatedF4t(unit)) as server:
        results = check(server, f"watlow-f4t://127.0.0.1:{server.port}?event=1&door=8")
    assert failed(results) == set(), results


@pytest.mark.slow
@pytest.mark.parametrize(
    "form", ["scpi-chamber://127.0.0.1:{}", evidence("scpi-chamber:tcp://localhost:{}")]
)
def test_the_scpi_driver_passes_in_both_forms_of_its_address(form: str):
    with served(SimulatedScpiChamber()) as server:
        results = check(server, form.format(server.port) + "?output=1&low=-70&high=150")
    assert failed(results) == set(), results


@pytest.mark.parametrize(
    "fault",
    [
        one if one.driver in REPRESENTATIVE else pytest.param(one, marks=pytest.mark.slow)
        for one in FAULTS
    ],
    ids=[one.driver.__name__ for one in FAULTS],
)
def test_a_planted_fault_is_found(fault: Fault):
    with served(SimulatedScpiChamber()) as server, CHAMBERS.with_("own", fault.driver.open):
        address = server.device.driver_address(server.address)
        results = check(server, address.replace("scpi-chamber:", "own:"))
    while LEFT_OPEN:
        ScpiChamber.close(LEFT_OPEN.pop())
    assert failed(results) == fault.found_by, results


SIMULATOR_FAULTS: dict[str, Callable[[Any], None]] = {
    "an open door": lambda device: device.fault("door"),
    "a failed sensor": lambda device: device.fault("sensor"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SIMULATOR_FAULTS)
def test_a_fault_of_the_simulator_is_found(name: str):
    with served(SimulatedScpiChamber()) as server:
        SIMULATOR_FAULTS[name](server.device)
        results = check(server, server.device.driver_address(server.address))
    assert "state" in failed(results)


@pytest.mark.parametrize(
    "address",
    ["watlow-f4t://192.0.2.1", "watlow-f4t://127.0.0.1", "scpi-chamber:serial:/dev/ttyS0", "sim"],
)
def test_only_a_simulator_at_a_port_of_this_machine_is_checked(address: str):
    with refused(key="ADDRESS"):
        check_driver(address)
