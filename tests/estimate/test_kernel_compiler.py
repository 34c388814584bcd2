"""Kernels do what the same Python code does, whatever arrays, indices and ranges they use."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from inercal.basics.arrays import Array, Indices
from inercal.basics.parallel import available_cores
from inercal.estimation.kernel_options import compile_beside, kernel, kernel_step


@kernel_step
def _add_row(row: Array, out: Array) -> None:
    for k in range(row.size):
        out[k] += row[k]


@kernel
def read_and_write(cube: Array, chosen: Indices, out: Array) -> float:
    """Use items, rows and planes with constant, variable and negative indices."""
    total, last = 0.0, chosen[-1]
    for i in range(chosen.size):
        plane, row = cube[chosen[i]], cube[i, -2]
        for j in range(1, cube.shape[1]):
            total += plane[j, i] * cube[-1, last, 0] + row[j] * plane[last][2]
        _add_row(plane[1], out)
        out[-1 - i] -= cube[i][0, 1]
    return total


@kernel
def count_steps(first: int, stop: int, step: int, out: Indices) -> int:
    """Write the numbers of loops of each kind, and return their sum."""
    total = 0
    for i in range(stop):
        out[0], total = out[0] + 1, total + i
    for i in range(first, stop):
        out[1], total = out[1] + 1, total + i
    for i in range(first, stop, step):
        out[2], total = out[2] + 1, total + i
    for i in range(stop - 1, first - 1, -1):
        out[3], total = out[3] + 1, total + i
    return total


CUBE = np.random.default_rng(0).normal(size=(3, 4, 5))


@pytest.mark.parametrize(
    "cube", [CUBE, np.asfortranarray(CUBE), np.tile(CUBE, 2)[:, :, 1::2], CUBE[::-1, :, ::-1]]
)
def test_items_and_rows_equal_those_of_python_in_every_memory_layout(cube: Array):
    compiled, plain = np.zeros(5), np.zeros(5)
    of_python: Any = read_and_write
    chosen = np.array([0, 2, -3])
    got, expected = read_and_write(cube, chosen, compiled), 0.0
    for i in range(3):
        plane, row = cube[chosen[i]], cube[i, -2]
        for j in range(1, 4):
            expected += plane[j, i] * cube[-1, -3, 0] + row[j] * plane[-3][2]
        plain += plane[1]
        plain[-1 - i] -= cube[i][0, 1]
    assert of_python.nopython_signatures
    assert got == expected
    assert np.array_equal(compiled, plain)


@pytest.mark.parametrize(
    ("first", "stop", "step"), [(0, 5, 2), (2, 7, 3), (4, 1, -2), (3, 3, 1), (5, 2, 1), (-4, 0, 1)]
)
def test_ranges_have_the_steps_of_python(first: int, stop: int, step: int):
    out = np.zeros(4, np.int64)
    ranges = range(stop), range(first, stop), range(first, stop, step)
    down = range(stop - 1, first - 1, -1)
    assert count_steps(first, stop, step, out) == sum(map(sum, (*ranges, down)))
    assert out.tolist() == [len(one) for one in (*ranges, down)]


def test_items_of_other_types_are_converted():
    @kernel
    def convert(flags: Any, small: Any, out: Array) -> int:
        count = 0
        for i in range(flags.size):
            if flags[i]:
                count += small[i]
            flags[i] = not flags[i]
            out[i] = small[i]
        return count

    flags, out = np.array([True, False, True]), np.zeros(3)
    assert convert(flags, np.array([3, 4, 5], np.int32), out) == 8
    assert flags.tolist() == [False, True, False]
    assert out.tolist() == [3.0, 4.0, 5.0]


def _module(path: Path) -> ModuleType:
    path.write_text(
        "from inercal.estimation.kernel_options import kernel\n"
        "@kernel\ndef first(x):\n    return x + 1\n"
        "@kernel\ndef second(x):\n    return x + 2\n"
    )
    found = spec_from_file_location(path.stem, path)
    assert found is not None
    assert found.loader is not None
    module = module_from_spec(found)
    sys.modules[path.stem] = module
    found.loader.exec_module(module)
    return module


@pytest.mark.skipif(sys.platform != "linux" or available_cores() < 2, reason="needs a second core")
def test_another_process_compiles_what_this_one_needs_next(tmp_path: Path):
    made = _module(tmp_path / "two_kernels_of_a_test.py")
    with compile_beside(lambda: (made.second(1.0), 1 / 0), after=0.0):  # its errors have no effect
        assert made.first(1.0) == 2.0
    assert made.second(1.0) == 3.0
    assert sum(made.first.stats.cache_misses.values()) == 1
    assert sum(made.second.stats.cache_hits.values()) == 1
    ran: list[str] = []
    with compile_beside(lambda: ran.append(""), after=0.0):
        made.first(1.0)  # nothing is compiled
    assert not ran
