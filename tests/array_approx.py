"""`pytest.approx` of arrays without a call for each element, which took seconds for recordings.

Only what is equal is decided here, by the same tolerance max(rel |expected|, abs): everything else
goes on to pytest, which says where it differs.
"""

from typing import Any

import numpy as np
import pytest

_REL, _ABS = 1e-6, 1e-12  # pytest's own, where a test states none


def compare_arrays_at_once() -> None:
    """Let pytest compare arrays of finite numbers of one shape as a whole."""
    approximate: Any = type(pytest.approx(np.zeros(1)))
    one_by_one = approximate.__eq__

    def equal(self: Any, actual: Any) -> bool:
        return _surely_equal(self, actual) or one_by_one(self, actual)

    approximate.__eq__ = equal


def _surely_equal(stated: Any, actual: Any) -> bool:
    expected = stated.expected
    if not isinstance(actual, np.ndarray) or actual.shape != expected.shape:
        return False
    if actual.dtype.kind not in "fiu" or expected.dtype.kind not in "fiu":
        return False
    tolerance = _ABS if stated.abs is None else stated.abs
    with np.errstate(all="ignore"):  # neither infinity nor NaN is within a tolerance
        if stated.abs is None or stated.rel is not None:
            relative = _REL if stated.rel is None else stated.rel
            tolerance = np.maximum(tolerance, relative * np.abs(expected))
        off = np.abs(np.subtract(actual, expected, dtype=float))
        return bool(np.all(np.isfinite(tolerance)) and np.all(off <= tolerance))
