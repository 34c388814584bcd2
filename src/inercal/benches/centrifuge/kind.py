"""Register the precision centrifuge as a kind of bench, with its sections of the run file.

Its worksheet lists the dwells at each rate, attitude by attitude.
"""

from collections.abc import Sequence
from math import degrees, pi
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from inercal.basics.units import Measured, format_duration
from inercal.benches.centrifuge.arm_motion import attitude_names, sensed_motion
from inercal.benches.centrifuge.bench import Centrifuge
from inercal.benches.centrifuge.simulation import (
    arm_plan_duration,
    head_angles_of_attitude,
    simulate_arm_motion,
)
from inercal.benches.key_declarations import add_bench_keys, build_bench
from inercal.benches.kind_definition import Effect, Kind, simulate_without_sensor
from inercal.benches.operator_sheet import DURATION, ROW, Heading, Sheet, SheetRow
from inercal.benches.report_data import (
    MeasuredDirection,
    ReportInput,
    describe_spin,
    measured_direction,
)
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.plan import Spin, describe_direction
from inercal.physics.section_settings import (
    PLANNING,
    BenchSection,
    BenchUsage,
    key_error,
    positive_value,
    section_constant,
    section_deviation,
    section_length,
)
from inercal.physics.sensors import G0
from inercal.recordings.data import DataSection, EstimatorInput, ReadbackColumn, RunBase, unit_size
from inercal.recordings.data.recording_loader import readback_units


@add_bench_keys(Centrifuge, after={"platform": "dwell_tilt"})
class CentrifugeSection(BenchSection):
    """Section [bench] for a precision centrifuge."""

    kind: Literal["centrifuge"]
    radius: str = Field(examples=["1 m ± 10 µm"])
    platform: Literal["locked", "counter-rotating"] = "locked"
    sense: Literal["counter-clockwise", "clockwise"] = "counter-clockwise"
    indexing: str | None = Field(
        None, description="angles of each attitude, if attitudes are known", examples=["0.02 °"]
    )
    max_acceleration: str = Field(
        "3 rad/s²",
        description="angular acceleration of the arm between its rates",
        json_schema_extra=PLANNING,
    )

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
        """Return the keys that have no effect on the result in this use, each with the reason."""
        found: dict[str, str] = {}
        if self.platform == "locked":
            found["lean"] = (
                "on a locked platform the spindle's tilt averages to zero over whole turns"
            )
        if self.indexing is None:
            found["mounting"] = (
                "without indexing only norms are used, and mounting does not affect them"
            )
        if self.latitude is None and self.platform == "locked" and self.indexing is None:
            found["sense"] = "without latitude the sense of the earth's rate is not used"
        return found


class CentrifugeData(DataSection):
    """Section [data] for a precision centrifuge, in which each row is a dwell of the arm."""

    arm_rate: str | int = Field(description="column of the arm's rate", examples=["rate"])
    arm_rate_unit: str = Field(
        "rpm", description="unit of the rate, or its size such as '0.5 rev/s'"
    )
    attitude: tuple[str | int, str | int] | None = Field(
        None, description="for means: columns of ψ and θ", examples=[["psi", "theta"]]
    )
    attitude_unit: str = "°"

    def readback(self, bench: Centrifuge) -> tuple[ReadbackColumn, ...]:
        """Return the columns with the rate of the arm and the attitudes."""
        rate = unit_size(self.arm_rate_unit, "rad/s", "arm_rate_unit")
        found = (ReadbackColumn("arm_rate", str(self.arm_rate), rate),)
        if self.attitude is None:
            return found
        angle = unit_size(self.attitude_unit, "°", "attitude_unit")
        psi, theta = map(str, self.attitude)
        return (*found, ReadbackColumn("psi", psi, angle), ReadbackColumn("theta", theta, angle))


def build(section: CentrifugeSection, folder: Path) -> Centrifuge:
    """Build the bench in SI from its section; the files that it names are in `folder`."""
    latitude = None
    if section.latitude is not None:
        latitude = section_constant(section, "latitude", "°")
        earth_rate_up_north(latitude.value)  # refuses an impossible latitude
    acceleration = positive_value(section.max_acceleration, "rad/s²", "[bench] max_acceleration")
    return build_bench(
        Centrifuge,
        section,
        radius=section_length(section, "radius"),
        latitude=latitude,
        platform=section.platform,
        indexing=None if section.indexing is None else section_deviation(section, "indexing", "°"),
        sense=1 if section.sense == "counter-clockwise" else -1,
        acceleration=acceleration,
    )


def require_locked_platform(run: RunBase[CentrifugeData]) -> None:
    """Refuse a counter-rotating platform for a table of means."""
    if run.bench.platform != "locked":
        raise key_error(
            "[bench] platform",
            f"{run.bench.platform!r} needs a recording instead of a table of means: over a dwell "
            "the mean of the arm's acceleration is zero",
            run.path,
        )


def sheet(run: RunBase[CentrifugeData]) -> Sheet:
    """Return the worksheet with the dwells of a run's plan.

    Raises
    ------
    InputError
        The run file states no plan, or the platform turns against the arm.
    """
    data, bench = run.data, run.bench
    require_locked_platform(run)
    if not run.has_plan_keys:
        text = 'is missing: state the rates of the arm, such as rates = ["60 rpm", "120 rpm"]'
        raise key_error("[method] rates", text, run.path)
    steps, sizes = _by_attitude(run), readback_units(run)
    positions = attitude_names(steps)
    names = {step.label: positions[step.attitude].removesuffix("_r1") for step in steps}
    stated = {name: np.array(p.value) for name, p in bench.acting_parameters(steps).items()}
    rows: list[SheetRow] = []
    sensed = sensed_motion(bench, steps, stated).f
    for k, (step, f) in enumerate(zip(steps, sensed, strict=True), start=1):
        assert step.attitude is not None
        name, rpm = names[step.label], step.rate * 30 / pi
        angles = head_angles_of_attitude(step)
        out, up = (describe_direction(one) for one in (step.attitude.out, step.attitude.up))
        reads = [f"{x + 0.0:+.3f}".replace("-", "−") for x in np.asarray(f / G0).round(3).tolist()]
        head = [f"{round(angle / sizes[key], 9) + 0.0:.12g}" for key, angle in _head(data, angles)]
        cells = (str(k), name, *head, out, up, f"{rpm:.6g}", f"{step.seconds:.6g} s", *reads)
        labelled = [name] * (data.label is not None)
        given = (*labelled, *head, f"{step.rate / sizes['arm_rate']:.12g}")
        facts = {"position": name, "out": out, "up": up, "rpm": rpm, "felt": f.tolist()}
        rows.append(SheetRow(step.label, cells, step.seconds, name, given, facts))
    duration = arm_plan_duration(bench, steps)
    head_units = [f"{name}, {data.attitude_unit}" for name in ("ψ", "θ")]
    return Sheet(
        f"{len(rows)} dwells in {len(positions)} attitudes, "
        f"{format_duration(duration)} in all, including spin-up and spin-down",
        (
            ROW,
            Heading("position"),
            *[Heading(text, align_right=True) for text in head_units if data.attitude is not None],
            Heading("outwards"),
            Heading("up"),
            Heading("r/min", align_right=True),
            DURATION,
            *(Heading(f"{axis}, g", align_right=True) for axis in run.sensor.channels),
        ),
        tuple(rows),
        (
            "Measure all rates of an attitude before you change it.",
            "At each rate wait until it is steady, then average the readings over whole turns.",
            "The printed readings are those of a sensor without errors. Use them to check the axes "
            "and signs.",
            "Remove the row of a failed dwell from the file.",
            "The duration includes spin-up and spin-down of the arm at "
            f"{bench.acceleration:.3g} rad/s² ([bench] max_acceleration) and the time to settle "
            "before each dwell, but not the changes of attitude.",
        ),
        (data.label, *(data.attitude or ()), data.arm_rate, *data.accelerometer),
        seconds_between=duration - sum(step.seconds for step in steps),
    )


def _by_attitude(run: RunBase[CentrifugeData]) -> list[Spin]:
    """Return the dwells of the plan grouped by attitude, otherwise in the order of the plan."""
    steps = [step for step in run.steps if isinstance(step, Spin)]
    order = {attitude: k for k, attitude in enumerate(attitude_names(steps))}
    return sorted(steps, key=lambda step: order[step.attitude])


def _head(data: CentrifugeData, angles: Sequence[float]) -> list[tuple[str, float]]:
    """Return the angles of the two-axis head by name, rad, if the table has them."""
    return [] if data.attitude is None else list(zip(("psi", "theta"), angles, strict=True))


_NONE = Measured(0.0, 0.0)


def _refuses_budget(bench: Centrifuge, steps: Sequence[Spin]) -> str:
    if bench.platform == "locked":
        return ""
    return "a budget cannot be computed for a counter-rotating platform; simulate its runs instead"


def directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return the measured direction of the specific force during each dwell."""
    spins = [step for step in shown.steps if isinstance(step, Spin)]
    known = all(step.attitude is not None for step in spins)
    stated = {name: np.array(q.value) for name, q in shown.expected.items()}
    nominal = sensed_motion(shown.bench, spins, stated) if known else None
    sensed = shown.sensed_motion(None if nominal is None else nominal.w)
    return tuple(
        measured_direction(step, sensed.f[k], None if nominal is None else nominal.f[k])
        for k, step in enumerate(spins)
    )


def _observe(run: RunBase[CentrifugeData]) -> EstimatorInput:
    """Return the observations from a run; the reader is imported only when it is needed."""
    from inercal.benches.centrifuge.reading import observe

    return observe(run)


KIND = Kind(
    "centrifuge",
    Centrifuge,
    CentrifugeSection,
    CentrifugeData,
    build,
    (Spin,),
    _observe,
    simulate_without_sensor(simulate_arm_motion),
    arm_plan_duration,
    effects=(
        Effect("earth's rate", "latitude", _NONE, "° of latitude", degrees(1)),
        Effect("stretch of the arm", "stretch", _NONE, "ppm/g", 1e6 * G0),
    ),
    refuses_budget=_refuses_budget,
    rows_of_table=True,
    spins=True,
    sheet=sheet,
    directions=directions,
    row=describe_spin,
)
