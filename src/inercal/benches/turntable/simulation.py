"""A turntable in simulation: from step to step at its limits, with its readback.

The table starts at rest with all angles zero. Before a step it moves all axes at once, each at its
own limits and to the nearest of all equal angles; samples of such a move have no label. Axes count
on: after two turns they read 720°.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, degrees, pi

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.benches.contract import SimulatedMotion
from inercal.benches.turntable.attitude import ideal_readback, motion
from inercal.benches.turntable.axis_profiles import AxisProfile, join_profiles, move_profile
from inercal.benches.turntable.bench import Turntable
from inercal.errors import InputError
from inercal.io.column_table import row_blocks
from inercal.motion import Motion
from inercal.plan import Position, Rotation, TableStep

_THERE = 1e-12  # rad: an axis that near need not move
_ROUNDED = 1e-6  # of a sample, of a rate
_BLOCK = 1 << 13  # samples at a time: their matrices stay in the cache


@dataclass(frozen=True, eq=False)
class PathProfile:
    """The way of all axes through a path.

    Parameters
    ----------
    axes : tuple of k AxisProfile
        The outermost first.
    labels : tuple of str
        Of each section; empty of a move between steps.
    ends : (sections,) array
        When each section ends, s; the first one starts at 0.
    """

    axes: tuple[AxisProfile, ...]
    labels: tuple[str, ...]
    ends: Array

    def evaluate(self, time: Array) -> tuple[Array, Array, Array]:
        """Return angles, rates and accelerations at times (n,), (n, k) each: rad, s."""
        parts = zip(*(axis.evaluate(time) for axis in self.axes), strict=True)
        angles, rates, accelerations = (np.stack(part, axis=-1) for part in parts)
        return angles, rates, accelerations

    def sample_labels(self, rate_hz: float) -> NDArray[np.str_]:
        """Return the label of each sample; one at the very end of a section belongs to it."""
        last = np.floor(self.ends * rate_hz + _ROUNDED).astype(np.int64)
        samples = np.diff(last, prepend=0)
        return np.repeat(np.array(["", *self.labels]), [1, *samples])


def path_profile(bench: Turntable, steps: Sequence[TableStep]) -> PathProfile:
    """Return the way through the steps.

    Raises
    ------
    InputError
        No steps, a step of other axes than the table has, or a rate beyond its axis' limit.
    """
    if not steps:
        raise InputError("turntable: a path without steps leads nowhere")
    time, now = 0.0, np.zeros(len(bench.axes))
    moves: list[list[tuple[float, float, AxisProfile]]] = [[] for _ in bench.axes]
    sections: list[tuple[str, float]] = []
    for step in steps:
        _refuse_step(bench, step)
        if step.angles is not None:
            longest = 0.0
            for i, way in enumerate(_nearest_rotation(now, np.array(step.angles))):
                if abs(way) > _THERE:
                    seconds, course = move_profile(way, bench.axis_motion_limits[i])
                    moves[i].append((time, now[i], course))
                    now[i] += way
                    longest = max(longest, seconds)
            time += longest
            sections.append(("", time))
        if isinstance(step, Position):
            time += step.seconds
        else:
            limits = replace(bench.axis_motion_limits[step.axis], rate=step.rate)
            seconds, course = move_profile(step.angle, limits)
            moves[step.axis].append((time, now[step.axis], course))
            now[step.axis] += step.angle
            time += seconds
        sections.append((step.label, time))
    labels, ends = zip(*sections, strict=True)
    return PathProfile(tuple(join_profiles(one, 0.0) for one in moves), labels, np.array(ends))


def _nearest_rotation(now: Array, goal: Array) -> Array:
    """Return the way from angles to the nearest of all that equal the goal, (k,) rad."""
    return goal + 2 * pi * np.round((now - goal) / (2 * pi)) - now


def _refuse_step(bench: Turntable, step: TableStep) -> None:
    k = len(bench.axes)
    if step.angles is not None and len(step.angles) != k:
        raise InputError(f"{step.label}: {len(step.angles)} angles; the turntable's axes are {k}")
    if isinstance(step, Rotation):
        if step.axis >= k:
            raise InputError(f"{step.label}: axis {step.axis}; the turntable has 0 to {k - 1}")
        most = bench.axis_motion_limits[step.axis].rate
        if step.rate > most * (1 + _ROUNDED):
            raise InputError(
                f"{step.label}: {degrees(step.rate):.6g} °/s is beyond the limit of the "
                f"{bench.names[step.axis]} axis, {degrees(most):.6g} °/s"
            )


def turntable_path_duration(bench: Turntable, steps: Sequence[TableStep]) -> float:
    """Return how long a path takes with all its moves, s."""
    return float(path_profile(bench, steps).ends[-1])


def simulate_turntable_motion(
    bench: Turntable,
    steps: Sequence[TableStep],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int = 1,
    readback_hz: float | None = None,
) -> SimulatedMotion:
    """Return the motion of each trial, and what the table reads back of each axis.

    Parameters
    ----------
    bench : Turntable
        Its parameters are drawn from normal distributions of their stated deviations.
    steps : sequence of TableStep
    rate_hz : float
        Samples per second.
    rng : Generator
    trials : int
        Length of the leading axis of what is drawn, of the motion and of the readback.
    readback_hz : float, optional
        Readings of the table per second, brought to the samples linearly by their stamps; None is
        one reading each sample.

    Returns
    -------
    SimulatedMotion
        Its readback is (trials, n), by the name of the axis, such as "outer": angle, rad, which
        counts on beyond whole turns.

    Raises
    ------
    InputError
        As `path_profile`.
    """
    way = path_profile(bench, steps)
    labels = way.sample_labels(rate_hz)
    time: Array = np.arange(labels.size) / rate_hz
    declared = bench.acting_parameters()
    drawn = {n: p.value + p.sd * rng.standard_normal(trials) for n, p in declared.items()}
    stamps = time if readback_hz is None else _readback_times(time[-1], readback_hz)
    f, w, dw = (np.empty((trials, time.size, 3)) for _ in range(3))
    said = np.empty((trials, time.size, len(bench.axes)))
    for k in range(trials):
        q = {name: values[k] for name, values in drawn.items()}
        for part in row_blocks(time.size, _BLOCK):
            result = motion(bench, *way.evaluate(time[part]), q)
            f[k, part], w[k, part], dw[k, part] = result.f, result.w, result.dw
        said[k] = _simulated_readback(bench, way, stamps, time, q, rng)
    readback = {name: said[..., i] for i, name in enumerate(bench.names)}
    return SimulatedMotion(time, Motion(f, w, dw), labels, drawn, readback)


def _simulated_readback(
    bench: Turntable,
    way: PathProfile,
    stamps: Array,
    time: Array,
    q: Mapping[str, Array],
    rng: np.random.Generator,
) -> Array:
    """Return readings by the table's stamps, brought to the samples' times, (n, k) rad."""
    read = sample_readback(bench, way, stamps, q, rng)
    brought: list[Array] = [np.interp(time, stamps, one) for one in read.T]
    return np.stack(brought, axis=-1)


def sample_readback(
    bench: Turntable,
    way: PathProfile,
    stamps: Array,
    q: Mapping[str, Array],
    rng: np.random.Generator,
) -> Array:
    """Return what the table reads back by its own stamps, (n, k) rad.

    Parameters
    ----------
    bench : Turntable
    way : PathProfile
    stamps : (n,) array
        s of the table's clock; before and after its way the table stands.
    q : mapping of str to ()
        The bench's parameters by name, SI.
    rng : Generator
        Of the readback's noise.
    """
    angles = way.evaluate(stamps * (1 - q["clock"]) - q["latency"])[0]
    return ideal_readback(bench, angles, q) + bench.white * rng.standard_normal(angles.shape)


def _readback_times(end: float, rate_hz: float) -> Array:
    return np.arange(ceil(end * rate_hz) + 1) / rate_hz
