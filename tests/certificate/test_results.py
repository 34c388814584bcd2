"""Rounding, coverage factors, the capability of the laboratory, and the statement of conformity."""

from dataclasses import replace
from datetime import date
from math import erf, inf, sqrt
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.calibration import Calibration
from inercal.calibration.files import load
from inercal.calibration.specification import Conformity, LimitResult
from inercal.estimation.uncertainty.conformity import DecisionRule
from inercal.laboratory.certificate.content import (
    CertificateChange,
    CertificateInput,
    make_certificate,
)
from inercal.laboratory.certificate.job import read_job
from inercal.laboratory.certificate.results import (
    acceptance_risk,
    judge_results,
    make_results,
    stated_capability,
)
from inercal.physics.sensors.coefficient_tables import G0
from inercal.runfile.job import read_laboratory

UG = 1e-6 * G0


@pytest.fixture(scope="module")
def calibration(example: Path) -> Calibration:
    return load(example / "run.calibration.json")


def with_bias(calibration: Calibration, value: float, u: float) -> Calibration:
    """Return a calibration whose ax.k0 has this value and standard uncertainty, µg."""
    values, covariance = calibration.values.copy(), calibration.covariance.copy()
    values[0] = value * UG
    scale = np.ones(values.size)
    scale[0] = u * UG / np.sqrt(covariance[0, 0])
    covariance = covariance * np.outer(scale, scale)
    return replace(calibration, values=values, covariance=covariance, conformity=None)


@pytest.mark.parametrize(
    ("value", "u", "shown"),
    [
        (12.3456, 0.5, ("12.3", "1.0")),
        (12.3456, 0.4999, ("12.3", "1.0")),
        (-12.3456, 0.04321, ("-12.346", "0.086")),
        (54321.2, 617.0, ("54300", "1200")),
        (0.0004, 4.98, ("0.0", "10.0")),
    ],
)
def test_u_has_two_digits_and_the_value_ends_with_it(
    value: float, u: float, shown: tuple[str, str], calibration: Calibration
):
    row = make_results(with_bias(calibration, value, u), None, inf).rows[0]
    if u == 4.98:  # 9.96 rounds to 10: two digits, not three
        shown = ("0", "10")
    assert (row.value, row.expanded) == shown


def test_u_below_the_capability_is_raised_with_its_correlations(calibration: Calibration):
    u = 2 * calibration.uncertainty("ax.k0")
    found = make_results(calibration, {"ax.k0": 3 * u, "ay.k0": 0.1 * UG}, inf)
    raised = {row.name for row in found.rows if row.raised}
    assert raised == {"ax.k0"}
    std = np.sqrt(np.diag(found.covariance))
    assert 2 * std[0] == pytest.approx(3 * u)
    before = calibration.covariance / np.outer(calibration.std, calibration.std)
    np.testing.assert_allclose(found.covariance / np.outer(std, std), before, atol=1e-12)


def test_a_coefficient_without_uncertainty_has_that_of_the_capability(calibration: Calibration):
    covariance = calibration.covariance.copy()
    covariance[0] = covariance[:, 0] = 0.0
    exact = replace(calibration, covariance=covariance, conformity=None)
    found = make_results(exact, {"ax.k0": 20 * UG}, inf)
    assert found.rows[0].expanded == "20"


@pytest.mark.parametrize("as_found", [False, True])
def test_a_calibration_without_any_uncertainty_is_refused(
    as_found: bool, calibration: Calibration, example: Path
):
    imported = replace(calibration, covariance=0 * calibration.covariance, conformity=None)
    pair = (calibration, imported) if as_found else (imported, None)
    laboratory = read_laboratory(example / "lab.toml")
    job = read_job(calibration.job)
    given = CertificateInput(*pair, laboratory, job, "en", date(2026, 11, 26), draft=True)
    with refused(names=(calibration.sensor.name,)):
        make_certificate(given, "", CertificateChange())


def test_capability_is_stated_by_groups_and_full_names(calibration: Calibration):
    sensor = calibration.sensor
    words = {"bias": "20 µg", "ax.k0": "50 µg", "g": "1 °/h/g", "misalignment": "10 ″"}
    found = stated_capability(words, sensor)
    assert found["ax.k0"] == pytest.approx(50 * UG)
    assert found["ay.k0"] == pytest.approx(20 * UG)
    assert "ax.k1" not in found
    with refused(key="[capability.uncertainty] bias"):
        stated_capability({"bias": "20 m"}, sensor)
    with refused(key="[capability.uncertainty] bias"):
        stated_capability({"bias": "0 µg"}, sensor)
    for word in ("bais", "ax.k00"):
        with refused(key=f"[capability.uncertainty] {word}"):
            stated_capability({word: "20 µg"}, sensor)


def test_few_degrees_of_freedom_widen_u(calibration: Calibration):
    """EA-4/02: k of 95.45 %."""
    for dof, k in ((1, 13.97), (2, 4.53), (5, 2.65), (10, 2.28), (50, 2.05), (inf, 2.0)):
        assert make_results(calibration, None, dof).k == pytest.approx(k, abs=5e-3)


def limits(value: float, u: float, lower: float, upper: float, rule: DecisionRule) -> Conformity:
    one = LimitResult("ax.k0", lower * UG, upper * UG, value * UG, u * UG, 0.0, "pass", 1.0)
    return Conformity(rule, (one,), 1.0)


# JCGM 106:2012, examples of clause 7: best estimate, standard uncertainty, limits, probability.
WORKED = [
    pytest.param(-5.47, 0.05, -inf, -5.40, 0.92, id="Zener diode"),
    pytest.param(509.7, 8.6, 490.0, inf, 0.989, id="burst strength"),
    pytest.param(13.6, 1.8, 12.5, 16.3, 0.66, id="motor oil"),
]


@pytest.mark.parametrize(("value", "u", "lower", "upper", "probability"), WORKED)
def test_worked_examples_of_jcgm_106(
    value: float,
    u: float,
    lower: float,
    upper: float,
    probability: float,
    calibration: Calibration,
):
    stated = limits(value, u, lower, upper, DecisionRule())
    certified = replace(with_bias(calibration, value, u), conformity=stated)
    conformity = judge_results(make_results(certified, None, inf))
    assert conformity is not None
    (found,) = conformity.limits
    assert round(found.probability, 3 if probability > 0.95 else 2) == probability
    # The same by the error function of the standard library.
    below, above = ((limit - value) / u / sqrt(2) for limit in (lower, upper))
    assert found.probability == pytest.approx((erf(above) - erf(below)) / 2, rel=1e-12)
    assert conformity.probability == pytest.approx(found.probability, abs=1e-3)


@pytest.mark.parametrize(
    ("rule", "risk"),
    [
        (DecisionRule(), 0.0228),
        (DecisionRule(factor=0.83), 0.0485),
        (DecisionRule(factor=1.5), 0.00135),
        (DecisionRule("simple"), 0.5),
    ],
)
def test_risk_that_the_certificate_states_is_that_of_the_rule(rule: DecisionRule, risk: float):
    """JCGM 106:2012, 8.3.2, and ILAC-G8:09/2019, table 1."""
    assert acceptance_risk(limits(0, 1, -9, 9, rule)) == pytest.approx(risk, rel=3e-3)


def test_conformity_is_judged_with_the_u_of_the_certificate(calibration: Calibration):
    stated = limits(100.0, 10.0, -inf, 125.0, DecisionRule())
    certified = replace(with_bias(calibration, 100.0, 10.0), conformity=stated)
    results = {
        "": make_results(certified, None, inf),
        "capability": make_results(certified, {"ax.k0": 30 * UG}, inf),
        "degrees of freedom": make_results(certified, None, 3.0),
    }
    found = {name: judge_results(one) for name, one in results.items()}
    assert {name: one.result for name, one in found.items() if one} == {
        "": "pass",
        "capability": "conditional pass",
        "degrees of freedom": "conditional pass",  # 3.3 u
    }
