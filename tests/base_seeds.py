"""Base seeds of a Monte Carlo that takes seconds: one for `make test`, two more for `make slow`."""

import pytest

SEEDS = [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))]
