"""A session by hand at the controllers that tell no clock: an ACUTROL3000 and a motor."""

from math import degrees
from pathlib import Path
from typing import Any

import pytest
from tests.host.simulated_runs import plan

from inercal.benches.turntable import require_turntable
from inercal.host.addresses import DeviceAddresses
from inercal.host.journal import Journal
from inercal.host.manual.commands import parse_command
from inercal.host.manual.session import ManualSession
from inercal.host.sim.acutrol import SimulatedAcutrol
from inercal.host.sim.motor import SimulatedMotor
from inercal.host.sim.server import ScaledClock, SimulatorServer
from inercal.runfile import Run

# The script is in the wall's seconds: a machine that stands still skips a motion.
pytestmark = pytest.mark.wall_time
Ask = tuple[float, dict[str, Any]]


def operated(
    folder: Path, run: Run, address: str, *script: Ask, until: float
) -> tuple[list[str], ManualSession]:
    """Carry out a script, s of the session; return what the journal has."""
    asked = list(script)

    def act(session: ManualSession) -> None:
        while asked and asked[0][0] <= session.time:
            session.request("Ada", parse_command(asked.pop(0)[1]))
        if session.time > until:
            session.end("the script is over")

    addresses = DeviceAddresses(address, "")
    with Journal.create(folder / "manual.journal", "plan.toml", addresses, 0.02, 0) as journal:
        with ManualSession(run, journal, addresses, act) as session:
            session.operate()
        return [event.words for event in journal.events()], session


def test_an_acutrol_is_operated_by_hand_and_homes_nothing(tmp_path: Path):
    device = SimulatedAcutrol()
    with SimulatorServer(device, ScaledClock()) as server:
        address = server.address.replace("tcp", "acutrol", 1) + "?axes=1,2,3"
        begin = degrees(device.table.reading(0))
        script: list[Ask] = [
            (0.0, {"what": "servo", "axis": "outer", "on": True}),
            (0.3, {"what": "home", "axis": "outer"}),
            (0.4, {"what": "go", "axis": "outer", "angle": begin + 1, "rate": 5}),
            (0.9, {"what": "go", "axis": "middle", "angle": 0, "rate": 5}),
            (1.4, {"what": "jog", "axis": "outer", "rate": -5, "press": 1}),
        ]
        said, session = operated(tmp_path, plan(tmp_path / "plan"), address, *script, until=2.4)
        rest = degrees(device.table.reading(0))
    assert any(
        "refused: Ada: axis outer: home: " in words and "absolute" in words for words in said
    )
    assert any("at rest" in words for words in said)
    assert any("servo is off" in words for words in said)
    assert any("no message about the held key" in words for words in said)
    # 0.3 s at 5 °/s, and what the deceleration at 15 °/s² takes.
    assert begin + 1 - 5 * 0.3 - 5**2 / (2 * 15) - 0.1 < rest < begin + 1
    assert session.state is not None
    assert [axis.enabled for axis in session.state.axes] == [True, False, False]


def test_the_motor_of_one_axis_is_jogged_and_its_servo_stays_on(tmp_path: Path):
    path = "label,kind,z [°],seconds [s],axis,angle [°],rate [°/s]\nrest,position,0,22,,,\n"
    one_axis = [
        ('kind = "turntable"', 'kind = "turntable"\naxes = "z"'),
        ('table = ["outer", "middle", "inner"]', 'table = ["z"]'),
        ('square = "2 ″"\n', ""),
    ]
    run = plan(tmp_path / "plan", path, one_axis)
    (axis,) = require_turntable(run).names
    device = SimulatedMotor()
    with SimulatorServer(device, ScaledClock()) as server:
        script: list[Ask] = [
            (0.0, {"what": "servo", "axis": axis, "on": False}),
            (0.2, {"what": "jog", "axis": axis, "rate": 10, "press": 1}),
            (0.9, {"what": "go", "axis": axis, "angle": 0, "rate": 5}),
        ]
        said, session = operated(tmp_path, run, f"motor:{server.address}", *script, until=2.2)
        rate = degrees(float(device.table.state[0].rate))
    assert any("servo off: this controller has no command" in words for words in said)
    assert any("no message about the held key" in words for words in said)
    assert any("home it first" in words for words in said)
    assert session.state is not None
    assert session.state.axes[0].enabled
    assert 0 < degrees(session.state.axes[0].angle) < 10 * 0.3 + 10**2 / (2 * 15) + 0.1
    assert abs(rate) < 0.5
