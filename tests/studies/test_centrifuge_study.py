"""Wang and Li 2021 recomputed: verdicts and figures as the method note has them.

The note's numbers were computed apart from this project. Where ours differ, the comment says why.
"""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy import centrifuge as independent
from tests.base_seeds import SEEDS

from inercal.estimation import least_squares
from inercal.methods.centrifuge_norm import RATES, closed_formulas
from inercal.methods.centrifuge_norm.problems import norm_problem
from inercal.studies import Study
from inercal.studies.centrifuge import (
    bench_effects,
    efficiency,
    equations,
    misalignment,
    printed_tables,
    simulated_centrifuge,
)
from inercal.studies.centrifuge.simulated_centrifuge import TRUTH

Array = NDArray[np.float64]


@pytest.fixture(scope="module", params=SEEDS)
def repeated_trials(request: pytest.FixtureRequest) -> simulated_centrifuge.CentrifugeTrials:
    return simulated_centrifuge.repeat_experiment(4000, request.param)


def verdicts(study: Study, section: str) -> dict[str, str]:
    (found,) = [s for s in study.sections if s.name == section]
    return {f.claim.title: f.verdict for f in found.findings}


# The design


@pytest.mark.parametrize("attitudes", ["half-circle", "full-circle"])
def test_the_design_is_that_of_the_independent_generator(attitudes: simulated_centrifuge.Attitudes):
    angles = {
        "half-circle": independent.printed_attitudes(),
        "full-circle": independent.full_circle(),
    }[attitudes]
    spins = simulated_centrifuge.steps(attitudes)
    f, rates = independent.sensed_motion(angles, independent.RATES)
    assert np.abs(simulated_centrifuge.dwell_force(spins) - f).max() < 1e-12
    assert [step.rate for step in spins] == rates.tolist()
    phi = 1e-3 * np.array([[0, 1, -2], [1, 0, 3], [-2, 3, 0]])
    arms = 0.02 * np.array([[1.0, 2, 3], [-1, 4, 0], [2, -2, 1]])
    device = replace(simulated_centrifuge.misaligned_triad(phi), arms=arms)
    other = independent.Triad(axes=device.axes, arms=arms)
    expected = other.output(f, independent.ups(angles, independent.RATES), rates)
    assert np.abs(simulated_centrifuge.outputs(device, spins) - expected).max() < 1e-12


def test_the_earths_rate_adds_to_the_arms():
    up = 7.292115e-5 * np.sin(np.radians(39))
    f, _ = independent.sensed_motion(
        independent.printed_attitudes(), independent.RATES, earth_up=up
    )
    found = simulated_centrifuge.dwell_force(
        simulated_centrifuge.steps(), simulated_centrifuge.LATITUDE
    )
    assert np.abs(found - f).max() < 1e-9


# Table 1


def test_the_stored_table_1_equals_the_printed_one(data_dir: Path):
    path = data_dir / "centrifuge_table1" / "table1_as_printed.csv"
    if not path.exists():
        pytest.skip(f"{path} is missing")
    expected = np.loadtxt(path, delimiter=",", skiprows=1)[:, 3:]
    assert np.array_equal(printed_tables.read_printed_table(), expected)


@pytest.fixture(scope="module")
def screened_table() -> printed_tables.ScreenedTable:
    return printed_tables.repair_table(printed_tables.read_printed_table())


@pytest.mark.slow
def test_screening_restores_the_table(data_dir: Path, screened_table: printed_tables.ScreenedTable):
    path = data_dir / "centrifuge_table1" / "table1_corrected.csv"
    if not path.exists():
        pytest.skip(f"{path} is missing")
    expected = np.loadtxt(path, delimiter=",", skiprows=1)[:, 3:]
    assert (
        np.abs(screened_table.repaired - expected).max() < 1.1e-6
    )  # last digits that slipped in print


def test_exactly_the_lost_signs_are_found_each_with_its_one_repair(
    screened_table: printed_tables.ScreenedTable,
):
    lost = {(20 * rate + row - 1, "z") for rate in range(3) for row in (1, 5, 9, 10, 13, 17)}
    lost |= {(row - 1, "x") for row in (6, 15, 16, 19, 20)}
    assert len(lost) == 23
    named = {(s.row, axis) for s in screened_table.suspects for r in s.repairs for axis in r.after}
    assert named == lost
    assert all(len(s.repairs) == 1 and s.repairs[0].kind == "sign" for s in screened_table.suspects)
    design = simulated_centrifuge.outputs(TRUTH, simulated_centrifuge.steps())
    assert np.abs(screened_table.repaired - design).max() < 6.0e-7


def test_lost_signs_violate_the_norm_and_other_rows_do_not(
    screened_table: printed_tables.ScreenedTable,
):
    f = equations.truncated_root(
        (screened_table.printed - TRUTH.bias) / TRUTH.scale, TRUTH.bend, None
    )
    a = np.array([step.rate for step in simulated_centrifuge.steps()]) ** 2 / 9.8
    off = np.abs((f**2).sum(axis=1) - a**2 - 1)
    wrong = (screened_table.printed != screened_table.repaired).any(axis=1)
    assert wrong.sum() == 23
    assert off[wrong].min() > 0.1
    assert off[~wrong].max() < 4e-5


def test_a_robust_fit_with_fixed_threshold_rejects_sound_rows(
    screened_table: printed_tables.ScreenedTable,
):
    """33 by the note, 32 with our loss and threshold: of 37 sound rows hardly one is left."""
    assert printed_tables.count_falsely_rejected_rows(screened_table) in (32, 33)


@pytest.mark.slow
def test_verdicts_on_table_1(centrifuge_study: Study):
    assert list(verdicts(centrifuge_study, "table1").values()) == [
        "false",
        "reproduced",
        "false",
        "false",
    ]


# Table 2 and the estimators


@pytest.mark.slow
def test_noise_free_errors(repeated_trials: simulated_centrifuge.CentrifugeTrials):
    paper, series, ml = (
        repeated_trials.noise_free[name] for name in simulated_centrifuge.ESTIMATORS
    )
    assert paper[2] == pytest.approx([6.0e-10, 1.06e-7, -2.8e-9], rel=0.05)
    assert np.all(np.abs(paper[:2]).max(axis=1) < [2e-7, 7e-7])
    assert np.all(np.abs(series).max(axis=1) < [6e-9, 6.5e-7, 2.1e-9])
    assert np.all(np.abs(ml).max(axis=1) < [1e-12, 1e-12, 1e-15])


def test_ml_finds_the_truth_from_a_start_far_off():
    spins, made = simulated_centrifuge.steps(), simulated_centrifuge.sensor()
    seen = simulated_centrifuge.observations(simulated_centrifuge.outputs(TRUTH, spins), made)
    asked = norm_problem(seen, made, simulated_centrifuge.BENCH, spins)
    start = np.tile([0.3 * 9.8 / 1.25, 0.0, 0.0], 3)  # S = 1.25, b = 0.3, D = 0
    found = (
        simulated_centrifuge.coefficients_as_printed(
            least_squares(replace(asked, start=start)).value
        )
        - TRUTH.values
    )
    assert np.all(np.abs(found).max(axis=1) < [1e-12, 1e-12, 1e-15])


SCATTER = {
    "paper": [[1.6e-6, 1.5e-5, 6.9e-6], [5.2e-6, 1.5e-5, 7.4e-6], [9.2e-7, 1.1e-5, 2.1e-6]],
    "series": [[4.1e-7, 2.9e-6, 5.4e-7], [5.2e-6, 1.8e-5, 6.8e-6], [4.7e-9, 1.3e-7, 7.8e-9]],
}
BOUND = [[1.16e-7, 7.1e-7, 1.56e-7], [2.75e-6, 5.2e-6, 3.5e-6], [3.48e-9, 1.49e-8, 5.6e-9]]


def test_scatter_of_the_closed_formulas(repeated_trials: simulated_centrifuge.CentrifugeTrials):
    for name, expected in SCATTER.items():
        assert repeated_trials.std(name) == pytest.approx(np.array(expected), rel=0.06)
    assert 0.10 < repeated_trials.rootless < 0.16


def test_ml_reaches_the_bound(repeated_trials: simulated_centrifuge.CentrifugeTrials):
    assert repeated_trials.bound == pytest.approx(np.array(BOUND), rel=0.01)
    n = len(repeated_trials.error["ml"])
    assert n == 200
    assert np.abs(repeated_trials.std("ml") / repeated_trials.bound - 1).max() < 4 / np.sqrt(2 * n)
    bias = repeated_trials.error["ml"].mean(axis=0) / repeated_trials.bound
    assert np.abs(bias).max() < 4 / np.sqrt(n)
    assert repeated_trials.dof == 51
    assert repeated_trials.chi2.mean() == pytest.approx(51, abs=0.8 * np.sqrt(4000 / n))


def test_table_2_is_not_reproducible_with_21(
    repeated_trials: simulated_centrifuge.CentrifugeTrials,
):
    found = {f.claim.title: f for f in printed_tables.estimates_section(repeated_trials).findings}
    accuracies = [f for name, f in found.items() if "(21)" in name]
    assert len(accuracies) == 3
    for finding in accuracies:
        assert finding.verdict == "not reproducible"
        assert finding.claim.expected == pytest.approx(1e-4, rel=0.3)
        assert finding.computed > 100 * finding.claim.expected
    values = {name.split("_a")[0][-1] + name[-1]: f.verdict for name, f in found.items()
              if "(21)" not in name}  # fmt: skip
    # What is off by more than the stated noise explains; the note says nothing of these.
    assert values == {
        "Sx": "not reproducible", "Sy": "reproduced", "Sz": "not reproducible",
        "bx": "reproduced", "by": "reproduced", "bz": "not reproducible",
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_four_thousand_trials_of_ml(seed: int):
    spins = simulated_centrifuge.steps()
    exact = simulated_centrifuge.outputs(TRUTH, spins)
    found = simulated_centrifuge.ml_estimate(
        simulated_centrifuge.noisy_outputs(exact, 4000, seed), spins
    )
    bound = simulated_centrifuge.stated_deviations(simulated_centrifuge.ml_estimate(exact, spins))
    error = simulated_centrifuge.coefficients_as_printed(found.value) - TRUTH.values
    assert np.abs(error.std(axis=0) / bound - 1).max() < 0.05
    assert np.abs(error.mean(axis=0) / bound).max() < 4 / np.sqrt(4000)
    assert found.chi2.mean() == pytest.approx(51, abs=0.8)


# Fig. 4


@pytest.fixture(scope="module")
def ignored_misalignment() -> misalignment.IgnoredMisalignment:
    return misalignment.ignored_misalignment_errors()


@pytest.mark.slow
def test_errors_of_an_ignored_non_orthogonality(
    ignored_misalignment: misalignment.IgnoredMisalignment,
):
    paper, ml = (
        misalignment.largest_axis_errors(ignored_misalignment.non_orthogonality[name])[0]
        for name in ("paper", "ml")
    )
    assert paper == pytest.approx([9e-4, 8e-3, 1.3e-4], rel=0.06)
    assert ml == pytest.approx([3e-5, 2.2e-3, 7e-7], rel=0.05)


def test_over_the_whole_range_the_smallest_error_is_thousands_of_times_what_is_claimed(
    ignored_misalignment: misalignment.IgnoredMisalignment,
):
    for name in ("paper", "ml"):
        smallest = misalignment.largest_axis_errors(
            ignored_misalignment.non_orthogonality[name]
        ).min(axis=0)
        assert np.all(smallest[:2] > 1e3 * 1e-8)
        assert smallest[2] > 10 * 1e-8


def test_all_six_angles_alike_are_a_rotation_and_harmless(
    ignored_misalignment: misalignment.IgnoredMisalignment,
):
    h = simulated_centrifuge.rotated_triad(1e-3).axes
    assert np.abs(h @ h.T - np.eye(3)).max() < 1e-15
    # The source's Φ with all six angles γ, to the first order
    phi = 1e-3 * np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]])
    assert np.abs(h - np.eye(3) - phi).max() < 2e-6
    assert misalignment.largest_axis_errors(ignored_misalignment.turn["ml"]).max() < 1e-14
    straight = misalignment.largest_axis_errors(ignored_misalignment.turn["paper"])
    assert np.all(straight.max(axis=0) < [2e-7, 7e-7, 1.2e-7])


def test_the_symmetric_part_found_recovers_all(
    ignored_misalignment: misalignment.IgnoredMisalignment,
):
    assert (
        misalignment.largest_axis_errors(
            ignored_misalignment.non_orthogonality["ml, Φ found"]
        ).max()
        < 1e-12
    )


def test_a_bias_by_the_angle_between_two_axes():
    phi = np.zeros((3, 3))
    phi[0, 1] = phi[1, 0] = 1e-6
    output = simulated_centrifuge.outputs(
        simulated_centrifuge.misaligned_triad(phi), simulated_centrifuge.steps()
    )
    found = simulated_centrifuge.coefficients_as_printed(
        simulated_centrifuge.ml_estimate(output, simulated_centrifuge.steps()).value
    )
    assert (found - TRUTH.values)[1, 0] / 2e-6 == pytest.approx(-5.4, abs=0.05)


def test_twelve_parameters_are_identified_to_a_tenth_of_a_microradian():
    spins, made = (
        simulated_centrifuge.steps(),
        simulated_centrifuge.sensor("misalignment", symmetric=True),
    )
    seen = simulated_centrifuge.observations(simulated_centrifuge.outputs(TRUTH, spins), made)
    found = simulated_centrifuge.ml(seen, made, simulated_centrifuge.BENCH, spins)
    assert found.rank == 12
    sd = found.std[[".delta" in name for name in found.names]]
    assert np.all((sd > 0.9e-7) & (sd < 1.4e-7))


def test_verdicts_on_fig_4(centrifuge_study: Study):
    expected = {"Abstract": "false", "scale factors": "false", "(23)": "false"}
    for title, verdict in verdicts(centrifuge_study, "misalignment").items():
        named = [v for name, v in expected.items() if name in title]
        # Biases do suffer more than D, in the units of the table.
        assert verdict == (named[0] if named else "reproduced"), title


# Taylor orders and equations


def test_taylor_orders():
    f = simulated_centrifuge.dwell_force(simulated_centrifuge.steps())
    u = f + TRUTH.bend * f**2
    by_hand = u - TRUTH.bend * u**2 + 2 * TRUTH.bend**2 * u**3
    assert np.abs(equations.truncated_root(u, TRUTH.bend, 3) - by_hand).max() < 1e-13
    assert np.abs(equations.truncated_root(u, TRUTH.bend, None) - f).max() < 1e-12
    worst = [np.abs(equations.truncation_error(n, f, TRUTH.bend)).max() for n in equations.ORDERS]
    assert worst[0] == pytest.approx(3.1e-4, rel=0.02)
    tail = np.abs(5 * TRUTH.bend**3 * f**4).max()
    assert worst[1] == pytest.approx(tail, rel=0.02)
    assert all(b < 0.01 * a for a, b in pairwise(worst))


def test_each_order_does_less_to_the_coefficients_and_the_exact_root_nothing():
    shift = equations.order_errors()
    size = [np.abs(shift[n]).max(axis=1) for n in (*equations.ORDERS, None)]
    assert all(np.all(b < a) for a, b in pairwise(size))
    assert np.all(size[-1] < [1e-12, 1e-12, 1e-15])
    # A fit to the second order errs by several deviations of the noise.
    assert np.abs(shift[2] / np.array(BOUND)).max() > 10


def test_verdicts_on_11_and_12(centrifuge_study: Study):
    assert set(verdicts(centrifuge_study, "taylor").values()) == {"false"}
    (section,) = [s for s in centrifuge_study.sections if s.name == "taylor"]
    first, second = section.findings
    assert first.computed == pytest.approx(3.1e-4, rel=0.02)
    assert 10**second.computed == pytest.approx(5.8e-3, rel=0.02)


def test_printed_equations_fail_and_the_mended_ones_hold(centrifuge_study: Study):
    found = verdicts(centrifuge_study, "equations")
    assert [title.partition(":")[0] for title in found] == [
        "(4)", "(9)", "(14)", "(19)", "(21)", "(22)",
    ]  # fmt: skip
    assert set(found.values()) == {"false"}
    tried = [equations.norm_of_sum(), equations.misalignment_signs(), equations.fourth_power(),
             equations.root_branch(), equations.inverted_fraction()]  # fmt: skip
    for one in tried:
        corrected, printed = abs(one.corrected - one.true), abs(one.printed - one.true)
        assert printed > 1000 * corrected
    assert equations.root_branch().printed == pytest.approx(2e4, rel=0.2)


def test_9_as_mended_errs_by_the_second_order_alone(monkeypatch: pytest.MonkeyPatch):
    whole = abs(equations.misalignment_signs().corrected - equations.misalignment_signs().true)
    monkeypatch.setattr(
        equations,
        "MISALIGNMENT_ANGLES",
        {k: v / 10 for k, v in equations.MISALIGNMENT_ANGLES.items()},
    )
    tenth = abs(equations.misalignment_signs().corrected - equations.misalignment_signs().true)
    assert tenth == pytest.approx(whole / 100, rel=0.1)


# Efficiency and plans


def test_bounds_of_known_attitudes_and_of_the_full_circle():
    known = [[9.2e-8, 3.8e-7, 1.2e-7], [1.5e-6, 1.8e-6, 1.4e-6], [2.9e-9, 9.6e-9, 3.9e-9]]
    assert efficiency.known_attitude_bound() == pytest.approx(np.array(known), rel=0.03)
    circle = efficiency.full_circle_bound()
    assert circle[0, 1] == pytest.approx(1.0e-7, rel=0.01)
    assert circle[2, 1] == pytest.approx(3.4e-9, rel=0.01)


def test_rank_and_condition():
    assert efficiency.rank_and_condition(simulated_centrifuge.steps()) == (
        13,
        pytest.approx(330, rel=0.01),
    )
    assert efficiency.rank_and_condition(simulated_centrifuge.steps("full-circle")) == (
        13,
        pytest.approx(17, rel=0.03),
    )
    assert efficiency.rank_and_condition(simulated_centrifuge.steps(rates=RATES[:1]))[0] == 10
    assert efficiency.rank_and_condition(simulated_centrifuge.steps(rates=RATES[:2]))[0] == 13


def test_the_weak_direction_is_in_the_powers_of_y():
    output = simulated_centrifuge.outputs(TRUTH, simulated_centrifuge.steps())
    assert len(np.unique(output[:, 1].round(9))) == 7
    assert simulated_centrifuge.dwell_force(simulated_centrifuge.steps())[:, 1].max() < 1e-12
    rows = closed_formulas.regression_matrix(output)
    weakest = np.abs(np.linalg.svd(rows / np.linalg.norm(rows, axis=0))[2][-1])
    # 1, then x y z, x² y² z², …: y³, y², y⁴ are columns 8, 5 and 11
    assert np.argsort(-weakest)[:3].tolist() == [8, 5, 11]
    assert efficiency.least_observable_terms(simulated_centrifuge.steps()) == "N_y³, N_y², N_y⁴"


def test_verdicts_on_the_counting_rule(centrifuge_study: Study):
    assert list(verdicts(centrifuge_study, "efficiency").values()) == ["false", "false"]


# Table 3 and the bench


def test_lever_arms():
    found = bench_effects.lever_arm_errors()
    assert found.ml[0, 1] == pytest.approx(0.041, abs=5e-4)
    assert found.ml[1, 2] == pytest.approx(-0.14, abs=5e-3)
    assert (found.std.min(), found.std.max()) == pytest.approx((0.25e-6, 3e-6), rel=0.15)
    assert found.left < 1e-12


def test_verdicts_on_table_3(centrifuge_study: Study):
    found = verdicts(centrifuge_study, "bench")
    table = [v for title, v in found.items() if title.startswith("Table 3")]
    assert table == ["not reproducible"] * 9
    assert [v for title, v in found.items() if "Abstract" in title] == ["false"] * 3


def test_the_earths_rate_at_39_degrees():
    found = bench_effects.earth_rate_errors()
    assert found[0, [0, 2]] == pytest.approx([7e-6, 7e-6], rel=0.06)
    assert found[1, 1] == pytest.approx(-6.8e-5, rel=0.01)


def test_an_acceleration_that_is_larger_throughout_scales_s_and_d():
    """ΔS = Sε and ΔD = Dε where gravity is larger too; its share in the norm bends D otherwise."""
    found = bench_effects.common_acceleration_error()
    assert found[0] == pytest.approx(1e-5 * TRUTH.scale, rel=0.04)
    spins = simulated_centrifuge.steps()
    whole = simulated_centrifuge.outputs(
        TRUTH, spins, simulated_centrifuge.dwell_force(spins) * (1 + 1e-5)
    )
    exact = (
        simulated_centrifuge.coefficients_as_printed(
            simulated_centrifuge.ml_estimate(whole, spins).value
        )
        - TRUTH.values
    )
    assert exact[0] == pytest.approx(1e-5 * TRUTH.scale, rel=1e-8)
    assert np.abs(exact[1]).max() < 1e-12
    assert exact[2] == pytest.approx(1e-5 * TRUTH.bend, rel=1e-6)
    # With gravity as it is, D of the weak axis moves twenty times as far.
    assert found[2, 1] == pytest.approx(20 * exact[2, 1], rel=0.05)


@pytest.mark.parametrize("seed", SEEDS)
def test_an_acceleration_off_at_random_costs_tens_of_times_the_noise(seed: int):
    found = bench_effects.random_acceleration_scatter(120, seed)
    for row, (low, high) in zip(found, [(0.5e-5, 1.8e-5), (5e-5, 8e-5), (1.4e-7, 4.5e-7)],
                                strict=True):  # fmt: skip
        # 120 trials know a deviation to 7 %; S_ay comes out at 1.9e-5 over thousands of them.
        assert row.min() == pytest.approx(low, rel=0.2)
        assert row.max() == pytest.approx(high, rel=0.2)
    cost = found / np.array(BOUND)
    assert cost.min() == pytest.approx(16, rel=0.2)
    assert 35 < cost.max() < 50
