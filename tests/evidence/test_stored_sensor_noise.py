"""The stored counts of the noise analysis meet their bounds, and a sample is counted again."""

import json

import numpy as np
import pytest
from tests.base_seeds import chosen
from tests.evidence import sensor_noise
from tests.evidence.stored_runs import page_text

FOUND = json.loads(sensor_noise.DATA.read_text(encoding="utf-8"))
RMS = {"MEMS": (0.0035, 0.0225, 0.31), "tactical": (0.0030, 0.064, 0.38)}
SAMPLE = 8


@pytest.mark.parametrize("grade", sensor_noise.GRADES)
def test_coefficients_are_covered_and_as_efficient_as_the_method_can_be(grade: str):
    one = FOUND["coverage"][grade]
    assert all(0.92 <= share <= 0.98 for share in one["covered"])
    assert (np.array(one["rms"]) <= 1.1 * np.array(RMS[grade])).all()
    assert np.allclose(one["median"][:2], 1, atol=0.02)


def test_the_true_model_is_chosen_and_false_terms_are_seldom_significant():
    models = FOUND["models"]
    for name, least in (("N", 0.9), ("NB", 0.88), ("NBK", 0.7)):
        assert models[name]["right"] >= least
    assert np.mean([one["false_significant"] for one in models.values()]) <= 0.02


def test_disturbances_are_found_and_clean_recordings_raise_few_alarms():
    found = FOUND["disturbances"]
    for what in ("step, °/h 40", "knock of 5 s, °/h 100", "burst of 10 s, times 3",
                 "line, amplitude over sd 0.1"):  # fmt: skip
        assert found[what]["found"] >= 0.95
        assert found[what]["largest_time_error"] <= 5
    for name, seeds in sensor_noise.CLEAN.items():
        assert FOUND["clean"][name]["seeds"] == [seeds[0], seeds[-1]]
        assert FOUND["clean"][name]["alarms"] <= 0.02 * len(seeds)


def test_the_page_is_that_of_the_counts():
    assert page_text(sensor_noise.PAGE) == sensor_noise.page(FOUND)


@pytest.mark.slow
@pytest.mark.parametrize("grade", chosen(sensor_noise.GRADES, ["MEMS"]))
def test_a_sample_of_recordings_is_covered_again(grade: str):
    rows = np.array([sensor_noise.cover((grade, 1, run)) for run in range(SAMPLE)])
    assert (rows[:, 3:6].sum(axis=0) >= SAMPLE - 2).all()
