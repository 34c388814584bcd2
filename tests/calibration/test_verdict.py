"""The verdict says in words what the numbers say."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from inercal.benches.report_data import measured_direction
from inercal.calibration import grade
from inercal.calibration.best_cause import OutlierRow
from inercal.calibration.explanation import CHECKS, NEXT_STEPS, UNCERTAINTIES
from inercal.calibration.verdict import verdict
from inercal.estimation import Estimate
from inercal.estimation.scores import COMMON_DRIFT, SLOW_NOISE, ModelTest
from inercal.physics.plan import Hold
from inercal.physics.sensors import G0, Readout, Sensor, imu, triad
from inercal.recordings import Finding

SENSOR = triad("t", "f", "a").with_coefficients("bias", "scale")


def estimate(sensor: Sensor, chi2: float, dof: int, sd: float = 50e-6, **values: float) -> Estimate:
    """Return one whose deviations are `sd` of the natural sizes."""
    p = len(sensor.coefficients)
    given = {name.replace("_", ".", 1): value for name, value in values.items()}
    return Estimate(
        names=sensor.coefficients,
        value=np.array([given.get(name, 0.0) for name in sensor.coefficients]),
        covariance=np.diag((sd * sensor.unit_scale) ** 2),
        chi2=np.array(chi2),
        dof=dof,
        residual=np.zeros(0),
        whitened=np.zeros(0),
        observations=(),
        wanted=sensor.coefficients,
        rank=p,
        singular_values=np.ones(p),
        null_directions=(),
        weakest=None,
        converged=np.array(True),
        iterations=np.array(1),
    )


def test_consistent_data_are_said_to_agree():
    found = verdict(estimate(SENSOR, 10.5, 12), SENSOR, ())
    first, *others = found.lines
    assert first == (
        "Consistent: the data agree with the stated noise and bench (χ² = 10.5 with 12 degrees of "
        "freedom)."
    )
    assert len(others) == 1
    # P(χ²₁₂ > 10.5) = 0.572
    assert any("p = 0.57" in line for line in found.statements)


def test_counts_per_g_are_stated_for_accelerometers_that_read_counts():
    readout = Readout(scale=8192 / G0, unit="LSB")
    sensor = triad("t", "f", "a", readout=readout).with_coefficients("bias", "scale")
    for one, counts in ((sensor, True), (SENSOR, False)):
        found = verdict(estimate(one, 10.5, 12, ax_k1=2e-3), one, ())
        text = "are ax 8208.38, ay 8192, az 8192 LSB/g"
        assert any(text in line for line in found.statements) == counts


def test_inconsistent_data_enlarge_all_uncertainties_by_the_birge_ratio():
    found = verdict(estimate(SENSOR, 48.0, 12), SENSOR, ())
    assert found.lines[0].startswith("Usable with reservations: the residuals are too large")
    assert any(f"multiplied by {sqrt(48 / 12):.2f}" in line for line in found.statements)
    # 50 µg and 50 ppm, times the Birge ratio of 2, times k = 2.
    assert "Largest U (k = 2): bias 200 µg; scale factor 200 ppm." in found.lines


def test_residuals_large_by_chance_state_the_factor_in_the_first_line():
    found = verdict(estimate(SENSOR, 24.0, 12), SENSOR, ())
    assert found.grade == "consistent"
    assert f"{sqrt(24 / 12):.2f}" in found.lines[0]
    assert "2.0 % of runs" in found.lines[0]  # P(χ²₁₂ > 24) = 0.0203


@pytest.mark.parametrize(("chi2", "agrees"), [(21.0, True), (21.1, False)])
def test_the_line_is_drawn_at_95_per_cent(chi2: float, agrees: bool):
    # The 95 % point of χ² with 12 degrees of freedom is 21.026.
    said = verdict(estimate(SENSOR, chi2, 12), SENSOR, ())
    assert ("data agree" in said.lines[0]) is agrees


def test_the_least_known_of_each_group_is_stated_with_k_2():
    whole = imu().with_coefficients("bias", "scale", "misalignment", "g")
    found = estimate(whole, 10.0, 12)
    found.covariance[whole.coefficients.index("ay.k0")] *= 9.0
    said = verdict(found, whole, ())
    (line,) = [line for line in said.lines if line.startswith("Largest U")]
    assert "bias 300 µg, " in line
    (section,) = [one for one in said.explanation if one.heading == UNCERTAINTIES]
    assert "accelerometer bias: 300 µg" in section.lines
    assert "accelerometer scale factor: 100 ppm" in section.lines
    assert "gyro scale factor: 100 ppm" in section.lines
    assert len(section.lines) == 7


def test_closed_formulas_have_nothing_left_to_test_with():
    said = verdict(estimate(SENSOR, 0.0, 0), SENSOR, ())
    assert "this estimator does not test how well the data agree" in said.lines[0]


@pytest.mark.parametrize(("k1", "times"), [(-2.0, "−1.0"), (-0.6, "0.40"), (1.5, "2.5")])
def test_a_reversed_axis_or_a_wrong_scale_is_named(k1: float, times: str):
    said = verdict(estimate(SENSOR, 10.0, 12, ay_k1=k1), SENSOR, ())
    assert said.lines[0] == (
        f"Not to be relied on: the scale factor of the y accelerometer is {times} times nominal."
    )
    assert ("reversed" in said.lines[1]) == (k1 < -1)


def test_an_axis_whose_scale_factor_is_zero_does_not_react():
    said = verdict(estimate(SENSOR, 10.0, 12, ay_k1=-1.0 + 1e-6), SENSOR, ())
    assert said.grade == "unreliable"
    assert "the y accelerometer does not react to gravity" in said.reasons


def test_a_sensor_that_always_reads_the_same_has_no_direction():
    found = measured_direction(Hold("x_p", (1, 0, 0), 1.0), np.zeros(3), np.array([1.0, 0.0, 0.0]))
    assert np.isnan(found.deviation_angle)


def test_a_reversed_gyro_is_named():
    sensor = imu().with_coefficients("bias", "scale")
    said = verdict(estimate(sensor, 10.0, 12, gz_scale=-2.0), sensor, ())
    assert "the scale factor of the z gyro is −1.0 times nominal" in said.reasons


def test_ordinary_scale_errors_and_large_biases_say_nothing():
    found = estimate(SENSOR, 10.0, 12, ax_k1=0.3, ay_k1=-0.3, az_k0=-3 * G0)
    assert not [line for line in verdict(found, SENSOR, ()).statements if "nominal" in line]


def test_warnings_are_repeated_and_notes_are_not():
    findings = (Finding("warning", "gap", "a gap"), Finding("note", "jitter", "some jitter"))
    said = verdict(estimate(SENSOR, 10.0, 12), SENSOR, findings)
    assert "a gap" in said.statements
    assert said.warned == ("gap",)
    assert "some jitter" not in said.statements


@pytest.mark.parametrize("name", [f"{COMMON_DRIFT} (ax)", SLOW_NOISE])
def test_a_slow_change_comes_before_the_row_that_fits_worst(
    name: str, monkeypatch: pytest.MonkeyPatch
):
    row = OutlierRow("r07", 21.0, 1, 1e-4, ())
    monkeypatch.setattr(grade, "find_outlier_row", lambda _: row)
    made = replace(estimate(SENSOR, 60.0, 12), tests=(ModelTest(name, 80.0, 1),))
    (steps,) = (one for one in verdict(made, SENSOR, ()).explanation if one.heading == NEXT_STEPS)
    assert ["r07" in line for line in steps.lines] == [False, True]


def test_warnings_are_only_mentioned_if_there_are_any():
    scattered = estimate(SENSOR, 60.0, 12)
    quiet, warned = (
        verdict(scattered, SENSOR, found)
        for found in ((), (Finding("warning", "odd", "an odd reading"),))
    )
    assert CHECKS not in {one.heading for one in quiet.explanation}
    assert ["warnings" in "".join(one.lines) for one in (quiet, warned)] == [False, True]
