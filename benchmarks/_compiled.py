"""Peers in C++, compiled where there is a compiler, for the machine that measures."""

import ctypes
import shutil
import subprocess
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
from numpy.typing import NDArray

_FLAGS = ("-O3", "-march=native", "-ffast-math", "-shared", "-fPIC", "-std=c++17")


def pointer(array: NDArray[np.generic]) -> ctypes.c_void_p:
    """Return where a contiguous array is, as C++ takes it; the caller keeps the array."""
    return array.ctypes.data_as(ctypes.c_void_p)


@cache
def library(source: Path) -> ctypes.CDLL | None:
    """Return the shared library of a source; None where no compiler is."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        return None
    target = Path(mkdtemp()) / f"{source.stem}.so"
    subprocess.run([compiler, *_FLAGS, str(source), "-o", str(target)], check=True)
    return ctypes.CDLL(str(target))
