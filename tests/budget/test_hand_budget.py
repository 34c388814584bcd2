"""Budgets in the hand, and what every budget keeps to."""

from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused
from tests.runfile.run_file_texts import FERRARIS, SIX_POSITIONS, run_file

from inercal.basics.errors import InputError
from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.methods import method
from inercal.physics.plan import six_positions
from inercal.physics.sensors import triad
from inercal.pipeline.budget import (
    Experiment,
    budget,
    effect_shifts,
    first_order_contributions,
    sample_deviation,
)
from inercal.pipeline.budget.contribution_table import budget_as_dict, contribution_rows
from inercal.pipeline.budget.experiment_from_runfile import experiment_from_run
from inercal.runfile import read

G, SD_G = 9.81, 2e-4
BENCH = Hand(Measured(G, SD_G), tilt=radians(0.1))


def six_position_experiment(estimator: str, **truth: float) -> Experiment:
    sensor = triad("t", "f", "").with_coefficients("bias", "scale", "misalignment")
    noise = np.broadcast_to((3e-4) ** 2 * np.eye(3), (6, 3, 3))
    chosen = method("six_position").estimator(estimator)
    return Experiment(sensor, BENCH, six_positions(), chosen, noise, truth=truth)


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["ml", "classical"])
def test_gravity_contributes_to_scale_factors_only(estimator: str):
    made = six_position_experiment(estimator, **{"y.k1": -0.2})
    by_gravity = first_order_contributions(made)["gravity"]
    k1 = [name.endswith("k1") for name in made.sensor.coefficients]
    expected = SD_G / G * np.array([1.0, 0.8, 1.0])
    assert by_gravity[k1] == pytest.approx(expected, rel=2e-4)
    assert np.all(by_gravity[~np.array(k1)] < 1e-9)


@pytest.mark.slow
def test_noise_of_six_positions_is_that_of_the_closed_formula():
    made = six_position_experiment("classical")
    by_noise = first_order_contributions(made)["noise"]
    k0 = [name.endswith("k0") for name in made.sensor.coefficients]
    assert by_noise[k0] == pytest.approx(np.full(3, 3e-4 / np.sqrt(2)), rel=1e-6)
    assert by_noise[~np.array(k0)] == pytest.approx(np.full(9, 3e-4 / np.sqrt(2) / G), rel=1e-6)


@pytest.mark.slow
def test_a_lean_of_the_faces_is_misalignment_to_first_order_and_scale_to_second():
    found = budget(six_position_experiment("classical"), 60, seed=2)
    tilt = next(s for one, s in found.contributions.items() if one.name == "tilt")
    k1 = found.experiment.sensor.coefficients.index("x.k1")
    # Mean of (t₁² + t₂²)/2 over two faces has the deviation sd² / √2.
    assert tilt.first_order[k1] < 1e-9
    assert tilt.monte_carlo[k1] == pytest.approx(BENCH.tilt**2 / np.sqrt(2), rel=0.3)
    delta = found.experiment.sensor.coefficients.index("x.delta_o")
    assert tilt.first_order[delta] == pytest.approx(BENCH.tilt / np.sqrt(2), rel=1e-3)


@pytest.mark.slow
def test_maximum_likelihood_scatters_as_it_states_and_its_budget_adds_up():
    found = budget(six_position_experiment("ml"), 1000, seed=3)
    assert found.total.monte_carlo == pytest.approx(found.stated, rel=5 / np.sqrt(2000))
    assert found.total.first_order == pytest.approx(found.stated, rel=0.02)
    assert np.all(np.abs(found.bias) < 4.5 * found.stated / np.sqrt(1000))


@pytest.mark.slow
def test_equal_seeds_give_equal_budgets():
    one, two, other = (budget(six_position_experiment("ml"), 20, seed) for seed in (4, 4, 5))
    assert np.array_equal(one.total.monte_carlo, two.total.monte_carlo)
    assert not np.array_equal(one.total.monte_carlo, other.total.monte_carlo)


def test_earth_rate_in_the_hand_is_a_sensitivity_to_acceleration_if_left(tmp_path: Path):
    made = experiment_from_run(read(run_file(tmp_path, FERRARIS)))
    (only,) = effect_shifts(made)
    named = dict(zip(made.sensor.coefficients, only.shift.tolist(), strict=True))
    vertical = 7.292115e-5 * np.sin(radians(47)) / G
    for axis in ("gx", "gy", "gz"):
        assert named[f"{axis}.g_i"] == pytest.approx(vertical, rel=0.02)


def test_coefficients_of_the_truth_that_are_not_estimated_are_shifts():
    made = six_position_experiment("classical", **{"x.k2": 1e-4})
    (only,) = effect_shifts(made)
    k0 = made.sensor.coefficients.index("x.k0")
    assert only.shift[k0] == pytest.approx(1e-4 * G**2, rel=1e-4)
    assert only.name == "x.k2"


def test_noise_of_a_recording_is_white_noise_over_the_step(tmp_path: Path):
    made = experiment_from_run(read(run_file(tmp_path, SIX_POSITIONS)))
    sd = 100e-6 * 9.80665 / np.sqrt(4)
    assert np.sqrt(np.diagonal(made.noise[0])) == pytest.approx(np.full(3, sd))


def test_searches_end_where_chi_squared_is_far_below_one(tmp_path: Path):
    """Without redundancy to see the noise, χ² is a thousandth, and rounding no small part of it."""
    made = experiment_from_run(read(run_file(tmp_path, SIX_POSITIONS)))
    steps = np.eye(made.size)
    readings, priors = made.simulated_readings(
        np.concatenate([made.expansion_point + steps, made.expansion_point - steps])
    )
    found = made.estimator(made.observations(readings), made.sensor, made.bench, made.steps, priors)
    assert found.converged.all()
    assert found.iterations.max() < 10


def test_a_prior_is_a_line_and_the_truth_where_none_is_stated(tmp_path: Path):
    prior = 'seconds = "4 s"\n[method.prior]\n"ax.k0" = "10 mg ± 20 µg"\n'
    run = read(run_file(tmp_path, SIX_POSITIONS, ('seconds = "4 s"\n', prior),
                        ('"ax.k0" = "32 mg"\n', "")))  # fmt: skip
    made = experiment_from_run(run)
    assert made.truth["ax.k0"] == pytest.approx(0.0980665)
    found = first_order_contributions(made)["prior of ax.k0"]
    k0 = made.sensor.coefficients.index("ax.k0")
    assert 0.5 < found[k0] / (20e-6 * 9.80665) < 1
    assert made.imperfections[-2].stated == "20 µg"


@pytest.mark.slow
def test_rows_are_sorted_and_end_with_the_total():
    found = budget(six_position_experiment("ml"), 50, seed=6)
    for k in range(len(found.experiment.sensor.coefficients)):
        *lines, total = contribution_rows(found, k)
        sizes = [row.size for row in lines if row.kind == "line"]
        assert sizes == sorted(sizes, reverse=True)
        assert total.kind == "total"
        assert sum(row.share for row in lines) == pytest.approx(1, abs=0.6)
    content = budget_as_dict(found)
    assert content["coefficients"][0]["name"] == "x.k0"
    assert content["coefficients"][0]["unit"] == "m/s²"


@pytest.mark.slow
def test_the_standard_error_of_a_deviation_is_that_of_gauss_and_of_heavier_tails():
    rng = np.random.default_rng(7)
    normal = rng.standard_normal((4000, 200, 1))
    heavy = rng.laplace(size=(4000, 200, 1))
    for drawn in (normal, heavy):
        found = [sample_deviation(one) for one in drawn]
        scatter = np.std([sd for sd, _ in found])
        assert np.sqrt(np.mean([e**2 for _, e in found])) == pytest.approx(scatter, rel=0.1)


def test_impossible_budgets_are_refused_with_a_reason():
    with refused(InputError, key="trials"):
        budget(six_position_experiment("ml"), 1)
    made = six_position_experiment("ml")
    with refused(InputError, key="noise"):
        replace(made, noise=np.zeros((6, 3, 3)))
    with refused(InputError, key="steps"):
        replace(made, steps=(), noise=np.zeros((0, 3, 3)))
    with refused(InputError, key="noise"):
        replace(made, noise=np.eye(3))
