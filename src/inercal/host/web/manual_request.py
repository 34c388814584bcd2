"""The request and the commands of a session by hand, and the start of its process."""

import json
import sys
from dataclasses import dataclass

from inercal.host.manual.commands import ManualCommand, command_fields, parse_command
from inercal.host.web.json_objects import as_object
from inercal.host.web.run_process import RunProcess
from inercal.host.web.run_request import FolderRequest

MANUAL_JOURNAL = "manual.journal"
MANUAL, HALT, END = "manual ", "halt ", "abort"  # begin a line to the process


@dataclass(frozen=True)
class ManualRequest(FolderRequest):
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
        fields = as_object(json.loads(line)) or {}
    except ValueError:
        fields = {}
    return str(fields.get("by", "")), parse_command(as_object(fields.get("command")) or {})


def start_manual_process(order: ManualRequest) -> RunProcess:
    """Start the process of a session by hand."""
    return RunProcess(order, (sys.executable, "-P", "-m", "inercal.host.web.manual_worker"))
