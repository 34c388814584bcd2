"""The dialogue of a guided measurement: asks for settings and readings, row by row.

A line is a reading or a command. If a reading is far from the expected value, the operator must
confirm it by entering it again or by `keep`. If the lines come from a file or another program, an
unusable line ends the measurement, because the following lines would be assigned to the wrong
position.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, radians

import numpy as np

from inercal.basics.errors import InercalError, InputError, NotObserved
from inercal.basics.units import format_count
from inercal.benches import MeanBench
from inercal.host.guided.instruments import SensorInstrument, read_instruments
from inercal.host.guided.measurement_table import MeasuredRow, MeasurementTable, Reading
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import Axis
from inercal.recordings.data.recording_loader import reader_columns, stated_deviations
from inercal.runfile import Run

_GYRO_BIAS = radians(6.0)  # rad/s; possible bias of a consumer-grade gyro


class ReadingCheck:
    """The expected readings in the steps of a run, which are those of an ideal sensor.

    A reading is far from the expected value if the difference exceeds a share of the sensed
    specific force or rate; gyros may also have a bias of 6 °/s. At 1 g, a bias of 0.1 g together
    with a scale factor error of 10 % is accepted, but the wrong axis, a wrong sign or a shifted
    decimal point is not. If a coefficient has a prior, the mean of the prior is used. If the method
    estimates the attitudes, only the norm of the specific force is compared.

    Parameters
    ----------
    run : Run
    tolerance : float
        Permitted difference of a reading, as a share of the sensed magnitude.

    Attributes
    ----------
    axes : dict of str to Axis
        Sensor axes, by column of the table.
    """

    def __init__(self, run: Run, tolerance: float):
        self._tolerance = tolerance
        by_name = {axis.name: axis for axis in run.sensor.axes}
        self.axes: dict[str, Axis] = {
            column: by_name[name] for name, column, _ in reader_columns(run).channels
        }
        self._sd = stated_deviations(run)
        self._free = run.method.unknown_attitudes
        self._duration = str(run.data.seconds)
        self._seconds = {step.label: step.seconds for step in run.steps}
        self._gravity = float(run.bench.gravity.value)
        self._size: dict[str, dict[str, float]] = {}  # magnitude, SI, by step and quantity
        self._expected: dict[str, dict[str, float]] = {}  # output units, by step and column
        if not self._free and isinstance(run.bench, MeanBench):
            self._compute(run, run.bench)

    def _compute(self, run: Run, bench: MeanBench) -> None:
        try:
            motion = bench.mean_motion(run.steps, {}).motion
        except (InputError, NotObserved):
            return  # the plan does not state the attitudes
        known = {
            name: float(value)
            for prior in run.priors
            for name, value in zip(prior.names, prior.mean, strict=True)
        }
        c = np.array([known.get(name, 0.0) for name in run.sensor.coefficients])
        output = np.broadcast_to(
            run.sensor.to_output(run.sensor.forward(motion, c)),
            (len(run.steps), len(run.sensor.axes)),
        )
        # If a component is the same in all steps, it may have a single row.
        sizes = {
            kind: np.broadcast_to(np.linalg.norm(vectors, axis=-1), len(run.steps)).tolist()
            for kind, vectors in (("f", motion.f), ("w", motion.w))
        }
        place = {axis.name: k for k, axis in enumerate(run.sensor.axes)}
        for k, step in enumerate(run.steps):
            self._expected[step.label] = {
                column: float(output[k, place[axis.name]]) for column, axis in self.axes.items()
            }
            self._size[step.label] = {kind: size[k] for kind, size in sizes.items()}

    def expected(self, label: str) -> Mapping[str, float]:
        """Return readings of an ideal sensor in a step, in output units, by column."""
        return self._expected.get(label, {})

    def far_readings(self, label: str, reading: Mapping[str, float]) -> list[str]:
        """Return texts about values in a reading that are far from the expected values."""
        if self._free:
            return self._far_norm(reading)
        found: list[str] = []
        # The mean rate of a turn by hand depends on its actual duration.
        faster = self._seconds.get(label, 0.0) / reading.get(self._duration, inf) or 1.0
        for column, value in self.expected(label).items():
            axis, size = self.axes[column], self._size[label]
            if axis.measures == "w":
                value, size = value * faster, {"w": size["w"] * faster}
            allowed = self._tolerance * size[axis.measures]
            allowed += _GYRO_BIAS * (axis.measures == "w")
            if abs(value - reading[column]) > allowed * abs(axis.readout.scale):
                found.append(
                    f"{column} reads {reading[column]:+.6g}, but {value:+.4g} {axis.readout.unit} "
                    f"is expected{self._si_hint(axis, value, reading[column])}"
                )
        return found

    def _si_hint(self, axis: Axis, expected: float, value: float) -> str:
        """Return a hint if a reading would be correct in SI but not in the sensor's unit."""
        scale = axis.readout.scale
        in_si = value * scale + axis.readout.offset
        alike = abs(in_si - expected) <= self._tolerance * abs(expected)
        if not alike or abs(scale - 1) < self._tolerance:
            return ""
        si = QUANTITIES[axis.measures].unit
        return f" (is it in {si}? [sensor] states {axis.readout.unit})"

    def _far_norm(self, reading: Mapping[str, float]) -> list[str]:
        si = [
            (reading[column] - axis.readout.offset) / axis.readout.scale
            for column, axis in self.axes.items()
            if axis.measures == "f"
        ]
        norm = float(np.linalg.norm(si))
        if abs(norm - self._gravity) <= self._tolerance * self._gravity:
            return []
        text = f"the norm is {norm:.4g} m/s², but {self._gravity:.4g} m/s² is expected"
        plain = [reading[column] for column, axis in self.axes.items() if axis.measures == "f"]
        if abs(float(np.linalg.norm(plain)) - self._gravity) <= self._tolerance * self._gravity:
            text += " (are the readings in m/s²? [sensor] states another unit)"
        return [text]

    def out_of_range(self, reading: Mapping[str, float]) -> list[str]:
        """Return texts about values in a reading that reach or exceed the full scale."""
        found: list[str] = []
        for column, axis in self.axes.items():
            reach = axis.readout.full_scale
            if reach is not None and abs(reading[column] - axis.readout.offset) >= reach:
                found.append(f"{column} reads {reading[column]:+.6g}, at or beyond full_scale")
        return found

    def columns_of_large_scatter(self, readings: Sequence[Mapping[str, float]]) -> list[str]:
        """Return the columns whose scatter far exceeds [data.sd], which applies to a mean."""
        found: list[str] = []
        for column, axis in self.axes.items():
            stated = self._sd.get(axis.measures)
            of_mean = scatter(readings, column) / np.sqrt(len(readings))
            if stated is not None and of_mean > 3 * stated * abs(axis.readout.scale):
                found.append(column)
        return found


def scatter(readings: Sequence[Mapping[str, float]], column: str) -> float:
    """Return the standard deviation of single readings; 0 if there are fewer than two."""
    values = [one[column] for one in readings]
    return float(np.std(values, ddof=1)) if len(values) > 1 else 0.0


_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_MOST = 1e100  # largest number, as in tables of means
_COMMANDS = "undo, repeat, quit or help"
_HELP = (
    "undo     takes back the last reading",
    "repeat   takes back all readings in this row, or in the previous row if this one has none",
    "keep     accepts a reading that is far from the expected value",
    "quit     ends the measurement; the same command continues it later",
    "help     prints this list",
)


@dataclass(eq=False)
class GuidedMeasurement:
    """A guided measurement, row by row.

    Parameters
    ----------
    table : MeasurementTable
    check : ReadingCheck
    instruments : sequence of SensorInstrument
        Instruments that read the sensor's columns. If there are none, the operator types all
        readings.
    count : int
        Number of readings for each mean.
    units : mapping of str to str
        Units of the columns to fill in.
    read_line : callable
        Function that shows a prompt and returns a line, or None at the end of the input.
    say : callable
        Function that prints a line.
    interactive : bool
        Whether somebody can correct an unusable line. If not, such a line ends the measurement.
    """

    table: MeasurementTable
    check: ReadingCheck
    instruments: Sequence[SensorInstrument]
    count: int
    units: Mapping[str, str]
    read_line: Callable[[str], str | None]
    say: Callable[[str], None]
    interactive: bool
    _doubtful: list[Reading] = field(default_factory=list[Reading])  # far from expected
    _lines: int = 0
    _shown: int | None = None  # row of the last printed setting

    def run(self) -> bool:
        """Measure the remaining rows, and return whether all rows are complete.

        Raises
        ------
        InputError
            A line cannot be used, and nobody can correct it.
        LinkLost
            An instrument does not answer, and nobody can repeat the reading.
        """
        while True:
            k = self.table.open_row
            self._describe(k)
            line = self.read_line(self._prompt(k))
            self._lines += 1
            text = "quit" if line is None else line.strip()
            word = text.lower()
            if word == "quit" or (k is None and not word):
                return self.table.open_row is None
            try:
                self._answer(k, text)
            except InercalError as error:
                if not self.interactive:
                    raise error.located(f"standard input line {self._lines}") from None
                self.say(str(error))

    def _answer(self, k: int | None, text: str) -> None:
        word = text.lower()
        if word in ("help", "?"):
            for line in _HELP:
                self.say(line)
        elif word in ("undo", "repeat"):
            self._take_back(k, last=word == "undo")
        elif k is None:
            raise InputError(f"{text[:40]!r}: all rows are measured; possible are {_COMMANDS}")
        elif word == "keep":
            if not self._doubtful:
                raise InputError("there is no reading to keep; give one first")
            self._accept(k, self._doubtful)
        else:
            self._take(k, text)

    def _take(self, k: int, line: str) -> None:
        """Accept a typed reading, or read the instruments and add the typed columns."""
        row, before = self.table.rows[k], self._doubtful
        typed = self._typed_columns(row)
        by_hand = _typed_numbers(line, typed, self.units)
        if not self.instruments:
            found: list[Reading] = [by_hand]
        else:
            columns = [name for name in row.columns if name not in typed]
            for one in self.instruments:
                one.begin()
            wanted = self.count - len(row.readings)
            found = [
                by_hand | read_instruments(self.instruments, columns, self.units)
                for _ in range(wanted)
            ]
        for one in found:
            if beyond := self.check.out_of_range(one):
                raise InputError("; ".join(beyond) + ": change the range, or correct full_scale")
        mean = MeasuredRow(row.planned, row.columns, {}, found).mean()
        far = self.check.far_readings(row.planned.label, mean)
        if not far or found == before:
            return self._accept(k, found)
        words = f"{row.planned.label}: {'; '.join(far)}: check the setting, the axes and the digits"
        if before and not self.interactive:
            raise InputError(f"{words}; a line of keep after the reading accepts it")
        self._doubtful = found
        again = "Enter reads again" if self.instruments else "give the reading again"
        self.say(f"{words}; {again}, keep accepts it")

    def _accept(self, k: int, readings: Sequence[Reading]) -> None:
        row, self._doubtful = self.table.rows[k], []
        if not self.table.add(k, readings):
            self.say(f"{row.planned.label}: reading {len(row.readings)} of {self.count}")
            return
        self.say(f"{row.planned.label}: {self._summary(row)}")
        if scattered := self.check.columns_of_large_scatter(row.readings):
            self.say(
                f"{', '.join(scattered)}: the scatter of the mean is more than three times "
                "[data.sd]; wait until the readings are steady, and repeat, or state a larger one"
            )

    def _take_back(self, k: int | None, *, last: bool) -> None:
        """Remove the readings of this row or, if it has none, of the previous row."""
        self._shown, rows = None, self.table.rows
        if self._doubtful:
            self._doubtful = []
            return self.say("the reading is dropped")
        if k is None or not rows[k].readings:
            k = (len(rows) if k is None else k) - 1
        if k < 0:
            raise InputError("there is no reading to take back")
        self.table.remove(k, last=last)
        self.say(f"{rows[k].planned.label}: {'last reading' if last else 'readings'} taken back")

    def _describe(self, k: int | None) -> None:
        if k == self._shown:
            return
        self._shown, rows = k, self.table.rows
        if k is None:
            self.say(f"all {len(rows)} rows are measured")
            return
        planned = rows[k].planned
        cells = [
            f"{heading.text}: {cell}"
            for heading, cell in zip(self.table.sheet.headings, planned.cells, strict=True)
            if cell and heading.text != "row"
        ]
        self.say(f"[{k + 1}/{len(rows)}] {', '.join(cells)}")
        expected = self.check.expected(planned.label)
        if expected:
            texts = (f"{name} {value:+.4g}" for name, value in expected.items())
            self.say(f"      expected about {', '.join(texts)}")

    def _prompt(self, k: int | None) -> str:
        if k is None:
            return "Enter ends, undo or repeat goes back> "
        typed = self._typed_columns(self.table.rows[k])
        names = ", ".join(f"{name} [{self.units.get(name, '')}]" for name in typed)
        if self.instruments:
            return f"{names}, then Enter reads> " if names else "Enter reads> "
        return f"{names}> "

    def _typed_columns(self, row: MeasuredRow) -> tuple[str, ...]:
        if not self.instruments:
            return row.columns
        return tuple(name for name in row.columns if name not in self.check.axes)

    def _summary(self, row: MeasuredRow) -> str:
        """Return the means and standard deviations of a row as text."""
        n, expected = len(row.readings), self.check.expected(row.planned.label)
        texts: list[str] = []
        for name, value in row.mean().items():
            more = [f"s {scatter(row.readings, name):.2g}"] * (n > 1)
            if name in expected:
                more.append(f"expected {expected[name]:+.4g}")
            texts.append(f"{name} {value:.9g}" + f" ({', '.join(more)})" * bool(more))
        return f"mean of {n}: " * (n > 1) + ", ".join(texts)


def _typed_numbers(line: str, columns: Sequence[str], units: Mapping[str, str]) -> dict[str, float]:
    """Return the numbers in a line, by column.

    Raises
    ------
    InputError
        The line has a wrong number of values, or a word that is not a number.
    """
    words = [word for word in re.split(r"[,;\s]+", line.replace("−", "-").strip()) if word]
    wanted = ", ".join(f"{name} in {units[name]}" if units.get(name) else name for name in columns)
    for word in words:
        if not _NUMBER.fullmatch(word) or abs(float(word)) >= _MOST:
            raise InputError(
                f"{word[:40]!r} is neither a number nor a command; type {wanted or 'nothing'}, or "
                f"{_COMMANDS}",
                names=(word,),
            )
    if len(words) != len(columns):
        raise InputError(
            f"{format_count(len(words), 'number')}, but {len(columns)} are needed: type "
            f"{wanted or 'nothing'}, with decimal points, separated by spaces"
        )
    return dict(zip(columns, map(float, words), strict=True))
