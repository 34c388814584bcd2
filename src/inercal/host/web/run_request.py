"""Defines requests to the process of a run or a manual session, and messages about its end.

The process also leaves a record in the run's folder.
"""

import asyncio
import json
import os
import signal
import sys
from abc import ABC, abstractmethod
from collections.abc import AsyncGenerator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Any, ClassVar, NamedTuple, Self

import tomlkit

from inercal.basics.errors import InputError
from inercal.basics.small_files import read_toml
from inercal.host.manual.commands import ManualCommand, command_fields, parse_command
from inercal.host.run_folder import JOURNAL, LOG
from inercal.host.run_log import is_locked, lock_file, os_errors_as_input_errors
from inercal.host.tasks import DEFAULT_OPTIONS, RunOptions
from inercal.host.web.json_objects import object_or_none
from inercal.runfile.filter_fields import changed_section

PROCESS_RECORD = "run.page.json"
MANUAL_JOURNAL = "manual.journal"
# First words of lines to a process. MANUAL and HALT are for sessions, and MOUNTED is for runs.
NOTE, MOUNTED, MANUAL, HALT, END = "note ", "mounted ", "manual ", "halt ", "abort"
EndMessage = dict[str, Any]


@dataclass(frozen=True)
class ProcessRequest(ABC):
    """A request to a process that drives the bench; it is sent as one line of JSON.

    Parameters
    ----------
    folder : str
        Folder to which the process writes.
    requested_by : str
        Name of the person who makes the request.
    table, imu, clock : str
        Addresses of the devices. For a run, an empty text means that the address has not changed;
        for a session, that of the IMU is empty if it is not read.
    simulated : str or None
        Packet preset of the simulated bench; None for a real bench.
    seed : int
        Seed of the simulated bench, unless the run already has a seed.

    Attributes
    ----------
    worker : str
        Name of the module that carries out the request.
    """

    worker: ClassVar[str]

    folder: str
    requested_by: str = ""
    table: str = ""
    imu: str = ""
    clock: str = ""
    simulated: str | None = None
    seed: int = 0

    @property
    def name(self) -> str:
        """The name of the folder, which is also the name of the run or session."""
        return Path(self.folder).name

    @property
    def json_line(self) -> str:
        """The request as a line of JSON."""
        return json.dumps(asdict(self))

    @property
    @abstractmethod
    def premature_state(self) -> str:
        """The `state` that is reported if the process ends early."""

    @property
    @abstractmethod
    def loss_text(self) -> str:
        """Text that says what happens to table and run if the process is lost."""

    @classmethod
    def from_json(cls, line: str) -> Self:
        """Convert a line to a request.

        Raises
        ------
        InputError
            The line is not a valid request.
        """
        try:
            return cls(**json.loads(line))
        except (TypeError, ValueError):
            raise InputError(
                f"{line[:80]!r} is not a request; send the JSON object of a {cls.__name__}",
                key="request",
            ) from None


@dataclass(frozen=True)
class RunRequest(ProcessRequest):
    """A request to start or resume a run.

    Parameters
    ----------
    folder, requested_by, table, imu, clock, simulated, seed
        See `ProcessRequest`.
    plan : str or None
        Path of the run file; None means that the run in the folder is resumed.
    sensor : str or None
        Name of the sensor, if it differs from the name in the run file.
    register : str or None
        Address of the register.
    options : RunOptions
    ambient : float or None
        Room temperature that the operator typed, °C.
    filter : mapping of str to str, optional
        Filter parameters that the operator has changed; see `changed_section`.
    """

    worker = "inercal.host.web.worker"

    plan: str | None = None
    sensor: str | None = None
    register: str | None = None
    options: RunOptions = DEFAULT_OPTIONS
    ambient: float | None = None
    filter: Mapping[str, str] | None = None

    def __post_init__(self) -> None:
        speed, temperature, patience = self.options  # JSON has no tuples, only lists
        options = RunOptions(speed, temperature and (temperature[0], temperature[1]), patience)
        object.__setattr__(self, "options", options)

    @property
    def is_resumable(self) -> bool:
        """Whether a journal exists from which the run can be resumed."""
        return (Path(self.folder) / JOURNAL).is_file()

    @property
    def premature_state(self) -> str:
        """See `ProcessRequest`."""
        return "interrupted" if self.is_resumable else "not begun"

    @property
    def loss_text(self) -> str:
        """See `ProcessRequest`."""
        if self.is_resumable:
            return "; the watchdog brings the table to rest, and the run can be resumed"
        return " before anything moved"


@dataclass(frozen=True)
class ManualRequest(ProcessRequest):
    """A request to start a manual session.

    Parameters
    ----------
    folder, requested_by, table, imu, clock, simulated, seed
        See `ProcessRequest`.
    plan : str
        Path of the run file. Its [bench] states the axes and their limits; its plan is not
        executed.
    with_imu : bool
        Whether the IMU is read; this also applies to a simulated bench.
    """

    worker = "inercal.host.web.manual_worker"

    plan: str = field(kw_only=True)
    with_imu: bool = False

    @property
    def premature_state(self) -> str:
        """See `ProcessRequest`."""
        return "manual"

    @property
    def loss_text(self) -> str:
        """See `ProcessRequest`."""
        return "; the watchdog brings the table to rest"


_MAX_MESSAGE = 1 << 20  # largest number of bytes in a message


class RunProcess:
    """The process for a run or a manual session.

    Parameters
    ----------
    order : ProcessRequest
    command : sequence of str, optional
        Command that starts the process; by default, it starts the worker of the request.
    """

    def __init__(self, order: ProcessRequest, command: tuple[str, ...] = ()):
        self.order = order
        python = (sys.executable, "-P", "-m", order.worker)
        self._process = Popen(command or python, stdin=PIPE, stdout=PIPE, start_new_session=True)
        assert self._process.stdin
        os.set_blocking(self._process.stdin.fileno(), False)
        self.send_line(order.json_line)

    def send_line(self, line: str) -> bool:
        """Send a line to the process; return False if the process does not read its input."""
        assert self._process.stdin
        data = f"{line}\n".encode()
        try:
            return os.write(self._process.stdin.fileno(), data) == len(data)
        except OSError:
            return False

    def stop(self) -> None:
        """Stop the table; the signal handler of the process informs the watchdog immediately."""
        with suppress(ProcessLookupError):
            if self._process.poll() is None:
                os.killpg(self._process.pid, signal.SIGINT)

    async def messages(self) -> AsyncGenerator[tuple[str, str]]:
        """Yield the kind and text of each message from the process until its output ends."""
        assert self._process.stdout
        reader = asyncio.StreamReader(_MAX_MESSAGE)
        protocol = asyncio.StreamReaderProtocol(reader)
        loop = asyncio.get_running_loop()
        transport, _ = await loop.connect_read_pipe(lambda: protocol, self._process.stdout)
        try:
            while line := await reader.readline():
                kind, _, text = line.decode("utf-8", "replace").rstrip("\n").partition(" ")
                yield kind, text
        except ValueError:
            return  # an unterminated line is not a complete message
        finally:
            transport.close()

    async def wait_for_exit(self) -> int:
        """Wait until the process has ended, and return its exit status."""
        assert self._process.stdin
        with suppress(OSError):
            self._process.stdin.close()
        # The wait is in a thread, because a run that is being stopped may need some time to end.
        return await asyncio.to_thread(self._process.wait)


def mounted_line(number: int, mounting: str, by: str) -> str:
    """Return the line by which somebody confirms a mounting for a request."""
    return f"{MOUNTED}{json.dumps([number, mounting, by])}"


def manual_line(by: str, command: ManualCommand) -> str:
    """Return the line that sends an operator's command to the process."""
    return f"{MANUAL}{json.dumps({'by': by, 'command': command_fields(command)})}"


def parse_manual_line(line: str) -> tuple[str, ManualCommand]:
    """Return the operator and the command in a line that follows `MANUAL`.

    Raises
    ------
    InputError
        The line is not a valid command.
    """
    try:
        fields = object_or_none(json.loads(line)) or {}
    except ValueError:
        fields = {}
    return str(fields.get("by", "")), parse_command(object_or_none(fields.get("command")) or {})


def end_message(order: ProcessRequest, state: str, words: str = "", **more: object) -> EndMessage:
    """Return the message about the end of a run or session.

    Parameters
    ----------
    order : ProcessRequest
    state : "done", "carried out", "interrupted", "not begun" or "manual"
        "carried out" means that the plan is complete but the run was not calibrated. "not begun"
        means that there is nothing to resume. "manual" means the end of a manual session.
    words : str
        Reason why the state is not "done".
    **more
        "report", "calibration", "history" and "verdict", if they exist, and "estimates", which
        contains the coefficients in the calibration file with their uncertainties.
    """
    links = dict.fromkeys(("report", "calibration", "history", "verdict", "estimates"))
    return {"run": order.name, "state": state, "words": words, **links, **more}


def premature_end_message(order: ProcessRequest, words: str) -> EndMessage:
    """Return the message for a process that ended early."""
    return end_message(order, order.premature_state, words)


class SimulationRequest(NamedTuple):
    """Packet preset and seed of the simulated bench of a run."""

    preset: str
    seed: int


class ProcessRecord(NamedTuple):
    """The record that the process of a run writes to the folder.

    Parameters
    ----------
    process : int
        Process ID. It is only valid while the record is locked (`is_locked`), because an old ID may
        now belong to another process.
    simulated : SimulationRequest or None
        The simulated bench of the run.
    """

    process: int
    simulated: SimulationRequest | None


def write_process_record(folder: Path, simulated: SimulationRequest | None) -> int:
    """Write the record, and return a descriptor that keeps it locked until the process ends.

    Raises
    ------
    InputError
        Another process has locked the record, or it is not writable.
    """
    path = folder / PROCESS_RECORD
    content = json.dumps(ProcessRecord(os.getpid(), simulated)._asdict()).encode()
    with os_errors_as_input_errors(path, "written"):
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        lock_file(file, folder, "another process drives this run; stop that process first")
        os.ftruncate(file, 0)
        os.write(file, content)
    return file


def read_process_record(folder: Path) -> ProcessRecord | None:
    """Return the record in a folder; None if there is no record."""
    try:
        content: Mapping[str, Any] = json.loads((folder / PROCESS_RECORD).read_bytes())
        was = content["simulated"]
        simulated = None if was is None else SimulationRequest(str(was[0]), int(was[1]))
        return ProcessRecord(int(content["process"]), simulated)
    except (OSError, ValueError, LookupError, TypeError):
        return None


def run_in_progress(folder: Path) -> bool:
    """Return whether any process drives the run in a folder, from a page or another host."""
    return is_locked(folder / PROCESS_RECORD) or is_locked(folder / LOG)


def changed_run_file(
    path: Path, sensor: str | None, filter_changes: Mapping[str, str] | None
) -> bytes | None:
    """Return the text of a run file with an operator's changes; None if there are no changes.

    Parameters
    ----------
    path : Path
    sensor : str or None
        New name of the sensor, if it changes.
    filter_changes : mapping of str to str or None
        Changes to the filter parameters; see `changed_section`.

    Raises
    ------
    InputError
        The file cannot be read or changed.
    """
    if sensor is None and not filter_changes:
        return None
    try:
        read_toml(path, "run file")  # this limits size and depth; tomlkit does not
        document: Any = tomlkit.parse(path.read_text(encoding="utf-8"))
        if sensor is not None:
            document["sensor"]["name"] = sensor
        if filter_changes:
            document["method"].pop("filter", None)
            if section := changed_section(path, filter_changes):
                document["method"]["filter"] = section
        return tomlkit.dumps(document).encode()
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            f"{path}: the run file cannot be changed: {error}; check [sensor] name and "
            "[method.filter]"
        ) from None
