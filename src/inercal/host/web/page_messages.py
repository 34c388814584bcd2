"""Converts the plan, state and samples of a run to messages in the units of the page.

Numbers are rounded to a resolution that a page can show. An unknown number is null.
"""

from collections.abc import Sequence
from math import degrees, isfinite, pi
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.basics.units import ZERO_CELSIUS
from inercal.benches.motion_control import SpinTask, Task
from inercal.benches.turntable import require_turntable
from inercal.benches.turntable.attitude import reference_attitude
from inercal.calibration import Calibration
from inercal.calibration.grade import GRADE_TONES, GRADE_WORDS, Grade
from inercal.estimation.scores import chi2_tail_probability
from inercal.host.bench_run import BenchRun
from inercal.host.drivers.rotary_table import AxisState
from inercal.host.packets import PacketCounts
from inercal.host.tasks import host_plan
from inercal.physics.sensors import Axis
from inercal.runfile import Run

_SIGNIFICANT_DIGITS = 7
# A run has about a hundred independent windows for two filters, so a warning appears in 1 of 50
# runs by chance.
_NIS_LEVEL = 1e-4
_MAX_NIS = 4.0  # at this NIS, innovations are twice as large as stated


def plan_message(run: Run) -> dict[str, Any]:
    """Return the message about the plan; it can be sent before anything moves."""
    sensor, plan = run.sensor, host_plan(run)
    coefficients = [(name, sensor.coefficient(name)) for name in sensor.coefficients]
    return {
        "sensor": sensor.name,
        "plan": run.path.name,
        "seconds": plan.seconds,
        "axes": list(plan.bench.names),
        "spins": plan.spins,
        "live": run.method.sequential is not None,
        "channels": channel_fields(sensor.axes),
        "steps": [
            {"label": one.label, "what": _task_text(one), "seconds": one.seconds}
            for one in plan.tasks
        ],
        "coefficients": [
            {
                "name": name,
                "axis": CoefficientName(name).axis,
                "own": line.name,
                "symbol": line.symbol,
                "meaning": line.meaning,
                "measures": sensor.measures[CoefficientName(name).axis],
                "unit": line.unit,
            }
            for name, line in coefficients
        ],
    }


def state_message(run: BenchRun, plan: Run, angles: Array | None) -> dict[str, Any]:
    """Return the message about the state of a run.

    Parameters
    ----------
    run : BenchRun
    plan : Run
        The run from the run file.
    angles : (k,) array or None
        Angles of the table at the time of the navigation solution, rad.
    """
    seen, assembly = run.state, run.recorder.assembly
    remaining = run.sequencer.remaining_time(seen.time) if seen is not None else None
    table = None if seen is None else {"axes": [axis_fields(axis) for axis in seen.axes]}
    task, request = run.sequencer.task, run.mounting_request
    celsius = rounded_number(run.recorder.temperature - ZERO_CELSIUS, 4)
    return {
        "time": rounded_number(run.time),
        "phase": run.sequencer.phase,
        "paused": run.pause_reason,
        "trouble": run.trouble,
        "done": run.sequencer.number,
        "remaining": rounded_number(remaining),
        "speed": rounded_number(run.speed, 3),
        "table": table,
        "set_rate": _set_rate(task, run.sequencer.phase),
        "mounting": None if request is None else request._asdict(),
        "imu": imu_fields(
            assembly.imu.counts, assembly.samples, assembly.samples_without_angle, celsius
        ),
        "live": run.recorder.estimation,
        "attitude": _attitude_fields(run, plan, angles),
    }


def final_estimates(calibration: Calibration) -> dict[str, Any]:
    """Return values and expanded uncertainties (k = 2) from a calibration, by coefficient."""
    sensor = calibration.sensor
    sizes = np.array([sensor.coefficient(name).si for name in sensor.coefficients])
    return {
        "names": list(sensor.coefficients),
        "units": [sensor.coefficient(name).unit for name in sensor.coefficients],
        "values": rounded_numbers(calibration.values / sizes),
        "u2": rounded_numbers(2 * calibration.std / sizes),
    }


def samples_message(time: Array, output: Array, every: int) -> dict[str, Any]:
    """Return the message with samples, (n, m), at run times, (n,), s; each a mean of `every`."""
    return {
        "t": [round(t, 4) for t in time.tolist()],
        "y": [[rounded_number(y, 6) for y in column] for column in output.T.tolist()],
        "every": every,
    }


def nis_fields(ratio: float, count: int) -> dict[str, Any]:
    """Describe how well innovations agree with their covariance, in the words of the verdict.

    Parameters
    ----------
    ratio : float
        Normalised innovation squared (NIS) per component.
    count : int
        Number of components in the mean `ratio`. If the stated covariance is correct, count · ratio
        follows χ² with this number of degrees of freedom.
    """
    tail = chi2_tail_probability(ratio * count, count)
    p = 2 * min(tail, 1 - tail)
    grade: Grade = (
        "unreliable" if ratio > _MAX_NIS else "reservations" if p < _NIS_LEVEL else "consistent"
    )
    level, words = GRADE_TONES[grade], GRADE_WORDS[grade]
    return {"ratio": rounded_number(ratio, 4), "level": level, "words": words}


def rounded_number(value: float | None, digits: int = _SIGNIFICANT_DIGITS) -> float | None:
    """Return a number rounded to significant digits; None if it is unknown."""
    return float(f"{value:.{digits}g}") if value is not None and isfinite(value) else None


def rounded_numbers(values: Sequence[float] | Array) -> list[float | None]:
    """Return numbers rounded to significant digits; None replaces unknown numbers."""
    return [rounded_number(float(value)) for value in values]


def channel_fields(axes: Sequence[Axis]) -> list[dict[str, str]]:
    """Return the name, quantity and unit of each axis of a sensor."""
    return [
        {"name": axis.name, "measures": axis.measures, "unit": axis.readout.unit} for axis in axes
    ]


def imu_fields(
    counts: PacketCounts,
    samples: int | None = None,
    no_angle: int | None = None,
    temperature: float | None = None,
) -> dict[str, Any]:
    """Return the packet counts of an IMU and its temperature in °C."""
    return {
        "packets": counts.packets,
        "lost": counts.lost,
        "failed": counts.failed,
        "thrown": counts.discarded,
        "samples": samples,
        "no_angle": no_angle,
        "temperature": temperature,
    }


def axis_fields(axis: AxisState) -> dict[str, Any]:
    """Return the state of an axis in °, °/s and ″."""
    return {
        "angle": rounded_number(degrees(axis.angle), 9),
        "rate": rounded_number(degrees(axis.rate)),
        "error": rounded_number(3600 * degrees(axis.following_error), 4),
        "state": axis.status_text,
        "fault": bool(axis.faults),
    }


def _set_rate(task: Task | None, phase: str) -> float | None:
    """Return the set rate of a rate table, °/s; 0 while no state is in progress."""
    if not isinstance(task, SpinTask):
        return None
    return rounded_number(degrees(task.rate if phase in ("approach", "work") else 0.0))


def _task_text(task: Task) -> str:
    if isinstance(task, SpinTask):
        return f"{task.mounting} at {task.rate * 30 / pi:.4g} r/min" if task.rate else "at rest"
    return "turn" if task.rate else "hold"


def _attitude_fields(run: BenchRun, plan: Run, angles: Array | None) -> dict[str, Any] | None:
    """Return the attitudes from the table and from the IMU's readings, if they are known."""
    if not plan.motion_control.has_attitude:
        return None
    bench = require_turntable(plan)
    seen = run.state
    at = run.recorder.navigation if run.recorder.estimation == "on" else None
    if at is None and seen is not None and all(axis.homed for axis in seen.axes):
        # The attitude from the table needs no samples.
        angles = np.array([axis.angle for axis in seen.axes])
    if angles is None:
        return None
    return {
        "table": rounded_numbers(reference_attitude(bench, angles[None, :])[0].ravel()),
        "navigation": None if at is None else rounded_numbers(at.attitude.ravel()),
        "roll": None if at is None else rounded_number(at.roll),
        "pitch": None if at is None else rounded_number(at.pitch),
        "heading": None if at is None else rounded_number(at.heading),
        "apart": None if at is None else rounded_numbers(at.rotation_error),
        "velocity": None if at is None else rounded_numbers(at.velocity),
    }
