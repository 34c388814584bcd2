"""A run in the units and words of the page: its plan, its state, its samples.

Numbers are rounded to what a page can show; one that is not known is null.
"""

from collections.abc import Sequence
from math import degrees, isfinite
from typing import Any

import numpy as np

from inercal.arrays import Array
from inercal.benches.turntable.attitude import reference
from inercal.benches.turntable.bench import Turntable
from inercal.host.drivers.table import AxisState
from inercal.host.run import BenchRun
from inercal.host.tasks import tasks
from inercal.keys import CoefficientName
from inercal.runfile import Run
from inercal.units import ZERO_CELSIUS

_DIGITS = 7


def plan(run: Run, bench: Turntable) -> dict[str, Any]:
    """Return what is known of a run before anything moves."""
    sensor, steps = run.sensor, tasks(bench, run.table_steps)
    coefficients = [(name, sensor.coefficient(name)) for name in sensor.coefficients]
    measures = {axis.name: axis.measures for axis in sensor.axes}
    return {
        "sensor": sensor.name,
        "plan": run.path.name,
        "seconds": sum(one.approach + one.seconds for one in steps),
        "axes": list(bench.names),
        "channels": [
            {"name": axis.name, "measures": axis.measures, "unit": axis.readout.unit}
            for axis in sensor.axes
        ],
        "steps": [
            {"label": one.label, "what": "turn" if one.rate else "hold", "seconds": one.seconds}
            for one in steps
        ],
        "coefficients": [
            {
                "name": name,
                "axis": CoefficientName(name).axis,
                "own": line.name,
                "measures": measures[CoefficientName(name).axis],
                "unit": line.unit,
            }
            for name, line in coefficients
        ],
    }


def state(run: BenchRun, bench: Turntable, angles: Array | None) -> dict[str, Any]:
    """Return how a run stands.

    Parameters
    ----------
    run : BenchRun
    bench : Turntable
    angles : (k,) array or None
        The table's, rad, at the time of the run's navigation.
    """
    seen, tally = run.state, run.account.assembly.tally
    remaining = run.sequencer.remaining(seen.time) if seen is not None else None
    table = None if seen is None else {"axes": [_axis(axis) for axis in seen.axes]}
    counts = tally.bytes
    return {
        "time": number(run.time),
        "phase": run.sequencer.phase,
        "paused": run.paused,
        "trouble": run.trouble,
        "done": run.sequencer.number,
        "remaining": number(remaining),
        "speed": number(run.speed, 3),
        "table": table,
        "imu": {
            "packets": counts.packets,
            "lost": counts.lost,
            "failed": counts.failed,
            "thrown": counts.thrown,
            "samples": tally.samples,
            "no_angle": tally.no_angle,
            "temperature": number(run.account.temperature - ZERO_CELSIUS, 4),
        },
        "live": run.account.estimation,
        "attitude": _attitude(run, bench, angles),
    }


def samples(time: Array, output: Array, every: int) -> dict[str, Any]:
    """Return samples, (n,) s and (n, m) in output units, or means of `every` of them each."""
    return {
        "t": [round(t, 4) for t in time.tolist()],
        "y": [[number(y, 6) for y in column] for column in output.T.tolist()],
        "every": every,
    }


def number(value: float | None, digits: int = _DIGITS) -> float | None:
    """Return a number of so many digits; None for one that is not known."""
    return float(f"{value:.{digits}g}") if value is not None and isfinite(value) else None


def numbers(values: Sequence[float] | Array) -> list[float | None]:
    """Return many of them."""
    return [number(float(value)) for value in values]


def _axis(axis: AxisState) -> dict[str, Any]:
    return {
        "angle": number(degrees(axis.angle), 9),
        "rate": number(degrees(axis.rate)),
        "error": number(3600 * degrees(axis.following_error), 4),
        "state": axis.words,
        "fault": bool(axis.faults),
    }


def _attitude(run: BenchRun, bench: Turntable, angles: Array | None) -> dict[str, Any] | None:
    """Return the attitude by the table and beside it by the readings, as far as either is known."""
    seen = run.state
    at = run.account.navigation if run.account.estimation == "on" else None
    if at is None and seen is not None and all(axis.homed for axis in seen.axes):
        # No samples are needed for these, nor need they be of the same time as any.
        angles = np.array([axis.angle for axis in seen.axes])
    if angles is None:
        return None
    return {
        "table": numbers(reference(bench, angles[None, :])[0].ravel()),
        "navigation": None if at is None else numbers(at.attitude.ravel()),
        "roll": None if at is None else number(at.roll),
        "pitch": None if at is None else number(at.pitch),
        "heading": None if at is None else number(at.heading),
        "apart": None if at is None else numbers(at.rotation_error),
        "velocity": None if at is None else numbers(at.velocity),
    }
