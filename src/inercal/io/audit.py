"""What is wrong or odd with a recording, before anything is computed from it.

Each check is a function of the recording and returns findings. Three of them also say which
samples to keep, in which order: non-finite rows and repeated rows go, and sections that were
stored by label are put in the order of time. Messages name lines of the file as it was read.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from inercal.errors import InputError
from inercal.io import runs
from inercal.recording import Array, Finding, Indices, Recording

Nonfinite = Literal["refuse", "drop"]
Where = Callable[[int], str]
"""Names the place of a sample in the file."""

_LOST = 0.01  # of the recording; less is a note
_NEAR_S = 1.0  # saturated stretches closer than this are one finding


class _Checked(NamedTuple):
    findings: list[Finding]
    keep: Indices | None = None


def audit(
    recording: Recording,
    nonfinite: Nonfinite = "refuse",
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> Recording:
    """Return the recording cleaned of repeated and dropped rows, with all findings.

    Parameters
    ----------
    recording : Recording
        One run: data (n, m).
    nonfinite : "refuse" or "drop"
        What to do with rows that hold NaN or infinity.
    limits : mapping of channel to (lowest, highest), optional
        Output at the ends of the range, output units; others are found from the data.

    Returns
    -------
    Recording
        Where a finding is "refused" the samples are as they came.

    Raises
    ------
    InputError
        The recording has an axis of trials, or limits name no channel.
    """
    if recording.data.ndim != 2:
        raise InputError("audit takes one run, data (n, m), without an axis of trials")
    limits = limits or {}
    for channel in set(limits) - set(recording.channels):
        raise InputError(f"limits for {channel!r}; channels are {', '.join(recording.channels)}")
    cleaned, rows = recording, np.arange(recording.time.size)
    findings = list(recording.findings)
    for check in (_nonfinite_check(nonfinite), order, repeated):
        found, keep = check(cleaned, lambda k, rows=rows: recording.where(int(rows[k])))
        findings += found
        if any(finding.severity == "refused" for finding in found):
            return replace(recording, findings=tuple(findings))
        if keep is not None:
            cleaned, rows = cleaned.take(keep), rows[keep]
    for sampled in (gaps, jitter):
        findings += sampled(cleaned)
    for k, channel in enumerate(cleaned.channels):
        findings += channel_findings(cleaned, k, limits.get(channel))
    kept = None if np.array_equal(rows, np.arange(recording.time.size)) else rows
    return replace(cleaned, findings=tuple(findings), original=kept)


def accept(recording: Recording) -> Recording:
    """Return an audited recording.

    Raises
    ------
    InputError
        A finding refuses it; the line is the first such finding's.
    """
    refused = [finding.message for finding in recording.findings if finding.severity == "refused"]
    if refused:
        more = f" (and {len(refused) - 1} more)" if refused[1:] else ""
        raise InputError(f"{recording.source or 'recording'}: {refused[0]}{more}")
    return recording


def _nonfinite_check(nonfinite: Nonfinite) -> Callable[[Recording, Where], _Checked]:
    return lambda recording, where: finite(recording, where, drop=nonfinite == "drop")


def finite(recording: Recording, where: Where, *, drop: bool) -> _Checked:
    """Refuse rows with NaN or infinity, or drop them."""
    columns: dict[str, Array] = {"time": recording.time}
    columns |= {name: recording.data[:, k] for k, name in enumerate(recording.channels)}
    columns |= recording.readback
    if recording.temperature is not None:
        columns["temperature"] = recording.temperature
    bad = {name: ~np.isfinite(values) for name, values in columns.items()}
    rows = np.logical_or.reduce(list(bad.values()))
    count = int(rows.sum())
    if count == 0:
        return _Checked([])
    first = int(np.argmax(rows))
    name = next(name for name in bad if bad[name][first])
    text = f"{_rows(count)} without a finite number, the first {name} at {where(first)}"
    if drop and count < rows.size:
        return _Checked(
            [Finding("warning", "nonfinite", f"{text}: dropped")], np.flatnonzero(~rows)
        )
    advice = 'remove them, or state nonfinite = "drop"' if not drop else "nothing is left"
    return _Checked([Finding("refused", "nonfinite", f"{text}: {advice}", name, first, first + 1)])


def order(recording: Recording, where: Where) -> _Checked:
    """Refuse time that goes back, but put sections stored by label in the order of time."""
    step = np.diff(recording.time)
    back = np.flatnonzero(step < 0)
    if recording.time.size < 2:
        return _Checked([Finding("refused", "order", "a single sample: nothing to average")])
    if not back.size:
        return _Checked([])
    labels = recording.labels
    if labels is not None and (labels[back] != labels[back + 1]).all():
        start = np.concatenate([[0], np.flatnonzero(labels[1:] != labels[:-1]) + 1])
        place = np.argsort(np.argsort(recording.time[start]))  # of each section, in time
        length = np.diff(start, append=labels.size)
        keep = np.argsort(np.repeat(place, length), kind="stable")
        if (np.diff(recording.time[keep]) >= 0).all():
            text = f"{start.size} labelled sections were not stored in the order of time: sorted"
            return _Checked([Finding("note", "order", text)], keep)
    worst = int(back[0])
    others = f", and at {back.size - 1} more places" if back.size > 1 else ""
    text = (
        f"time goes back by {-step[worst]:.6g} s at {where(worst + 1)}{others}: "
        "was the clock reset, or are two files joined? Split the file there"
    )
    return _Checked([Finding("refused", "order", text, None, worst, worst + 2)])


def repeated(recording: Recording, where: Where) -> _Checked:
    """Drop rows that repeat the row before; refuse two different rows of one time."""
    same_time = np.flatnonzero(np.diff(recording.time) == 0)
    if not same_time.size:
        return _Checked([])
    before, after = recording.take(same_time), recording.take(same_time + 1)
    same = (before.data == after.data).all(axis=1)
    if before.labels is not None and after.labels is not None:
        same &= before.labels == after.labels
    if before.temperature is not None and after.temperature is not None:
        same &= before.temperature == after.temperature
    for name in recording.readback:
        same &= before.readback[name] == after.readback[name]
    if not same.all():
        first = int(same_time[np.argmin(same)])
        text = (
            f"{_rows(int((~same).sum()))} with the time of the row before and other readings, the "
            f"first at {where(first + 1)}: with stamps this coarse, state [data] rate in place of "
            "the time column"
        )
        return _Checked([Finding("refused", "repeated", text, None, first, first + 2)])
    keep = np.delete(np.arange(recording.time.size), same_time + 1)
    if keep.size < 2:
        text = "every row repeats the first one: time and readings stand still"
        return _Checked([Finding("refused", "repeated", text)])
    text = f"{_rows(same_time.size)} repeated, the first at {where(int(same_time[0]) + 1)}: dropped"
    return _Checked([Finding("note", "repeated", text)], keep)


def gaps(recording: Recording) -> list[Finding]:
    """Note gaps; those inside a section that lose more than 1 % of the time are a warning."""
    found = recording.gaps
    if recording.labels is None:
        between = np.zeros(len(found), np.bool_)
    else:
        between = recording.labels[found[:, 0]] != recording.labels[found[:, 1]]
    findings: list[Finding] = []
    for some, place in ((found[~between], ""), (found[between], " between labelled sections")):
        if not len(some):
            continue
        lost = recording.time[some[:, 1]] - recording.time[some[:, 0]] - recording.median_step
        k = int(np.argmax(lost))
        start, stop = int(some[k, 0]), int(some[k, 1]) + 1
        count = f"{len(some)} gap" + ("s" if len(some) > 1 else "")
        text = f"{count}{place}, {lost.sum():.4g} s lost in all"
        if len(some) > 1:
            text += f", {lost[k]:.4g} s in the longest"
        text += f", after sample {start} ({recording.time[start]:.6g} s)"
        severe = not place and lost.sum() > _LOST * recording.duration
        findings.append(Finding("warning" if severe else "note", "gap", text, None, start, stop))
    return findings


def jitter(recording: Recording) -> list[Finding]:
    """Note how much the steps of time vary, gaps aside, where it exceeds their rounding."""
    step = np.delete(np.diff(recording.time), recording.gaps[:, 0])
    rms = float(np.sqrt(np.mean((step - recording.median_step) ** 2)))
    rounding = float(np.spacing(np.abs(recording.time).max()))
    if rms <= 2 * rounding:
        return []
    text = f"steps of time vary by {rms:.3g} s rms about {recording.median_step:.6g} s"
    return [Finding("note", "jitter", text)]


def channel_findings(
    recording: Recording, k: int, limits: tuple[float, float] | None
) -> list[Finding]:
    """Refuse a constant channel; warn of samples at the end of the range and of stuck ones."""
    x, channel = recording.data[:, k], recording.channels[k]
    if (x == x[0]).all():
        text = f"{channel} reads {x[0]:.6g} throughout: is it connected, and is it this column?"
        return [Finding("refused", "stuck", text, channel, 0, x.size)]
    railed = runs.at_rails(x) if limits is None else runs.beyond(x, *limits)
    findings: list[Finding] = []
    for start, stop in runs.joined(railed, _NEAR_S * recording.rate_hz):
        text = f"{channel} is at the end of its range {_span(recording, start, stop)}"
        findings.append(Finding("warning", "saturation", text, channel, start, stop))
    for start, stop in runs.stuck(x, railed).tolist():
        text = f"{channel} holds {x[start]:.6g} {_span(recording, start, stop)}"
        findings.append(Finding("warning", "stuck", text, channel, start, stop))
    return findings


def _rows(count: int) -> str:
    return f"{count} row" + ("s" if count != 1 else "")


def _span(recording: Recording, start: int, stop: int) -> str:
    time = recording.time
    return f"in samples {start} to {stop - 1} ({time[start]:.6g} s to {time[stop - 1]:.6g} s)"
