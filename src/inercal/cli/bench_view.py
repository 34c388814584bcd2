"""What a run on a bench looks like in a terminal while it goes on."""

import os
import sys
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from math import degrees
from typing import TYPE_CHECKING

from inercal.cli.show import number
from inercal.keys import CoefficientName

if TYPE_CHECKING:
    from rich.console import RenderableType

    from inercal.host.run import BenchRun

_COLOURS = {"info": "default", "warning": "yellow", "alarm": "bold red"}
KEYS, STOP = "p pause · g go on · Ctrl-C stop", "Ctrl-C stop"


@contextmanager
def viewing(keys: str = KEYS) -> Generator[Callable[["BenchRun"], None]]:
    """Give what shows a run on standard error: a panel on a terminal, else a line an event.

    `keys` is what the panel says of those that are listened to.
    """
    from rich.console import Console
    from rich.live import Live

    class Unseen(Console):
        """A console that a run survives when nobody reads it any more."""

        def on_broken_pipe(self) -> None:
            # Rich ends the program here; what is written from now on goes nowhere.
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, sys.stderr.fileno())
            os.close(nowhere)

    console = Unseen(stderr=True, highlight=False)
    if not console.is_terminal:
        told = 0

        def say(run: "BenchRun") -> None:
            nonlocal told
            fresh = min(run.account.events - told, len(run.account.said))
            for level, words in list(run.account.said)[len(run.account.said) - fresh :]:
                line = f"{run.time:8.1f} s  {level:7}  {words}"
                console.print(line, markup=False, soft_wrap=True)
            told = run.account.events

        yield say
        return
    with Live(console=console, auto_refresh=False, transient=True) as live:

        def draw(run: "BenchRun") -> None:
            live.update(panel(run, keys), refresh=True)

        yield draw


def panel(run: "BenchRun", keys: str = KEYS) -> "RenderableType":
    """Return the picture of a run, with what is said of keys."""
    from rich.console import Group
    from rich.panel import Panel
    from rich.table import Table
    from rich.text import Text

    head = Text(_progress(run), style="bold")
    heads = map(number, ("angle", "rate", "following error"))
    axes = Table("axis", *heads, "", box=None, padding=(0, 2, 0, 0))
    if run.state is not None:
        for name, axis in zip(run.axes, run.state.axes, strict=True):
            axes.add_row(
                name,
                f"{degrees(axis.angle):.4f} °",
                f"{degrees(axis.rate):.3f} °/s",
                f"{3600 * degrees(axis.following_error):.1f} ″",
                axis.words,
            )
    said = Text()
    for level, words in run.account.said:
        said.append(f"{words}\n", style=_COLOURS[level])
    parts = [head, axes, Text(_imu(run)), *_found(run), said, Text(keys, style="dim")]
    return Panel(Group(*parts), title=run.name)


def _progress(run: "BenchRun") -> str:
    made, task = run.sequencer, run.sequencer.task
    left = made.remaining(run.state.time) if run.state is not None else 0.0
    where = f"step {made.number + 1} of {len(run.tasks)}: {task.label}, " if task else ""
    what = f"pauses: {run.paused}" if run.paused else made.phase
    return (
        f"{where}{what} · {_clock(run.time)} gone, {_clock(left)} to go"
        f"{f' · {run.speed:.0f} × real time' if run.speed > 1.5 else ''}"
    )


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


def _imu(run: "BenchRun") -> str:
    tally = run.account.assembly.tally
    counts = tally.bytes
    return (
        f"IMU: {counts.packets} packets, {counts.lost} lost, {counts.failed} with a wrong check, "
        f"{counts.thrown} bytes thrown away; {tally.samples} samples with an angle, "
        f"{tally.no_angle} without"
    )


def _found(run: "BenchRun") -> "list[RenderableType]":
    """Return where the IMU is, and the estimate so far."""
    from rich.table import Table
    from rich.text import Text

    live = run.account.live
    if live is None:
        return []
    if not live.begun:
        return [Text("nothing is estimated yet: the method needs more samples")]
    made: list[RenderableType] = []
    if (at := run.account.navigation) is not None:
        made.append(Text(
            f"attitude: roll {at.roll:.3f} °, pitch {at.pitch:.3f} °, heading {at.heading:.3f} °; "
            "from the table's "
            + " ".join(f"{x:+.1f} ″" for x in at.rotation_error)
            + "; velocity " + " ".join(f"{v:+.3f}" for v in at.velocity) + " m/s"
        ))  # fmt: skip
    values: dict[str, tuple[float, float]] = {
        name: (v, u) for name, v, u in zip(live.names, live.values, live.std, strict=True)
    }
    for kind in ("f", "w"):
        part = run.sensor.only(kind)
        if not part.coefficients:
            continue
        heads = (number(axis.name) for axis in part.axes)
        table = Table("", *heads, "", box=None, padding=(0, 2, 0, 0))
        for own in dict.fromkeys(CoefficientName(name).term for name in part.coefficients):
            cells = [_cell(run, f"{axis.name}.{own}", values) for axis in part.axes]
            unit = part.coefficient(f"{part.axes[0].name}.{own}").unit
            table.add_row(own, *cells, f"{unit} (± is k = 2)")
        made.append(table)
    return made


def _cell(run: "BenchRun", name: str, values: "Mapping[str, tuple[float, float]]") -> str:
    from inercal.units import digits

    if name not in values:
        return ""
    value, std = values[name]
    size = run.sensor.coefficient(name).si
    return " ± ".join(digits(value / size, 2 * std / size))
