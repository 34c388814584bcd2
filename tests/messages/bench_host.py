"""Messages of the bench host: links, tables, the run's folder and log."""

from collections.abc import Callable
from pathlib import Path

from inercal.host.clock import SimulatedClock
from inercal.host.drivers.pmac_codec import ReplyReader, parse_number, response_request
from inercal.host.drivers.rotary_table import AxisLimits, axis_index
from inercal.host.link import open_link
from inercal.host.run_folder import JOURNAL, prepare_folder
from inercal.host.run_log import RunLog, read_frames

LIMITS = AxisLimits(rate=1.0, acceleration=1.0, low=-1.0, high=1.0)


def _other_file(folder: Path) -> None:
    (folder / "run.log").write_text("notes of mine")
    RunLog(folder / "run.log")


def _damaged(folder: Path) -> None:
    path = folder / "run.log"
    with RunLog(path) as log:
        log.append(1, 0.0, b"bytes")
    path.write_bytes(path.read_bytes().replace(b"bytes", b"bites"))
    list(read_frames(path))


def _second_run(folder: Path) -> None:
    (folder / JOURNAL).touch()
    prepare_folder(folder)


CASES: dict[str, Callable[[Path], object]] = {
    "address": lambda _: open_link("udp://host:1"),
    "unknown_parameter": lambda _: open_link("serial:/dev/ttyS0?speed=9600"),
    "parameter_out_of_range": lambda _: open_link("serial:/dev/ttyS0?bits=9"),
    "clock_address": lambda _: SimulatedClock("tcp://127.0.0.1:4000"),
    "speed": lambda _: SimulatedClock("clock://127.0.0.1:4000", 0.0),
    "soft_limit": lambda _: LIMITS.check("inner", 1.0, 1.0, 2.0),
    "rate": lambda _: LIMITS.check("inner", 2.0, 1.0),
    "unknown_axis": lambda _: axis_index("yaw", ("outer", "inner")),
    "refused_command": lambda _: ReplyReader("#1J+").feed(b"\x07ERR012\r"),
    "reply_that_is_no_number": lambda _: parse_number("1.2.3"),
    "command_line": lambda _: response_request("#1P\r"),
    "other_file": _other_file,
    "damaged_log": _damaged,
    "second_run": _second_run,
}
