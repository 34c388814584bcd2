"""The run that is shown, and those to whom: what they ask for is judged and done here."""

import asyncio
import json
import signal
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from os import kill
from pathlib import Path
from zlib import crc32

from inercal.errors import InputError
from inercal.host.log import driven
from inercal.host.options import ORDINARY, Options
from inercal.host.web.choice import Choice, Chosen
from inercal.host.web.message_history import MessageHistory
from inercal.host.web.order import NOTE, RunRequest, cut_short, noted
from inercal.host.web.plans import Plans
from inercal.host.web.requests import Asked
from inercal.host.web.run_process import RunProcess
from inercal.host.web.runs import Runs, RunThere
from inercal.host.web.viewers import GONE, Viewer, Viewers

_NAME = 80  # characters of a sensor's name
_ENDING = 15.0  # s that a process may take to end that has told its end
_SURELY = 0.1  # s: a timer may be that early
_COMMANDS = ("pause", "go on", "abort")
_OF_OPERATOR = (*_COMMANDS, "start", "resume", "put away")
POSSIBLE = ("operate", "leave", "stop", *_OF_OPERATOR)


class Hub:
    """What the server has beside its connections.

    Parameters
    ----------
    plans : Plans
    runs : Runs
    choice : Choice
    register : str or None
        Address.
    options : Options
        Of each run.
    start : callable, optional
        Makes an order a run that goes on.

    Attributes
    ----------
    probing : asyncio.Lock
        Locked while the devices are asked who they are: no run begins then.
    """

    def __init__(
        self,
        plans: Plans,
        runs: Runs,
        choice: Choice,
        register: str | None = None,
        options: Options = ORDINARY,
        start: Callable[[RunRequest], RunProcess] = RunProcess,
    ):
        self.probing = asyncio.Lock()
        self.plans, self.runs, self.choice = plans, runs, choice
        self.people = Viewers()
        self._stopping = ThreadPoolExecutor(1, "stop")
        self._register, self._options, self._start = register, options, start
        self.going: RunProcess | None = None
        self._has_told_its_end = False
        self._kept: MessageHistory | None = None
        self._relaying: asyncio.Task[None] | None = None

    @property
    def goes_on(self) -> bool:
        """Whether a run goes on; one that has told its end does not, though its process may."""
        return self.going is not None and not self._has_told_its_end

    def come(self, version: str, browser: str | None) -> Viewer:
        """Take a viewer in, and tell what there is to tell."""
        viewer = self.people.come(browser)
        viewer.send("hello", _text("hello", version=version))
        self._tell_people()
        if self._kept is None:
            viewer.send("idle", _text("idle"))
        else:
            for text in self._kept.all():
                viewer.send("kept", text)
        return viewer

    def go(self, viewer: Viewer) -> None:
        """Let a viewer go; an operator's place is nobody's after a while, and then all know it."""
        operated = self.people.operates(viewer)
        self.people.go(viewer)
        self._tell_people()
        if operated:
            asyncio.get_running_loop().call_later(GONE + _SURELY, self._tell_people)

    async def do(self, viewer: Viewer, asked: Asked) -> None:
        """Do what a viewer asks.

        Raises
        ------
        InputError
            Why not, in words.
        """
        if asked.get("do") not in POSSIBLE:
            raise InputError(f'say {{"do": …}}; possible: {", ".join(POSSIBLE)}')
        what: str = asked["do"]
        if what in _OF_OPERATOR and not self.people.operates(viewer):
            raise InputError(f"{what!r} is the operator's; become operator first")
        match what:
            case "operate":
                if (words := self.people.take_seat(viewer, asked.get("name"))) is not None:
                    raise InputError(words)
                self._tell_people()
            case "leave":
                if self.people.leave_seat(viewer):
                    self._tell_people()
            case "stop":
                await self.stop(asked.get("run"))
            case "start":
                await self._begin(asked)
            case "resume":
                await self._resume(asked)
            case "put away":
                if self.goes_on:
                    raise InputError("the run goes on")
                self._put_away()
            case _:
                if not self.goes_on or self.going is None or not self.going.tell(what):
                    raise InputError("no run goes on")

    async def stop(self, name: object = None) -> None:
        """Have the table stopped: at once of the run that is shown, else of one without a page.

        Raises
        ------
        InputError
            No run goes on, or one does that this server cannot reach.
        """
        if self.going is not None and name in (None, self.going.order.name):
            self.going.stop()
            return
        # All journals are opened to find it: meanwhile the loop hears others, their stop too. The
        # thread is its own: others may wait for a register.
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(self._stopping, self._stop_elsewhere, name)

    async def none_goes_on(self) -> Mapping[str, RunThere]:
        """Return the runs there are.

        Raises
        ------
        InputError
            One of them goes on, here or without this page.
        """
        runs = await asyncio.to_thread(self.runs.all)
        if self.going is not None:
            raise InputError("a run goes on")
        if name := next((n for n, one in runs.items() if one.state == "running"), None):
            raise InputError(f"the run {name} goes on, without this page: stop it, or wait")
        return runs

    async def over(self, patience: float | None = None) -> None:
        """Return when no run goes on any more, or after `patience` s."""
        if self._relaying is not None:
            await asyncio.wait([self._relaying], timeout=patience)

    def _stop_elsewhere(self, name: object) -> None:
        """Have a run stopped that is not shown."""
        runs = self.runs.all().items()
        there = [one for key, one in runs if one.state == "running" and name in (None, key)]
        if not there:
            raise InputError("no run goes on")
        reached = [_interrupted(one.path) for one in there]
        if not all(reached):
            raise InputError("a terminal drives it: stop it there, or by the emergency stop")

    async def _begin(self, asked: Asked) -> None:
        """Begin a run as asked."""
        chosen = self.choice.chosen(asked.get("table"), asked.get("imu"))
        plans = await asyncio.to_thread(self.plans.all)
        await self._require_idle()
        name = asked.get("plan")
        plan = plans.get(name) if isinstance(name, str) else None
        if plan is None:
            raise InputError(f"no plan {name!r}; look at the list again")
        if plan.shown["trouble"]:
            raise InputError(plan.shown["trouble"])
        self._go(self._order(_free(self.runs.folder, plan.path.stem), chosen, asked, plan.path))

    async def _resume(self, asked: Asked) -> None:
        """Go on with an interrupted run as asked."""
        runs = await self._require_idle()
        name = asked.get("run")
        run = runs.get(name) if isinstance(name, str) else None
        if run is None or run.state not in ("interrupted", "carried out"):
            raise InputError(f"no interrupted run {name!r}; look at the list again")
        table, imu = asked.get("table"), asked.get("imu")
        as_before = table is None and imu is None
        chosen = Chosen("", "") if as_before else self.choice.chosen(table, imu)
        self._go(self._order(run.path, chosen, asked, None))

    async def _require_idle(self) -> Mapping[str, RunThere]:
        """Return the runs there are, none of which goes on, while nobody asks the devices."""
        if self._has_told_its_end:
            await self.over(_ENDING)
        runs = await self.none_goes_on()
        if self.probing.locked():
            raise InputError("the devices are being asked: start when they have answered")
        return runs

    def _order(self, folder: Path, chosen: Chosen, asked: Asked, plan: Path | None) -> RunRequest:
        sensor = asked.get("sensor") if plan is not None else None
        if sensor is not None and not _is_name(sensor):
            raise InputError(f"sensor: give a name of 1 to {_NAME} characters")
        return RunRequest(
            str(folder.absolute()),
            None if plan is None else str(plan.absolute()),
            None if sensor is None else sensor.strip(),
            self.people.operator or "",
            *chosen,
            crc32(folder.name.encode()),  # another bench for another run
            self._options.speed,
            self._register,
            self._options.temperature,
            self._options.patience,
        )

    def _go(self, order: RunRequest) -> None:
        try:
            self.going = self._start(order)
        except OSError as error:
            raise InputError(f"the run's process cannot be started: {error.strerror}") from None
        self._kept, self._has_told_its_end = MessageHistory(), False
        # The process takes seconds before it tells anything itself.
        starts = _text("phase", run=order.name, words="starting the run's process")
        self._kept.keep("phase", starts)
        self._tell("phase", starts)
        self._relaying = asyncio.create_task(self._relay(self.going, self._kept))

    async def _relay(self, going: RunProcess, kept: MessageHistory) -> None:
        """Hand on what a run tells, until it tells no more."""
        async for kind, text in going.messages():
            self._has_told_its_end |= kind == "done"
            kept.keep(kind, text)
            self._tell(kind, text)
        status = await going.ended()
        self.going = None
        if not self._has_told_its_end:
            since = (
                "; the watchdog brings the table to rest, and the run can be resumed"
                if going.order.can_go_on
                else " before anything moved"
            )
            words = f"the run's process has ended (status {status}){since}"
            text = _text("done", **cut_short(going.order, words))
            kept.keep("done", text)
            self._tell("done", text)

    def _put_away(self) -> None:
        self._kept = None
        self._tell("idle", _text("idle"))

    def _tell(self, kind: str, text: str) -> None:
        for viewer in self.people.viewers.values():
            viewer.send(kind, text)

    def _tell_people(self) -> None:
        people = self.people
        for viewer in people.viewers.values():
            yours, count = people.operates(viewer), len(people.viewers)
            operator = people.operator
            text = _text("people", viewers=count, operator=operator, yours=yours)
            viewer.send("people", text)


def _interrupted(folder: Path) -> bool:
    """Have the process of a page's run in a folder stop it; False where there is none."""
    # A note that nobody has locked is an old one, its process another's by now.
    was = noted(folder) if driven(folder / NOTE) else None
    if was is None:
        return False
    try:
        kill(was.process, signal.SIGINT)
    except ProcessLookupError:
        pass  # it has ended meanwhile
    except PermissionError:
        return False
    return True


def _free(runs: Path, stem: str) -> Path:
    """Return a new name for a folder."""
    name = f"{stem}-{datetime.now():%Y%m%d-%H%M%S}"
    made, count = runs / name, 1
    while made.exists():
        count += 1
        made = runs / f"{name}-{count}"
    return made


def _is_name(text: object) -> bool:
    return isinstance(text, str) and 0 < len(text.strip()) <= _NAME and text.isprintable()


def _text(kind: str, **content: object) -> str:
    return json.dumps({"kind": kind, **content}, ensure_ascii=False)
