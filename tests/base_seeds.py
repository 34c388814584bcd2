"""How much of a Monte Carlo or a list of cases `make slow` draws from; evidence takes all."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def evidence(*values: Any) -> Any:
    """Return a case for `make evidence` only."""
    return pytest.param(*values, marks=pytest.mark.evidence)


def slow(*values: Any) -> Any:
    """Return a case for `make slow` only."""
    return pytest.param(*values, marks=pytest.mark.slow)


# Base seeds: tests take the first of three, `make evidence` the others.
SEEDS = [1, evidence(2), evidence(3)]


def sampled(few: int, many: int) -> list[Any]:
    """Return base seeds with numbers of draws: few of the first seed, in evidence many of each."""
    return [(1, few), *(evidence(seed, many) for seed in (1, 2, 3))]


def chosen(cases: Iterable[Any], representative: Collection[Any]) -> list[Any]:
    """Return all cases; those that are not representative are for `make evidence`."""
    cases = list(cases)
    assert set(representative) <= set(cases)
    return [
        one if one in representative else evidence(*(one if isinstance(one, tuple) else (one,)))
        for one in cases
    ]


def most_alarms(devices: int, share: float) -> int:
    """Return the upper end of the two-sided 99.9 % band of how many of the devices alarm."""
    from scipy.stats import binom  # loaded where it is used: it takes a second

    return int(binom.ppf(0.9995, devices, share))
