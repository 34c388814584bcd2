"""Connect a run to a chamber in such a way that the chamber never delays the run."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from math import nan

from inercal.basics.closeable import Closeable
from inercal.basics.errors import InercalError, InputError
from inercal.host.equipment import Chamber, ChamberState

# Longest time without a reading, s. A simulated chamber answers at once. A real one may repeat a
# request, and is no reason to interrupt a step.
_SIMULATED_SILENCE, _SILENCE = 0.8, 5.0


class ChamberPort(Closeable):
    """The connection to a chamber; a lost connection is opened again at the next exchange.

    Parameters
    ----------
    opener : callable
        Function that connects to the chamber.
    synchronous : bool
        Whether `exchange` waits for the reply. If not, a thread waits, so that a slow chamber does
        not delay the run.

    Attributes
    ----------
    target : float or None
        Set temperature, K; None stops the chamber. The next exchange sends it.
    silence : float
        Longest time without a reading, s.

    Raises
    ------
    LinkLost
        No chamber answers.
    """

    def __init__(self, opener: Callable[[], Chamber], *, synchronous: bool):
        self.target: float | None = None
        self.silence = _SIMULATED_SILENCE if synchronous else _SILENCE
        self._open = opener
        self._chamber: Chamber | None = opener()
        self._sent: float | None = nan  # target that the chamber knows; NaN if it is unknown
        self._thread = None if synchronous else ThreadPoolExecutor(1, "chamber")
        self._job: Future[ChamberState] | None = None

    @property
    def is_stopped(self) -> bool:
        """Whether the chamber was stopped and has received no target since then."""
        return self._sent is None

    def exchange(self) -> ChamberState | None:
        """Send a new target and return a reading; None if the reading has not arrived yet.

        Raises
        ------
        InputError
            The chamber cannot reach the target.
        LinkLost, ProtocolError
            The chamber does not answer, or its reply is not understood.
        """
        if self._thread is None:
            return self._talk()
        if self._job is None:
            self._job = self._thread.submit(self._talk)
        if not self._job.done():
            return None
        job, self._job = self._job, None
        return job.result()

    def stop(self) -> None:
        """Stop the chamber and wait for the reply; raises the errors of `exchange`."""
        if self._thread is not None:
            self._thread.shutdown()
        self.target = None
        if self._sent is not None:
            self._talk()

    def close(self) -> None:
        """Close the connection."""
        if self._thread is not None:
            self._thread.shutdown()
        if self._chamber is not None:
            self._chamber.close()

    def _talk(self) -> ChamberState:
        chamber, target = self._chamber, self.target
        if chamber is None:
            self._chamber = chamber = self._open()
            self._sent = nan
        try:
            if target != self._sent:
                chamber.stop() if target is None else chamber.set_temperature(target)
                self._sent = target
            return chamber.read()
        except InputError:
            raise
        except InercalError:
            self._chamber = None
            chamber.close()
            raise
