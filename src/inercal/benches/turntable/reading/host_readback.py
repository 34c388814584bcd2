"""Reads what a bench host adds to a recording about its readings of the table.

The group `bench` of the HDF5 file has the quality of the interpolated angles, a row per sample
(`recording.AngleQuality`), and as attributes the numbers of omitted readings.
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
_MARGIN = 2.0  # s by which an interruption is noticed late, and the samples are back late
_NAMED = 5  # interruptions that are stated with their times
_FEW = 0.01  # of the readings, that may be left out without a word in the verdict
_SUFFIXES = (".h5", ".hdf5")


class Interruption(NamedTuple):
    """A time in which a run was stopped or had no host: s from the first sample on, and why."""

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
    """Return which of the times from `start` to `stop`, (n,) s, lie in an interruption."""
    known = np.zeros(start.size, np.bool_)
    for one in interruptions:
        known |= (start >= one.start - _MARGIN) & (stop <= one.stop + _MARGIN)
    return known


def write_interruptions(interruptions: Sequence[Interruption]) -> str:
    """Return interruptions as the text of an attribute, which `read_host_readback` reads."""
    return json.dumps([tuple(one) for one in interruptions])


def describe_interruptions(interruptions: Sequence[Interruption]) -> str:
    """Return in a sentence when a run was interrupted, and why; empty where it never was."""
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
    """Return what a host wrote of its readings; no quality where the file has none.

    Parameters
    ----------
    path : Path
        The file of the recording.
    recording : Recording
        As it was read, of which the audit may have left out samples.

    Raises
    ------
    InputError
        The file is damaged, or the quality is not that of its samples.
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
            f"angles, but the recording {rows} samples; use the file as the host wrote it",
            file=path,
        )
    if kept is not None:
        quality = AngleQuality(*(one[kept] for one in quality))
    interruptions = _read_interruptions(group.attributes.get(INTERRUPTIONS))
    return HostReadback(quality, _findings(group.attributes), interruptions)


def _read_interruptions(text: object) -> tuple[Interruption, ...]:
    """Return the interruptions that a host wrote; none where the text says nothing of the kind."""
    try:
        found: Any = json.loads(str(text))
        return tuple(Interruption(float(a), float(b), str(why)) for a, b, why in found)
    except (ValueError, TypeError):
        return ()


def _findings(attributes: dict[str, object]) -> tuple[Finding, ...]:
    """Return a line for readings that were left out, and for angles that are not usable."""
    implausible, polls, unusable = (
        int(number) if isinstance(number := attributes.get(name, 0), int | float) else 0
        for name in (IMPLAUSIBLE_POLLS, POLLS, UNUSABLE_ANGLES)
    )
    result: list[Finding] = []
    if implausible:
        result.append(
            Finding(
                "note" if implausible < _FEW * polls else "warning",
                "implausible",
                f"the host left out {implausible} of {polls} readings of the table: position, rate "
                "and following error were not those of a motion within the bench's limits; look at "
                "the cable to its controller",
            )
        )
    if unusable:
        result.append(
            Finding(
                "note",
                "angles",
                f"{unusable} samples have an angle that the filters do not use: the table was read "
                "too seldom while it turned",
            )
        )
    return tuple(result)
