"""Base seeds of a Monte Carlo: tests take the first of three, `make evidence` the others."""

import pytest

SEEDS = [1, *(pytest.param(seed, marks=pytest.mark.evidence) for seed in (2, 3))]
