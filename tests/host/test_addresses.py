"""Addresses of tables and IMUs: what they open, and what is said of those that are none."""

import os
import pty
import tty
from collections.abc import Iterator
from dataclasses import replace
from math import radians
from pathlib import Path
from time import monotonic
from typing import Any

import pytest
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.benches.motion_control import AxisMotionLimits
from inercal.host.addresses import (
    allows_second_connection,
    layout_of_address,
    link_of_address,
    open_imu,
    open_table,
)
from inercal.host.drivers.acutrol import Acutrol
from inercal.host.drivers.motor import Motor
from inercal.host.drivers.pmac import Pmac
from inercal.host.packets import PRESETS, encode, read_layout
from inercal.host.sim.acutrol import SimulatedAcutrol
from inercal.host.sim.motor import SimulatedMotor
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.server import SimulatorServer

BENCH = Turntable(
    Measured(9.8, 0.0), radians(38), limits=(AxisMotionLimits(radians(90), radians(45)),)
)
SINGLE = replace(BENCH, axes="z")


def _at(scheme: str, server: SimulatorServer[Any], query: str) -> str:
    return f"{server.address.replace('tcp', scheme, 1)}?{query}"


def test_a_pmac_is_opened_with_motors_and_counts_by_axis(pmac: SimulatorServer[SimulatedPmac]):
    with open_table(_at("pmac", pmac, "motors=3,1,2&counts=3600000"), BENCH) as table:
        assert isinstance(table, Pmac)
        assert table.axes == ("outer", "middle", "inner")
        outer = table.read().axes[0].angle
    with open_table(_at("pmac", pmac, "motors=1,3&counts=3600000,-1800000"), None) as table:
        assert table.axes == ("1", "3")
        assert table.read().axes[1].angle == pytest.approx(-2 * outer)


def test_an_acutrol_is_opened_with_its_axes():
    with SimulatorServer(SimulatedAcutrol()) as server:
        with open_table(_at("acutrol", server, "axes=1,2,3"), BENCH, 5.0) as table:
            assert isinstance(table, Acutrol)
            assert table.axes == BENCH.names
        with open_table(_at("acutrol", server, "axes=2"), SINGLE, 5.0) as table:
            assert table.axes == ("outer",)
        with open_table(f"acutrol:{server.address}?axes=1", SINGLE, 5.0) as table:
            assert table.identity() == "inercal,simulated ACUTROL3000"


@pytest.mark.parametrize("terminal", [False, True])
def test_a_motor_is_opened_over_any_link_and_held_to_the_benchs_limits(terminal: bool):
    with SimulatorServer(SimulatedMotor(), terminal=terminal) as server:
        address = f"motor:{server.address}"
        with open_table(address, SINGLE, 5.0) as table:
            assert isinstance(table, Motor)
            assert table.axes == ("outer",)
            with refused(key="rate", names=("outer",)):
                table.spin("outer", radians(91), radians(45))
        assert allows_second_connection(address) is not terminal


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("tcp://h:1025", "is not an address of a table; possible: pmac://HOST:1025"),
        ("pmac://h:1025", "has no parameter motors; add it, such as motors=1,2,3"),
        ("pmac://h:1025?motors=1,2,3", "has no parameter counts; add it, such as counts=3600000"),
        (
            "pmac://h?motors=1,2&counts=1",
            "gives 2 motors, but the bench has the axes outer, middle, inner",
        ),
        ("pmac://h?motors=1,2,2&counts=1", "possible: 1 to 32, each once"),
        ("pmac://h?motors=1,2,33&counts=1", "possible: 1 to 32, each once"),
        ("pmac://h?motors=1;2;3&counts=1", "give numbers as motors=1,2,3"),
        ("pmac://h?motors=1,2,3&counts=1,2", "one number for all axes, or 3 numbers"),
        ("pmac://h?motors=1,2,3&counts=0", "counts per turn, not 0"),
        ("pmac://h?motors=1,2,3&counts=nan", "counts per turn, not 0"),
        ("pmac://h?motors=1,2,3&counts=many", "counts per turn, not 0"),
        ("pmac://h?motors=1,2,3&counts=1&speed=2", "unknown parameter 'speed'"),
        ("pmac://h?motors=1,2,3&counts=1&counts=2", "gives a parameter twice"),
        ("pmac://h:99999?motors=1,2,3&counts=1", "has no valid host and port"),
        ("pmac://?motors=1,2,3&counts=1", "has no valid host and port"),
        ("acutrol://h?axes=1,2,3", "has no valid host and port"),
        ("acutrol:tcp://h?axes=1,2,3", "has no valid host and port"),
        ("acutrol:serial:/dev/ttyS0?axes=1,2,3", "has no valid host and port"),
        ("acutrol://h:1", "has no parameter axes"),
        ("motor:serial:/dev/ttyS0", "gives 1 motor, but the bench has the axes"),
        ("motor:/dev/ttyS0", "has no link after"),
    ],
)
def test_what_is_no_table_is_one_line_with_what_is(address: str, says: str):
    with pytest.raises(InputError) as caught:
        open_table(address, BENCH)
    assert says in str(caught.value)


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    device, host = pty.openpty()
    tty.setraw(host)
    yield device, os.ttyname(host)
    for end in (device, host):
        os.close(end)


def test_an_imu_is_opened_by_preset_or_by_a_file_of_ones_own(
    terminal: tuple[int, str], tmp_path: Path
):
    device, path = terminal
    own = tmp_path / "own.toml"
    own.write_text('line = "{ax:.3f},{ay:.3f},{az:.3f}"\n[accelerometer]\nscale = "1 g"\n')
    for query, name in ((f"layout={own}", "own"), ("baud=921600&preset=fixed", "fixed")):
        with open_imu(f"serial:{path}?{query}", monotonic) as port:
            assert port.layout.name == name
            data = encode(port.layout, [[0.0, 0.0, 9.8, 0.0, 0.0, 0.0]], temperature=[300.0])
            os.write(device, data)
            assert b"".join(piece for _, piece in port.take(len(data))) == data


def test_what_is_the_packets_is_taken_off_the_links_address():
    assert link_of_address("serial:/dev/ttyUSB0?preset=xsens&baud=921600") == (
        "serial:/dev/ttyUSB0?baud=921600"
    )
    assert link_of_address("tcp://h:1?preset=fixed") == "tcp://h:1"
    assert link_of_address("serial:/dev/ttyS0?baud=9600") == "serial:/dev/ttyS0?baud=9600"
    assert layout_of_address("tcp://h:1?preset=vn100").name == read_layout("vn100").name


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("tcp://h:1", "either preset=NAME or layout=FILE.toml; presets are ascii"),
        ("tcp://h:1?preset=fixed&layout=a.toml", "either preset=NAME or layout=FILE.toml"),
        ("tcp://h:1?preset=mine.toml", f"possible: {', '.join(PRESETS)}"),
        (
            "tcp://h:1?layout=/none.toml",
            "/none.toml: no such description of packets; check the path; presets are",
        ),
        ("tcp://h:1?preset=fixed&baud=9600", "unknown parameter 'baud'"),
        ("udp://h:1?preset=fixed", "possible: tcp://HOST:PORT or serial:PATH"),
    ],
)
def test_what_is_no_imu_is_one_line_with_what_is(address: str, says: str):
    with pytest.raises(InputError) as caught:
        open_imu(address, monotonic)
    assert says in str(caught.value)
