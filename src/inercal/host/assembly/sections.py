"""Sections of a run by the table's clock: where it holds, and what samples are called.

The recording begins with the first section. Estimation begins with its rest: where that is
interrupted before it lasted `COARSE`, the recording begins anew with the section's repetition.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.benches.turntable.epochs import COARSE
from inercal.errors import InputError

Indices = NDArray[np.int64]
_LASTED = 1 + 1e-3


@dataclass
class Span:
    """A section, or as much as there was of one.

    Parameters
    ----------
    number : int
        Of the task.
    label : str
    begun, ended : float
        s by the table's clock; infinite while it is open.
    what : "begun", "done" or "void"
        Of a void one that was done first, the task is to be done again.
    holds : bool
    """

    number: int
    label: str
    begun: float
    ended: float
    what: Literal["begun", "done", "void"]
    holds: bool


class Sections:
    """The sections that events tell of.

    Parameters
    ----------
    settling : float
        s that go at both ends of a hold.

    Attributes
    ----------
    all : list of Span
        In the order of time.
    attempt : int
        How often the recording has begun anew.
    """

    def __init__(self, settling: float):
        self.all: list[Span] = []
        self.attempt: int = 0
        self._settling = settling
        self._first = 0  # where the recording begins among all

    @property
    def start(self) -> float:
        """When the recording begins, s by the table's clock; infinite while it has not."""
        return self.all[self._first].begun if self._first < len(self.all) else inf

    def tell(self, event: Mapping[str, Any], turns: float = 0.0) -> None:
        """Take in an event "section"; `turns` (s) are added to its time.

        Raises
        ------
        InputError
            An event that is none.
        """
        try:
            number, label, what = int(event["number"]), str(event["label"]), event["state"]
            time, holds = float(event["time"]) + turns, bool(event.get("hold", False))
        except (KeyError, TypeError, ValueError):
            raise InputError(f"an event of the log is no section: {json.dumps(event)}") from None
        if what == "begun":
            self._end(time, "void")
            self.all.append(Span(number, label, time, inf, "begun", holds))
        elif what in ("done", "void"):
            self._end(time, what)

    def session(self, next_number: int, last: float) -> None:
        """Void what is open, by the last time before the gap, and all that is to be done again."""
        self._end(last, "void")
        for one in self.all:
            if one.number >= next_number:
                one.what = "void"

    def _end(self, time: float, what: Literal["done", "void"]) -> None:
        if not self.all or self.all[-1].what != "begun":
            return
        last = self.all[-1]
        last.what, last.ended = what, max(time, last.begun)
        held = last.ended - last.begun - 2 * self._settling
        if what == "void" and len(self.all) == self._first + 1 and held < COARSE * _LASTED:
            self._first += 1
            self.attempt += 1

    def holding(self, time: Array) -> Indices:
        """Return by which of the sections the table holds at times, (n,); −1 where by none."""
        found = self._within(time)
        held = np.array([one.holds for one in self.all], np.bool_)
        begun, ended = self._ends()
        k = np.maximum(found, 0)
        good = (found >= 0) & held[k]
        good &= (time >= begun[k] + self._settling) & (time <= ended[k] - self._settling)
        return np.where(good, found, -1)

    def labels(self, time: Array) -> NDArray[np.str_]:
        """Return what the samples of times are called, (n,); "" beside and within void sections."""
        names = np.array([*(one.label if one.what == "done" else "" for one in self.all), ""])
        return names[self._within(time)]

    def _ends(self) -> Array:
        """Return when the sections began, and when they ended, (2, sections)."""
        return np.array([(one.begun, one.ended) for one in self.all]).reshape(-1, 2).T

    def _within(self, time: Array) -> Indices:
        """Return in which section times are; −1 where in none."""
        begun, ended = self._ends()
        at = np.searchsorted(begun, time, "right") - 1
        return np.where((at >= 0) & (time <= ended[np.maximum(at, 0)]), at, -1)
