"""Drifting biases: cancellation of forward and reverse, stated uncertainty, the note's figures.

RMS of K0 in µg and mean normalised squared error (NEES) of `joint` with priors of K3 ± 5 and
Kip ± 20, at a drift of 2 µg (1σ) of each accelerometer in each pass::

    autocollimator   passes              no drift      not declared      declared
    pairs            forward             .37           .47   NEES 8.8    .46   NEES 1
    pairs            forward, reverse    .27           .35   NEES 8.8    .31   NEES 1
    every face       forward             .23           .29   NEES 9.1    .24   NEES 1
    every face       forward, reverse    .16           .21   NEES 9.1    .17   NEES 1

NEES is by the modelled covariance; χ² shows a drift that is not declared, and what is stated grows.
A drift alike in both passes cancels.

The numbers of the table are of this test's own runs. Those of the method note come without their
set-up: the two readings below reach them, found by trial, and need not be the note's.
"""

from dataclasses import replace

import numpy as np
import pytest
from tests.accuracy.dividing_head import Bench
from tests.base_seeds import SEEDS, chosen
from tests.methods.dual_orthogonal_cases import (
    SENSOR,
    Case,
    bound,
    case,
    known,
    nees,
    observed,
    rms,
)

from inercal.estimation import Estimate
from inercal.methods.dual_orthogonal import joint
from inercal.physics.sensors import G0

DRIFT = 2e-6  # g
TABLE = {
    ("pairs", False): (0.37, 0.47, 8.8, 0.46),
    ("pairs", True): (0.27, 0.35, 8.8, 0.31),
    ("every", False): (0.23, 0.29, 9.1, 0.24),
    ("every", True): (0.16, 0.21, 9.1, 0.17),
}
PLACES = [(*place, seed) for place in TABLE for seed in (1, 2, 3)]


def calibrated(given: Case) -> Estimate:
    priors = [known(given, "kip", 20), known(given, "k3", 5)]
    return joint(given.seen, SENSOR, given.bench, given.steps, priors)


@pytest.mark.parametrize(("collimated", "reverse", "seed"), chosen(PLACES, PLACES[::3]))
def test_a_drift_that_is_declared_is_in_what_is_stated(collimated: str, reverse: bool, seed: int):
    trials = 1000
    given = case(seed, trials, Bench(collimated=collimated, drifting=DRIFT), reverse=reverse)
    found = calibrated(given)
    reached = rms(found, given)["k0"]
    print(f"K0 {reached:.3f} NEES {nees(found, given):.3f}")
    assert nees(found, given) == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / trials))
    assert reached == pytest.approx(bound(found)["k0"], rel=4 / np.sqrt(2 * 2 * trials))
    assert bound(found)["k0"] == pytest.approx(TABLE[collimated, reverse][3], abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("collimated", "reverse", "seed"), chosen(PLACES, PLACES[::3]))
def test_a_drift_that_is_not_declared_is_in_the_residuals_alone(
    collimated: str, reverse: bool, seed: int
):
    bench = Bench(collimated=collimated, drifting=DRIFT)
    given = case(seed, 1000, bench, reverse=reverse)
    silent = given._replace(bench=replace(given.bench, drift=0.0))
    found = calibrated(silent)
    print(f"K0 {rms(found, given)['k0']:.3f} NEES {nees(found, given):.3f}")
    without, reached, squares, _ = TABLE[collimated, reverse]
    index = [found.names.index(name) for name in ("a.k0", "b.k0")]
    modelled = 1e6 / G0 * np.sqrt(np.mean(found.covariance[:, index, index]))
    assert modelled == pytest.approx(without, abs=0.01)
    assert bound(found)["k0"] > 1.2 * modelled
    assert found.chi2.mean() > 1.5 * found.dof
    assert rms(found, given)["k0"] == pytest.approx(reached, rel=0.06)
    assert nees(found, given) == pytest.approx(squares, rel=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("collimated", ["pairs", "every"])
def test_k0_of_a_drifting_run_is_the_mean_of_its_bias_over_all_rows(collimated: str):
    """Coverage of ± 2 u of that mean is .95, and that of the bias at the middle is far less."""
    trials, n = 1000, 12
    # Only what drifts differs between the two draws of one seed: their difference is the drift.
    there, still = (
        case(5, trials, Bench(collimated=collimated, drifting=size), reverse=True)
        for size in (DRIFT, 0.0)
    )
    course = (there.seen.mean - still.seen.mean) / G0
    found = calibrated(there)
    names = ("a.k0", "b.k0")
    both = found.select(names)
    u = np.sqrt(np.diagonal(both.covariance, axis1=-2, axis2=-1)) / G0
    bias = there.truth["k0"][:, None, :] + course
    middle = (bias[:, n - 1] + bias[:, n]) / 2
    mean, at_middle = (
        float(np.mean(np.abs(both.value / G0 - true) < 2 * u)) for true in (bias.mean(1), middle)
    )
    print(f"{collimated}: coverage of the mean {mean:.3f}, of the middle {at_middle:.3f}")
    assert mean == pytest.approx(0.954, abs=4 * np.sqrt(0.954 * 0.046 / trials))
    assert at_middle < 0.75


@pytest.mark.slow
def test_forward_and_reverse_cancel_a_drift():
    for collimated in ("pairs", "every"):
        reached: list[dict[str, float]] = []
        scatter: list[float] = []
        for reverse in (False, True):
            for drift in (0.0, 2e-6):
                bench = Bench(collimated=collimated, drift=drift)
                given = case(1, 300, bench, reverse=reverse)
                priors = [known(given, "kip", 20), known(given, "k3", 5)]
                found = joint(given.seen, SENSOR, given.bench, given.steps, priors)
                reached.append(rms(found, given))
                scatter.append(nees(found, given))
        assert scatter[1] > 5
        assert scatter[3] == pytest.approx(scatter[2], rel=1e-2)
        assert list(reached[3].values()) == pytest.approx(list(reached[2].values()), rel=1e-3)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_drift_about_the_middle_of_the_pass_reaches_the_notes_figures_forward(seed: int):
    """Note: K0 .52, NEES 9.3. Forward alone, not declared: 2 µg (k/12 − ½) at row k from 0."""
    given = case(seed, 2000, Bench(drift=DRIFT))
    # The generator's truth is that of the mean of the rows, half a row earlier.
    middle = {"k0": given.truth["k0"] + DRIFT / 24}
    given = given._replace(truth=given.truth | middle)
    found = calibrated(given)
    print(f"K0 {rms(found, given)['k0']:.3f} NEES {nees(found, given):.3f}")
    assert rms(found, given)["k0"] == pytest.approx(0.52, rel=0.06)
    assert nees(found, given) == pytest.approx(9.3, rel=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_one_trim_and_the_noise_of_one_reading_reach_the_notes_figures_of_both_passes(seed: int):
    """Note: K0 .355, NEES .66. Passes averaged, pairs off alike in both, noise stated as of one."""
    noise = Bench().noise
    given = case(seed, 2000, Bench(noise=noise / np.sqrt(2)))
    stated = observed(given.seen.mean / G0, given.steps, noise)
    found = calibrated(given._replace(seen=stated))
    print(f"K0 {rms(found, given)['k0']:.3f} NEES {nees(found, given):.3f}")
    assert rms(found, given)["k0"] == pytest.approx(0.355, rel=0.06)
    assert nees(found, given) == pytest.approx(0.66, rel=0.06)
    assert nees(calibrated(given), given) == pytest.approx(1, abs=4 * np.sqrt(2 / 12 / 2000))
