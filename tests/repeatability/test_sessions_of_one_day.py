"""What sessions of one day, and several of each day, say of another day: coverage in percent."""

import numpy as np
import pytest
from tests.refusals import refused
from tests.repeatability.laboratory import Laboratory, draw
from tests.repeatability.sessions import sessions_of

from inercal.basics.errors import InputError
from inercal.laboratory.repeatability import repeat

# Day and mounting together scatter by √2 of the turn-on, own uncertainties by half of it.
LABORATORY = Laboratory(
    own=(30, 15, 15),
    shared=(0, 0, 0),
    turn_on=(60, 30, 30),
    day=(85, 42, 42),
    mount=0,
)
BIASES = [0, 4, 8]


@pytest.mark.slow
def test_ten_turn_ons_of_a_day_cover_three_in_four_of_other_days(seed: int):
    rng = np.random.default_rng([seed, 10])
    one_day = np.zeros(10, dtype=np.intp)
    hits = np.zeros(2)
    for _ in range(120):
        for which, days in enumerate((one_day, None)):
            drawn = draw(LABORATORY, 10, rng, days)
            scope = "day" if days is None else "turn-on"
            found = repeat(sessions_of(drawn, days), scope=scope)
            off = np.abs(found.values - drawn.next_use)[BIASES]
            hits[which] += np.mean(off < found.next_use.expanded[BIASES])
    same, other = hits / 120
    assert 0.62 < same < 0.82
    assert 0.91 < other < 0.985


@pytest.mark.slow
def test_four_sessions_of_each_of_five_days_are_no_twenty_days(seed: int):
    rng = np.random.default_rng([seed, 20])
    days = np.repeat(np.arange(5), 4)
    hits = np.zeros(2)
    for _ in range(25):
        drawn = draw(LABORATORY, 20, rng, days)
        for which, stated in enumerate((days, None)):
            found = repeat(sessions_of(drawn, stated))
            off = np.abs(found.values - drawn.mean)[BIASES]
            hits[which] += np.mean(off < found.mean.expanded[BIASES])
    by_day, as_twenty = hits / 25
    assert by_day > 0.88
    assert as_twenty < by_day - 0.05


def test_of_one_day_the_next_day_is_not_stated():
    days = np.zeros(10, dtype=np.intp)
    drawn = draw(LABORATORY, 10, np.random.default_rng(1), days)
    with refused(InputError, key="--next"):
        repeat(sessions_of(drawn, days))
