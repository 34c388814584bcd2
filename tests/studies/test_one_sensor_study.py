"""One sensor through all methods: the differences are as large as the uncertainties say."""

from itertools import combinations

import numpy as np
import pytest

from inercal.methods import METHODS
from inercal.studies import reproduce
from inercal.studies.one_sensor import LABORATORIES, TRIALS_PER_SENSOR, draw_truth, run_file_text

SENSORS = 3
PAIRS = len(list(combinations(LABORATORIES, 2)))


def test_every_laboratory_is_a_method_and_gets_the_same_sensor():
    assert set(LABORATORIES) <= set(METHODS)
    truth = draw_truth(np.random.default_rng(1))
    for name in LABORATORIES:
        text = run_file_text(name, truth)
        assert f'name = "{name}"' in text
        assert f'"ax.k1" = "{truth["ax.k1"]}"' in text


@pytest.mark.evidence
def test_each_two_laboratories_agree_within_their_uncertainties():
    study = reproduce("one-sensor", trials=SENSORS * TRIALS_PER_SENSOR, seed=2)
    assert [one.verdict for one in study.findings] == ["reproduced", "reproduced"]
    (section,) = study.sections
    ratios = [float(cells[1]) for _, cells in section.tables[0].rows]
    assert len(ratios) == PAIRS
    assert min(ratios) > 0.3
    assert max(ratios) < 2.5
