"""Findings of the audit and other checks of a recording."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from inercal.basics.run_file_advice import Change

Severity = Literal["note", "warning", "refused"]
_APART = 5  # messages of one cause that stay apart
_LISTED = 12  # places that a merged message lists


@dataclass(frozen=True)
class Finding:
    """A finding in a recording.

    Parameters
    ----------
    severity : "note", "warning" or "refused"
        A refused recording is not used: `inercal.recordings.io.audit.require_accepted` raises an
        error.
    what : str
        Kind of finding: "gap", "saturation", ...
    message : str
        One clear line.
    channel : str or None
        The channel; None for all channels.
    start, stop : int or None
        Half-open range of samples; None for all samples.
    changes : tuple of Change
        Keys of the run file that would take the finding away.
    factor : float or None
        Of a stated noise that contradicts the data: the stated standard deviation over that found.
    merged : tuple of Finding
        The findings that this one stands for, where it stands for several.
    """

    severity: Severity
    what: str
    message: str
    channel: str | None = None
    start: int | None = None
    stop: int | None = None
    changes: tuple[Change, ...] = ()
    factor: float | None = None
    merged: tuple["Finding", ...] = ()


def merge_findings(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return the findings, those of one event merged into one, in the order of the first.

    Findings of one severity and kind belong to one event if their messages are equal, or if they
    concern the same samples of the same channel.
    """
    groups: list[list[Finding]] = []
    for one in findings:
        for group in groups:
            if any(_is_of_one_event(one, other) for other in group):
                group.append(one)
                break
        else:
            groups.append([one])
    return tuple(_merged(group) for group in groups)


def _is_of_one_event(one: Finding, other: Finding) -> bool:
    if (one.severity, one.what) != (other.severity, other.what) or one.factor != other.factor:
        return False
    if one.message == other.message:
        return True
    if one.channel != other.channel or one.start is None or other.start is None:
        return False
    return one.start < (other.stop or 0) and other.start < (one.stop or 0)


def _merged(group: Sequence[Finding]) -> Finding:
    """Return one finding for several that are alike."""
    first = group[0]
    if len(group) == 1:
        return first
    every = tuple(part for one in group for part in (one.merged or (one,)))
    starts = [one.start for one in every if one.start is not None]
    stops = [one.stop for one in every if one.stop is not None]
    whole = len(starts) == len(stops) == len(every)
    return replace(
        first,
        message="; ".join(merge_messages([one.message for one in every])),
        channel=first.channel if len({one.channel for one in every}) == 1 else None,
        start=min(starts) if whole else None,
        stop=max(stops) if whole else None,
        changes=next((one.changes for one in every if one.changes), ()),
        merged=every,
    )


def merge_messages(messages: Sequence[str]) -> tuple[str, ...]:
    """Return messages without repetition, in the order of the first of each.

    Equal messages become one that says how often it came. Of one cause, which follows the first
    colon, more than five become one with all places.
    """
    by_cause: dict[str, list[str]] = {}
    for message in messages:
        place, _, cause = message.partition(": ")
        by_cause.setdefault(cause or place, []).append(message)
    result: list[str] = []
    for cause, group in by_cause.items():
        distinct = list(dict.fromkeys(group))
        if len(distinct) <= _APART:
            result += [
                f"{one} ({group.count(one)} times)" if group.count(one) > 1 else one
                for one in distinct
            ]
            continue
        places = [one.removesuffix(f": {cause}") for one in distinct]
        more = f" and {len(places) - _LISTED} more" if len(places) > _LISTED else ""
        result.append(f"{', '.join(places[:_LISTED])}{more}: {cause}")
    return tuple(result)
