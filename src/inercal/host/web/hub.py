"""The run that is shown, and those to whom: what they ask for is judged and done here."""

import asyncio
import json
import shutil
import signal
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from os import kill
from pathlib import Path
from zlib import crc32

from inercal.errors import InputError
from inercal.host.options import DEFAULT_OPTIONS, RunOptions
from inercal.host.run_log import is_locked
from inercal.host.web.command_relay import MOUNTED, NOTE
from inercal.host.web.device_catalogue import ChosenDevices, DeviceCatalogue
from inercal.host.web.filter_changes import filter_changes, require_filter_changes
from inercal.host.web.json_objects import JsonObject
from inercal.host.web.message_history import MessageHistory, is_alarm
from inercal.host.web.plans import Plans
from inercal.host.web.run_process import RunProcess
from inercal.host.web.run_request import (
    PROCESS_RECORD,
    RunRequest,
    premature_end_message,
    read_process_record,
)
from inercal.host.web.runs import Runs, StoredRun
from inercal.host.web.viewers import OPERATOR_GRACE, Viewer, Viewers

_MAX_NAME = 80  # characters of a sensor's name
_EXIT_TIMEOUT = 15.0  # s that a process may take to end that has told its end
_TIMER_MARGIN = 0.1  # s: a timer may be that early
_MAX_NOTE = 400  # characters of a note
_AMBIENT_RANGE = (-90.0, 100.0)  # °C
_COMMANDS = ("pause", "go on", "abort")
_OPERATOR_COMMANDS = (*_COMMANDS, "start", "resume", "put away", "note", "mounted")
COMMANDS = ("operate", "leave", "stop", *_OPERATOR_COMMANDS)


class Hub:
    """What the server has beside its connections.

    Parameters
    ----------
    plans : Plans
    runs : Runs
    choice : DeviceCatalogue
    register : str or None
        Address.
    options : RunOptions
        Of each run.
    start : callable, optional
        Makes an order a run that goes on.

    Attributes
    ----------
    probe_lock : asyncio.Lock
        Locked while the devices are asked who they are: no run begins then.
    """

    def __init__(
        self,
        plans: Plans,
        runs: Runs,
        choice: DeviceCatalogue,
        register: str | None = None,
        options: RunOptions = DEFAULT_OPTIONS,
        start: Callable[[RunRequest], RunProcess] = RunProcess,
    ):
        self.probe_lock = asyncio.Lock()
        self.plans, self.runs, self.choice = plans, runs, choice
        self.people = Viewers()
        self._stop_executor = ThreadPoolExecutor(1, "stop")
        self._register, self._options, self._start = register, options, start
        self.run_process: RunProcess | None = None
        self._end_published = False
        self._history: MessageHistory | None = None
        self._relay_task: asyncio.Task[None] | None = None

    @property
    def is_run_active(self) -> bool:
        """Whether a run goes on; one that has told its end does not, though its process may."""
        return self.run_process is not None and not self._end_published

    def add_viewer(self, version: str, browser: str | None, tab: str | None = None) -> Viewer:
        """Take a viewer in, and tell how the run stands, then what was before."""
        viewer = self.people.add_viewer(browser, tab)
        viewer.send("hello", _message_text("hello", version=version))
        self._broadcast_viewers()
        if self._history is None:
            viewer.send("idle", _message_text("idle"))
        else:
            for kind, text in self._history.present():
                viewer.send(kind, text)
            viewer.send_history(self._history.past())
        return viewer

    def remove_viewer(self, viewer: Viewer) -> None:
        """Let a viewer go; an operator's place is nobody's after a while, and then all know it."""
        operated = self.people.is_operator(viewer)
        self.people.remove_viewer(viewer)
        self._broadcast_viewers()
        if operated:
            asyncio.get_running_loop().call_later(
                OPERATOR_GRACE + _TIMER_MARGIN, self._broadcast_viewers
            )

    async def execute(self, viewer: Viewer, asked: JsonObject) -> None:
        """Do what a viewer asks.

        Raises
        ------
        InputError
            Why not, in words.
        """
        if asked.get("do") not in COMMANDS:
            raise InputError(f'say {{"do": …}}; possible: {", ".join(COMMANDS)}')
        what: str = asked["do"]
        if what in _OPERATOR_COMMANDS and not self.people.is_operator(viewer):
            raise InputError(f"{what!r} is the operator's; become operator first")
        match what:
            case "operate":
                if (words := self.people.take_seat(viewer, asked.get("name"))) is not None:
                    raise InputError(words)
                self._broadcast_viewers()
            case "leave":
                if self.people.leave_seat(viewer):
                    self._broadcast_viewers()
            case "stop":
                await self.stop(asked.get("run"))
            case "start":
                await self._start_run(asked)
            case "resume":
                await self._resume_run(asked)
            case "put away":
                if self.is_run_active:
                    raise InputError("the run goes on")
                self._dismiss_run()
            case "note":
                text = _printable_line(asked.get("text"), _MAX_NOTE)
                if text is None:
                    raise InputError(f"a note has 1 to {_MAX_NOTE} characters", key="text")
                self._send_to_run(f"{NOTE}{self.people.operator}: {text}")
            case "mounted":
                number = asked.get("number")
                if not isinstance(number, int) or isinstance(number, bool):
                    raise InputError(
                        f"number {number!r} is not that of the step that waits for a mounting",
                        key="number",
                    )
                self._send_to_run(f"{MOUNTED}{number} {self.people.operator}")
            case _:
                self._send_to_run(what)

    def _send_to_run(self, line: str) -> None:
        run_process = self.run_process if self.is_run_active else None
        if run_process is None or not run_process.send_line(line):
            raise InputError("no run goes on")

    async def stop(self, name: object = None) -> None:
        """Have the table stopped: at once of the run that is shown, else of one without a page.

        Raises
        ------
        InputError
            No run goes on, or one does that this server cannot reach.
        """
        if self.run_process is not None and name in (None, self.run_process.order.name):
            self.run_process.stop()
            return
        # All journals are opened to find it: meanwhile the loop hears others, their stop too. The
        # thread is its own: others may wait for a register.
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(self._stop_executor, self._stop_external_run, name)

    async def require_no_active_run(self) -> Mapping[str, StoredRun]:
        """Return the runs there are.

        Raises
        ------
        InputError
            One of them goes on, here or without this page.
        """
        runs = await asyncio.to_thread(self.runs.all)
        if self.run_process is not None:
            raise InputError("a run goes on")
        if name := next((n for n, one in runs.items() if one.state == "running"), None):
            raise InputError(f"the run {name} continues without this page: stop it, or wait")
        return runs

    async def wait_until_idle(self, patience: float | None = None) -> None:
        """Return when no run goes on any more, or after `patience` s."""
        if self._relay_task is not None:
            await asyncio.wait([self._relay_task], timeout=patience)

    def _stop_external_run(self, name: object) -> None:
        """Have a run stopped that is not shown."""
        runs = self.runs.all().items()
        there = [one for key, one in runs if one.state == "running" and name in (None, key)]
        if not there:
            raise InputError("no run goes on")
        reached = [_interrupt_process(one.path) for one in there]
        if not all(reached):
            raise InputError("a terminal drives it: stop it there, or by the emergency stop")

    async def _start_run(self, asked: JsonObject) -> None:
        """Begin a run as asked."""
        chosen = self.choice.chosen(asked.get("table"), asked.get("imu"))
        plans = await asyncio.to_thread(self.plans.all)
        await self._require_idle()
        name = asked.get("plan")
        plan = plans.get(name) if isinstance(name, str) else None
        if plan is None:
            raise InputError(f"no plan {name!r}; look at the list again")
        if plan.summary["trouble"]:
            raise InputError(plan.summary["trouble"])
        await asyncio.to_thread(require_filter_changes, plan, filter_changes(asked.get("filter")))
        _require_room(self.runs.folder, plan.summary["bytes"])
        self._launch_process(
            self._run_request(
                _new_run_folder(self.runs.folder, plan.path.stem), chosen, asked, plan.path
            )
        )

    async def _resume_run(self, asked: JsonObject) -> None:
        """Go on with an interrupted run as asked."""
        runs = await self._require_idle()
        name = asked.get("run")
        run = runs.get(name) if isinstance(name, str) else None
        if run is None or run.state not in ("interrupted", "carried out"):
            raise InputError(f"no interrupted run {name!r}; look at the list again")
        table, imu = asked.get("table"), asked.get("imu")
        as_before = table is None and imu is None
        chosen = ChosenDevices("", "") if as_before else self.choice.chosen(table, imu)
        self._launch_process(self._run_request(run.path, chosen, asked, None))

    async def _require_idle(self) -> Mapping[str, StoredRun]:
        """Return the runs there are, none of which goes on, while nobody asks the devices."""
        if self._end_published:
            await self.wait_until_idle(_EXIT_TIMEOUT)
        runs = await self.require_no_active_run()
        if self.probe_lock.locked():
            raise InputError("the devices are being probed: start when the probe has ended")
        return runs

    def _run_request(
        self, folder: Path, chosen: ChosenDevices, asked: JsonObject, plan: Path | None
    ) -> RunRequest:
        sensor = asked.get("sensor") if plan is not None else None
        if sensor is not None and (sensor := _printable_line(sensor, _MAX_NAME)) is None:
            raise InputError(f"sensor: give a name of 1 to {_MAX_NAME} characters", key="sensor")
        return RunRequest(
            str(folder.absolute()),
            None if plan is None else str(plan.absolute()),
            sensor,
            self.people.operator or "",
            *chosen,
            crc32(folder.name.encode()),  # another bench for another run
            self._options.speed,
            self._register,
            self._options.temperature,
            self._options.patience,
            _ambient_temperature(asked.get("ambient")),
            None if plan is None else filter_changes(asked.get("filter")),
        )

    def _launch_process(self, order: RunRequest) -> None:
        try:
            self.run_process = self._start(order)
        except OSError as error:
            raise InputError(f"the run's process cannot be started: {error.strerror}") from None
        self._history, self._end_published = MessageHistory(), False
        # The process takes seconds before it tells anything itself.
        starts = _message_text("phase", run=order.name, words="starting the run's process")
        self._history.add_message("phase", starts)
        self._broadcast("phase", starts)
        self._relay_task = asyncio.create_task(self._relay(self.run_process, self._history))

    async def _relay(self, run_process: RunProcess, kept: MessageHistory) -> None:
        """Hand on what a run tells, until it tells no more."""
        async for kind, text in run_process.messages():
            self._end_published |= kind == "done"
            kept.add_message(kind, text)
            self._broadcast(kind, text)
        status = await run_process.wait_for_exit()
        self.run_process = None
        if not self._end_published:
            since = (
                "; the watchdog brings the table to rest, and the run can be resumed"
                if run_process.order.is_resumable
                else " before anything moved"
            )
            words = f"the run's process has ended (status {status}){since}"
            text = _message_text("done", **premature_end_message(run_process.order, words))
            kept.add_message("done", text)
            self._broadcast("done", text)

    def _dismiss_run(self) -> None:
        self._history = None
        self._broadcast("idle", _message_text("idle"))

    def _broadcast(self, kind: str, text: str) -> None:
        urgent = kind != "event" or is_alarm(text)
        for viewer in self.people.viewers.values():
            viewer.send(kind, text, urgent=urgent)

    def _broadcast_viewers(self) -> None:
        people = self.people
        for viewer in people.viewers.values():
            yours, count = people.is_operator(viewer), len(people.viewers)
            operator = people.operator
            text = _message_text("people", viewers=count, operator=operator, yours=yours)
            viewer.send("people", text)


def _interrupt_process(folder: Path) -> bool:
    """Have the process of a page's run in a folder stop it; False where there is none."""
    # A note that nobody has locked is an old one, its process another's by now.
    was = read_process_record(folder) if is_locked(folder / PROCESS_RECORD) else None
    if was is None:
        return False
    try:
        kill(was.process, signal.SIGINT)
    except ProcessLookupError:
        pass  # it has ended meanwhile
    except PermissionError:
        return False
    return True


def _new_run_folder(runs: Path, stem: str) -> Path:
    """Return a new name for a folder."""
    name = f"{stem}-{datetime.now():%Y%m%d-%H%M%S}"
    result, count = runs / name, 1
    while result.exists():
        count += 1
        result = runs / f"{name}-{count}"
    return result


def free_space(folder: Path) -> int:
    """Return the bytes that are free on the disk of a folder."""
    return shutil.disk_usage(folder).free


def _require_room(folder: Path, needed: int) -> None:
    """Refuse a run that the disk has no room for: it would end when the disk is full."""
    if (free := free_space(folder)) < needed:
        raise InputError(
            f"{folder}: the run needs about {needed / 1e6:.0f} MB, and {free / 1e6:.0f} MB are "
            "free: make room, or serve another folder by --runs",
            file=folder,
        )


def _printable_line(text: object, most: int) -> str | None:
    """Return a text that somebody typed, without spaces around it; None where it is none."""
    if not isinstance(text, str) or not text.isprintable():
        return None
    return text.strip() if 0 < len(text.strip()) <= most else None


def _ambient_temperature(asked: object) -> float | None:
    low, high = _AMBIENT_RANGE
    if asked is None:
        return None
    if not isinstance(asked, (int, float)) or isinstance(asked, bool) or not low <= asked <= high:
        raise InputError(
            f"the ambient temperature must be a number from {low:g} to {high:g} °C", key="ambient"
        )
    return float(asked)


def _message_text(kind: str, **content: object) -> str:
    return json.dumps({"kind": kind, **content}, ensure_ascii=False)
