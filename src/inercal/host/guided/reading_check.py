"""Compares readings with the values that an ideal sensor would give in each step.

A reading is far from the expected value if the difference exceeds a share of the sensed specific
force or rate; gyros may also have a bias of 6 °/s. At 1 g, a bias of 0.1 g together with a scale
factor error of 10 % is accepted, but the wrong axis, a wrong sign or a shifted decimal point is
not. If a coefficient has a prior, the mean of the prior is used. If the method estimates the
attitudes, only the norm of the specific force is compared.
"""

from collections.abc import Mapping, Sequence
from math import inf, radians

import numpy as np

from inercal.basics.errors import InputError, NotObserved
from inercal.benches import MeanBench
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import Axis
from inercal.recordings.data.recording_loader import reader_columns, stated_deviations
from inercal.runfile import Run

_GYRO_BIAS = radians(6.0)  # rad/s; possible bias of a consumer-grade gyro


class ReadingCheck:
    """The expected readings in the steps of a run.

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
