"""The hub connects the active run with its viewers, and checks and executes their requests."""

import asyncio
import json
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from zlib import crc32

from inercal.basics.errors import InputError
from inercal.host.manual.commands import HaltCommand, ManualCommand, ReleaseCommand, parse_command
from inercal.host.tasks import DEFAULT_OPTIONS, RunOptions
from inercal.host.web import folders, run_request, viewers
from inercal.host.web.device_catalogue import ChosenDevices, DeviceCatalogue
from inercal.host.web.interface import COMMANDS
from inercal.host.web.json_objects import (
    JsonObject,
    ambient_temperature,
    object_or_none,
    printable_line,
)
from inercal.host.web.message_history import MessageHistory, ReceivedMessage, is_alarm
from inercal.host.web.run_request import RunProcess

_MAX_NAME = 80  # largest number of characters of a sensor's name
_EXIT_TIMEOUT = 15.0  # s; a process must exit in this time after its end message
_TIMER_MARGIN = 0.1  # s; a timer may fire too early by this time
_MAX_NOTE = 400  # largest number of characters of a note


class Hub:
    """The server's state, except for its connections.

    Parameters
    ----------
    plans : Plans
    runs : Runs
    choice : DeviceCatalogue
    register : str or None
        Address of the register.
    options : RunOptions
        Options of each run.
    start : callable, optional
        Function that starts the process for a run or a manual session.

    Attributes
    ----------
    probe_lock : asyncio.Lock
        Lock that is held while devices are probed, because no run may begin during this time.
    """

    def __init__(
        self,
        plans: folders.Plans,
        runs: folders.Runs,
        choice: DeviceCatalogue,
        register: str | None = None,
        options: RunOptions = DEFAULT_OPTIONS,
        start: Callable[[Any], RunProcess] = RunProcess,
    ):
        self.probe_lock = asyncio.Lock()
        self.plans, self.runs, self.choice = plans, runs, choice
        self.people = viewers.Viewers()
        self._stop_executor = ThreadPoolExecutor(1, "stop")
        self._register, self._options = register, options
        self._start = start
        self.run_process: RunProcess | None = None
        self._end_published = False
        self._history: MessageHistory | None = None
        self._relay_task: asyncio.Task[None] | None = None

    @property
    def is_run_active(self) -> bool:
        """Whether a run is active; it ends with its end message, even if the process still runs."""
        return self.run_process is not None and not self._end_published

    def latest(self, kind: str) -> ReceivedMessage | None:
        """Return the latest message of this kind about the displayed run, or None."""
        return None if self._history is None else self._history.latest(kind)

    def add_viewer(
        self, version: str, browser: str, tab: str | None, client: viewers.Client
    ) -> viewers.Viewer | None:
        """Add a viewer; send it the current state of the run, and then the history of the run.

        Returns None if no place is free.
        """
        if not self.people.make_place(client):
            return None
        viewer = self.people.add_viewer(browser, tab, client)
        viewer.send("hello", _message_text("hello", version=version))
        self._broadcast_viewers()
        if self._history is None:
            viewer.send("idle", _message_text("idle"))
        else:
            for kind, text in self._history.present():
                viewer.send(kind, text)
            viewer.send_history(self._history.past())
        return viewer

    def remove_viewer(self, viewer: viewers.Viewer) -> None:
        """Remove a viewer; an operator's place becomes free later, and all viewers learn this."""
        operated = self.people.is_operator(viewer)
        if operated:
            self._halt_manual("the operator's page is gone")
        self.people.remove_viewer(viewer)
        self._broadcast_viewers()
        if operated:
            asyncio.get_running_loop().call_later(
                viewers.OPERATOR_GRACE + _TIMER_MARGIN, self._broadcast_viewers
            )

    async def execute(self, viewer: viewers.Viewer, asked: JsonObject) -> None:
        """Execute a viewer's request.

        Raises
        ------
        InputError
            The request is refused. The message states the reason.
        """
        what = asked.get("do")
        if not isinstance(what, str) or what not in COMMANDS:
            raise InputError(
                f'the request has no known command in "do"; possible: {", ".join(COMMANDS)}'
            )
        if not COMMANDS[what].everyone and not self.people.is_operator(viewer):
            raise InputError(f"only the operator may send {what!r}; become operator first")
        match what:
            case "operate":
                if (words := self.people.take_seat(viewer, asked.get("name"))) is not None:
                    raise InputError(words)
                self._broadcast_viewers()
            case "leave":
                if self.people.is_operator(viewer):
                    self._halt_manual("the operator has released control")
                if self.people.leave_seat(viewer):
                    self._broadcast_viewers()
            case "stop":
                await self.stop(asked.get("run"))
            case "start":
                await self._start_run(asked)
            case "resume":
                await self._resume_run(asked)
            case "begin manual":
                await self._begin_manual(asked)
            case "manual":
                self._send_manual(parse_command(object_or_none(asked.get("ask")) or {}))
            case "release":
                everything = asked.get("all") is True
                self._send_manual(HaltCommand() if everything else ReleaseCommand())
            case "put away":
                if self.is_run_active:
                    raise InputError(
                        "the run is still active; stop it, or wait until it has ended, before you "
                        "close its view"
                    )
                self._history = None
                self._broadcast("idle", _message_text("idle"))
            case "note":
                text = printable_line(asked.get("text"), _MAX_NOTE)
                if text is None:
                    raise InputError(
                        f"the note is empty or too long; write 1 to {_MAX_NOTE} printable "
                        "characters",
                        key="text",
                    )
                self._send_to_run(f"{run_request.NOTE}{self.people.operator}: {text}")
            case "mounted":
                self._confirm_mounting(asked)
            case _:
                self._send_to_run(what)

    def _confirm_mounting(self, asked: JsonObject) -> None:
        number, mounting = asked.get("number"), asked.get("mounting")
        if not isinstance(number, int) or isinstance(number, bool):
            raise InputError(
                f"number {str(number)[:40]!r} is not that of the mounting for which the run waits; "
                "send the number and the mounting as the run states them",
                key="number",
            )
        if printable_line(mounting, _MAX_NAME) is None:
            raise InputError(
                "the confirmation names no mounting; send the number and the mounting of the "
                "request",
                key="mounting",
            )
        self._send_to_run(
            run_request.mounted_line(number, str(mounting), self.people.operator or "")
        )

    def _send_manual(self, command: ManualCommand) -> None:
        if not self._is_manual:
            raise InputError("no manual session is active; start one first")
        self._send_to_run(run_request.manual_line(self.people.operator or "", command))

    def _halt_manual(self, why: str) -> None:
        """Stop all axes in a manual session, because it no longer has an operator."""
        if self._is_manual and self.run_process is not None:
            self.run_process.send_line(f"{run_request.HALT}{why}")

    @property
    def _is_manual(self) -> bool:
        run_process = self.run_process if self.is_run_active else None
        return run_process is not None and isinstance(run_process.order, run_request.ManualRequest)

    def _send_to_run(self, line: str) -> None:
        if self._is_manual and line in ("pause", "go on"):
            raise InputError("no run is active: the table is under manual control")
        run_process = self.run_process if self.is_run_active else None
        if run_process is None or not run_process.send_line(line):
            raise InputError("no run is active; start or resume a run first")

    async def stop(self, name: object = None) -> None:
        """Stop the table at once, in the active run or in a run outside this page.

        Raises
        ------
        InputError
            No run is active, or this server cannot reach the run.
        """
        if self.run_process is not None and name in (None, self.run_process.order.name):
            self.run_process.stop()
            return
        # To find the run, all journals must be opened. Meanwhile, the event loop serves other
        # viewers, who may also stop the table. A separate thread is used, because the other threads
        # may be waiting for a register.
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(self._stop_executor, self.runs.stop, name)

    async def require_no_active_run(self) -> Mapping[str, folders.StoredRun]:
        """Return the stored runs.

        Raises
        ------
        InputError
            A stored run is active, on this page or elsewhere.
        """
        runs = await asyncio.to_thread(self.runs.all)
        if self.run_process is not None:
            if isinstance(self.run_process.order, run_request.ManualRequest):
                raise InputError(
                    "the table is under manual control; end that session before you start a run"
                )
            raise InputError("another run is active; stop it, or wait until it has ended")
        if sessions := await asyncio.to_thread(self.runs.manual_sessions):
            raise InputError(
                f"manual session {sessions[0].name} has not ended yet; stop it, or wait"
            )
        if name := next((n for n, one in runs.items() if one.state == "running"), None):
            raise InputError(
                f"run {name} is active outside this page; stop it, or wait until it has ended"
            )
        return runs

    async def wait_until_idle(self, patience: float | None = None) -> None:
        """Wait until no run is active, or for `patience` s."""
        if self._relay_task is not None:
            await asyncio.wait([self._relay_task], timeout=patience)

    async def _choose(self, asked: JsonObject) -> tuple[ChosenDevices, folders.Plan]:
        """Return the devices and the plan in a request, after checking that nothing is active."""
        chosen = self.choice.chosen(asked.get("table"), asked.get("imu"))
        plan = await asyncio.to_thread(self.plans.get, asked.get("plan"))
        await self._require_idle()
        if plan is None:
            raise InputError(
                f"this server has no plan {asked.get('plan')!r}; reload the page and choose from "
                "its list"
            )
        if plan.summary["trouble"]:
            raise InputError(plan.summary["trouble"])
        return chosen, plan

    async def _start_run(self, asked: JsonObject) -> None:
        """Start a run as requested."""
        chosen, plan = await self._choose(asked)
        changes = folders.filter_changes(asked.get("filter"))
        await asyncio.to_thread(folders.require_filter_changes, plan, changes)
        self.runs.require_room(plan.summary["bytes"])
        self._launch(
            self._run_request(self.runs.new_folder(plan.path.stem), chosen, asked, plan.path)
        )

    async def _begin_manual(self, asked: JsonObject) -> None:
        """Start a manual session within the limits of a plan's [bench]."""
        chosen, plan = await self._choose(asked)
        folder = self.runs.new_folder("manual")
        with_imu = asked.get("with_imu") is True
        table, imu, clock, simulated = chosen
        order = run_request.ManualRequest(
            str(folder.absolute()), self.people.operator or "", table, imu if with_imu else "",
            clock, simulated, crc32(folder.name.encode()), with_imu, plan=str(plan.path.absolute()),
        )  # fmt: skip
        self._launch(order)

    async def _resume_run(self, asked: JsonObject) -> None:
        """Resume an interrupted run as requested."""
        runs = await self._require_idle()
        name = asked.get("run")
        run = runs.get(name) if isinstance(name, str) else None
        if run is None or run.state not in ("interrupted", "carried out"):
            raise InputError(
                f"this server has no interrupted run {name!r}; reload the page and choose from "
                "its list"
            )
        table, imu = asked.get("table"), asked.get("imu")
        as_before = table is None and imu is None
        chosen = ChosenDevices("", "") if as_before else self.choice.chosen(table, imu)
        self._launch(self._run_request(run.path, chosen, asked, None))

    async def _require_idle(self) -> Mapping[str, folders.StoredRun]:
        """Return the stored runs, after checking that no run and no probe is active."""
        if self._end_published:
            await self.wait_until_idle(_EXIT_TIMEOUT)
        runs = await self.require_no_active_run()
        if self.probe_lock.locked():
            raise InputError(
                "the devices are still being probed; start the run when the probe has ended"
            )
        return runs

    def _run_request(
        self, folder: Path, chosen: ChosenDevices, asked: JsonObject, plan: Path | None
    ) -> run_request.RunRequest:
        sensor = asked.get("sensor") if plan is not None else None
        if sensor is not None and (sensor := printable_line(sensor, _MAX_NAME)) is None:
            raise InputError(
                f"the sensor name is empty or too long; give 1 to {_MAX_NAME} printable characters",
                key="sensor",
            )
        return run_request.RunRequest(
            str(folder.absolute()),
            self.people.operator or "",
            *chosen,
            crc32(folder.name.encode()),  # a different simulated bench for each run
            None if plan is None else str(plan.absolute()),
            sensor,
            self._register,
            self._options,
            ambient_temperature(asked.get("ambient")),
            None if plan is None else folders.filter_changes(asked.get("filter")),
        )

    def _launch(self, order: run_request.ProcessRequest) -> None:
        try:
            self.run_process = self._start(order)
        except OSError as error:
            raise InputError(
                f"the operating system cannot start the process of the run: {error.strerror}; "
                "free memory or disk space, then start again"
            ) from None
        is_manual = isinstance(order, run_request.ManualRequest)
        self._history, self._end_published = MessageHistory(keeps_trend=is_manual), False
        # The process needs seconds before it sends its first message.
        starts = _message_text("phase", run=order.name, words="starting the run's process")
        self._history.add_message("phase", starts)
        self._broadcast("phase", starts)
        self._relay_task = asyncio.create_task(self._relay(self.run_process, self._history))

    async def _relay(self, run_process: RunProcess, kept: MessageHistory) -> None:
        """Relay the messages of a run until its end."""
        async for kind, text in run_process.messages():
            self._end_published |= kind == "done"
            kept.add_message(kind, text)
            self._broadcast(kind, text)
        status = await run_process.wait_for_exit()
        self.run_process = None
        if not self._end_published:
            since = run_process.order.loss_text
            words = f"the run's process has ended (status {status}){since}"
            text = _message_text(
                "done", **run_request.premature_end_message(run_process.order, words)
            )
            kept.add_message("done", text)
            self._broadcast("done", text)

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


def _message_text(kind: str, **content: object) -> str:
    return json.dumps({"kind": kind, **content}, ensure_ascii=False)
