"""Faults of a simulated link: fragmented, late or corrupted replies, and dropped connections.

`dynamics.SimulatedTable.fault` sets faults of the table itself. Times are bench time, so a delay is
the same at any speed. Each fault also has a text form, which one process can send to another:

    fragment 3        sends replies in pieces of 3 bytes; 0: in one piece
    delay 0.2         sends replies 0.2 s late
    corrupt 5         changes one bit of one byte in every 5th reply; 0: none
    drop 2            closes the connection during the 2nd reply from now
    die               ends the process at once, as if killed
"""

import os
from dataclasses import dataclass, field
from math import nan

import numpy as np

from inercal.basics.errors import InputError

FAULT_SYNTAX = "fragment N, delay SECONDS, corrupt N, drop N, die"


@dataclass
class Faults:
    """The active faults; see the module docstring. `rng` selects the byte and bit to corrupt."""

    fragment: int = 0
    delay: float = 0.0
    corrupt: int = 0
    drop: int = 0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    replies: int = 0

    def apply_faults(self, reply: bytes) -> tuple[list[bytes], bool]:
        """Return the pieces in which a reply is sent, and whether the connection then ends."""
        self.replies += 1
        if self.corrupt and self.replies % self.corrupt == 0 and reply:
            bad = bytearray(reply)
            bad[self.rng.integers(len(bad))] ^= 1 << int(self.rng.integers(8))
            reply = bytes(bad)
        ends = False
        if self.drop:
            self.drop -= 1
            ends = self.drop == 0
            reply = reply[: len(reply) // 2] if ends else reply
        size = self.fragment or max(len(reply), 1)
        return [reply[i : i + size] for i in range(0, len(reply), size)], ends

    def set_fault(self, words: str) -> None:
        """Set a fault from its text, or raise an `InputError` that lists the possible faults."""
        match words.split():
            case ["die"]:
                os._exit(9)
            case ["fragment" | "corrupt" | "drop" as what, count] if count.isdecimal():
                setattr(self, what, int(count))
            case ["delay", seconds] if 0 <= parse_number(seconds) < 1e6:
                self.delay = float(seconds)
            case _:
                raise unknown_fault(words, FAULT_SYNTAX)


def unknown_fault(words: str, possible: str) -> InputError:
    """Return the error for a text that is not a possible fault."""
    return InputError(
        f"{words!r} is not a fault; possible: {possible}", key="fault", names=(words,)
    )


def parse_number(text: str | bytes) -> float:
    """Return the number in a text; NaN if it is not a number."""
    try:
        return float(text)
    except ValueError:
        return nan
