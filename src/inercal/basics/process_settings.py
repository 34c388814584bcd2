"""Settings of the processes that the program starts; importing inercal changes nobody else's."""

import ctypes
import gc
import sys

# Python seeks unreachable cycles after so many new objects, by default 700 or 2000. A compiler of
# kernels makes millions, nearly all of them reachable: the search takes a tenth of its time.
_OBJECTS = 100_000

# glibc returns the memory of a freed array to the system where the array exceeds a limit, at first
# 128 kB, later 32 MB; the system clears each page of the next array: a third of the time of a Monte
# Carlo run. Parameters of mallopt(3).
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_RETURNED_FROM = 2**30  # B, of one array
_RETURNED_BEYOND = 2**31 - 1  # B, of all that is free at the end of the heap


def prepare_process() -> None:
    """Keep memory that arrays have freed for those to come, and seek garbage less often."""
    gc.set_threshold(_OBJECTS)
    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), "mallopt"):
        library.mallopt(_MMAP_THRESHOLD, _RETURNED_FROM)
        library.mallopt(_TRIM_THRESHOLD, _RETURNED_BEYOND)
