"""Base seeds of a Monte Carlo: three, of which the cheap commands take the first.

`SEEDS` are of one that takes seconds: one seed for `make test`, two more for `make slow`.
`SLOW_SEEDS` are of one that takes minutes: one seed for `make slow`, two more for `make evidence`.
"""

import pytest

SEEDS = [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))]
SLOW_SEEDS = [1, *(pytest.param(seed, marks=pytest.mark.evidence) for seed in (2, 3))]
