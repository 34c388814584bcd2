"""Find the rests in a recording from a rate table, and explain which states were left out."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import pi
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, true_ranges
from inercal.basics.units import format_count, format_duration
from inercal.recordings import Finding, Mark, Recording
from inercal.recordings.segments import dwells
from inercal.recordings.segments.plan_check import marks_from_labels

_LEAST_REST = 3.0  # s


def find_stationary_states(recording: Recording) -> tuple[tuple[Mark, ...], tuple[Finding, ...]]:
    """Return the table's rests under each label, "XY at rest", and findings about unused rests.

    Parameters
    ----------
    recording : Recording
        Recording with readback "arm_rate", rad/s, and labels.
    """
    still = _is_stationary(recording)
    rests: list[Mark] = []
    left_out: list[Finding] = []
    for name, start, stop in _labelled_sections(recording):
        for first, last in _runs(still, start, stop):
            mark = Mark(f"{name} at rest", *_trim_settling(recording, first, last))
            if mark.stop - mark.start < round(_LEAST_REST * recording.rate_hz):
                continue
            again = sum(other.label.startswith(mark.label) for other in rests)
            mark = replace(mark, label=f"{mark.label} ({again + 1})") if again else mark
            if (flaw := dwells.flaw_text(recording, mark)) is None:
                rests.append(mark)
                continue
            text = f"{mark.label} is not used: {flaw}"
            left_out.append(Finding("warning", "dwell", text, None, mark.start, mark.stop))
    return tuple(rests), tuple(left_out)


def omitted_state_findings(
    recording: Recording, marks: Sequence[Mark], findings: Sequence[Finding]
) -> tuple[Finding, ...]:
    """Return findings about parts of a recording that do not count as states, with the reasons.

    The findings concern steady rates with too few whole turns under a label, rests that are too
    short, labels without any state, and places where the recording is interrupted while the table
    turns.

    Parameters
    ----------
    recording : Recording
        Recording with readback "arm_rate", rad/s, and labels.
    marks : sequence of Mark
        Marks of the recording's states.
    findings : sequence of Finding
        Findings about states that were not used for other reasons, with their samples.
    """
    used = [(mark.start, mark.stop) for mark in marks]
    used += [(f.start, f.stop) for f in findings if f.start is not None and f.stop is not None]
    sections = _labelled_sections(recording)
    known = {name for name, start, stop in sections if any(start <= k < stop for k, _ in used)}
    smooth, steady = dwells.steady_rate(recording)
    still = _is_stationary(recording)
    lost: list[_OmittedState] = []
    for name, start, stop in sections:
        here = [(first, last) for first, last in used if start <= first < stop]
        short = [
            one
            for run in _runs(steady, start, stop)
            if not any(first < run[1] and last > run[0] for first, last in here)
            and (one := _short_dwell(recording, name, smooth, *run))
        ]
        rests = _runs(still, start, stop)
        if not any(still[first] for first, _ in here):
            short += _short_rest(recording, name, rests, bool(short) or name in known)
        if not short and name not in known:
            short = [_OmittedState(name, "never steady or at rest")]
        lost += short
    kinds = dict.fromkeys(one.kind for one in lost)
    texts = [_omission_text([one for one in lost if one.kind == kind]) for kind in kinds]
    texts += _lost_motion_texts(recording)
    return tuple(Finding("warning", "states", text) for text in texts)


class _OmittedState(NamedTuple):
    """A part that does not count as a state: the reason, its size, and the required size."""

    label: str
    kind: str
    size: float = np.nan
    unit: str = ""
    needed: str = ""


def _omission_text(lost: Sequence[_OmittedState]) -> str:
    names = ", ".join(one.label for one in lost)
    count = f"{format_count(len(lost), 'state')} left out: {names}"
    _, kind, _, unit, needed = lost[0]
    if not unit:
        return f"{count} ({kind})"
    # Round down: 2.96 turns are not 3.
    low, high = (
        f"{int(10 * size) / 10:.1f}"
        for size in (min(one.size for one in lost), max(one.size for one in lost))
    )
    size = low if low == high else f"{low} to {high}"
    return f"{count} ({size} {unit}{kind}; {needed} are needed)"


def _short_dwell(
    recording: Recording, name: str, smooth: Array, start: int, stop: int
) -> _OmittedState | None:
    """Return a steady rate that does not count as a state; None if it lasts only a moment."""
    if recording.span(start, stop) < dwells.SETTLING_TIME:
        return None
    cuts = [int(after) for after in recording.gaps[:, 1] if start < after < stop]
    rate = recording.readback[dwells.ARM_RATE]
    turns = 0.0
    for first, last in pairwise([start, *cuts, stop]):
        first += round(dwells.SETTLING_TIME * recording.rate_hz)
        if last - first > 1:
            angle = dwells.swept_angle(rate[first:last], recording.time[first:last])
            turns = max(turns, abs(float(angle[-1])) / (2 * pi))
    label = f"{name} at {abs(float(smooth[start:stop].mean())) * 30 / pi:.4g} rpm"
    why = _interruption_text(recording, start, stop)
    return _OmittedState(label, why, turns, "turns", f"{dwells.LEAST_TURNS}")


def _short_rest(
    recording: Recording, name: str, runs: Sequence[tuple[int, int]], others: bool
) -> list[_OmittedState]:
    """Return the longest rest under a label, if it was intended as a state.

    Between other states, a table may stop for a moment without such an intention.
    """
    longest = max(runs, key=lambda run: run[1] - run[0], default=(0, 0))
    if (longest[1] - longest[0]) / recording.rate_hz < (
        _LEAST_REST if others else dwells.SETTLING_TIME
    ):
        return []
    first, last = _trim_settling(recording, *longest)
    seconds = max((last - first) / recording.rate_hz, 0.0)
    kind = f" settled{_interruption_text(recording, *longest)}"
    return [_OmittedState(f"{name} at rest", kind, seconds, "s", f"{_LEAST_REST:g}")]


def _interruption_text(recording: Recording, start: int, stop: int) -> str:
    """Return words that say how a state was interrupted, if it did not end by itself."""
    if any(start <= after <= stop for after in recording.gaps[:, 1].tolist()):
        return " next to a gap"
    return " up to the end of the recording" if stop == recording.time.size else ""


def _lost_motion_texts(recording: Recording) -> list[str]:
    """Return texts on gaps or an end while the table turns, where its states are unknown."""
    labels, rate = recording.labels, recording.readback[dwells.ARM_RATE]
    assert labels is not None
    turning = ~_is_stationary(recording)
    texts: list[str] = []
    for before, after in recording.gaps.tolist():
        same = labels[before] == labels[after] and np.isclose(rate[before], rate[after], rtol=0.01)
        if (turning[before] or turning[after]) and not same:
            lost = recording.time[after] - recording.time[before]
            side = f"{labels[before]} when" if turning[before] else f"{labels[after]} after"
            texts.append(
                f"the table turns under {side} {format_duration(float(lost))} of data are lost "
                f"({recording.where(before)}): states may be missing there"
            )
    if turning[-1]:
        texts.append(
            f"the recording ends while the table turns under {labels[-1]}; record until the table "
            "stands still"
        )
    return texts


def _is_stationary(recording: Recording) -> Bools:
    rate = np.abs(recording.readback[dwells.ARM_RATE])
    return rate <= dwells.TURNING_SHARE * rate.max()


def _trim_settling(recording: Recording, start: int, stop: int) -> tuple[int, int]:
    settling = round(dwells.SETTLING_TIME * recording.rate_hz)
    return start + settling, stop - settling


def _labelled_sections(recording: Recording) -> list[tuple[str, int, int]]:
    """Return the label of each section and its half-open range of samples."""
    marks = () if recording.labels is None else marks_from_labels(recording, again=True)
    return [(mark.label, mark.start, mark.stop) for mark in marks]


def _runs(held: Bools, start: int, stop: int) -> list[tuple[int, int]]:
    """Return the ranges, within samples start to stop, in which `held` is true."""
    return [(first, last) for first, last in (true_ranges(held[start:stop]) + start).tolist()]
