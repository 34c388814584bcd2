"""What the process of a session by hand is told, and how it is started."""

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from inercal.errors import InputError
from inercal.host.manual.commands import ManualCommand, command_fields, parse_command
from inercal.host.web.json_objects import as_object
from inercal.host.web.run_process import RunProcess

MANUAL_JOURNAL = "manual.journal"
MANUAL, HALT, END = "manual ", "halt ", "abort"  # begin a line that the process is told


@dataclass(frozen=True)
class ManualRequest:
    """A session by hand to be begun.

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

    folder: str
    plan: str
    requested_by: str = ""
    table: str = ""
    imu: str = ""
    clock: str = ""
    simulated: str | None = None
    seed: int = 0
    with_imu: bool = False

    @property
    def json_line(self) -> str:
        """The request as a line of JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, line: str) -> "ManualRequest":
        """Return what a line says.

        Raises
        ------
        InputError
            It is not a request.
        """
        try:
            return cls(**json.loads(line))
        except (TypeError, ValueError):
            raise InputError(
                f"{line[:80]!r} is not a request for a session by hand; send the JSON object of "
                "a ManualRequest",
                key="request",
            ) from None

    @property
    def name(self) -> str:
        """What the session is called: its folder's name."""
        return Path(self.folder).name

    @property
    def premature_state(self) -> str:
        """As of `ProcessRequest`."""
        return "manual"

    @property
    def loss_text(self) -> str:
        """As of `ProcessRequest`."""
        return "; the watchdog brings the table to rest"


def manual_line(by: str, command: ManualCommand) -> str:
    """Return the line by which the process is told a command of an operator."""
    return f"{MANUAL}{json.dumps({'by': by, 'command': command_fields(command)})}"


def parse_manual_line(line: str) -> tuple[str, ManualCommand]:
    """Return operator and command of a line without its `MANUAL`.

    Raises
    ------
    InputError
        It is none.
    """
    try:
        told = as_object(json.loads(line)) or {}
    except ValueError:
        told = {}
    return str(told.get("by", "")), parse_command(as_object(told.get("command")) or {})


def start_manual_process(order: ManualRequest) -> RunProcess:
    """Start the process of a session by hand."""
    return RunProcess(order, (sys.executable, "-P", "-m", "inercal.host.web.manual_worker"))
