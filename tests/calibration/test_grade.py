"""The rule of the verdict: which grade follows from tests, scores, checks and scales."""

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from inercal.calibration import grade
from inercal.calibration.verdict import verdict
from inercal.calibration.verdict_object import VerdictRecord, recorded_verdict, verdict_object
from inercal.estimation import Candidate, Estimate, ModelTest, Problem, least_squares
from inercal.estimation.residual_scatter import ScatterModel
from inercal.estimation.result import ResidualGroup
from inercal.estimation.scores import COMMON_DRIFT, SLOW_NOISE
from inercal.physics.sensors import G0, triad
from inercal.recordings import Finding, RoundedChannel

SENSOR = triad("t", "f", "a").with_coefficients("bias", "scale")
SD = 1e-4 * G0


def estimate(
    violation: float = 0.0, column: int = 0, noise: float = 1.0, seed: int = 1, rows: int = 30
) -> Estimate:
    """Return a fit of 30 rows whose readings hold one of two candidates, in units of η."""
    rng = np.random.default_rng(seed)
    design = rng.standard_normal((rows, 6)) * G0
    extra = rng.standard_normal((rows, 2)) * G0
    basis = np.linalg.qr(design)[0]
    left = extra - basis @ (basis.T @ extra)
    eta = np.linalg.norm(left, axis=0) / SD
    y = SD * noise * rng.standard_normal(rows) + extra[:, column] * violation / eta[column]

    def candidates(_: np.ndarray) -> Sequence[Candidate]:
        single = (np.eye(rows)[:, [k]] for k in range(rows))
        return [
            Candidate("ax.k2", "coefficient", ("ax.k2",), ("(m/s²)⁻¹",), extra[:, :1]),
            Candidate("radius", "bench", ("radius",), ("m",), extra[:, 1:]),
            *(
                Candidate(f"p{k}", "row", (f"ax[p{k}]",), ("m/s²",), c)
                for k, c in enumerate(single)
            ),
        ]

    names = SENSOR.coefficients
    return least_squares(
        Problem(
            names, np.zeros(6), lambda x: (y - x @ design.T, design), np.full(rows, SD),
            SENSOR.unit_scale, candidates=candidates,
        )
    )  # fmt: skip


def graded(found: Estimate, *findings: Finding) -> grade.Verdict:
    return verdict(found, SENSOR, findings)


def test_a_fit_that_agrees_is_consistent() -> None:
    one = graded(estimate())
    assert one.grade == "consistent"
    assert one.reasons == ()
    assert one.suspect is None


@pytest.mark.parametrize(("column", "name"), [(0, "ax.k2"), (1, "radius")])
def test_a_violation_of_eta_eight_is_said_and_named(column: int, name: str) -> None:
    one = graded(estimate(8.0, column))
    assert one.grade != "consistent"
    assert one.suspect is not None
    assert one.suspect.name == name
    # Its size is that which was put in, within its uncertainty.
    assert one.suspect.chi2 == pytest.approx(64, abs=4 * 16)


def test_a_suspect_that_shifts_a_coefficient_by_more_than_u_is_not_relied_on() -> None:
    found = estimate(8.0)
    suspect = graded(found).suspect
    assert suspect is not None
    assert graded(found).grade == ("unreliable" if suspect.shift > 1 else "reservations")
    narrow = replace(found, covariance=found.covariance * (suspect.shift / 2) ** 2)
    again = graded(narrow)
    assert again.suspect is not None
    assert again.suspect.shift == pytest.approx(2.0, rel=1e-6)
    assert again.grade == "unreliable"


def test_noise_three_times_as_large_names_no_suspect_and_is_not_relied_on() -> None:
    # A scatter of all rows is not a candidate's, however large its score is.
    for seed in range(10):
        one = graded(estimate(noise=3.0, seed=seed))
        assert one.grade == "unreliable"
        assert one.suspect is None


def test_an_outlying_row_is_named() -> None:
    found = estimate()
    (row,) = [s for s in found.score_tests.scores if s.name == "p7"]
    assert graded(found).suspect is None
    y = np.zeros(30)
    y[7] = 9 * SD
    rng = np.random.default_rng(3)
    design = rng.standard_normal((30, 6)) * G0
    readings = y + SD * rng.standard_normal(30)
    rows = [
        Candidate(f"p{k}", "row", (f"ax[p{k}]",), ("m/s²",), np.eye(30)[:, [k]]) for k in range(30)
    ]
    outlying = least_squares(
        Problem(
            SENSOR.coefficients, np.zeros(6), lambda x: (readings - x @ design.T, design),
            np.full(30, SD), SENSOR.unit_scale, candidates=lambda _: rows,
        )
    )  # fmt: skip
    one = graded(outlying)
    assert one.suspect is not None
    assert one.suspect.name == row.name == "p7"


@pytest.mark.parametrize(
    ("severity", "expected"),
    [("note", "consistent"), ("warning", "reservations"), ("refused", "unreliable")],
)
def test_checks_lower_the_grade(severity: str, expected: str) -> None:
    finding = Finding(severity, "gap", "one gap")  # pyright: ignore[reportArgumentType]
    assert graded(estimate(), finding).grade == expected


def test_a_scale_far_from_nominal_is_not_relied_on() -> None:
    found = estimate()
    value = found.value.copy()
    value[SENSOR.coefficients.index("ay.k1")] = -2.0
    assert graded(replace(found, value=value)).grade == "unreliable"


def test_a_fit_without_any_test_is_usable_with_reservations() -> None:
    closed = Estimate.from_closed_form(SENSOR.coefficients, np.zeros(6), np.eye(6), np.ones(6))
    assert graded(closed).grade == "reservations"


@pytest.mark.parametrize(("statistic", "expected"), [(20.0, "consistent"), (60.0, "reservations")])
def test_a_further_test_counts(statistic: float, expected: str) -> None:
    found = replace(estimate(), tests=(ModelTest("mean innovation of each step", statistic, 20),))
    assert graded(found).grade == expected


def test_the_strongest_rejecting_test_is_the_main_reason_and_a_drift_has_a_remedy() -> None:
    tests = (ModelTest(f"{COMMON_DRIFT} (ay)", 35.0, 1), ModelTest(SLOW_NOISE, 103.0, 2))
    found = graded(replace(estimate(), tests=tests))
    assert SLOW_NOISE in found.reasons[0]
    assert "warm up" in found.lines[1]
    other = graded(replace(estimate(), tests=(ModelTest("mean innovation", 60.0, 20),)))
    assert "warm up" not in other.lines[1]


@pytest.mark.parametrize(("factor", "expected"), [(1.9, "reservations"), (2.1, "unreliable")])
def test_means_of_steps_that_scatter_twice_as_much_are_not_relied_on(
    factor: float, expected: str
) -> None:
    test = ModelTest("mean residuals of the gyros in each step", 57 * factor**2, 57)
    assert graded(replace(estimate(), tests=(test,))).grade == expected


def test_a_group_with_excess_counts_by_what_it_was_before() -> None:
    group = ResidualGroup(
        "norms",
        "m/s²",
        ("a",),
        np.zeros((1, 1)),
        np.ones((1, 1)),
        80.0,
        30,
        ScatterModel(excess=1.0),
    )
    assert graded(replace(estimate(), groups=(group,))).grade == "reservations"


@pytest.mark.parametrize(
    ("dof", "ratio", "expected"),
    [
        (np.inf, 1.9, "reservations"),
        (np.inf, 2.1, "unreliable"),
        (300.0, 2.9, "reservations"),
        (300.0, 3.1, "unreliable"),
    ],
)
def test_noise_measured_within_rests_has_the_wider_limit(
    dof: float, ratio: float, expected: str
) -> None:
    rows = np.zeros((1, 1)), np.ones((1, 1))
    group = ResidualGroup("norms", "m/s²", ("a",), *rows, 30 * ratio**2, 30, ScatterModel(excess=1))
    assert graded(replace(estimate(), noise_dof=dof, groups=(group,))).grade == expected


@pytest.mark.slow
def test_false_alarms_are_one_per_cent_at_most() -> None:
    wrong = sum(graded(estimate(seed=seed)).grade != "consistent" for seed in range(600))
    # 99.9 % of a binomial of 600 with 1 %.
    assert wrong <= 15


def test_a_verdict_survives_json() -> None:
    rounded = RoundedChannel("gx", 3.5e-4, 0.1, False, 1e-4)
    one = replace(graded(estimate(8.0)), rounding=(rounded,))
    written = json.loads(json.dumps(verdict_object(one)))
    assert written["rounding"][0]["channel"] == "gx"
    assert written["advice"]
    assert all(set(each) == {"reason", "changes", "action", "chi2"} for each in written["advice"])
    read = recorded_verdict(VerdictRecord.model_validate(written), ())
    assert verdict_object(read) == written
    assert (read.grade, read.lines, read.reasons) == (one.grade, one.lines, one.reasons)
    assert (read.explanation, read.warned) == (one.explanation, one.warned)
