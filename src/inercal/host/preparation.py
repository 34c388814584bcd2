"""Prepares a run before anything moves: checks its plan, and compiles its kernels.

Method and table must both accept the plan. A moving table must not wait for a compiler, so each
kernel is called with the kinds of arrays that occur in a run: a table at rest is polled, packets
are encoded and converted to samples, and the sequential estimator of the method is run. Without a
cache, this takes almost a minute on one core, while a second process compiles the kernels for the
accelerometers. Later runs on the same machine load the kernels from the cache. The kernels for the
final calibration are compiled at the end, when the table is at rest.
"""
# Numba is not typed.
# pyright: reportUnknownMemberType=false

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from inercal.basics.errors import InercalError, InputError, NotObserved
from inercal.benches.motion_control import ControlledBench, SpinTask, Task
from inercal.benches.turntable import Turntable, is_turntable, require_turntable
from inercal.benches.turntable.bench import COARSE_REST_SECONDS, settling_time
from inercal.estimation import Gaussian
from inercal.estimation.kernel_options import compile_beside
from inercal.host.assembly import SampleAssembler
from inercal.host.drivers.rotary_table import AxisLimits, AxisState, TableState, pack_state
from inercal.host.interlocks import Interlocks
from inercal.host.live_estimator import Navigator, is_whole_imu
from inercal.host.packets import PacketLayout, encode
from inercal.host.run_log import EVENT, IMU, TABLE, LogFrame
from inercal.host.tasks import RunOptions
from inercal.physics.plan import Position
from inercal.physics.quantities import Measures
from inercal.physics.sensors import G0, Sensor
from inercal.pipeline.design.turntable_path import turntable_path_sheet
from inercal.recordings import Track
from inercal.runfile import Run

_REST_KEY = "hold"  # key of the error if the first rest is too short


def check_plan(run: Run) -> tuple[str, ...]:
    """Return warnings about a plan that a host is about to carry out.

    The method processes a recording of an ideal sensor on an ideal table. It may refuse these data
    for a reason that does not apply to a real recording, such as a temperature coefficient. Such a
    refusal says nothing about the plan.

    Parameters
    ----------
    run : Run

    Raises
    ------
    InputError
        The first rest is too short, so the method would refuse the recording.
    """
    if not is_turntable(run.bench):
        return ()
    first = next((step for step in run.steps if isinstance(step, Position)), None)
    left_out = 2 * settling_time(run.bench)  # omitted at the ends of a rest
    checked = run
    if first is not None and first.seconds > left_out:
        shorter = replace(first, seconds=first.seconds - left_out)
        steps = tuple(shorter if step is first else step for step in run.steps)
        checked = replace(run, plan=lambda: steps)
    try:
        sheet = turntable_path_sheet(checked)
    except NotObserved as error:
        return (f"the plan does not determine all coefficients: {error}",)
    except InputError as error:
        if error.key != _REST_KEY:
            return ()
        rest = "no rest" if first is None else f"{first.label}, a rest of {first.seconds:g} s"
        raise InputError(
            f"the first rest of the plan is {rest}, but the method needs "
            f"{COARSE_REST_SECONDS:g} s of rest for the first values of the biases: begin with a "
            "rest of this length or longer",
            key="[method] path",
            names=() if first is None else (first.label,),
        ).located(run.path) from None
    except Exception:
        # A method may come from another package. If it fails on an ideal path, the run must not
        # end.
        return ()
    undecided = "; ".join(sheet.undecided)
    lacking = f"the plan does not determine all coefficients: {undecided}" if undecided else ""
    return tuple(filter(None, (lacking, *sheet.warnings)))


def require_feasible_plan(
    tasks: Sequence[Task], limits: Sequence[AxisLimits], bench: ControlledBench
) -> None:
    """Raise an error if the controller would refuse the plan or nothing enforces a limit.

    Parameters
    ----------
    tasks : sequence of Task
    limits : sequence of AxisLimits
        Limits that are set in the controller.
    bench : ControlledBench

    Raises
    ------
    InputError
        An axis cannot execute the plan; the message names the axis.
    """
    names, held = bench.names, bench.axis_motion_limits
    for task in tasks:
        if isinstance(task, SpinTask):
            limits[0].check(names[0], task.rate, held[0].acceleration)
            continue
        for name, most, of, *angles in zip(names, limits, held, task.start, task.end, strict=True):
            for angle in angles:
                most.check(name, task.rate or of.rate, of.acceleration, angle)


def require_thermometer(options: RunOptions, layout: PacketLayout) -> None:
    """Raise an `InputError` if the temperature of an IMU is limited, but not in its packets."""
    if options.temperature is not None and "temperature" not in layout.roles:
        raise InputError(
            f"the packets of {layout.name} contain no temperature; leave --temperature out",
            key="--temperature",
            names=(layout.name,),
        )


_RATE = 10.0  # Hz
_REST = 22.0  # s; a sequential estimator should not need a longer initial rest
_POLL = 0.02  # s
_CLOCKS_MATCHED = 7.0  # s after which the clocks have been related
_SECOND_PIECE = 2.0  # s at the end, which form a second piece
_AT_REST = (0.0, 0.0, G0, 0.0, 0.0, 0.0)  # m/s² and rad/s; approximate values are sufficient
_ROOM_TEMPERATURE = 298.15  # K
_LAST_SAMPLES = 10  # samples at the end of the rest, which are processed separately


def precompile_run(run: Run, layout: PacketLayout | None = None) -> None:
    """Compile all kernels that a run needs, and load them into this process.

    Parameters
    ----------
    run : Run
        A run on a bench that a host can drive.
    layout : PacketLayout, optional
        Layout of the IMU's packets. Without a layout, the kernels for packets and polls are not
        compiled.

    Raises
    ------
    InputError
        The packets do not match the run file.
    """
    # Packets do not have a temperature for each sample, so temperature coefficients are estimated
    # after the run.
    if run.method.sequential is not None and not run.sensor.uses("dT"):
        _compile_estimator(run)
    if not run.motion_control.has_attitude:
        if layout is not None:
            _assemble_rest(run, layout)
        return
    table = require_turntable(run)
    tracks = [_rest_track(run.sensor, table)] if layout is None else _assemble_rest(run, layout)
    checks = Interlocks((AxisLimits(),) * len(table.names), table, run.sensor)
    for track in tracks:
        checks.check_gyros(track)
    if is_whole_imu(run.sensor):
        navigator = Navigator(run.sensor, table)
        for track in tracks:
            navigator.feed(track, np.zeros(len(run.sensor.coefficients)))


def _compile_estimator(run: Run) -> None:
    """Run the sequential estimator on a rest; if it must be compiled, use two processes."""
    sensor = run.sensor
    if len({axis.measures for axis in sensor.axes}) > 1:
        with compile_beside(partial(_follow_part, run, "f")):
            _follow_part(run, "w")
    _follow_rest(run, sensor, run.priors)


def _follow_part(run: Run, kind: Measures) -> None:
    """Process one part of the sensor; if a method needs the whole sensor, it may refuse this."""
    with suppress(InercalError):
        _follow_rest(run, run.sensor.select_axes(kind), ())


def _follow_rest(run: Run, sensor: Sensor, priors: Sequence[Gaussian]) -> None:
    """Process a table at rest in two pieces; the first piece starts the estimator."""
    assert run.method.sequential is not None
    table = require_turntable(run)
    track = _rest_track(sensor, table)
    n = track.time.size
    result = run.method.sequential(run.estimator, sensor, table, run.steps, priors, _RATE)
    for piece in (track.slice(0, n - _LAST_SAMPLES), track.slice(n - _LAST_SAMPLES, n)):
        result.feed(piece)
        result.estimate()


def _assemble_rest(run: Run, layout: PacketLayout) -> list[Track]:
    """Return the samples of a rest in two pieces."""
    lasting = _CLOCKS_MATCHED + _REST + 3 * run.motion_control.settling(run.bench) + _SECOND_PIECE
    result, frames = SampleAssembler(run, layout, _POLL), _rest_frames(run, layout, lasting)
    tracks: list[Track] = []
    for early in (True, False):
        for frame in frames:
            if (frame.time < lasting - _SECOND_PIECE) == early:
                result.feed(frame)
        if (block := result.take()) is not None:
            tracks.append(block.track)
    return tracks


def _rest_frames(run: Run, layout: PacketLayout, lasting: float) -> list[LogFrame]:
    """Return the log frames of a rest: polls, packets and the start of the first section."""
    assert run.rate_hz is not None
    k = len(run.motion_control.readback(run.bench))
    rests = AxisState(0.0, 0.0, 0.0, in_position=True, moving=False, enabled=True, homed=True)
    section = {"what": "section", "number": 0, "label": "", "state": "begun", "hold": True}
    frames = [
        _event_frame(0.0, {"what": "session", "next": 0}),
        _event_frame(_CLOCKS_MATCHED, section | {"time": _CLOCKS_MATCHED}),
    ]
    for time in np.arange(0.0, lasting, _POLL).tolist():
        frames.append(LogFrame(TABLE, time, pack_state(TableState(time, (rests,) * k))))
    taken = np.arange(0.0, lasting, 1 / run.rate_hz)
    n = max(round(run.rate_hz * _POLL), 1)
    readings = np.tile(_AT_REST, (n, 1))
    step = int(layout.step or 1)
    for first in range(0, taken.size, n):
        part = taken[first : first + n]
        counter = (first + np.arange(part.size)) * step
        data = encode(layout, readings[: part.size], counter, part, _ROOM_TEMPERATURE)
        frames.append(LogFrame(IMU, float(part[-1]), data))
    return sorted(frames, key=lambda one: one.time)


def _event_frame(time: float, told: Mapping[str, object]) -> LogFrame:
    return LogFrame(EVENT, time, json.dumps(told).encode())


def _rest_track(sensor: Sensor, table: Turntable) -> Track:
    time = np.arange(0.0, _REST, 1 / _RATE)
    n, sensed = time.size, {"f": _AT_REST[:3], "w": _AT_REST[3:]}
    reading = [sensed[axis.measures][k % 3] for k, axis in enumerate(sensor.axes)]
    angles = np.zeros((n, len(table.names)))
    return Track(time, np.tile(reading, (n, 1)), angles, np.zeros(n, dtype=np.int64))
