"""Read the information that a bench host adds to a recording about its readings of the table.

The group `bench` in the HDF5 file contains the quality of the interpolated angles, with one row per
sample (`recording.AngleQuality`). Its attributes are the numbers of omitted readings.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.recordings import AngleQuality, Finding, Recording
from inercal.recordings.io.hdf5 import ISOLATION, Group, read_group
from inercal.recordings.io.isolation import read_isolated

BENCH_GROUP = "bench"
POLLS, IMPLAUSIBLE_POLLS = "polls", "polls left out as implausible"
UNUSABLE_ANGLES = "samples with unusable angle"
INTERRUPTIONS = "interruptions"
_MARGIN = 2.0  # s: delay until an interruption is noticed, and until samples come back
_NAMED = 5  # most interruptions that are listed with their times
_FEW = 0.01  # fraction of readings that may be left out without a remark in the verdict
_SUFFIXES = (".h5", ".hdf5")


class Interruption(NamedTuple):
    """An interruption of a run: its start and stop, s since the first sample, and its cause."""

    start: float
    stop: float
    cause: str


class HostReadback(NamedTuple):
    """The quality of a recording's angles, and findings about the readings of the table."""

    quality: AngleQuality | None
    findings: tuple[Finding, ...] = ()
    interruptions: tuple[Interruption, ...] = ()


def are_interrupted(
    start: Array, stop: Array, interruptions: Sequence[Interruption]
) -> NDArray[np.bool_]:
    """Return which of the intervals from `start` to `stop`, (n,) s, lie in an interruption."""
    known = np.zeros(start.size, np.bool_)
    for one in interruptions:
        known |= (start >= one.start - _MARGIN) & (stop <= one.stop + _MARGIN)
    return known


def write_interruptions(interruptions: Sequence[Interruption]) -> str:
    """Return interruptions as the text of the attribute that `read_host_readback` reads."""
    return json.dumps([tuple(one) for one in interruptions])


def describe_interruptions(interruptions: Sequence[Interruption]) -> str:
    """Describe when and why a run was interrupted; return an empty text if it was not."""
    if not interruptions:
        return ""
    said = [
        f"from {one.start:.4g} s to {one.stop:.4g} s ({one.cause})"
        for one in interruptions[:_NAMED]
    ]
    count = len(interruptions)
    often = {1: "once", 2: "twice"}.get(count, f"{count} times")
    more = f" and {count - _NAMED} more times" if count > _NAMED else ""
    times = ", ".join(said) + more
    return f"the run was interrupted {often}: {times}; the interrupted steps were repeated"


def read_host_readback(path: Path, recording: Recording) -> HostReadback:
    """Read the information that a host wrote about its readings, including the angle quality.

    Parameters
    ----------
    path : Path
        File of the recording.
    recording : Recording
        The recording as it was read; the audit may have left out samples.

    Raises
    ------
    InputError
        The file is damaged, or the number of quality rows differs from the number of samples.
    """
    if path.suffix.lower() not in _SUFFIXES:
        return HostReadback(None)
    group: Group = read_isolated(ISOLATION, path, read_group, BENCH_GROUP, AngleQuality._fields)
    if any(name not in group.arrays for name in AngleQuality._fields):
        return HostReadback(None)
    quality = AngleQuality(*(group.arrays[name] for name in AngleQuality._fields))
    kept = recording.original
    rows = recording.time.size if kept is None else int(kept.max(initial=-1)) + 1
    if any(one.shape[:1] < (rows,) or (kept is None and one.shape != (rows,)) for one in quality):
        raise InputError(
            f"{path.name}: group {BENCH_GROUP!r} has the quality of {quality.noise_gain.size} "
            f"angles, but the recording has {rows} samples; use the file that the host wrote",
            file=path,
        )
    if kept is not None:
        quality = AngleQuality(*(one[kept] for one in quality))
    interruptions = _read_interruptions(group.attributes.get(INTERRUPTIONS))
    return HostReadback(quality, _findings(group.attributes), interruptions)


def _read_interruptions(text: object) -> tuple[Interruption, ...]:
    """Return the interruptions that a host wrote, or none if the text describes none."""
    try:
        found: Any = json.loads(str(text))
        return tuple(Interruption(float(a), float(b), str(why)) for a, b, why in found)
    except (ValueError, TypeError):
        return ()


def _findings(attributes: dict[str, object]) -> tuple[Finding, ...]:
    """Return a finding for omitted readings, and one for unusable angles."""
    implausible, polls, unusable = (
        int(number) if isinstance(number := attributes.get(name, 0), int | float) else 0
        for name in (IMPLAUSIBLE_POLLS, POLLS, UNUSABLE_ANGLES)
    )
    result: list[Finding] = []
    if implausible:
        severity = "note" if implausible < _FEW * polls else "warning"
        text = (
            f"the host left out {implausible} of {polls} readings of the table, because their "
            "position, rate and following error imply motion beyond the bench's limits; check "
            "the cable to its controller"
        )
        result.append(Finding(severity, "implausible", text))
    if unusable:
        text = (
            f"{unusable} samples have an angle that the filters do not use, because the table "
            "was read too rarely while it turned"
        )
        result.append(Finding("note", "angles", text))
    return tuple(result)
