"""Collect the findings of the audit and of other checks of a recording."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from inercal.basics.run_file_advice import Change

Severity = Literal["note", "warning", "refused"]
_APART = 5  # up to this many messages with the same cause are listed separately
_LISTED = 12  # number of places that a merged message lists


@dataclass(frozen=True)
class Finding:
    """A finding in a recording.

    Parameters
    ----------
    severity : "note", "warning" or "refused"
        A refused recording is not used: `inercal.recordings.io.audit.require_accepted` raises an
        error for it.
    what : str
        Kind of finding: "gap", "saturation", ...
    message : str
        The message, in one clear line.
    channel : str or None
        The affected channel; None if the finding concerns all channels.
    start, stop : int or None
        Half-open range of affected samples; None if the finding concerns all samples.
    changes : tuple of Change
        Changes of run-file keys that would remove the finding.
    factor : float or None
        The stated standard deviation divided by the one found, if the stated noise contradicts the
        data.
    merged : tuple of Finding
        The individual findings, if this finding summarizes several.
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
    """Merge the findings that belong to the same event; keep the order of first appearance.

    Two findings of the same severity and kind belong to the same event if their messages are equal,
    or if they concern overlapping samples of the same channel.
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
    """Return one finding that summarizes several findings about the same event."""
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
    """Return the messages without repetition, in order of first appearance.

    Identical messages are replaced by one that states how often it occurred. The text after the
    first colon is the cause. More than five messages with the same cause are replaced by one that
    lists all their places.
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
