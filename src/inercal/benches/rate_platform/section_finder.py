"""Find the sections of one recording with the gyros, and match them in order to a stated list.

The means of blocks of half a second are compared with the running median of a section. A block
belongs to the section if, on every gyro, it agrees within 6σ, 2e-4 of the rate and twice the
earth's rate. σ is the standard deviation of a block, estimated from the median difference between
neighbouring blocks. A section lasts 5 s or longer. One second at each end and the part that exceeds
whole turns are left out.

A turn through a known angle is everything between two rests; its section extends into both rests.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import degrees
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import format_duration
from inercal.benches.rate_platform.sections import KnownTurn, PlatformStep, RateDwell, whole_turns
from inercal.physics.earth import EARTH_RATE
from inercal.physics.plan import describe_direction
from inercal.physics.sensors import Sensor
from inercal.recordings import Mark, Recording

_BLOCK = 0.5  # s
_SIGMAS = 6.0
_STEADY = 2e-4  # largest change relative to the rate
_SHORTEST = 5.0  # s
_GUARD = 1.0  # s at each end
_NORMAL_MEDIAN = 0.6745  # median magnitude of a standard normal number
_SLOW = 0.3  # times the slowest stated rate: slower is a rest
_SHOWN = 12


class SteadyRun(NamedTuple):
    """A half-open range of samples with a steady rate, and the rate, (3,) rad/s."""

    start: int
    stop: int
    rate: Array


def find_sections(
    recording: Recording, sensor: Sensor, stated: Sequence[PlatformStep], settle: float = 0.0
) -> tuple[tuple[Mark, ...], tuple[PlatformStep, ...]]:
    """Return the section of each stated step, and the steps with their durations.

    Parameters
    ----------
    recording : Recording
        Recording without a trial axis.
    sensor : Sensor
        Sensor with three gyros.
    stated : sequence of RateDwell or Pose
        Stated steps in the order of the recording.
    settle : float
        Time to leave out at the beginning of each section, s; at least one second is left out.

    Raises
    ------
    InputError
        The sensor does not have three gyros, or the number of sections found differs from the
        stated number. The message names both numbers.
    """
    gyros = sensor.select_axes("w")
    if len(gyros.axes) != len("xyz"):
        raise InputError(
            'sections can only be found with three gyros; label them, such as "x +50" and '
            '"x rest", and state marks = "labels"',
            key="[data] marks",
        )
    columns = [recording.channels.index(name) for name in gyros.channels]
    rate = gyros.to_si(recording.data[:, columns])
    runs = steady_runs(rate, recording.rate_hz)
    speeds = np.linalg.norm(_block_means(rate, recording.rate_hz)[0], axis=-1)  # also in turns
    pieces = _matched(recording, gyros, runs, stated, float(speeds.max(initial=0.0)))
    marks: list[Mark] = []
    steps: list[PlatformStep] = []
    for step, (start, stop) in zip(stated, pieces, strict=True):
        mark = Mark(step.label, start, stop)
        if not isinstance(step, KnownTurn):
            mark = _trimmed(recording, mark, step, settle)
        marks.append(mark)
        steps.append(_lasting(step, recording.span(mark.start, mark.stop)))
    return tuple(marks), tuple(steps)


def steady_runs(rate: Array, rate_hz: float) -> list[SteadyRun]:
    """Return the stretches in which the rate, (n, 3) rad/s, is steady, in order."""
    blocks, size = _block_means(rate, rate_hz)
    if (count := len(blocks)) < 2:
        return []
    noise = np.median(np.abs(np.diff(blocks, axis=0)), axis=0) / _NORMAL_MEDIAN / np.sqrt(2)
    runs: list[SteadyRun] = []
    first = 0
    for k in range(1, count + 1):
        middle = np.median(blocks[first:k], axis=0)
        limit = _SIGMAS * noise + _STEADY * np.linalg.norm(middle) + 2 * EARTH_RATE
        if k < count and np.all(np.abs(blocks[k] - middle) <= limit):
            continue
        if (k - first) * size >= _SHORTEST * rate_hz:
            runs.append(SteadyRun(first * size, k * size, middle))
        first = k
    return runs


def _block_means(rate: Array, rate_hz: float) -> tuple[Array, int]:
    """Return the means of a rate, (n, 3) rad/s, over blocks, and the samples in a block."""
    size = max(round(_BLOCK * rate_hz), 1)
    count = len(rate) // size
    return rate[: count * size].reshape(count, size, -1).mean(axis=1), size


def _matched(
    recording: Recording,
    gyros: Sensor,
    runs: Sequence[SteadyRun],
    stated: Sequence[PlatformStep],
    fastest: float,
) -> list[tuple[int, int]]:
    """Return the range of samples for each stated step.

    If no turn has a steady part, the fastest steady run is a rest, so rests are then compared with
    the highest rate of all.
    """
    turning = any(isinstance(step, KnownTurn) for step in stated)
    steady = [step for step in stated if not isinstance(step, KnownTurn)]
    tokens = list(runs)
    if turning:
        speeds = (float(np.linalg.norm(run.rate)) for run in runs)
        ways = [_without_turns(runs, stated, one) for one in (max(speeds, default=0.0), fastest)]
        tokens = next((one for one in ways if len(one) == len(steady)), ways[0])
    if len(tokens) != len(steady):
        further = " besides the turns" * turning
        raise InputError(
            f"{recording.source}: {len(tokens)} sections with a steady rate were found{further}, "
            f"but {len(steady)} are stated: found {_words(recording, gyros, tokens)}; stated "
            f"{', '.join(step.label for step in steady[:_SHOWN])}"
            f"{', …' * (len(steady) > _SHOWN)}; correct the list, or label the sections; "
            "consecutive rests without a motion between them count as one",
            key="[data] marks",
            names=tuple(step.label for step in steady[len(tokens) :]),
        )
    pieces: list[tuple[int, int]] = []
    done = 0
    for step in stated:
        if not isinstance(step, KnownTurn):
            pieces.append((tokens[done].start, tokens[done].stop))
            done += 1
            continue
        if not 0 < done < len(tokens):
            text = f"turn {step.label} needs a rest before and after it; state both"
            raise InputError(text, key="[data] sections", names=(step.label,))
        guard = round(_GUARD * recording.rate_hz)
        pieces.append((tokens[done - 1].stop - guard, tokens[done].start + guard))
    return pieces


def _without_turns(
    runs: Sequence[SteadyRun], stated: Sequence[PlatformStep], fastest: float
) -> list[SteadyRun]:
    """Return the rests and the stated rates, without steady parts of turns through an angle.

    A steady part of a turn is faster than a rest, and its rate is not one of the stated rates.
    `fastest` is a rate in turns, rad/s.
    """
    dwells = [
        abs(s.rate)
        for s in stated
        if isinstance(s, RateDwell) and s.rate and not isinstance(s, KnownTurn)
    ]
    speeds = [float(np.linalg.norm(run.rate)) for run in runs]
    slow = _SLOW * min([*dwells, _SLOW * fastest])
    return [
        run
        for run, speed in zip(runs, speeds, strict=True)
        if speed < slow or any(abs(speed / rate - 1) < _SLOW for rate in dwells)
    ]


def _trimmed(recording: Recording, mark: Mark, step: PlatformStep, settle: float) -> Mark:
    """Return a section without its ends, shortened to whole turns."""
    guard = round(_GUARD * recording.rate_hz)
    start, stop = mark.start + max(guard, round(settle * recording.rate_hz)), mark.stop - guard
    if stop <= start:
        raise _nothing_left(recording, mark, settle)
    if isinstance(step, RateDwell):
        seconds = whole_turns(step.rate, (stop - start) / recording.rate_hz)
        stop = min(stop, start + round(seconds * recording.rate_hz))
    return Mark(mark.label, start, stop)


def _lasting(step: PlatformStep, seconds: float) -> PlatformStep:
    """Return the step with another duration; a turn keeps its angle."""
    if isinstance(step, KnownTurn):
        return replace(step, rate=step.angle / seconds, seconds=seconds)
    return replace(step, seconds=seconds)


def _words(recording: Recording, gyros: Sensor, runs: Sequence[SteadyRun]) -> str:
    """Describe the found sections, such as "2.5 to 38 s +50.01 °/s about +z"."""
    if not runs:
        return "none"
    texts: list[str] = []
    for run in runs[:_SHOWN]:
        k = int(np.argmax(np.abs(run.rate)))
        i, j, m = gyros.axes[k].i
        rate = f"{degrees(run.rate[k]):+.4g} °/s about {describe_direction((i, j, m))}"
        texts.append(f"{run.start / recording.rate_hz:.3g} s {rate}".replace("-", "−"))
    more = f", and {len(runs) - _SHOWN} more" if len(runs) > _SHOWN else ""
    return f"at {', '.join(texts)}{more}"


def settled(
    recording: Recording, marks: Sequence[Mark], steps: Sequence[PlatformStep], settle: float
) -> tuple[tuple[Mark, ...], tuple[PlatformStep, ...]]:
    """Return labelled sections without the settling time of the table.

    Raises
    ------
    InputError
        A section is not longer than the settling time.
    """
    wait = round(settle * recording.rate_hz)
    kept: list[Mark] = []
    for mark, step in zip(marks, steps, strict=True):
        if mark.stop - mark.start <= wait:
            raise _nothing_left(recording, mark, settle)
        start = mark.start if isinstance(step, KnownTurn) else mark.start + wait
        kept.append(replace(mark, start=start))
    lasting = [
        _lasting(step, recording.span(mark.start, mark.stop))
        for step, mark in zip(steps, kept, strict=True)
    ]
    return tuple(kept), tuple(lasting)


def _nothing_left(recording: Recording, mark: Mark, settle: float) -> InputError:
    lasts = recording.span(mark.start, mark.stop)
    return InputError(
        f"{recording.source}: section {mark.label} lasts {format_duration(lasts)}, and nothing "
        f"remains after settle = {settle:g} s; record longer sections, or state a shorter time",
        key="[data] settle",
        names=(mark.label,),
    )
