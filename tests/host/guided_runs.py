"""Guided measurements in this process: a run file of six positions, lines, and instruments."""

import re
from collections.abc import Callable, Iterable
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from tests.program import Ended, run_program

from inercal.host.sim.server import SimulatorServer
from inercal.physics.motion import Motion
from inercal.physics.plan import Hold
from inercal.physics.sensors import G0
from inercal.runfile import read

SIX = """\
[sensor]
name = "triad 4"

[sensor.accelerometer]
unit = "V"
scale = "2 V/g"
full_scale = "5 g"

[sensor.truth]
"ax.k0" = "12 mg"
"ay.k1" = "-0.4 %"
"az.delta_p" = "2 ′"

[bench]
gravity = "9.81 m/s² ± 0.2 mm/s²"
tilt = "0.02 °"

[data]
file = "sheet.csv"
kind = "means"
label = "position"
accelerometer = ["ax", "ay", "az"]

[data.sd]
accelerometer = "20 µg"

[method]
name = "six_position"
"""
LABELS = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")


class Terminal(StringIO):
    """Lines that somebody types."""

    def isatty(self) -> bool:
        return True


def six_positions(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the run file, its parts replaced."""
    text = SIX
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "run.toml"
    path.write_text(text, encoding="utf-8")
    return path


def readings(run_file: Path, seed: int = 1, count: int = 1) -> list[list[float]]:
    """Return `count` readings in each of the six positions, V, of the sensor of a run file."""
    run, rng = read(run_file), np.random.default_rng(seed)
    c = np.array([run.truth.get(name, 0.0) for name in run.sensor.coefficients])
    up = np.array([step.up for step in run.steps if isinstance(step, Hold)])
    si = np.repeat(run.sensor.forward(Motion(9.81 * up), c), count, axis=0)
    si += 20e-6 * G0 * np.sqrt(count) * rng.standard_normal(si.shape)
    return run.sensor.to_output(si).round(7).tolist()


def lines(values: Iterable[Iterable[float]]) -> list[str]:
    return [" ".join(map(str, row)) + "\n" for row in values]


def measure(*arguments: str | Path, given: Iterable[str] = (), typed: bool = False) -> Ended:
    """Run the verb with lines on standard input, by somebody or by a pipe."""
    text = "".join(given)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.stdin", Terminal(text) if typed else StringIO(text))
        return run_program("measure", *arguments)


class Voltmeter:
    """An instrument: what it answers to a line."""

    time = 0.0

    def __init__(self, answer: Callable[[str], str]):
        self.answer = answer
        self.asked: list[str] = []

    def advance(self, until: float) -> None: ...

    def fault(self, words: str) -> None: ...

    def session(self) -> "Voltmeter":
        return self

    def feed(self, data: bytes) -> bytes:
        replies = b""
        for line in re.findall(rb"[^\n]*\n", data):
            self.asked.append(line.decode().strip())
            replies += self.answer(line.decode().strip()).encode()
        return replies


def serve(answer: Callable[[str], str], *, terminal: bool = False) -> SimulatorServer[Voltmeter]:
    """Return a server of an instrument, on this machine's address or a pseudo-terminal."""
    return SimulatorServer(Voltmeter(answer), terminal=terminal)
