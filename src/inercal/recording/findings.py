"""Findings of the audit and other checks of a recording."""

from dataclasses import dataclass
from typing import Literal

from inercal.run_file_advice import Change

Severity = Literal["note", "warning", "refused"]


@dataclass(frozen=True)
class Finding:
    """A finding in a recording.

    Parameters
    ----------
    severity : "note", "warning" or "refused"
        A refused recording is not used: `inercal.io.audit.require_accepted` raises an error.
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
    """

    severity: Severity
    what: str
    message: str
    channel: str | None = None
    start: int | None = None
    stop: int | None = None
    changes: tuple[Change, ...] = ()
