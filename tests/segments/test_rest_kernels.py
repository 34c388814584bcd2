"""The kernels of rests against their definitions, window by window."""

import subprocess
import sys
from contextlib import redirect_stdout
from functools import cache
from io import StringIO
from os import environ

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.recordings.segments import _kernels

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
COLUMNS = np.array([4, 0, 2])
WEIGHT = np.array([1.0, 4.0, 0.25])
SEGMENTS = np.array([[0, 700], [700, 703], [703, 720], [720, 1400]])
WINDOWS = [4, 17, 50, 63, 64, 65, 200]


def recorded(seed: int = 1, offset: float = 0.0) -> Array:
    """Return quiet and lively stretches, (1400, 5)."""
    rng = np.random.default_rng(seed)
    loud = np.repeat(10.0 ** rng.uniform(-2, 2, 14), 100)
    return offset + loud[:, None] * rng.standard_normal((1400, 5))


def of_windows(data: Array, segment: Indices, window: int) -> Array:
    """Return the summed variances of a segment's windows by their definition."""
    start, stop = segment
    firsts = range(start, stop - window + 1)
    each = [data[i : i + window, COLUMNS].var(axis=0) @ WEIGHT for i in firsts]
    return np.array(each)


def of_samples(data: Array, window: int, these: slice = slice(None)) -> Array:
    """Return the summed variance of each sample's window by its definition."""
    out = np.empty(len(data))
    for start, stop in SEGMENTS:
        fits = min(window, stop - start)
        for i in range(start, stop):
            first = min(max(i - fits // 2, start), stop - fits)
            out[i] = data[first : first + fits, COLUMNS[these]].var(axis=0) @ WEIGHT[these]
    return out


@cache
def of_recorded(window: int, start: int = 0, stop: int = 3) -> Array:
    """Return the same of some of the columns of `recorded()`."""
    return of_samples(recorded(), window, slice(start, stop))


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("order", ["C", "F"])
def test_the_scatter_of_each_sample_is_that_of_its_own_window(window: int, order: str):
    data = np.asarray(recorded(), order="F" if order == "F" else "C")
    found = _kernels.window_variances(data, COLUMNS, WEIGHT, SEGMENTS, window)
    expected = of_recorded(window)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-14 * expected.max())


def test_a_large_offset_costs_no_digits_that_the_data_has():
    data = np.round(recorded() + 33000.0)
    apart = _kernels.window_variances(data, COLUMNS, WEIGHT, SEGMENTS, 50)
    moved = _kernels.window_variances(data + 2.0**40, COLUMNS, WEIGHT, SEGMENTS, 50)
    np.testing.assert_array_equal(apart, moved)
    np.testing.assert_allclose(apart, of_samples(data - 33000.0, 50), rtol=1e-9, atol=1e-12)


def test_a_shock_long_past_leaves_no_trace():
    data = recorded()
    data[100] = 1e9
    found = _kernels.window_variances(data, COLUMNS, WEIGHT, SEGMENTS, 50)
    calm = _kernels.window_variances(
        np.delete(data, 100, axis=0), COLUMNS, WEIGHT, SEGMENTS[:1], 50
    )
    np.testing.assert_allclose(found[300:600], calm[299:599], rtol=1e-9)


def test_a_dead_still_stretch_scatters_by_exactly_nothing():
    data = recorded()
    data[200:600] = data[200]
    found = _kernels.window_variances(data, COLUMNS, WEIGHT, SEGMENTS, 50)
    assert np.all(found[300:550] == 0.0)


@pytest.mark.parametrize("window", WINDOWS)
def test_the_largest_scatter_and_the_smallest_steps_are_found(window: int):
    data = np.round(recorded(), 1)
    data[:, 2] = 7.0
    top, step, changes = _kernels.variance_extent(data, COLUMNS, WEIGHT, SEGMENTS, window)
    assert top == pytest.approx(max(of_windows(data, s, window).max(initial=0) for s in SEGMENTS))
    for k, column in enumerate(COLUMNS):
        steps = np.concatenate([np.abs(np.diff(data[a:b, column])) for a, b in SEGMENTS])
        assert step[k] == np.min(steps, initial=np.inf, where=steps > 0)
        assert changes[k] == np.count_nonzero(steps)


@pytest.mark.parametrize("window", WINDOWS)
def test_each_window_is_counted_once_in_its_bin(window: int):
    data = recorded()
    v = np.concatenate([of_windows(data, s, window) for s in SEGMENTS])
    lowest, top = 3e-4, float(v.max())
    _, every = _kernels.variance_histogram(
        data, COLUMNS, WEIGHT, SEGMENTS, window, lowest, top, 10, 40
    )
    edges = np.linspace(np.log(lowest), np.log(top) + 1e-9, 41)
    expected, _ = np.histogram(np.log(np.maximum(v, lowest)), edges)
    np.testing.assert_array_equal(every, expected)


def test_a_level_that_stays_is_counted_for_a_while_only():
    data = recorded()
    window, stay = 50, 30
    expected = 0
    for segment in SEGMENTS:
        anchor, stayed = 0.0, 0
        for v in np.maximum(of_windows(data, segment, window), 1e-3):
            if not anchor / 4 <= v <= anchor * 4:
                anchor, stayed = v, 0
            stayed += 1
            expected += stayed <= stay
    given = (data, COLUMNS, WEIGHT, SEGMENTS, window, 1e-3, 1e6)
    counts, every = _kernels.variance_histogram(*given, stay, 64)
    assert counts.sum() == expected
    assert expected < every.sum()
    assert np.all(counts <= every)


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("shortest", [1, 60])
def test_runs_are_those_of_the_samples_whose_windows_are_quiet(window: int, shortest: int):
    data = recorded()
    limit = np.array([3.0, 50.0])
    ends = np.array([1, 3])
    quiet = np.ones(len(data), dtype=np.bool_)
    for start, stop, most in ((0, 1, limit[0]), (1, 3, limit[1])):
        quiet &= of_recorded(window, start, stop) < most
    expected: list[tuple[int, int]] = []
    for start, stop in SEGMENTS[SEGMENTS[:, 1] - SEGMENTS[:, 0] >= window]:
        edges = np.flatnonzero(np.diff(np.r_[False, quiet[start:stop], False].astype(np.int8)))
        expected += [(start + a, start + b) for a, b in edges.reshape(-1, 2) if b - a >= shortest]
    found = _kernels.rest_runs(data, COLUMNS, WEIGHT, ends, limit, SEGMENTS, window, shortest)
    assert expected
    np.testing.assert_array_equal(found, expected)


def test_many_runs_are_all_kept():
    data = np.zeros((8000, 1))
    data[::40] = 1.0
    one, whole = np.array([0]), np.array([[0, 8000]])
    each = np.array([1.0])
    found = _kernels.rest_runs(data, one, each, np.array([1]), np.array([0.1]), whole, 4, 1)
    assert len(found) == 200


def test_a_sample_that_is_not_a_number_spoils_its_own_windows_only():
    data = recorded()
    data[300, 0] = np.nan
    found = _kernels.window_variances(data, COLUMNS, WEIGHT, SEGMENTS, 50)
    assert np.isnan(found[276:325]).all()
    assert np.isfinite(found[400:]).all()


@pytest.mark.slow
def test_the_kernels_are_the_same_when_not_compiled():
    code = """
import numpy as np
from inercal.recordings.segments import _kernels
data = np.random.default_rng(1).standard_normal((300, 2)) * np.repeat([1.0, 9.0, 1.0], 100)[:, None]
given = data, np.array([0, 1]), np.ones(2), np.array([[0, 140], [140, 300]]), 20
print(_kernels.window_variances(*given).sum().hex(), _kernels.variance_extent(*given)[0].hex())
print([counts.tolist() for counts in _kernels.variance_histogram(*given, 1e-3, 1e3, 9, 8)])
ends, limit = np.array([1, 2]), np.array([4.0, 4.0])
print(_kernels.rest_runs(*given[:3], ends, limit, *given[3:], 5).tolist())
"""
    uncompiled = subprocess.run(
        [sys.executable, "-c", code],
        env={**environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    with redirect_stdout(StringIO()) as compiled:
        exec(code, {})
    said = [text.splitlines() for text in (compiled.getvalue(), uncompiled)]
    assert said[0][1:] == said[1][1:]
    sums = [[float.fromhex(number) for number in lines[0].split()] for lines in said]
    assert sums[0] == pytest.approx(sums[1], rel=1e-12)
