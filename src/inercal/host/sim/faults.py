"""What goes wrong on the way, on demand: replies in pieces, late, corrupted; connections dropped.

What goes wrong in the table itself is `dynamics.Table.fault`. Times are bench time, so that a
delay is the same at whatever pace. A fault is told in words too, by which one process asks it of
another:

    fragment 3        replies in pieces of 3 bytes; 0: whole
    delay 0.2         replies 0.2 s late
    corrupt 5         one bit of one byte in every 5th reply; 0: none
    drop 2            the 2nd reply from now ends its connection before it is whole
    die               the process ends at once, as if killed
"""

import os
from dataclasses import dataclass, field
from math import nan

import numpy as np

from inercal.basics.errors import InputError

FAULT_SYNTAX = "fragment N, delay SECONDS, corrupt N, drop N, die"


@dataclass
class Faults:
    """Faults in force; see the module. `rng` chooses the byte and the bit that are corrupted."""

    fragment: int = 0
    delay: float = 0.0
    corrupt: int = 0
    drop: int = 0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    replies: int = 0

    def apply_faults(self, reply: bytes) -> tuple[list[bytes], bool]:
        """Return the pieces in which a reply goes out, and whether its connection then ends."""
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
        """Set a fault told in words; raises `InputError` that says what is possible."""
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
    """Return the error of words that are none of the possible faults."""
    return InputError(
        f"{words!r} is not a fault; possible: {possible}", key="fault", names=(words,)
    )


def parse_number(text: str | bytes) -> float:
    """Return the number that a text is; NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return nan
