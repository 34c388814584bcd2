"""Which devices a request may choose, and what of a run file is taken over into a run."""

import logging
import os
import tomllib
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest
from tests.refusals import refused

from inercal.host import devices
from inercal.host.tasks import RunOptions
from inercal.host.web import device_catalogue
from inercal.host.web.access import Access, is_loopback
from inercal.host.web.device_catalogue import ChosenDevices, DeviceCatalogue
from inercal.host.web.folders import Plans
from inercal.host.web.json_objects import RefusalHandler, RefusalLog
from inercal.host.web.run_request import (
    RunRequest,
    SimulationRequest,
    changed_run_file,
    read_process_record,
    run_in_progress,
    write_process_record,
)
from inercal.host.web.server import host_header_values

SIMULATED = {"id": "simulated"}
IMU = {"address": "tcp://10.0.0.6:4000?preset=fixed"}
TABLE = {"address": "pmac://10.0.0.5:1025?motors=1,2,3&counts=3600000"}


@pytest.fixture
def offered(monkeypatch: pytest.MonkeyPatch) -> DeviceCatalogue:
    ports = (
        devices.SerialPort("serial:/dev/ttyUSB0", "FTDI"),
        devices.SerialPort("serial:/dev/ttyS0", ""),
    )
    monkeypatch.setattr(device_catalogue, "list_serial_ports", lambda: ports)
    made = DeviceCatalogue("acutrol://t:5025?axes=1,2,3", "tcp://i:1?preset=xsens", "clock://c:1")
    made.refresh()
    return made


def test_the_lists_say_what_is_there(offered: DeviceCatalogue):
    assert [one["what"] for one in offered.tables()] == [
        "simulated bench",
        "acutrol://t:5025?axes=1,2,3",
        "motor on serial:/dev/ttyUSB0 (FTDI)",
        "motor on serial:/dev/ttyS0",
    ]
    assert [one["id"] for one in offered.imus()] == ["simulated", "given", "port-0", "port-1"]


@pytest.mark.parametrize(
    ("table", "imu", "chosen"),
    [
        (SIMULATED, SIMULATED, ChosenDevices("", "", "", "fixed")),
        (SIMULATED, SIMULATED | {"preset": "vn100"}, ChosenDevices("", "", "", "vn100")),
        (
            {"id": "given"},
            {"id": "given"},
            ChosenDevices("acutrol://t:5025?axes=1,2,3", "tcp://i:1?preset=xsens", "clock://c:1"),
        ),
        (TABLE, IMU, ChosenDevices(TABLE["address"], IMU["address"])),
        (
            {"id": "port-1", "baud": 19200},
            {"id": "port-0", "preset": "xsens", "baud": 921600},
            ChosenDevices(
                "motor:serial:/dev/ttyS0?baud=19200",
                "serial:/dev/ttyUSB0?baud=921600&preset=xsens",
            ),
        ),
        (
            {"address": "motor:tcp://[::1]:4001"},
            {"address": "tcp://imu.lab:4000", "preset": "ascii"},
            ChosenDevices("motor:tcp://[::1]:4001", "tcp://imu.lab:4000?preset=ascii"),
        ),
    ],
)
def test_a_choice_becomes_addresses(
    offered: DeviceCatalogue, table: object, imu: object, chosen: ChosenDevices
):
    assert offered.chosen(table, imu) == chosen


@pytest.mark.parametrize(
    ("table", "imu", "key"),
    [
        (SIMULATED, IMU, None),
        (None, None, "table"),
        ({"id": "port-9"}, IMU, "id"),
        ({"id": "/dev/ttyS0"}, IMU, "id"),
        ({"id": ["port-0"]}, IMU, "id"),
        ({"address": "motor:serial:/dev/ttyS0"}, IMU, "address"),
        ({"address": "unix:/run/x"}, IMU, "address"),
        ({"address": "pmac://h:1/../../etc?motors=1"}, IMU, "address"),
        ({"address": "pmac://u:p@h:1?motors=1"}, IMU, "address"),
        ({"address": "pmac://h:1?motors=1&layout=/etc/passwd"}, IMU, "address"),
        ({"address": "pmac://h:1\n?motors=1"}, IMU, "address"),
        (TABLE, {"address": "serial:/dev/ttyS0?preset=xsens"}, "address"),
        (TABLE, {"address": "tcp://h:1?layout=/etc/passwd"}, "address"),
        (TABLE, {"address": "tcp://h:1?preset=fixed&layout=own.toml"}, "preset"),
        (TABLE, {"address": "tcp://h:1?preset=../own.toml"}, "preset"),
        (TABLE, {"address": "tcp://h:1/etc"}, "address"),
        (TABLE, {"address": "tcp://h:1"}, "preset"),
        (TABLE, {"id": "port-0"}, "preset"),
        (TABLE, {"id": "port-0", "preset": "own.toml"}, "preset"),
        (TABLE, {"id": "port-0", "preset": "xsens", "baud": "9600&x=1"}, "baud"),
        (TABLE, {"id": "port-0", "preset": "xsens", "baud": True}, "baud"),
        (TABLE, {"address": "tcp://" + "h" * 400}, "address"),
    ],
)
def test_nothing_else_may_be_chosen(
    offered: DeviceCatalogue, table: object, imu: object, key: str | None
):
    with refused(key=key):
        offered.chosen(table, imu)


def test_a_port_keeps_its_number_when_another_vanishes(
    offered: DeviceCatalogue, monkeypatch: pytest.MonkeyPatch
):
    left = (
        devices.SerialPort("serial:/dev/ttyS0", ""),
        devices.SerialPort("serial:/dev/ttyUSB1", ""),
    )
    monkeypatch.setattr(device_catalogue, "list_serial_ports", lambda: left)
    offered.refresh()
    assert [one["id"] for one in offered.imus()] == ["simulated", "given", "port-1", "port-2"]
    assert offered.table({"id": "port-1"}) == "motor:serial:/dev/ttyS0?baud=9600"
    with refused(key="id"):
        offered.table({"id": "port-0"})


def test_an_imu_may_be_asked_what_it_sends_without_a_preset(offered: DeviceCatalogue):
    assert offered.imu({"id": "port-0"}, preset_needed=False) == "serial:/dev/ttyUSB0?baud=115200"
    assert offered.imu({"address": "tcp://h:1"}, preset_needed=False) == "tcp://h:1"


def test_another_name_of_the_sensor_changes_nothing_else_of_a_run_file():
    path = Path(str(files("inercal").joinpath("demo.toml")))
    name = 'the "new" one µ'
    before, content = path.read_text(encoding="utf-8"), changed_run_file(path, name, None)
    assert content is not None
    after = content.decode()
    assert tomllib.loads(after)["sensor"]["name"] == name
    changed = [
        (a, b) for a, b in zip(before.splitlines(), after.splitlines(), strict=True) if a != b
    ]
    assert [a for a, _ in changed] == ['name = "simulated MIMU"']


def test_plans_that_are_none_are_listed_with_their_trouble(tmp_path: Path):
    text = files("inercal").joinpath("demo.toml").read_text(encoding="utf-8")
    (tmp_path / "good.toml").write_text(text)
    (tmp_path / "typed.toml").write_text(text.replace("200 Hz", "200 Hx"))
    (tmp_path / "no.toml").write_text("[sensor")
    (tmp_path / "pyproject.toml").write_text("[project]\nname = 'x'\n")
    (tmp_path / "six.toml").write_text(text.replace('kind = "turntable"', 'kind = "hand"'))
    plans = Plans(tmp_path)
    summary = {name: plan.summary["trouble"] for name, plan in plans.all().items()}
    assert list(summary) == ["good", "no", "six", "typed", "demo"]
    assert summary["good"] == summary["demo"] == ""
    assert "unknown unit 'Hx'" in summary["typed"]
    assert all(summary[name] for name in ("no", "six", "typed"))
    (tmp_path / "typed.toml").write_text(text)
    assert plans.all()["typed"].summary["trouble"] == ""


def test_an_order_comes_through_as_it_was_given():
    order = RunRequest(
        "/runs/a", "Ada", "t", "i", "c", "fixed", 7, "/plans/p.toml", "MIMU", "r", RunOptions(2.0)
    )
    assert RunRequest.from_json(order.json_line) == order
    watched = replace(order, options=RunOptions(2.0, (288.15, 313.15), 30.0))
    assert RunRequest.from_json(watched.json_line) == watched
    for line in (
        "",
        "{}",
        "[1]",
        '{"folder": "x", "burn": 1}',
        '{"folder": "x", "options": 3}',
        '{"folder": "x", "options": [null, 3, 120.0]}',
    ):
        with refused(key="request"):
            RunRequest.from_json(line)


def test_a_note_tells_who_drives_a_run_as_long_as_it_lives(tmp_path: Path):
    assert read_process_record(tmp_path) is None
    assert not run_in_progress(tmp_path)
    held = write_process_record(tmp_path, SimulationRequest("fixed", 7))
    assert run_in_progress(tmp_path)
    with refused(file=tmp_path):
        write_process_record(tmp_path, None)
    was = read_process_record(tmp_path)
    assert was is not None
    assert was == (os.getpid(), ("fixed", 7))
    os.close(held)
    assert not run_in_progress(tmp_path)


def test_refusals_are_said_now_and_then_with_how_many_there_were():
    lines: list[str] = []
    now = 0.0
    refused = RefusalLog(lines.append, lambda: now)
    for k in range(100):
        refused("1.2.3.4", f"{k}")
    assert len(lines) == 20
    now = 10.0
    refused("1.2.3.4", "later")
    assert "80" in lines[-2]
    assert lines[-1] == "inercal: refused: 1.2.3.4: later"


def test_what_fails_in_the_web_server_is_one_line():
    lines: list[str] = []
    logger = logging.Logger("server")
    logger.addHandler(RefusalHandler(RefusalLog(lines.append)))
    for _ in range(100):
        try:
            int("one\ntwo")
        except ValueError:
            logger.exception("Exception in ASGI application\n")
    assert len(lines) == 20
    assert (
        "web server: Exception in ASGI application: ValueError (test_web_device_catalogue.py:"
        in lines[0]
    )
    assert "\n" not in "".join(lines)


def test_hosts_of_this_machine_alone_need_no_token():
    assert all(is_loopback(host) for host in ("127.0.0.1", "localhost", "::1", "127.9.9.9"))
    assert not any(is_loopback(host) for host in ("0.0.0.0", "::", "10.0.0.1", "lab", ""))
    assert host_header_values(["::1", "Lab"], 8765) == {"[::1]:8765", "lab:8765"}
    assert host_header_values(["lab"], 80) == {"lab:80", "lab"}
    with refused(key="token"):
        Access(frozenset(), "secret")
