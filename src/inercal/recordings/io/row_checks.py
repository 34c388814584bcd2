"""Check the rows of a recording for non-finite numbers, wrong time order and repeated rows.

Each check returns findings and, if it changes the rows, which samples to keep and in which order.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.units import format_count
from inercal.recordings import Finding, Indices, Mark, Recording
from inercal.recordings.io.column_table import TOO_LARGE, row_blocks

_OFTEN = 0.3  # share of the samples that have the stamp of the one before, in bursts

SampleLocator = Callable[[int], str]
"""Function that names the place of a sample in the file."""


class RowCheck(NamedTuple):
    """The findings of a check, and which samples to keep; None means all of them."""

    findings: list[Finding]
    keep: Indices | None = None


def check_finite(recording: Recording, where: SampleLocator, *, drop: bool) -> RowCheck:
    """Refuse or drop rows that contain NaN or infinity."""
    columns: dict[str, Array] = {"time": recording.time}
    columns |= {name: recording.data[:, k] for k, name in enumerate(recording.channels)}
    columns |= recording.readback
    if recording.temperature is not None:
        columns["temperature"] = recording.temperature
    rows = np.zeros(recording.time.size, np.bool_)
    for values in columns.values():
        rows |= ~is_usable(values)
    count = int(rows.sum())
    if count == 0:
        return RowCheck([])
    first = int(np.argmax(rows))
    name = next(
        name for name, values in columns.items() if not is_usable(values[first : first + 1]).all()
    )
    kind = (
        "a finite number"
        if not np.isfinite(columns[name][first])
        else f"a number below {TOO_LARGE:g}"
    )
    text = f"{format_count(count, 'row')} without {kind} (the first is {name} at {where(first)})"
    if drop and count < rows.size:
        return RowCheck(
            [Finding("warning", "nonfinite", f"{text}: dropped")], np.flatnonzero(~rows)
        )
    advice = "no other rows remain" if drop else 'remove them, or state nonfinite = "drop"'
    return RowCheck([Finding("refused", "nonfinite", f"{text}: {advice}", name, first, first + 1)])


def is_usable(values: Array) -> Bools:
    """Return which values are finite and small enough to be squared and summed."""
    return (values > -TOO_LARGE) & (values < TOO_LARGE)


def check_time_order(recording: Recording, where: SampleLocator) -> RowCheck:
    """Refuse times that decrease, but sort sections that were stored by label."""
    time = recording.time
    back = np.flatnonzero(time[1:] < time[:-1])
    if recording.time.size < 2:
        return RowCheck([Finding("refused", "order", "there is only one sample: record again")])
    if not back.size:
        return RowCheck([])
    labels = recording.labels
    if labels is not None and (labels[back] != labels[back + 1]).all():
        start = np.concatenate([[0], np.flatnonzero(labels[1:] != labels[:-1]) + 1])
        place = np.argsort(np.argsort(recording.time[start]))  # rank of each section in time
        length = np.diff(start, append=labels.size)
        keep = np.argsort(np.repeat(place, length), kind="stable")
        if (np.diff(recording.time[keep]) >= 0).all():
            count = np.count_nonzero(labels[start])  # without the times between sections
            text = f"the {count} labelled sections were out of order in time and were sorted"
            return RowCheck([Finding("note", "order", text)], keep)
    worst = int(back[0])
    others = f", and at {format_count(back.size - 1, 'more place')}" if back.size > 1 else ""
    text = (
        f"time decreases by {time[worst] - time[worst + 1]:.6g} s at {where(worst + 1)}{others}: "
        "the clock was reset or two files were joined; split the file there"
    )
    return RowCheck([Finding("refused", "order", text, None, worst + 1, worst + 2)])


def check_repeated_rows(recording: Recording, where: SampleLocator) -> RowCheck:
    """Drop rows that repeat the preceding row; refuse different rows with the same time."""
    same_time = np.flatnonzero(recording.time[1:] == recording.time[:-1])
    if not same_time.size:
        return RowCheck([])
    same = np.concatenate(
        [_repeats_previous_row(recording, same_time[k]) for k in row_blocks(same_time.size)]
    )
    if not same.all():
        first = int(same_time[np.argmin(same)])
        text = (
            f"{format_count(int((~same).sum()), 'row')} with the same time as the row before "
            f"but different readings, the first at {where(first + 1)}: "
            f"{shared_stamps_text(recording.time)} instead of the time column"
        )
        often = same_time.size > _OFTEN * recording.time.size
        what = "bursts" if often else "repeated"
        return RowCheck([Finding("refused", what, text, None, first + 1, first + 2)])
    kept = np.ones(recording.time.size, np.bool_)
    kept[same_time + 1] = False
    if kept.sum() < 2:
        text = "all rows are equal: neither the time nor any reading changes; record again"
        return RowCheck([Finding("refused", "repeated", text)])
    text = (
        f"{format_count(same_time.size, 'row')} repeated, the first at "
        f"{where(int(same_time[0]) + 1)}: dropped"
    )
    return RowCheck([Finding("note", "repeated", text)], np.flatnonzero(kept))


def shared_stamps_text(time: Array) -> str:
    """Return why stamps that stand still, (n,) s, are not times, and the rate to state instead.

    The rate follows from the samples between the first and the last new stamp.
    """
    new = np.flatnonzero(time[1:] > time[:-1]) + 1
    if not new.size:
        return "it never increases; state [data] rate"
    shared = (new[-1] - new[0]) / (new.size - 1) if new.size > 1 else float(new[0])
    if shared < 1 / (1 - _OFTEN):
        cause = "the time stamps are too coarse"
    else:
        cause = (
            f"samples come in bursts, about {shared:.3g} with the same stamp, so the stamps are "
            "those of a link or too coarse"
        )
    span = float(time[new[-1]] - time[new[0]])
    rate = f' = "{(new[-1] - new[0]) / span:.4g} Hz"' if span > 0 else ""
    return f"{cause}; state [data] rate{rate}"


def _repeats_previous_row(recording: Recording, samples: Indices) -> Bools:
    """Return for each of some samples whether the next row repeats it."""
    before, after = recording.take(samples), recording.take(samples + 1)
    same = (before.data == after.data).all(axis=1)
    if before.labels is not None and after.labels is not None:
        same &= before.labels == after.labels
    if before.temperature is not None and after.temperature is not None:
        same &= before.temperature == after.temperature
    for name in recording.readback:
        same &= before.readback[name] == after.readback[name]
    return same


def copied_sections(recording: Recording, marks: Sequence[Mark]) -> tuple[Finding, ...]:
    """Return a warning if sections have exactly the same samples as others, and are then copies.

    Parameters
    ----------
    recording : Recording
    marks : sequence of Mark
        The sections. A section whose readings are all constant is not judged.
    """
    seen: dict[tuple[int, bytes, bytes], Mark] = {}
    copies: list[tuple[str, str]] = []
    for mark in marks:
        data = recording.data[..., mark.start : mark.stop, :]
        ends = (data[..., 0, :].tobytes(), data[..., -1, :].tobytes())
        first = seen.setdefault((mark.stop - mark.start, *ends), mark)
        same = recording.data[..., first.start : first.stop, :]
        if first is not mark and np.array_equal(same, data) and np.ptp(data, axis=-2).any():
            copies.append((first.label, mark.label))
    if not copies:
        return ()
    more = f" (and {format_count(len(copies) - 1, 'more pair')})" if len(copies) > 1 else ""
    one, copy = copies[0]
    text = (
        f"2 sections have exactly the same samples: {one} and {copy}{more}; remove the copy, {copy}"
    )
    return (Finding("warning", "copies", text),)
