"""Date the sections of a run by the table's clock: the times of holds, the labels of samples.

The recording begins with the first section. Estimation begins with the rest in this section. If
this rest is interrupted within `COARSE_REST_SECONDS`, the recording begins again when the section
is repeated.

From the same events, `InterruptionList` collects when and why the run was interrupted.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.benches.turntable.bench import COARSE_REST_SECONDS

_COARSE_MARGIN = 1 + 1e-3


@dataclass
class SectionSpan:
    """A section, either complete or interrupted.

    Parameters
    ----------
    number : int
        Number of the task.
    label : str
    start_time, end_time : float
        Times by the table's clock, s; the end is infinite while the section is open.
    state : "begun", "done" or "void"
        "void" means that the task has to be repeated, even if the section was completed before.
    is_hold : bool
    """

    number: int
    label: str
    start_time: float
    end_time: float
    state: Literal["begun", "done", "void"]
    is_hold: bool


class SectionTimeline:
    """The sections that the events in a log describe.

    Parameters
    ----------
    settling : float
        Time that is omitted at both ends of a hold, s.

    Attributes
    ----------
    spans : list of SectionSpan
        Sections in the order of time.
    attempt : int
        How often the recording has begun again.
    """

    def __init__(self, settling: float):
        self.spans: list[SectionSpan] = []
        self.attempt: int = 0
        self._settling = settling
        self._first = 0  # index of the first section in the recording

    @property
    def start(self) -> float:
        """Time by the table's clock at which the recording begins, s; infinite before."""
        return self.spans[self._first].start_time if self._first < len(self.spans) else inf

    def add_event(self, event: Mapping[str, Any], turns: float = 0.0) -> None:
        """Process a "section" event; `turns` (s) are added to its time.

        Raises
        ------
        InputError
            The event does not describe a section.
        """
        try:
            number, label, what = int(event["number"]), str(event["label"]), event["state"]
            time, holds = float(event["time"]) + turns, bool(event.get("hold", False))
        except (KeyError, TypeError, ValueError):
            raise InputError(
                f"the log has an event that does not describe a section: {json.dumps(event)}; "
                "it must have number, label, state and time",
                key="section",
            ) from None
        if what == "begun":
            self._end(time, "void")
            self.spans.append(SectionSpan(number, label, time, inf, "begun", holds))
        elif what in ("done", "void"):
            self._end(time, what)

    def begin_session(self, next_number: int, last: float) -> None:
        """Mark the open section, until the time `last`, and all steps to be repeated as void."""
        self._end(last, "void")
        for one in self.spans:
            if one.number >= next_number:
                one.state = "void"

    def _end(self, time: float, what: Literal["done", "void"]) -> None:
        if not self.spans or self.spans[-1].state != "begun":
            return
        last = self.spans[-1]
        last.state, last.end_time = what, max(time, last.start_time)
        held = last.end_time - last.start_time - 2 * self._settling
        is_first = len(self.spans) == self._first + 1
        if what == "void" and is_first and held < COARSE_REST_SECONDS * _COARSE_MARGIN:
            self._first += 1
            self.attempt += 1

    def hold_indices(self, time: Array) -> Indices:
        """Return the index of the hold section at each time, (n,); −1 if there is none."""
        found = self._within(time)
        held = np.array([one.is_hold for one in self.spans], np.bool_)
        begun, ended = self._ends()
        k = np.maximum(found, 0)
        good = (found >= 0) & held[k]
        good &= (time >= begun[k] + self._settling) & (time <= ended[k] - self._settling)
        return np.where(good, found, -1)

    def labels(self, time: Array) -> NDArray[np.str_]:
        """Return the labels at times, (n,); "" outside sections and in void sections."""
        names = np.array([*(one.label if one.state == "done" else "" for one in self.spans), ""])
        return names[self._within(time)]

    def _ends(self) -> Array:
        """Return the start times and the end times of the sections, (2, sections)."""
        return np.array([(one.start_time, one.end_time) for one in self.spans]).reshape(-1, 2).T

    def _within(self, time: Array) -> Indices:
        """Return the index of the section that contains each time; −1 if there is none."""
        begun, ended = self._ends()
        at = np.searchsorted(begun, time, "right") - 1
        return np.where((at >= 0) & (time <= ended[np.maximum(at, 0)]), at, -1)


HOST_GONE = "the host was not running"


@dataclass
class InterruptionSpan:
    """A period in which the table was stopped or was not driven.

    Parameters
    ----------
    start, stop : float
        Run times, s. While the interruption lasts, `stop` is the time of the last known event.
    causes : list of str
    is_open : bool
        Whether the interruption still lasts.
    """

    start: float
    stop: float
    causes: list[str]
    is_open: bool = True


class InterruptionList:
    """Collects the interruptions of a run.

    Attributes
    ----------
    spans : list of InterruptionSpan
        Interruptions in the order of time.
    """

    def __init__(self) -> None:
        self.spans: list[InterruptionSpan] = []
        self._last = 0.0

    def hear(self, time: float) -> None:
        """Record that a device has sent something at a run time, s."""
        self._last = max(self._last, time)

    def add_event(self, time: float, event: Mapping[str, Any]) -> None:
        """Process an event "session", "section" or "interruption" at a run time, s."""
        what, cause = event.get("what"), event.get("cause")
        if what == "interruption" and cause is not None:
            self._begin(float(event.get("since", time)), str(cause))
        elif what == "session" and self._last:
            # If no interruption is open, the host was killed, and nothing was recorded after that.
            self._begin(self._last, "" if self._is_open else HOST_GONE)
        elif what == "interruption" or event.get("state") == "begun":
            self._end(time)

    @property
    def _is_open(self) -> bool:
        return bool(self.spans) and self.spans[-1].is_open

    def _begin(self, time: float, cause: str) -> None:
        if not self._is_open:
            self.spans.append(InterruptionSpan(time, time, []))
        last = self.spans[-1]
        if cause and cause not in last.causes:
            last.causes.append(cause)

    def _end(self, time: float) -> None:
        if self._is_open:
            last = self.spans[-1]
            last.stop, last.is_open = time, False
