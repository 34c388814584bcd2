"""Audit a recording, to find what is wrong or unusual before anything is computed from it.

Each check is a function of the recording and returns findings. Three checks also return the samples
to keep and their order: they drop non-finite rows and repeated rows, and sort by time any sections
that were stored by label. Messages refer to line numbers of the original file. A recording may fill
most of the memory, so no check copies it.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS, format_count, format_duration
from inercal.recordings import Finding, Indices, Recording
from inercal.recordings.io import repeated_values
from inercal.recordings.io.column_table import row_blocks
from inercal.recordings.io.row_checks import (
    SampleLocator,
    check_finite,
    check_repeated_rows,
    check_time_order,
)
from inercal.recordings.io.wrapped_numbers import unsigned_findings
from inercal.recordings.temperature import seems_kelvin

_FASTEST = 1.0  # K/s; chambers for thermal shock reach a third of it
_SMALLEST = 3.0  # K; a smaller step is noise or rounding of a thermometer
_TYPICAL = 6.0  # in units of the typical change from one reading to the next


def temperature_findings(recording: Recording) -> list[Finding]:
    """Return warnings about a temperature that jumps, or that seems to be in K."""
    kelvin = recording.temperature
    if kelvin is None or kelvin.size < 2:
        return []
    findings: list[Finding] = []
    celsius = kelvin - ZERO_CELSIUS
    if seems_kelvin(celsius):
        text = (
            f"the temperature is {celsius.min():.1f} to {celsius.max():.1f} °C: if these are "
            'numbers in K, state temperature_unit = "K"'
        )
        findings.append(Finding("warning", "temperature unit", text))
    return [*findings, *_jumps(recording, celsius)]


def _jumps(recording: Recording, celsius: Array) -> list[Finding]:
    step, seconds = np.abs(np.diff(celsius)), np.diff(recording.time)
    changed = step[step > 0]
    if not changed.size:
        return []
    allowed = max(_SMALLEST, _TYPICAL * float(np.median(changed)))
    jumps = step > allowed + _FASTEST * seconds
    if recording.labels is not None:  # sections may be recorded on different days
        jumps &= recording.labels[1:] == recording.labels[:-1]
    places = np.flatnonzero(jumps)
    if not places.size:
        return []
    k = int(places[np.argmax(step[places])])
    count = f"{places.size} times" if places.size > 1 else "once"
    text = (
        f"the temperature jumps {count}, faster than any chamber: from {celsius[k]:.2f} to "
        f"{celsius[k + 1]:.2f} °C within {seconds[k]:.3g} s at {recording.time[k]:.6g} s; "
        "correct the readings of the thermometer, or remove these samples"
    )
    return [Finding("warning", "temperature jump", text, None, k, k + 2)]


NonfinitePolicy = Literal["refuse", "drop"]

_OTHER_UNIT = 100.0  # median steps; units of time differ by a factor of 1000
_OFTEN_FAR = 0.1  # share of the samples
_OFTEN_REPEATED = 0.9  # share of the samples after which the next message comes
_LOST = 0.01  # lost share of the recording, above which gaps are a warning
# A recording has bursts if at least this share of its time steps is long and the mean step is at
# least so many median steps. Over so many bursts, the samples must follow their mean rate.
_OFTEN, _SHORTER, _HELD_BACK = 0.02, 1.5, 10
_LIVES = 0.5  # a channel is active in a part if it scatters there by this share of its full scatter
_COPIED = 100  # so many equal samples of two channels are no chance
_NEAR_S = 1.0  # s; saturated stretches that are closer than this form one finding


def audit(
    recording: Recording,
    nonfinite: NonfinitePolicy = "refuse",
    limits: Mapping[str, tuple[float, float]] | None = None,
    *,
    in_place: bool = False,
) -> Recording:
    """Return the recording without repeated and dropped rows, with all findings.

    Parameters
    ----------
    recording : Recording
        A recording of one run: data (n, m).
    nonfinite : "refuse" or "drop"
        Whether to refuse or drop rows that contain NaN or infinity.
    limits : mapping of channel to (lowest, highest), optional
        Output at the ends of the range, output units; if omitted, the audit looks for saturation
        itself.
    in_place : bool
        Whether to overwrite the given recording if rows are dropped; this saves the memory of a
        copy.

    Returns
    -------
    Recording
        The audited recording. If a finding is "refused", the samples are unchanged unless
        `in_place`.

    Raises
    ------
    InputError
        The recording has a trial axis, or limits are given for an unknown channel.
    """
    limits = limits or {}
    for channel in set(limits) - set(recording.channels):
        raise InputError(
            f"limits are stated for a channel {channel!r} that the recording does not have; "
            f"channels are {', '.join(recording.channels)}",
            key="limits",
            names=(channel,),
        )
    cleaned = audit_rows(recording, nonfinite, in_place=in_place)
    findings = list(cleaned.findings)
    if not any(finding.severity == "refused" for finding in findings):
        if bursty := burst_findings(cleaned):
            kept = [finding for finding in findings if finding.what not in ("gap", "jitter")]
            return cleaned.with_findings((*kept, *bursty))
        if unsigned := unsigned_findings(cleaned):
            return cleaned.with_findings((*findings, *unsigned))
        for k, channel in enumerate(cleaned.channels):
            findings += channel_findings(cleaned, k, limits.get(channel))
    return cleaned.with_findings(tuple(findings))


def audit_rows(
    recording: Recording, nonfinite: NonfinitePolicy = "refuse", *, in_place: bool = False
) -> Recording:
    """Audit the rows as `audit` does, but do not check the channels, which may be constant.

    Raises
    ------
    InputError
        The recording has a trial axis.
    """
    if recording.data.ndim != 2:
        raise InputError(
            "audit needs a single run, whose data have the shape (n, m), but these data have the "
            f"shape {recording.data.shape}; audit each trial separately"
        )
    cleaned, rows = recording, None
    findings = list(recording.findings)
    for check in (
        partial(check_finite, drop=nonfinite == "drop"),
        check_time_order,
        check_repeated_rows,
    ):
        found, keep = check(cleaned, _sample_locator(recording, rows))
        if any(finding.severity == "refused" for finding in found):
            findings += [_renumbered(finding, rows) for finding in found]
            return recording.with_findings(tuple(findings))
        findings += found
        if keep is not None:
            cleaned = _compact_in_place(cleaned, keep) if in_place else cleaned.take(keep)
            rows = keep if rows is None else rows[keep]
    for sampled in (gap_findings, jitter_findings, temperature_findings):
        findings += sampled(cleaned)
    if cleaned.original is not rows:
        cleaned = replace(cleaned, original=rows)
    return cleaned.with_findings(tuple(findings))


def _sample_locator(recording: Recording, rows: Indices | None) -> SampleLocator:
    """Return a function that names the place of a sample in the file."""
    return lambda k: recording.where(k if rows is None else int(rows[k]))


def _renumbered(finding: Finding, rows: Indices | None) -> Finding:
    """Return the finding with samples numbered as in the file."""
    if rows is None or finding.start is None or finding.stop is None:
        return finding
    return replace(finding, start=int(rows[finding.start]), stop=int(rows[finding.stop - 1]) + 1)


def _compact_in_place(recording: Recording, keep: Indices) -> Recording:
    """Return the samples to keep as `take` does, reusing the arrays if the order is kept."""
    if (keep[1:] < keep[:-1]).any():
        return recording.take(keep)
    arrays = [recording.time, recording.data, *recording.readback.values()]
    arrays += [values for values in (recording.labels, recording.temperature) if values is not None]
    for values in arrays:
        for k in row_blocks(keep.size):
            values[k] = values[keep[k]]
    return recording.take(slice(0, keep.size))


def require_accepted(recording: Recording) -> Recording:
    """Return an audited recording if no finding refuses it.

    Raises
    ------
    InputError
        A finding refuses the recording; message, line and channel are those of the first such
        finding.
    """
    refused = [finding for finding in recording.findings if finding.severity == "refused"]
    if refused:
        first = refused[0]
        more = f" (and {len(refused) - 1} more findings)" if refused[1:] else ""
        raise InputError(
            f"{recording.source or 'recording'}: {first.message}{more}",
            file=recording.source or None,
            line=None if first.start is None else recording.line(first.start),
            names=() if first.channel is None else (first.channel,),
        )
    return recording


def burst_findings(recording: Recording) -> list[Finding]:
    """Refuse samples that were taken evenly but delivered and stamped in bursts by a link.

    Lost samples are different: they delay the rest of the recording more and more, whereas a burst
    delays a sample at most by the duration of the burst.
    """
    time, median = recording.time, recording.median_step
    if time.size < 4 * _HELD_BACK:
        return []
    steps = np.diff(time)
    late = recording.gaps[:, 0]
    if late.size < max(_OFTEN * steps.size, 2 * _HELD_BACK):
        return []
    pause = float(np.median(steps[late]))
    # Count a pause of the recorder as a pause between two bursts.
    mean = float(np.where(steps < _HELD_BACK * pause, steps, pause).mean())
    if mean < _SHORTER * median:
        return []
    # Compare each stretch's departure from even times with the pause between two bursts.
    length = int(_HELD_BACK * steps.size / late.size)
    whole = time.size // length * length
    stretches = time[:whole].reshape(-1, length)
    stretches = stretches - stretches.mean(axis=1, keepdims=True)
    count = np.arange(length) - 0.5 * (length - 1)
    pace = stretches @ count / (count @ count)
    off = (stretches - pace[:, None] * count).std(axis=1)
    even = float(np.quantile(np.abs(pace / np.median(pace) - 1), 0.75)) < 0.5 / _HELD_BACK
    if not even or float(np.median(off)) > 0.6 * pause:
        return []
    hz = 1 / mean
    text = (
        f"samples come in bursts: the median step of time is {median:.3g} s and the mean step "
        f"is {mean:.3g} s, so the time stamps come from the link, not from the sensor; remove "
        f'[data] time and state rate = "{hz:.4g} Hz" if that is the sampling rate'
    )
    return [Finding("refused", "bursts", text)]


def gap_findings(recording: Recording, gaps: Indices | None = None) -> list[Finding]:
    """Return notes about gaps; warn if gaps within sections lose more than 1 % of the time.

    Parameters
    ----------
    recording : Recording
    gaps : (n, 2) array of int, optional
        Samples before and after each gap; by default, all gaps of the recording.
    """
    found = recording.gaps if gaps is None else gaps
    if (refusal := _mixed_unit_finding(recording)) is not None:
        return [refusal]
    if recording.labels is None:
        between = np.zeros(len(found), np.bool_)
    else:
        between = recording.labels[found[:, 0]] != recording.labels[found[:, 1]]
    findings: list[Finding] = []
    own_times = any(one.what == "sections" for one in recording.findings)
    for some, place in ((found[~between], ""), (found[between], " between labelled sections")):
        if not len(some) or (place and own_times):
            continue
        lost = recording.time[some[:, 1]] - recording.time[some[:, 0]] - recording.median_step
        k = int(np.argmax(lost))
        start, stop = int(some[k, 0]), int(some[k, 1]) + 1
        count = format_count(len(some), "gap")
        text = f"{count}{place}, {format_duration(lost.sum())} lost in all"
        if len(some) > 1:
            text += f", {format_duration(lost[k])} in the longest"
        text += f", after sample {start} ({recording.time[start]:.6g} s)"
        severe = not place and lost.sum() > _LOST * recording.duration
        findings.append(Finding("warning" if severe else "note", "gap", text, None, start, stop))
    return findings


def _mixed_unit_finding(recording: Recording) -> Finding | None:
    """Refuse times that continue in another unit, so that many steps exceed 100 median steps."""
    found, median = recording.gaps, recording.median_step
    steps = recording.time[found[:, 1]] - recording.time[found[:, 0]]
    far = steps > _OTHER_UNIT * median
    if np.count_nonzero(far) < _OFTEN_FAR * recording.time.size:
        return None
    start, stop = (int(k) for k in found[np.argmax(far)])
    if start:  # many rows may fill the memory
        second = found[far, 0][:_COPIED]
        repeated = (recording.data[second] == recording.data[second - 1]).all(axis=1)
        if repeated.mean() > _OFTEN_REPEATED:
            text = (
                f"rows come in pairs with the same readings, {median:.3g} s apart, the first at "
                f"sample {start - 1} ({recording.time[start - 1]:.6g} s): each message was sent "
                "or recorded twice; remove the second row of each pair"
            )
            return Finding("refused", "repeated", text, None, start - 1, start + 1)
    text = (
        f"time continues in steps of {np.median(steps[far]):.3g} s instead of {median:.3g} s "
        f"after sample {start} ({recording.time[start]:.6g} s): part of the column of times is "
        "in another unit; convert it to one unit, or split the file there"
    )
    return Finding("refused", "time unit", text, None, start, stop + 1)


def jitter_findings(recording: Recording) -> list[Finding]:
    """Return a note about time-step jitter outside gaps if it exceeds the rounding of times."""
    time, gaps = recording.time, recording.gaps[:, 0]
    squares = 0.0
    for k in row_blocks(time.size - 1):
        off = np.diff(time[k.start : k.stop + 1]) - recording.median_step
        inside = gaps[np.searchsorted(gaps, k.start) : np.searchsorted(gaps, k.stop)]
        off[inside - k.start] = 0
        squares += float(np.sum(off**2))
    rms = float(np.sqrt(squares / (time.size - 1 - gaps.size)))
    rounding = float(np.spacing(max(abs(time.min()), abs(time.max()))))
    if rms <= 2 * rounding:
        return []
    text = (
        f"time steps vary by {rms:.3g} s rms about {recording.median_step:.6g} s; the mean rate is "
        f"{recording.mean_rate_hz:.6g} Hz"
    )
    return [Finding("note", "jitter", text)]


def channel_findings(
    recording: Recording, k: int, limits: tuple[float, float] | None
) -> list[Finding]:
    """Refuse a constant or copied channel, and warn about saturated or stuck samples."""
    x, channel = np.ascontiguousarray(recording.data[:, k]), recording.channels[k]
    if (x == x[0]).all():
        text = (
            f"{channel} reads {x[0]:.6g} throughout: check that it is connected and that [data] "
            "names its column"
        )
        return [Finding("refused", "stuck", text, channel, 0, x.size)]
    if dead := _dead_channel_finding(recording, k, x):
        return [dead]
    for other, y in zip(recording.channels[:k], recording.data.T, strict=False):
        few = slice(_COPIED)
        if x.size >= _COPIED and np.array_equal(x[few], y[few]) and np.array_equal(x, y):
            text = f"{channel} has the same values as {other} throughout: name its own column"
            return [Finding("refused", "copy", text, channel, 0, x.size)]
    why = ""
    if limits is None:
        others = [one for j, one in enumerate(recording.data.T) if j != k]
        railed = repeated_values.railed_ranges(x, others)
        cut = repeated_values.clipping_values(x)
        if cut:
            railed = repeated_values.ranges_with_values(x, railed, cut)
            values = " and ".join(f"{value:.6g}" for value in cut)
            why = (
                f": readings pile up at {values} {recording.units[k]}, where the range ends; "
                "if the range is larger, state full_scale in the run file"
            )
    else:
        railed = repeated_values.out_of_range(x, *limits)
        why = "; correct full_scale if its range is larger"
    findings: list[Finding] = []
    for start, stop in repeated_values.merge_ranges(railed, _NEAR_S * recording.rate_hz):
        text = f"{channel} is at the end of its range {_span_text(recording, start, stop)}{why}"
        findings.append(Finding("warning", "saturation", text, channel, start, stop))
    for start, stop in repeated_values.stuck_ranges(x, railed).tolist():
        text = f"{channel} stays at {x[start]:.6g} {_span_text(recording, start, stop)}"
        findings.append(Finding("warning", "stuck", text, channel, start, stop))
    return findings


def _dead_channel_finding(recording: Recording, k: int, x: Array) -> Finding | None:
    """Refuse a channel that stays constant for half of the time while the others change."""
    if (run := repeated_values.longest_constant_run(x)) is None:
        return None
    start, stop = run
    unit, channel = recording.units[k], recording.channels[k]
    like = [j for j, other in enumerate(recording.units) if other == unit and j != k]
    if not like:
        return None
    for j in like:
        other = recording.data[:, j]
        if not other[start:stop].std() > _LIVES * other.std():
            return None
    names = " and ".join(recording.channels[j] for j in like)
    text = (
        f"{channel} stays at {x[start]:.6g} {_span_text(recording, start, stop)} while {names}"
        " change: check its connection and record again, or save the parts before and after it "
        "as files"
    )
    return Finding("refused", "stuck", text, channel, start, stop)


def _span_text(recording: Recording, start: int, stop: int) -> str:
    time = recording.time
    return f"in samples {start} to {stop - 1} ({time[start]:.6g} s to {time[stop - 1]:.6g} s)"
