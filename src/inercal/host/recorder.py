"""What came of a run and what was made of it: log, journal, samples, live estimate.

The log has what an estimate is made of, and is written first; the journal what an operator and a
resumed run go by. All else follows from the log, live and again: a run that goes on replays it.
"""

import json
from collections import deque
from contextlib import ExitStack
from math import isfinite, nan
from time import monotonic
from typing import Literal

import numpy as np

from inercal.benches.turntable import turntable_of
from inercal.errors import InercalError
from inercal.host.assembly import Assembly, Block
from inercal.host.closing import Closing
from inercal.host.folder import Folder
from inercal.host.journal import Journal
from inercal.host.live import Live
from inercal.host.log import EVENT, Frame, Log, frames
from inercal.host.navigation import Navigation, Navigator
from inercal.host.packets import Layout
from inercal.host.sequencer import Section

_PIECE, _LONGEST = 0.5, 5.0  # s of the bench that are worked through at a time
_PIECE_WALL = 0.1  # s of the wall's
_KEPT = 8  # events, and blocks, that are at hand
_TRIAD = 3
_SAID_AGAIN = 60.0  # s


class RunRecorder(Closing):
    """The account of one run, begun or resumed; a context manager.

    Parameters
    ----------
    folder : Folder
    journal : Journal
    layout : Layout
        Of the IMU's packets.

    Attributes
    ----------
    assembly : Assembly
    live : Live or None
        The estimate, where the run file's method has a sequential estimator.
    navigation : Navigation or None
        Attitude and velocity by an IMU's corrected readings alone, once all of its coefficients
        are estimated.
    temperature : float
        Of the IMU, K; NaN where it tells none.
    events : int
        How many there were.
    said : deque of (str, str)
        Level and words of the last of them.
    blocks : deque of Block
        The last samples; who shows them takes them out.

    Raises
    ------
    InputError
        A log that is damaged, packets that do not go with the run file.
    """

    def __init__(self, folder: Folder, journal: Journal, layout: Layout):
        run, bench = folder.run, turntable_of(folder.run)
        self.assembly = Assembly(run, layout, journal.header().poll)
        # Packets hold no temperature of each sample: coefficients of it are found afterwards.
        self._estimates = run.method.sequential is not None and not run.sensor.uses("dT")
        self.live = Live(run) if self._estimates else None
        whole = all(len(run.sensor.only(kind).axes) == _TRIAD for kind in ("f", "w"))
        self._whole = run.sensor, bench
        self._navigator = Navigator(*self._whole) if whole else None
        self.navigation: Navigation | None = None
        self.temperature = nan
        self.events = 0
        self.said: deque[tuple[str, str]] = deque(maxlen=_KEPT)
        self.blocks: deque[Block] = deque(maxlen=_KEPT)
        self._journal = journal
        self._worked = 0.0, 0.0
        self._losses, self._lost_at = (0, 0, 0), 0.0
        with ExitStack() as opened:
            self._log = opened.enter_context(Log(folder.log))
            self._replay(folder)
            self._opened = opened.pop_all()

    @property
    def estimation(self) -> Literal["none", "waits", "on", "ended"]:
        """How live estimation stands: "none" where the run file's method has none."""
        if self.live is None:
            return "ended" if self._estimates else "none"
        return "on" if self.live.begun else "waits"

    def keep(self, kind: int, time: float, payload: bytes) -> None:
        """Keep what came from a device, at a time of the run."""
        self._log.append(kind, time, payload)
        self.assembly.feed(Frame(kind, time, payload))

    def attach(self, time: float, following: int, wraps: float) -> None:
        """Keep that what follows does not follow what was before.

        Parameters
        ----------
        time : float
            Of the run, s.
        following : int
            The step that is next: those from there on are to be done again.
        wraps : float
            s after which the table's clock begins again.
        """
        known = {"wraps": wraps} if isfinite(wraps) else {}
        self._event(time, {"what": "session", "next": following, **known})

    def section(self, time: float, one: Section, *, holds: bool) -> None:
        """Keep that a section began or ended, first in the log: what the journal calls done is."""
        content = {"number": one.number, "label": one.label, "state": one.what, "time": one.time}
        self._event(time, {"what": "section", **content, "hold": holds})
        self._journal.section(one.number, one.label, one.what, one.time)

    def say(self, time: float, level: Literal["info", "warning", "alarm"], words: str) -> None:
        """Keep what an operator should know."""
        self.events += 1
        self.said.append((level, words))
        self._journal.event(level, words, time)

    def due(self, time: float) -> bool:
        """Tell whether `work` is to be done; when that is changes no bit of what is found.

        A piece has a price of its own: a bench that is sped up has larger ones.
        """
        came, passed = time - self._worked[0], monotonic() - self._worked[1]
        return came >= _PIECE and (passed >= _PIECE_WALL or came >= _LONGEST)

    def work(self, time: float) -> Block | None:
        """Put together what came, and estimate by it; return the samples that are new.

        Raises
        ------
        InputError
            A device that set its clock anew.
        """
        block = self._piece(time)
        if block is not None:
            for words in self._of_losses(time):
                self.say(time, "warning", words)
        return block

    def _piece(self, time: float) -> Block | None:
        self._worked = time, monotonic()
        block = self.assembly.take()
        if block is not None:
            self.blocks.append(block)
            self._estimate(block, time)
        return block

    def _estimate(self, block: Block, time: float) -> None:
        self.temperature = float(block.temperature[-1])
        if self.live is None:
            return
        if block.begins and self._navigator is not None:
            self._navigator = Navigator(*self._whole)
        try:
            self.live.feed(block)
            if self._navigator is not None and np.isfinite(self.live.values).all():
                self.navigation = self._navigator.feed(block.track, self.live.values)
        except Exception as error:
            # The recording is what counts: it may be calibrated otherwise. A method may be another
            # package's, and whatever it raises must not end a run whose table moves.
            self.live = None
            what = "" if isinstance(error, InercalError) else f"{type(error).__name__}: "
            words = f"live estimation ends: {what}{error}"
            # A run that goes on comes to an end that it came to before: then it was said.
            if all(event.words != words for event in self._journal.events()):
                self.say(time, "warning", words)

    def _of_losses(self, time: float) -> list[str]:
        """Return what is to be said of losses, now and then where there are more, once."""
        tally = self.assembly.tally
        counts, before = tally.bytes, self._losses
        losses = counts.lost, counts.failed, tally.no_angle
        if losses == before or time - self._lost_at < _SAID_AGAIN:
            return []
        self._losses, self._lost_at = losses, time
        made: list[str] = []
        if losses[:2] != before[:2]:
            made.append(
                f"so far {counts.lost} packets of {counts.packets + counts.lost} are lost, and "
                f"{counts.failed} had a wrong check"
            )
        if tally.no_angle != before[2]:
            made.append(
                f"so far {tally.no_angle} samples of {tally.samples + tally.no_angle} are left "
                "out: the table was read too seldom while it turned, or sought its zero"
            )
        return made

    def _event(self, at: float, content: dict[str, object]) -> None:
        self.keep(EVENT, at, json.dumps(content).encode())

    def _replay(self, folder: Folder) -> None:
        """Go through what the log holds of a run that was interrupted; what was said stays so."""
        done = last = 0.0
        for frame in frames(folder.log):
            self.assembly.feed(frame)
            last = frame.time
            if last - done >= _LONGEST:
                done = last
                self._piece(done)
                self._of_losses(done)
        self._piece(last)

    def close(self) -> None:
        """Close the log."""
        self._opened.close()
