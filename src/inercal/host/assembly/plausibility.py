"""The account of readings that no motion of a table explains; a subclass compares readings."""

from abc import ABC, abstractmethod
from typing import ClassVar, Generic, TypeVar

from inercal.host.drivers.rotary_table import TableState

R = TypeVar("R")  # a reading as it is compared


class Plausibility(ABC, Generic[R]):
    """The check of one table's readings, one after the other.

    Attributes
    ----------
    rejected : int
        Readings that were rejected so far.
    in_a_row : int
        Of them, those since the last reading that was accepted.
    """

    most_in_a_row: ClassVar[int]

    def __init__(self):
        self.rejected, self.in_a_row = 0, 0
        self._accepted: R | None = None
        self._doubted: R | None = None
        self._stopping = False  # a stop was commanded, and the table does not yet rest

    @property
    def is_fault(self) -> bool:
        """Whether so many readings in a row are implausible that the table cannot be followed."""
        return self.in_a_row >= self.most_in_a_row

    @property
    def fault_text(self) -> str:
        """The message of the fault, for a person."""
        return (
            f"{self.in_a_row} readings of the table in a row are no motion within its limits: an "
            "encoder jumps, or digits of its replies are wrong"
        )

    def restart(self) -> None:
        """Compare the next reading with none before: the host was away, a table may be stopping."""
        self._accepted = self._doubted = None
        self.in_a_row = 0
        self._stopping = True

    def expect_stop(self) -> None:
        """Allow any deceleration until the table rests: a stop may exceed the limits of a plan."""
        self._stopping = True

    @abstractmethod
    def accept_state(self, state: TableState) -> bool:
        """Tell whether a reading is plausible, as a driver returned it."""

    def _accept(self, now: R) -> None:
        self._accepted, self._doubted, self.in_a_row = now, None, 0

    def _reject(self, now: R) -> None:
        """Keep a reading in doubt: a second one that agrees with it is accepted."""
        self._doubted = now
        self.rejected += 1
        self.in_a_row += 1
