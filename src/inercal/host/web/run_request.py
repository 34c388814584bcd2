"""Requests to the process of a run or of a manual session, and the message of its end.

A note of the process stays in the run's folder.
"""

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
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
# Lines to the process begin so; MANUAL and HALT to that of a session, MOUNTED to that of a run.
NOTE, MOUNTED, MANUAL, HALT, END = "note ", "mounted ", "manual ", "halt ", "abort"
EndMessage = dict[str, Any]


@dataclass(frozen=True)
class ProcessRequest(ABC):
    """The request of a process that drives the bench; one line of JSON hands it over.

    Parameters
    ----------
    folder : str
        That the process keeps.

    Attributes
    ----------
    worker : str
        The module that carries it out.
    """

    worker: ClassVar[str]

    folder: str

    @property
    def name(self) -> str:
        """The name of the folder, which names the run or session too."""
        return Path(self.folder).name

    @property
    def json_line(self) -> str:
        """The request as a line of JSON."""
        return json.dumps(asdict(self))

    @property
    @abstractmethod
    def premature_state(self) -> str:
        """Its `state` in the message of an end before its own."""

    @property
    @abstractmethod
    def loss_text(self) -> str:
        """What happens to the table and to the run if the process is lost."""

    @classmethod
    def from_json(cls, line: str) -> Self:
        """Return the request of a line.

        Raises
        ------
        InputError
            It is none.
        """
        try:
            return cls.from_fields(json.loads(line))
        except (TypeError, ValueError):
            raise InputError(
                f"{line[:80]!r} is no request; send the JSON object of a {cls.__name__}",
                key="request",
            ) from None

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> Self:
        """Return the request of these fields, as JSON has them."""
        return cls(**fields)


@dataclass(frozen=True)
class RunRequest(ProcessRequest):
    """A request to start or resume a run.

    Parameters
    ----------
    folder : str
        Of the run.
    plan : str or None
        The run file; None where the run in the folder goes on.
    sensor : str or None
        Its name, where it is not the run file's.
    requested_by : str
        Who wants it.
    table, imu, clock : str
        Addresses; empty where they are as before.
    simulated : str or None
        Preset of the packets of a bench that is simulated for the run.
    seed : int
        Of that bench, unless the run had another before.
    speed : float or None
        Most seconds of a simulated bench in one of the wall's.
    register : str or None
        Its address.
    temperature : (float, float) or None
        K that the IMU must stay within.
    patience : float
        s that the IMU may be gone before the run ends.
    ambient : float or None
        Temperature of the room, °C, as the operator typed it.
    filter : mapping of str to str, optional
        Parameters of the filters that the operator has changed, as of `changed_section`.
    """

    worker = "inercal.host.web.worker"

    plan: str | None = None
    sensor: str | None = None
    requested_by: str = ""
    table: str = ""
    imu: str = ""
    clock: str = ""
    simulated: str | None = None
    seed: int = 0
    speed: float | None = None
    register: str | None = None
    temperature: tuple[float, float] | None = None
    patience: float = DEFAULT_OPTIONS.patience
    ambient: float | None = None
    filter: Mapping[str, str] | None = None

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> Self:
        """Return the request of these fields, as JSON has them."""
        request = cls(**fields)
        if request.temperature is None:
            return request
        low, high = request.temperature  # JSON has lists only
        return replace(request, temperature=(low, high))

    @property
    def options(self) -> RunOptions:
        """The text about the run."""
        return RunOptions(self.speed, self.temperature, self.patience)

    @property
    def is_resumable(self) -> bool:
        """Whether there is a journal by which the run can be resumed."""
        return (Path(self.folder) / JOURNAL).is_file()

    @property
    def premature_state(self) -> str:
        """As of `ProcessRequest`."""
        return "interrupted" if self.is_resumable else "not begun"

    @property
    def loss_text(self) -> str:
        """As of `ProcessRequest`."""
        if self.is_resumable:
            return "; the watchdog brings the table to rest, and the run can be resumed"
        return " before anything moved"


@dataclass(frozen=True)
class ManualRequest(ProcessRequest):
    """A request to start a manual session.

    Parameters
    ----------
    folder : str
        Of the session.
    plan : str
        The run file whose [bench] states the axes and their limits; none of its steps is done.
    requested_by : str
        Who wants it.
    table, imu, clock : str
        Addresses; the IMU's is empty where it is not to be read.
    simulated : str or None
        Preset of the packets of a bench that is simulated for the session.
    seed : int
        Of that bench.
    with_imu : bool
        Whether the IMU is read, of a simulated bench too.
    """

    worker = "inercal.host.web.manual_worker"

    plan: str
    requested_by: str = ""
    table: str = ""
    imu: str = ""
    clock: str = ""
    simulated: str | None = None
    seed: int = 0
    with_imu: bool = False

    @property
    def premature_state(self) -> str:
        """As of `ProcessRequest`."""
        return "manual"

    @property
    def loss_text(self) -> str:
        """As of `ProcessRequest`."""
        return "; the watchdog brings the table to rest"


def mounted_line(number: int, mounting: str, by: str) -> str:
    """Return the line by which somebody confirms a mounting for the request `number`."""
    return f"{MOUNTED}{json.dumps([number, mounting, by])}"


def manual_line(by: str, command: ManualCommand) -> str:
    """Return the line that hands the command of an operator to the process."""
    return f"{MANUAL}{json.dumps({'by': by, 'command': command_fields(command)})}"


def parse_manual_line(line: str) -> tuple[str, ManualCommand]:
    """Return operator and command of a line without its `MANUAL`.

    Raises
    ------
    InputError
        It is none.
    """
    try:
        fields = object_or_none(json.loads(line)) or {}
    except ValueError:
        fields = {}
    return str(fields.get("by", "")), parse_command(object_or_none(fields.get("command")) or {})


def end_message(order: ProcessRequest, state: str, words: str = "", **more: object) -> EndMessage:
    """Return the message of an end.

    Parameters
    ----------
    order : ProcessRequest
    state : "done", "carried out", "interrupted", "not begun" or "manual"
        Carried out: without a calibration. Not begun: nothing was kept that could be resumed.
        Manual: the end of a manual session.
    words : str
        Why, where it is not done.
    **more
        "report", "calibration", "history" and "verdict", where there are any, and "estimates": the
        coefficients of the calibration file with their uncertainties.
    """
    links = dict.fromkeys(("report", "calibration", "history", "verdict", "estimates"))
    return {"run": order.name, "state": state, "words": words, **links, **more}


def premature_end_message(order: ProcessRequest, words: str) -> EndMessage:
    """Return the end message of a process that ended early."""
    return end_message(order, order.premature_state, words)


class SimulationRequest(NamedTuple):
    """A simulated bench for a run: packet preset and seed."""

    preset: str
    seed: int


class ProcessRecord(NamedTuple):
    """The note that a run's process leaves in the folder.

    Parameters
    ----------
    process : int
        Its number, as long as the note is locked (`is_locked`); an old one's may be another's by
        now.
    simulated : SimulationRequest or None
        The bench that is simulated for the run.
    """

    process: int
    simulated: SimulationRequest | None


def write_process_record(folder: Path, simulated: SimulationRequest | None) -> int:
    """Write the note, and return a descriptor that keeps it locked until the process ends.

    Raises
    ------
    InputError
        Another process has it locked, or it cannot be written.
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
    """Return the note; None where there is none."""
    try:
        content: Mapping[str, Any] = json.loads((folder / PROCESS_RECORD).read_bytes())
        was = content["simulated"]
        simulated = None if was is None else SimulationRequest(str(was[0]), int(was[1]))
        return ProcessRecord(int(content["process"]), simulated)
    except (OSError, ValueError, LookupError, TypeError):
        return None


def run_in_progress(folder: Path) -> bool:
    """Tell whether a process, that of a page or another host, drives the run in a folder."""
    return is_locked(folder / PROCESS_RECORD) or is_locked(folder / LOG)


def changed_run_file(
    path: Path, sensor: str | None, filter_changes: Mapping[str, str] | None
) -> bytes | None:
    """Return a run file with an operator's changes, otherwise as written; None for no change.

    Parameters
    ----------
    path : Path
    sensor : str or None
        The sensor's name, where it is another.
    filter_changes : mapping of str to str or None
        Of the filters' parameters, as of `changed_section`.

    Raises
    ------
    InputError
        It cannot be read.
    """
    if sensor is None and not filter_changes:
        return None
    try:
        read_toml(path, "run file")  # bounds size and depth, which tomlkit does not
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
