"""Whether a section is at rest, by the change of its mean and not by its scatter.

A section is cut into ten blocks. It moves where the means of its blocks, in some channel, range
over more than noise, quantisation and slow changes of a sensor at rest explain:

    ptp(means) > max(20 s, 10 s₁/√n, min(10 s₁, 100 s), 3 r, 2.5 q, floor)

with s₁ the median scatter within the section's blocks of n samples, s the median of s₁ over all
sections, r the median range over all sections (a drift common to all is not a move) and q the
channel's smallest step. With white noise of any size the range stays below 5 s₁/√n, and with noise
correlated over a block below 5 s₁.
"""

from collections.abc import Collection, Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Finding, Mark, Recording
from inercal.recordings.io.column_table import row_blocks

_BLOCKS = 10
_USUAL = 20.0  # a step of so many scatters half-way adds ten times the variance of noise squared
_OWN_SCATTER_FACTOR = 10.0
_LARGE = 100.0  # usual scatters; the noise of a position does not exceed that of others so much
_COMMON, _MIN_SECTIONS = 3.0, 4  # times the usual range, where so many sections show what is usual
_QUANTA = 2.5
# Changes below these are no move, however quiet the sensor: 0.1 mrad of tilt, 2 °/h.
_FLOOR = {"f": 1e-4 * G0, "w": 1e-5}


def require_still(
    recording: Recording,
    sensor: Sensor,
    marks: Sequence[Mark],
    accepted: Collection[str] = (),
) -> tuple[Finding, ...]:
    """Refuse a section at rest in which the sensor moves.

    Parameters
    ----------
    recording : Recording
        With any trial axes.
    sensor : Sensor
        Its readout gives SI.
    marks : sequence of Mark
        Marks of rests; rests with fewer than 20 samples are not checked.
    accepted : collection of str
        Labels of sections that the user accepts although they move.

    Returns
    -------
    tuple of Finding
        A warning for each accepted section that moves.

    Raises
    ------
    InputError
        A section moves, or an accepted label marks no section, or a section that is still.
    """
    if unknown := [label for label in accepted if label not in {mark.label for mark in marks}]:
        raise InputError(
            f"{recording.source}: [data] accept_moving names {unknown[0]!r}, which is no rest; "
            f"the rests are {', '.join(mark.label for mark in marks)}",
            key="[data] accept_moving",
            names=tuple(unknown),
        )
    marks = [mark for mark in marks if mark.stop - mark.start >= 2 * _BLOCKS]
    if not marks:
        return ()
    columns = [recording.channels.index(name) for name in sensor.channels]
    size = [(mark.stop - mark.start) // _BLOCKS for mark in marks]
    judged = [
        _blocks(recording, sensor, columns, mark, n) for mark, n in zip(marks, size, strict=True)
    ]
    reach = np.stack([one for one, _ in judged])  # (sections, trials, axes)
    own = np.stack([one for _, one in judged])
    usual = np.median(own, axis=0)
    of_means = own / np.sqrt(np.array(size))[:, None, None]
    fixed = [
        max(_FLOOR[axis.measures], _QUANTA * _step(recording, column) / abs(axis.readout.scale))
        for axis, column in zip(sensor.axes, columns, strict=True)
    ]
    limit = np.maximum(np.maximum(_USUAL * usual, fixed), _OWN_SCATTER_FACTOR * of_means)
    limit = np.maximum(limit, np.minimum(_OWN_SCATTER_FACTOR * own, _LARGE * usual))
    if len(marks) >= _MIN_SECTIONS:
        limit = np.maximum(limit, _COMMON * np.median(reach, axis=0))
    findings: list[Finding] = []
    refused: list[tuple[float, str, str]] = []
    for mark, changes, most in zip(marks, reach, limit, strict=True):
        trial, k = np.unravel_index(int(np.argmax(changes / most)), changes.shape)
        change, allowed = float(changes[trial, k]), float(most[trial, k])
        if change <= allowed:
            if mark.label in accepted:
                raise InputError(
                    f"{recording.source}: [data] accept_moving names {mark.label!r}, which does "
                    "not move: remove it",
                    key="[data] accept_moving",
                    names=(mark.label,),
                )
            continue
        axis = sensor.axes[int(k)]
        text = (
            f"section {mark.label} moves: its mean changes by {change:.3g} "
            f"{QUANTITIES[axis.measures].unit} ({axis.name}) within it, and noise and "
            "quantisation explain "
            f"{allowed:.3g} {QUANTITIES[axis.measures].unit} at most"
        )
        if mark.label in accepted:
            message = f"{text}; [data] accept_moving accepts it"
            findings.append(Finding("warning", "moving", message, None, mark.start, mark.stop))
        else:
            refused.append((change / allowed, text, mark.label))
    if refused:
        _, text, label = max(refused)
        raise InputError(
            f"{recording.source}: {text}; mark only the time at rest, or name the section in "
            "[data] accept_moving",
            names=(label,),
        )
    return tuple(findings)


def _blocks(
    recording: Recording, sensor: Sensor, columns: Sequence[int], mark: Mark, n: int
) -> tuple[Array, Array]:
    """Return the range of the means of a section's blocks, and the median of their scatters.

    Both are (trials, m), SI; without a trial axis there is one trial.
    """
    data = recording.data[..., mark.start : mark.start + _BLOCKS * n, columns]
    parts = sensor.to_si(data).reshape(-1, _BLOCKS, n, len(columns))
    means: Array = parts.mean(axis=2)
    scatters: Array = parts.std(axis=2)
    return np.ptp(means, axis=1), np.asarray(np.median(scatters, axis=1))


def _step(recording: Recording, column: int) -> float:
    """Return the smallest change between samples of a channel, output units; 0 if constant."""
    least = np.inf
    for k in row_blocks(recording.time.size - 1):
        steps = np.abs(np.diff(recording.data[..., k.start : k.stop + 1, column], axis=-1))
        least = min(least, float(np.min(steps, initial=np.inf, where=steps > 0)))
    return least if np.isfinite(least) else 0.0
