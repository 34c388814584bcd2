"""The example of a chamber of one's own passes the check, and shows its door and its alarm."""

import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from inercal.host.driver_check import check_driver
from inercal.host.equipment import CHAMBERS, open_chamber
from inercal.host.sim.server import SimulatorServer, SteppingClock

FOLDER = Path(__file__).parents[3] / "examples" / "own_driver"


def module(name: str) -> Any:
    made = ModuleType(name)
    text = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
    exec(compile(text, name, "exec"), vars(made))
    return made


@pytest.mark.slow
def test_the_oven_passes_all_checks():
    with (
        CHAMBERS.with_("oven", module("oven").open_oven),
        SimulatorServer(module("oven_simulator").SimulatedOven(), SteppingClock(5.0)) as server,
    ):
        results = check_driver(
            f"oven://127.0.0.1:{server.port}", timeout=0.4, now=lambda: server.device.time
        )
    assert [one for one in results if not one.passed] == []


def test_the_oven_reports_its_door_and_its_limiter():
    device = module("oven_simulator").SimulatedOven()
    with (
        CHAMBERS.with_("oven", module("oven").open_oven),
        SimulatorServer(device) as server,
        open_chamber(f"oven://127.0.0.1:{server.port}", 5.0) as oven,
    ):
        device.fault("door")
        assert oven.read().door_open is True
        device.fault("door off")
        device.fault("overtemperature")
        server.advance(10_000.0)
        assert oven.read().alarms == ("too hot",)


def test_the_package_registers_the_function_that_the_module_has():
    settings = tomllib.loads((FOLDER / "pyproject.toml").read_text(encoding="utf-8"))
    points = settings["project"]["entry-points"][CHAMBERS.group]
    name, _, function = points["oven"].partition(":")
    assert callable(getattr(module(name), function))
