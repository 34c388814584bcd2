"""Terminal display for a run on a bench, with keys to pause and continue it."""

import os
import sys
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, nullcontext
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.text import Text

from inercal.basics.keys import CoefficientName
from inercal.basics.process_settings import user_name
from inercal.basics.units import format_value_and_uncertainty
from inercal.cli.console import make_table
from inercal.cli.mounting_answers import WORD, TypedConfirmation, answer_mountings
from inercal.cli.terminal import Visible, terminal

if TYPE_CHECKING:
    from inercal.host.bench_run import BenchRun

_POLL_INTERVAL = 0.2  # s
_COLOURS = {"info": "default", "warning": "yellow", "alarm": "bold red"}
KEY_HELP, STOP_HELP = "p: pause · g: continue · Ctrl-C: stop", "Ctrl-C: stop"


@contextmanager
def run_display(
    keys: str = KEY_HELP, typed: TypedConfirmation | None = None
) -> Generator[Callable[["BenchRun"], None]]:
    """Yield a function that shows a run on standard error, as a panel or as event lines.

    A terminal shows the panel; other outputs get the event lines. `keys` is the line in the panel
    that explains the keys, and `typed` returns the text that is being typed.
    """
    console = terminal(stderr=True, highlight=False)
    if not console.is_terminal:
        printed = 0

        def print_new_events(run: "BenchRun") -> None:
            nonlocal printed
            recent = list(run.recorder.recent_messages)
            fresh = min(run.recorder.events - printed, len(recent))
            for level, words in recent[len(recent) - fresh :]:
                line = f"{run.time:8.1f} s  {level:7}  {words}"
                console.print(line, soft_wrap=True)
            printed = run.recorder.events

        yield print_new_events
        return
    with Live(console=console, auto_refresh=False, transient=True) as live:

        def draw(run: "BenchRun") -> None:
            live.update(Visible(run_panel(run, keys, typed.text if typed else "")), refresh=True)

        yield draw


def run_panel(run: "BenchRun", keys: str = KEY_HELP, typed: str = "") -> RenderableType:
    """Return the panel for a run: progress, axes, IMU, estimate, messages and keys."""
    head = Text(_progress_line(run), style="bold")
    heads = ("axis", ">angle", ">rate", ">following error", "")
    axes = make_table(*heads, box=None, padding=(0, 2, 0, 0))
    if run.state is not None:
        for name, axis in zip(run.axes, run.state.axes, strict=True):
            axes.add_row(
                name,
                f"{degrees(axis.angle):.4f} °",
                f"{degrees(axis.rate):.3f} °/s",
                f"{3600 * degrees(axis.following_error):.1f} ″",
                axis.status_text,
            )
    messages = Text()
    for level, words in run.recorder.recent_messages:
        messages.append(f"{words}\n", style=_COLOURS[level])
    assembly = run.recorder.assembly
    counts = assembly.imu.counts
    imu = (
        f"IMU: {counts.packets} packets, {counts.lost} lost, {counts.failed} checksum errors, "
        f"{counts.discarded} bytes discarded; {assembly.samples} samples with an angle, "
        f"{assembly.samples_without_angle} without"
    )
    mounting: list[RenderableType] = []
    if (request := run.mounting_request) is not None:
        words = f"{request.instruction}; then type {WORD} {request.mounting} and Enter"
        mounting = [Text(words, style="bold yellow"), Text(f"> {typed}_")]
    chamber = [Text(run.soaks.progress)] if run.soaks is not None else []
    parts = [head, *chamber, *mounting, axes, Text(imu), *_live_estimate(run), messages]
    return Panel(Group(*parts, Text(keys, style="dim")), title=run.name)


def _progress_line(run: "BenchRun") -> str:
    result, task = run.sequencer, run.sequencer.task
    left = result.remaining_time(run.state.time) if run.state is not None else 0.0
    where = f"step {result.number + 1} of {len(run.tasks)}: {task.label}, " if task else ""
    what = f"paused: {run.pause_reason}" if run.pause_reason else result.phase
    return (
        f"{where}{what} · {_clock_text(run.time)} elapsed, {_clock_text(left)} left"
        f"{f' · {run.speed:.0f} × real time' if run.speed > 1.5 else ''}"
    )


def _clock_text(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


def _live_estimate(run: "BenchRun") -> list[RenderableType]:
    """Return the attitude of the IMU and the current estimate."""
    live = run.recorder.live_estimator
    if live is None:
        return []
    if not live.has_estimate:
        return [Text("no estimate yet: the method needs more samples")]
    result: list[RenderableType] = []
    if (at := run.recorder.navigation) is not None:
        result.append(Text(
            f"attitude: roll {at.roll:.3f} °, pitch {at.pitch:.3f} °, heading {at.heading:.3f}"
            " °; error relative to the table "
            + " ".join(f"{x:+.1f} ″" for x in at.rotation_error)
            + "; velocity " + " ".join(f"{v:+.3f}" for v in at.velocity) + " m/s"
        ))  # fmt: skip
    values: dict[str, tuple[float, float]] = {
        name: (v, u) for name, v, u in zip(live.names, live.values, live.std, strict=True)
    }
    for kind in ("f", "w"):
        part = run.sensor.select_axes(kind)
        if not part.coefficients:
            continue
        heads = (f">{axis.name}" for axis in part.axes)
        table = make_table("", *heads, "", box=None, padding=(0, 2, 0, 0))
        for own in dict.fromkeys(CoefficientName(name).term for name in part.coefficients):
            cells = [_coefficient_cell(run, f"{axis.name}.{own}", values) for axis in part.axes]
            unit = part.coefficient(f"{part.axes[0].name}.{own}").unit
            table.add_row(own, *cells, f"{unit} (± is k = 2)")
        result.append(table)
    return result


def _coefficient_cell(
    run: "BenchRun", name: str, values: "Mapping[str, tuple[float, float]]"
) -> str:
    if name not in values:
        return ""
    value, std = values[name]
    size = run.sensor.coefficient(name).si
    return " ± ".join(format_value_and_uncertainty(value / size, 2 * std / size))


@contextmanager
def listen_to_keys(
    run: "BenchRun",
    operator: str = "",
    answers: Path | None = None,
    typed: TypedConfirmation | None = None,
) -> Generator[None]:
    """Listen to the operator of a run: keys in a terminal, otherwise lines of standard input.

    The key p pauses the run and the key g continues it. A line confirms the requested mounting,
    unless an answer file does so.
    """
    operator = operator or user_name()
    if not sys.stdin.isatty():
        with answer_mountings(run, operator, answers) if run.has_mountings else nullcontext():
            yield
        return
    if answers is not None:
        with answer_mountings(run, operator, answers), listen_to_keys(run, operator, typed=typed):
            yield
        return
    import termios
    import tty
    from codecs import getincrementaldecoder
    from select import select
    from threading import Lock, Thread

    ended, line = False, typed or TypedConfirmation()
    terminal, decoder = sys.stdin.fileno(), getincrementaldecoder("utf-8")("replace")
    lock = Lock()

    def take_waiting() -> bool:
        """Process the characters typed so far, and return False if the terminal has closed."""
        with lock:
            while select([terminal], [], [], 0)[0]:
                # sys.stdin is not used, because it buffers waiting bytes, which select then does
                # not see.
                try:
                    data = os.read(terminal, 64)
                except OSError:  # the terminal was closed
                    data = b""
                if not data:
                    return False
                for key in decoder.decode(data):
                    if run.has_mountings and line.take(key, run, operator):
                        continue
                    if key == "p":
                        run.request("pause")
                    elif key == "g":
                        run.request("go on")
        return True

    def listen() -> None:
        while not ended:
            if select([terminal], [], [], _POLL_INTERVAL)[0] and not take_waiting():
                return

    # Text that is read before a request is published cannot confirm it.
    run.call_before_request(take_waiting)
    before = termios.tcgetattr(sys.stdin)
    # Ctrl-C remains a signal, which the watchdog also receives.
    tty.setcbreak(sys.stdin)
    thread = Thread(target=listen, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended = True
        thread.join()
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
