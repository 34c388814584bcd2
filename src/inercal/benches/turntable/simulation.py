"""Simulate a turntable that moves from step to step at its limits, and its readback.

The table starts at rest with all angles zero. Before a step it moves all axes at once, each at its
own limits and to the nearest equivalent angle. Samples during this move have no label. Angles are
cumulative, so after two turns an axis reads 720°.

The moves of an axis from rest to rest consist of pieces with constant jerk. An axis speeds up to a
rate, keeps it and slows down symmetrically. Without a jerk limit its rate has a trapezoidal
profile. With a limit its acceleration is trapezoidal and its rate an S-curve::

    t_a = v/a,             way 2 · v t_a/2                         trapezoid
    t_j = min(a/j, √(v/j)),  t_a = v/(j t_j) − t_j,  way v (2 t_j + t_a)   S-curve

t_a is the time of acceleration, t_j the time of its ramps, and the way is the angle needed to speed
up to v and slow down. The axis turns through the rest of the angle at the rate v. If the angle is
too small to reach v, the axis only speeds up to the largest rate that it can reach.

Source: Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer
2008, 3.2 (trapezoidal velocity) and 3.4 (double S velocity).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, degrees, floor, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.benches.contract import SimulatedMotion
from inercal.benches.motion_control import AxisMotionLimits
from inercal.benches.turntable.attitude import ideal_readback, motion
from inercal.benches.turntable.bench import Turntable, settling_time
from inercal.benches.turntable.settings import HOLD_COLUMN, TurntableData
from inercal.physics.motion import Motion
from inercal.physics.plan import Position, Rotation, TableStep, table_steps
from inercal.physics.section_settings import key_error
from inercal.recordings import Recording
from inercal.recordings.data import RunBase
from inercal.recordings.data.recording_loader import readback_columns, readback_units
from inercal.recordings.io.column_table import row_blocks

_THERE = 1e-12  # rad: an axis this near to its goal does not move
_ROUNDED = 1e-6  # rounding error of a sample or a rate, relative
_MARGIN_SECONDS = 0.5  # s by which the readback's file extends beyond the recording at each end
_BLOCK = 1 << 13  # samples at a time, so that their matrices stay in the cache


@dataclass(frozen=True, eq=False)
class AxisProfile:
    """Angle of one axis over time in pieces with constant jerk, with rest before and after.

    Parameters
    ----------
    start : (p,) array
        Time at which each piece starts, in increasing order, s.
    state : (p, 4) array
        Angle, rate, acceleration and jerk at the start of each piece, in units of rad and s.
    """

    start: Array
    state: Array

    def evaluate(self, time: Array) -> tuple[Array, Array, Array]:
        """Return angle, rate and acceleration at times (n,), as (n,) arrays in rad and s."""
        piece = np.maximum(np.searchsorted(self.start, time, side="right") - 1, 0)
        t = np.maximum(time - self.start[piece], 0.0)
        angle, rate, acceleration, jerk = self.state[piece].T
        return (
            angle + t * (rate + t * (acceleration / 2 + t * jerk / 6)),
            rate + t * (acceleration + t * jerk / 2),
            acceleration + t * jerk,
        )


def stationary_profile(angle: float) -> AxisProfile:
    """Return the profile of an axis that stays at an angle, rad."""
    return AxisProfile(np.zeros(1), np.array([[angle, 0.0, 0.0, 0.0]]))


def move_profile(angle: float, limits: AxisMotionLimits) -> tuple[float, AxisProfile]:
    """Return the duration of a move from rest to rest, s, and its profile from 0.

    Parameters
    ----------
    angle : float
        Signed angle of the move, rad.
    limits : AxisMotionLimits
        Limits of the axis. The move is the fastest one with this shape within the limits.
    """
    size = abs(angle)
    if size == 0:
        return 0.0, stationary_profile(0.0)
    v = _largest_rate(size, limits)
    ramp = _ramp_time(v, limits)
    if limits.jerk is None:
        steady = v / limits.acceleration
        way = v * steady
        up = [(steady, limits.acceleration, 0.0)]
        down = [(steady, -limits.acceleration, 0.0)]
    else:
        # A rounding error must not make the steady part negative.
        steady = max(v / (limits.jerk * ramp) - ramp, 0.0)
        way = v * (2 * ramp + steady)
        top, j = limits.jerk * ramp, limits.jerk
        up = [(ramp, 0.0, j), (steady, top, 0.0), (ramp, top, -j)]
        down = [(ramp, 0.0, -j), (steady, -top, 0.0), (ramp, -top, j)]
    cruise = max(size - way, 0.0) / v
    pieces = [*up, (cruise, 0.0, 0.0), *down]
    return _join_pieces([p for p in pieces if p[0] > 0], angle)


def _ramp_time(v: float, limits: AxisMotionLimits) -> float:
    """Return the duration of one acceleration ramp on the way to the rate v, s."""
    if limits.jerk is None:
        return 0.0
    return min(limits.acceleration / limits.jerk, sqrt(v / limits.jerk))


def _largest_rate(size: float, limits: AxisMotionLimits) -> float:
    """Return the largest rate that an axis can reach within an angle, rad/s."""
    a, j = limits.acceleration, limits.jerk
    if j is None:
        return min(limits.rate, sqrt(size * a))
    # v (a/j + v/a) = size if the full acceleration is reached, otherwise 2 v √(v/j) = size.
    v = a / 2 * (sqrt((a / j) ** 2 + 4 * size / a) - a / j)
    if v < a**2 / j:
        v = j * (size / (2 * j)) ** (2 / 3)
    return min(limits.rate, v)


def _join_pieces(
    pieces: Sequence[tuple[float, float, float]], angle: float
) -> tuple[float, AxisProfile]:
    """Join pieces (duration, acceleration at start, jerk); return total duration and profile."""
    start, way, rate = 0.0, 0.0, 0.0
    rows: list[tuple[float, float, float, float, float]] = []
    for duration, acceleration, jerk in pieces:
        rows.append((start, way, rate, acceleration, jerk))
        way += duration * (rate + duration * (acceleration / 2 + duration * jerk / 6))
        rate += duration * (acceleration + duration * jerk / 2)
        start += duration
    rows.append((start, abs(angle), 0.0, 0.0, 0.0))  # exact, without accumulated rounding errors
    result = np.array(rows)
    return start, AxisProfile(result[:, 0], np.copysign(1.0, angle) * result[:, 1:])


def join_profiles(moves: Sequence[tuple[float, float, AxisProfile]], angle: float) -> AxisProfile:
    """Return the profile of an axis over all its moves.

    Parameters
    ----------
    moves : sequence of (start, angle, AxisProfile)
        Start, s, initial angle, rad, and profile of each move, in order and without overlap.
    angle : float
        Initial angle of the axis, rad.
    """
    first = stationary_profile(angle)
    starts, states = [first.start], [first.state]
    for start, origin, profile in moves:
        starts.append(profile.start + start)
        states.append(profile.state + np.array([origin, 0.0, 0.0, 0.0]))
    return AxisProfile(np.concatenate(starts), np.concatenate(states))


@dataclass(frozen=True, eq=False)
class PathProfile:
    """The motion of all axes along a path.

    Parameters
    ----------
    axes : tuple of k AxisProfile
        Profiles of the axes, outermost first.
    labels : tuple of str
        Label of each section; empty for a move between steps.
    ends : (sections,) array
        Time at which each section ends, s; the first section starts at 0.
    """

    axes: tuple[AxisProfile, ...]
    labels: tuple[str, ...]
    ends: Array

    def evaluate(self, time: Array) -> tuple[Array, Array, Array]:
        """Return angles, rates and accelerations at times (n,), as (n, k) arrays in rad and s."""
        parts = zip(*(axis.evaluate(time) for axis in self.axes), strict=True)
        angles, rates, accelerations = (np.stack(part, axis=-1) for part in parts)
        return angles, rates, accelerations

    def sample_labels(self, rate_hz: float) -> NDArray[np.str_]:
        """Return the label of each sample; a sample at the end of a section belongs to it."""
        last = np.floor(self.ends * rate_hz + _ROUNDED).astype(np.int64)
        samples = np.diff(last, prepend=0)
        return np.repeat(np.array(["", *self.labels]), [1, *samples])


def path_profile(bench: Turntable, steps: Sequence[TableStep]) -> PathProfile:
    """Return the motion of the axes over all steps.

    Raises
    ------
    InputError
        There are no steps, a step is for other axes than the table has, or a rate exceeds the limit
        of its axis.
    """
    if not steps:
        raise InputError("turntable: the path has no steps; add at least one", key="steps")
    time, now = 0.0, np.zeros(len(bench.axes))
    moves: list[list[tuple[float, float, AxisProfile]]] = [[] for _ in bench.axes]
    sections: list[tuple[str, float]] = []
    for step in steps:
        _refuse_step(bench, step)
        if step.angles is not None:
            longest = 0.0
            goal = np.array(step.angles)  # each axis moves to the nearest equivalent angle
            for i, angle in enumerate(goal + 2 * pi * np.round((now - goal) / (2 * pi)) - now):
                if abs(angle) > _THERE:
                    seconds, profile = move_profile(angle, bench.axis_motion_limits[i])
                    moves[i].append((time, now[i], profile))
                    now[i] += angle
                    longest = max(longest, seconds)
            time += longest
            sections.append(("", time))
        if isinstance(step, Position):
            time += step.seconds
        else:
            limits = replace(bench.axis_motion_limits[step.axis], rate=step.rate)
            seconds, profile = move_profile(step.angle, limits)
            moves[step.axis].append((time, now[step.axis], profile))
            now[step.axis] += step.angle
            time += seconds
        sections.append((step.label, time))
    labels, ends = zip(*sections, strict=True)
    axes = tuple(join_profiles(of_axis, 0.0) for of_axis in moves)
    return PathProfile(axes, labels, np.array(ends))


def _refuse_step(bench: Turntable, step: TableStep) -> None:
    k = len(bench.axes)
    if step.angles is not None and len(step.angles) != k:
        raise _step_error(
            step,
            "angles",
            f"{len(step.angles)} angles; give one for each of the {k} axes of the turntable",
        )
    if isinstance(step, Rotation):
        if step.axis >= k:
            raise _step_error(
                step, "axis", f"axis {step.axis}; the axes of the turntable are 0 to {k - 1}"
            )
        most = bench.axis_motion_limits[step.axis].rate
        if step.rate > most * (1 + _ROUNDED):
            text = (
                f"the rate {degrees(step.rate):.6g} °/s exceeds the limit of the "
                f"{bench.names[step.axis]} axis, {degrees(most):.6g} °/s"
            )
            raise _step_error(step, "rate", text)


def _step_error(step: TableStep, key: str, text: str) -> InputError:
    return InputError(f"{step.label}: {text}", key=key, names=(step.label,))


def turntable_path_duration(bench: Turntable, steps: Sequence[TableStep]) -> float:
    """Return the duration of a path with all its moves, s."""
    return float(path_profile(bench, steps).ends[-1])


def simulate_turntable_motion(
    bench: Turntable,
    steps: Sequence[TableStep],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int = 1,
    readback_hz: float | None = None,
) -> SimulatedMotion:
    """Simulate the motion in each trial, and the readback of each axis.

    Parameters
    ----------
    bench : Turntable
        The bench. Its parameters are drawn from normal distributions with their stated standard
        deviations.
    steps : sequence of TableStep
    rate_hz : float
        Samples per second.
    rng : Generator
    trials : int
        Number of trials, which is the leading axis of the drawn errors, the motion and the
        readback.
    readback_hz : float, optional
        Readings of the table per second, which are interpolated linearly to the samples. None means
        one reading per sample.

    Returns
    -------
    SimulatedMotion
        The motion. Its readback is the cumulative angle of each axis, (trials, n) rad, by the name
        of the axis, such as "outer".

    Raises
    ------
    InputError
        `path_profile` refuses the steps.
    """
    way = path_profile(bench, steps)
    labels = way.sample_labels(rate_hz)
    time: Array = np.arange(labels.size) / rate_hz
    declared = bench.acting_parameters()
    drawn = bench.qualified.draw(declared, rng, trials)
    stamps = time
    if readback_hz is not None:
        stamps = np.asarray(range(ceil(time[-1] * readback_hz) + 1)) / readback_hz
    f, w, dw = (np.empty((trials, time.size, 3)) for _ in range(3))
    readings = np.empty((trials, time.size, len(bench.axes)))
    for k in range(trials):
        q = {name: values[k] for name, values in drawn.items()}
        for part in row_blocks(time.size, _BLOCK):
            result = motion(bench, *way.evaluate(time[part]), q)
            f[k, part], w[k, part], dw[k, part] = result.f, result.w, result.dw
        for i, column in enumerate(sample_readback(bench, way, stamps, q, rng).T):
            readings[k, :, i] = np.interp(time, stamps, column)
    readback = {name: readings[..., i] for i, name in enumerate(bench.names)}
    return SimulatedMotion(time, Motion(f, w, dw), labels, drawn, readback)


def sample_readback(
    bench: Turntable,
    way: PathProfile,
    stamps: Array,
    q: Mapping[str, Array],
    rng: np.random.Generator,
) -> Array:
    """Return the readback of the table at time stamps of its own clock, (n, k) rad.

    Parameters
    ----------
    bench : Turntable
    way : PathProfile
    stamps : (n,) array
        Times on the table's clock, s. The table is at rest before and after its motion.
    q : mapping of str to ()
        The bench's parameters, SI, by name.
    rng : Generator
        Generator for the noise of the readback.
    """
    angles = way.evaluate(stamps * (1 - q["clock"]) - q["latency"])[0]
    return ideal_readback(bench, angles, q) + bench.white * rng.standard_normal(angles.shape)


def add_hold_numbers(
    bench: Turntable, steps: Sequence[TableStep], done: SimulatedMotion
) -> SimulatedMotion:
    """Add the hold number of each sample to a simulation, in the form that a bench host uses."""
    number, margin = np.full(done.time.size, -1.0), settling_time(bench)
    for k, step in enumerate(step for step in steps if isinstance(step, Position)):
        time = done.time[done.labels == step.label]
        number[(done.time >= time[0] + margin) & (done.time <= time[-1] - margin)] = k
    return replace(done, readback={**done.readback, HOLD_COLUMN: number})


def readback_files(
    run: RunBase[TurntableData], done: SimulatedMotion, rng: np.random.Generator
) -> dict[str, Recording]:
    """Return the readback file with the table's own clock, if the run file names one.

    The clock is ahead by the bench's latency and gains at the relative rate `clock`. The file
    begins before the recording and ends after it, as if it had been started and stopped by hand.
    """
    bench, data, rate = run.bench, run.data, run.rate_hz
    if data.sample == "mean":
        raise key_error(
            "[data] sample",
            'a simulation produces readings at single instants; set sample = "instant" to simulate',
            run.path,
        )
    if data.table_file is None:
        return {}
    assert rate is not None
    q = {name: values[0] for name, values in done.bench_errors.items()}
    first, last = ((t + q["latency"]) / (1 - q["clock"]) for t in (0.0, float(done.time[-1])))
    ticks = range(
        floor((first - _MARGIN_SECONDS) * rate), ceil((last + _MARGIN_SECONDS) * rate) + 1
    )
    stamps = np.array(ticks) / rate
    angles = sample_readback(bench, path_profile(bench, table_steps(run.steps)), stamps, q, rng)
    sizes = np.array([readback_units(run)[name] for name in bench.names])
    table = Recording(
        time=stamps / si_factor(data.table_time_unit, "s"),
        data=angles / sizes,
        channels=tuple(readback_columns(run)[name] for name in bench.names),
        units=(data.table_unit,) * len(sizes),
        time_name=str(data.table_time),
    )
    return {data.table_file: table}
