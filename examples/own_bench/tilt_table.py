"""A bench and a method of another package: a tilting plate, and the joint fit of its means.

The plate leans a sensor by known angles, in one of two planes. `pyproject.toml` beside this file
registers both; once the package is installed, `inercal` takes [bench] kind = "tilt_table".
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from inercal.basics.errors import InputError
from inercal.basics.keys import ErrorName
from inercal.basics.parameters import Parameter, local_gravity
from inercal.basics.units import Measured, format_quantity
from inercal.benches import MeanMotion
from inercal.benches.contract import SensorSimulation, SimulatedMotion
from inercal.benches.key_declarations import (
    add_bench_keys,
    build_bench,
    declared_parameters,
    small_angle,
)
from inercal.benches.kind_definition import Kind, Vocabulary
from inercal.benches.operator_sheet import Heading, Sheet, SheetRow
from inercal.methods import Method
from inercal.methods.mean_problem import joint
from inercal.physics.motion import Motion
from inercal.physics.section_settings import BenchSection
from inercal.physics.sensors import Sensor
from inercal.recordings.data import DataSection, EstimatorInput, ReadbackColumn, RunBase, unit_size
from inercal.recordings.data.recording_loader import (
    load_recording,
    readback_columns,
    readback_units,
    reader_columns,
    stated_deviations,
)
from inercal.recordings.io.mean_tables import observations_from_table, read_columns
from inercal.recordings.segments import marks_from_labels, observe

Array = NDArray[np.float64]
Plane = Literal["xz", "yz"]


@dataclass(frozen=True)
class Tilt:
    """The plate at an angle, rad; z points up at 0, x or y at 90°."""

    label: str
    plane: Plane
    angle: float
    seconds: float

    def describe(self) -> str:
        """Return what is set."""
        return f"plane {self.plane} at {self.angle * 180 / pi:g}°"


def plan(seconds: float = 5.0) -> tuple[Tilt, ...]:
    """Return both planes in steps of 45°."""
    planes: tuple[Plane, ...] = ("xz", "yz")
    return tuple(
        Tilt(f"{plane} {45 * k}", plane, k * pi / 4, seconds) for plane in planes for k in range(8)
    )


@dataclass(frozen=True, eq=False)
class TiltTable:
    """The plate as stated: the deviation of its zero, and of each angle, rad."""

    gravity: Measured
    zero: float = small_angle("0.1 °", "zero of the plate's scale")
    division: float = small_angle("10 ″", "error of one angle", scope="position")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The imperfections, as data."""
        return (local_gravity(self.gravity), *declared_parameters(self))

    def nuisances(self, steps: Sequence[Tilt], sensor: Sensor) -> Mapping[str, Parameter]:
        """Return the parameters that act on these steps, by full name."""
        g, zero, division = self.parameters
        own = {ErrorName(f"division[{step.label}]"): division for step in steps}
        return {ErrorName("g"): g, ErrorName("zero"): zero, **own}

    def mean_motion(self, steps: Sequence[Tilt], q: Mapping[str, Array]) -> MeanMotion:
        """Return the specific force in each step: g (sin α, 0, cos α), or y in the place of x."""
        g = np.asarray(q.get("g", self.gravity.value))[..., None, None]
        off = np.stack(
            np.broadcast_arrays(
                *(q.get("zero", 0.0) + q.get(f"division[{s.label}]", 0.0) for s in steps)
            ),
            axis=-1,
        )
        angle = off + [step.angle for step in steps]
        across = np.array([[p.plane == "xz", p.plane == "yz", False] for p in steps], dtype=float)
        up = np.array([0.0, 0.0, 1.0])
        sine, cosine = np.sin(angle)[..., None], np.cos(angle)[..., None]
        f, by_angle = g * (across * sine + up * cosine), g * (across * cosine - up * sine)
        alone = {
            f"division[{s.label}]": by_angle * (np.arange(len(steps)) == k)[:, None]
            for k, s in enumerate(steps)
        }
        return MeanMotion(Motion(f), {"g": f / g, "zero": by_angle, **alone})

    def reading_offsets(
        self, steps: Sequence[Tilt], sensor: Sensor, q: Mapping[str, Array]
    ) -> Array:
        """Return that no error adds to readings themselves."""
        return np.zeros(())


@add_bench_keys(TiltTable)
class TiltTableSection(BenchSection):
    """[bench]."""

    kind: Literal["tilt_table"]


class TiltTableData(DataSection):
    """[data]: rows are positions.

    `plane` is required, but a table of means alone has the column. In a recording the first two
    letters of a label are the plane: "xz 45".
    """

    plane: str | int = Field(description="column of the plane", examples=["plane"])
    angle: str | int = Field(description="column of the plate's angle", examples=["angle"])
    angle_unit: str = "°"

    def readback(self, bench: TiltTable) -> tuple[ReadbackColumn, ...]:
        """Return the column of the plate's angle."""
        return (
            ReadbackColumn("angle", str(self.angle), unit_size(self.angle_unit, "°", "angle_unit")),
        )


def build(section: TiltTableSection, folder: Path) -> TiltTable:
    """Return the bench in SI."""
    return build_bench(TiltTable, section)


def read(run: RunBase[TiltTableData]) -> EstimatorInput:
    """Return the observations of a run: of a table of means, or of labelled sections."""
    path, wanted, bench = run.file(run.data.file), reader_columns(run), run.bench
    column, size = readback_columns(run)["angle"], readback_units(run)["angle"]
    conditions = {"gravity": format_quantity(bench.gravity.value, bench.gravity.sd, "m/s²")}
    if run.data.kind == "means":
        table = read_columns(path, wanted, [str(run.data.plane), column])
        planes: list[Plane] = [
            _plane(str(one), path) for one in table.columns[str(run.data.plane)].tolist()
        ]
        steps = _steps(planes, table.numbers(column) * size)
        labels = tuple(step.label for step in steps)
        ones = np.ones(len(labels))
        means = observations_from_table(
            path, table, labels, wanted, run.sensor, stated_deviations(run), ones
        )
        return EstimatorInput(None, (), means, steps, steps, (), conditions)
    recording = load_recording(run)
    marks, told = marks_from_labels(recording), recording.readback["angle"] * size
    angles = np.array([told[mark.start : mark.stop].mean() for mark in marks])
    planes = [_plane(mark.label[:2], path) for mark in marks]
    steps = tuple(
        Tilt(mark.label, plane, angle, recording.span(mark.start, mark.stop))
        for mark, plane, angle in zip(marks, planes, angles.tolist(), strict=True)
    )
    means = observe(recording, run.sensor, marks, steps)
    return EstimatorInput(recording, marks, means, steps, steps, recording.findings, conditions)


def _plane(text: str, path: Path) -> Plane:
    if text not in ("xz", "yz"):
        raise InputError(
            f"{path}: plane {text!r}; there are xz and yz, in the column of the plane or as "
            'the first two letters of a label, "xz 45"'
        )
    return "yz" if text == "yz" else "xz"


def _steps(planes: Sequence[Plane], angles: Array) -> tuple[Tilt, ...]:
    return tuple(
        Tilt(f"{plane} {angle * 180 / pi:.6g}", plane, angle, 0.0)
        for plane, angle in zip(planes, angles.tolist(), strict=True)
    )


def simulate(
    bench: TiltTable,
    steps: Sequence[Tilt],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int,
    sensor: Sensor,
    carried: bool,
) -> SensorSimulation:
    """Carry a plan out, one position after the other."""
    drawn = {
        name: one.value + one.sd * rng.standard_normal(trials)
        for name, one in bench.nuisances(steps, sensor).items()
    }
    counts = [round(step.seconds * rate_hz) for step in steps]
    made = bench.mean_motion(steps, drawn).motion.f
    labels = np.repeat([step.label for step in steps], counts)
    told = np.repeat([step.angle for step in steps], counts)
    time, motion = np.arange(len(labels)) / rate_hz, Motion(np.repeat(made, counts, axis=-2))
    return SensorSimulation(SimulatedMotion(time, motion, labels, drawn, {"angle": told}), sensor)


def sheet(run: RunBase[TiltTableData]) -> Sheet:
    """Return what the operator sets."""
    size = readback_units(run)["angle"]
    rows: list[SheetRow] = []
    for step in (one for one in run.steps if isinstance(one, Tilt)):
        told = f"{step.angle / size:g}"
        given = (step.plane, told)
        rows.append(SheetRow(step.label, (step.label, *given), step.seconds, step.plane, given))
    data: Any = run.data
    return Sheet(
        f"{len(rows)} positions",
        (
            Heading("position"),
            Heading("plane"),
            Heading(f"angle, {data.angle_unit}", align_right=True),
        ),
        tuple(rows),
        ("Set each angle from below.",),
        (data.plane, data.angle, *data.accelerometer),
    )


KIND = Kind(
    "tilt_table",
    TiltTable,
    TiltTableSection,
    TiltTableData,
    build,
    (Tilt,),
    read,
    simulate,
    words=Vocabulary(row="position", rows="positions"),
    sheet=sheet,
)
METHOD = Method(
    name="tilt_means",
    bench=TiltTable,
    default_coefficients={"f": ("bias", "scale", "misalignment")},
    also={"f": ("temperature", "k2")},
    needs=("f",),
    plan=plan,
    estimators={"joint": joint},
    source="the example of a bench of your own",
)
