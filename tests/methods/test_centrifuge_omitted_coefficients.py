"""What a table of norms leaves out is named: by the score tests of `ml`, and by its screening.

Devices by `tests.accuracy.centrifuge`, which shares nothing with the product.
"""

import time
from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.centrifuge import RATES, Triad, full_circle, sensed_motion
from tests.base_seeds import evidence, most_alarms
from tests.methods.each_trial import estimate_each
from tests.methods.test_centrifuge_norm import BENCH, NOISE, TRUTH, table

from inercal.estimation import Estimate
from inercal.methods.centrifuge_norm import ml, series, series_weighted
from inercal.methods.centrifuge_norm.omitted_coefficients import find_omitted_coefficients
from inercal.methods.centrifuge_norm.screening import Repair, SuspectRow, screen_rows

Array = NDArray[np.float64]
LEVEL = 0.005  # of χ² and of the score tests, each
CUBIC = Triad(cubic=np.full(3, 1e-9))
SKEW = 5e-6  # rad, 1″
SKEWED = Triad(
    axes=np.array([[1, 0, 0], [np.sin(SKEW), np.cos(SKEW), 0], [np.sin(-SKEW), 0, np.cos(SKEW)]])
)


def outputs(triad: Triad, seed: int, rates: list[float] = RATES) -> tuple[Array, Array]:
    f, turned = sensed_motion(full_circle(), rates)
    noise = np.random.default_rng([seed, 1900]).standard_normal(f.shape)
    return triad.output(f) + NOISE * noise, turned


def suspect(estimate: Estimate) -> str:
    """Return the candidate that explains most where a test rejects the model, else nothing."""
    seen = [score for score in estimate.score_tests.scores if score.dof]
    best = min(seen, key=lambda score: (score.p_value, -score.chi2))
    if estimate.score_tests.adjusted(best) < LEVEL or float(estimate.p_value) < LEVEL:
        return best.name
    return ""


def said(triad: Triad, devices: int, first: int = 0) -> Counter[str]:
    drawn = [outputs(triad, seed) for seed in range(first, first + devices)]
    seen, sensor, spins = table(np.array([output for output, _ in drawn]), drawn[0][1])
    return Counter(map(suspect, estimate_each(ml, seen, sensor, BENCH, spins)))


def test_a_k3_of_a_nano_g_that_is_left_out_is_seen():
    found = said(CUBIC, 12)
    print(found)
    assert found[""] <= 1


def test_a_non_orthogonality_of_a_second_that_is_left_out_is_named():
    found = said(SKEWED, 12)
    print(found)
    right = {"nonorthogonality", "y.delta_p", "z.delta_o", "z.delta_p"}
    assert sum(n for name, n in found.items() if name in right) >= 10


def test_a_device_that_is_as_modelled_is_suspected_of_nothing():
    assert said(TRUTH, 12, 100) == {"": 12}


@pytest.mark.slow
@pytest.mark.parametrize(("devices", "most"), [(60, most_alarms(60, 2 * LEVEL)), evidence(300, 6)])
def test_false_alarms_are_few(devices: int, most: int):
    assert said(TRUTH, devices, 1000)[""] >= devices - most


@pytest.mark.evidence
def test_what_is_left_out_is_found_in_many_devices():
    assert said(CUBIC, 40, 2000)[""] <= 2
    assert said(SKEWED, 40, 2000)[""] == 0


@pytest.mark.parametrize("estimator", [series, series_weighted])
def test_closed_formulas_are_tested_too(estimator: Callable[..., Estimate]):
    for triad, rejected in ((TRUTH, False), (CUBIC, True)):
        p = [
            test.p_value
            for seed in range(3)
            for test in estimator(*_with_bench(triad, seed)).tests
            if test.name.startswith("readings")
        ]
        assert len(p) == 3
        assert (max(p) < LEVEL) is rejected, p


def _with_bench(triad: Triad, seed: int):
    seen, sensor, spins = table(*outputs(triad, seed))
    return seen, sensor, BENCH, spins


@pytest.mark.slow
@pytest.mark.parametrize(
    ("triad", "word"),
    [
        (Triad(cubic=np.array([3e-9, -2e-9, 5e-9])), "k3"),
        (Triad(axes=np.array([[1, 0, 0], [1e-4, 1, 0], [0, -2e-4, 1.0]])), "nonorthogonality"),
    ],
)
def test_screening_names_the_coefficient_that_explains_the_scatter(triad: Triad, word: str):
    output, rates = outputs(triad, 5)
    seen, sensor, spins = table(output, rates)
    found = find_omitted_coefficients(seen, sensor, BENCH, spins)
    assert found.words == (word,)
    assert screen_rows(seen, found.sensor, BENCH, spins, (), found.agreement) == ()
    # A wrong sign in addition is detected together with the coefficient.
    output[17, 0] *= -1
    seen, sensor, spins = table(output, rates)
    found = find_omitted_coefficients(seen, sensor, BENCH, spins)
    assert found.words == (word,)
    (one,) = screen_rows(seen, found.sensor, BENCH, spins, (), found.agreement)
    assert (one.row, [r.kind for r in one.repairs]) == (17, ["sign"])


@pytest.mark.slow
def test_rows_alone_are_blamed_on_no_coefficient():
    output, rates = outputs(TRUTH, 6)
    output[[3, 17, 40], [0, 1, 2]] *= -1
    seen, sensor, spins = table(output, rates)
    assert find_omitted_coefficients(seen, sensor, BENCH, spins).words == ()


@pytest.mark.slow
@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_a_decimal_point_that_slipped_is_named(factor: float):
    output, rates = outputs(TRUTH, 7)
    right = output[9, 1]
    output[9, 1] *= factor
    seen, sensor, spins = table(output, rates)
    (one,) = screen_rows(seen, sensor, BENCH, spins)
    assert one.row == 9
    (repair,) = [r for r in one.repairs if r.kind == "decimal"]
    assert repair.after[sensor.channels[1]] == pytest.approx(right, rel=1e-8)


def test_a_row_that_the_score_tests_name_is_the_one_that_screening_names():
    output, rates = outputs(TRUTH, 8)
    output[22, np.argmax(np.abs(output[22]))] += 12 * NOISE
    seen, sensor, spins = table(output, rates)
    assert suspect(ml(seen, sensor, BENCH, spins)) == seen.labels[22]
    assert [one.row for one in screen_rows(seen, sensor, BENCH, spins)] == [22]


@pytest.mark.slow
def test_screening_of_a_hundred_rows_takes_two_seconds():
    output, rates = outputs(TRUTH, 9, [*RATES, 3 * np.pi, 5 * np.pi])
    output[::9, 0] *= -1
    seen, sensor, spins = table(output, rates)
    assert len(spins) == 100
    start = time.process_time()
    found = find_omitted_coefficients(seen, sensor, BENCH, spins)
    screen_rows(seen, found.sensor, BENCH, spins, (), found.agreement)
    taken = time.process_time() - start
    print(f"{taken:.2f} s")
    assert taken < 2


def test_a_repair_says_in_plain_words_what_to_do():
    exchange = Repair("exchange", {"ax": 1.0, "ay": 2.0}, {"ax": 2.0, "ay": 1.0})
    said = SuspectRow("p1", 0, 1.0, 40.0, (exchange,)).describe()
    assert "exchanging ax and ay (1 → 2, 2 → 1)" in said
    assert "the exchange" not in said
    sign = Repair("sign", {"az": 1.0}, {"az": -1.0})
    assert "changing the sign of az (1 → −1)" in SuspectRow("p1", 0, 1.0, 40.0, (sign,)).describe()
