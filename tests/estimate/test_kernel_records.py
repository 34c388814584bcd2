"""Named tuples that kernels receive by reference."""

from typing import NamedTuple

import numpy as np
import pytest

from inercal.basics.arrays import Array, Indices
from inercal.estimation.kernel_options import njit, record


@record
class Inner(NamedTuple):
    """A record within a record."""

    weights: Array
    is_twice: bool


@record
class Outer(NamedTuple):
    """Fields of every kind that the kernels use."""

    number: int
    factor: float
    inner: Inner
    chosen: Indices
    written: Array


@njit
def weigh(outer: Outer) -> float:
    """Write the chosen weights times a factor to the record's array, and return their sum."""
    total, inner = 0.0, outer.inner
    for i in range(outer.number):
        value = outer.factor * inner.weights[outer.chosen[i], 1]
        outer.written[i] = 2 * value if inner.is_twice else value
        total += outer.written[i]
    return total


@pytest.mark.parametrize("is_twice", [False, True])
def test_a_kernel_reads_each_field_and_writes_to_the_arrays_of_the_caller(is_twice: bool):
    weights, chosen = np.arange(12.0).reshape(4, 3), np.array([3, 0])
    outer = Outer(2, 0.5, Inner(weights, is_twice), chosen, np.zeros(2))
    expected = (1 + is_twice) * 0.5 * weights[chosen, 1]
    assert weigh(outer) == expected.sum()
    assert np.array_equal(outer.written, expected)


def test_a_record_with_a_field_of_another_type_has_another_type():
    outer = Outer(1, 0.5, Inner(np.ones((1, 3)), False), np.array([0]), np.zeros(1))
    assert weigh(outer._replace(written=np.zeros(2, np.float32))) == 0.5
    assert len({kind for (kind,) in weigh.signatures}) == len(weigh.signatures) > 1
