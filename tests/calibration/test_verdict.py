"""The verdict says in words what the numbers say."""

from math import sqrt

import numpy as np
import pytest

from inercal.calibration.verdict import verdict
from inercal.estimation import Estimate
from inercal.physics.sensors import G0, Sensor, imu, triad
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
    summary, *others = verdict(estimate(SENSOR, 10.5, 12), SENSOR, ())
    assert summary.startswith(
        "6 coefficients estimated; the data agree with the stated noise and bench"
    )
    assert "χ² = 10.5 with 12 degrees of freedom" in summary
    assert "p = 0.57" in summary  # P(χ²₁₂ > 10.5) = 0.572
    assert len(others) == 1


def test_inconsistent_data_enlarge_all_uncertainties_by_the_birge_ratio():
    found = estimate(SENSOR, 48.0, 12)
    summary, leading = verdict(found, SENSOR, ())
    assert "residuals are larger than noise and bench allow" in summary
    assert f"scaled by {sqrt(48 / 12):.2f}" in summary
    # 50 µg and 50 ppm, times the Birge ratio of 2, times k = 2.
    assert "accelerometer bias 200 µg" in leading
    assert "accelerometer scale 200 ppm" in leading


@pytest.mark.parametrize(("chi2", "agrees"), [(21.0, True), (21.1, False)])
def test_the_line_is_drawn_at_95_per_cent(chi2: float, agrees: bool):
    # The 95 % point of χ² with 12 degrees of freedom is 21.026.
    summary = verdict(estimate(SENSOR, chi2, 12), SENSOR, ())[0]
    assert ("data agree" in summary) is agrees


def test_the_least_known_of_each_group_is_stated_with_k_2():
    whole = imu().with_coefficients("bias", "scale", "misalignment", "g")
    found = estimate(whole, 10.0, 12)
    found.covariance[whole.coefficients.index("ay.k0")] *= 9.0
    leading = verdict(found, whole, ())[1]
    assert leading.startswith("expanded uncertainties (k = 2) are at most: ")
    assert "accelerometer bias 300 µg" in leading
    assert "accelerometer scale 100 ppm" in leading
    assert "gyro scale 100 ppm" in leading
    assert leading.count(", ") == 6  # seven groups


def test_closed_formulas_have_nothing_left_to_test_with():
    (summary,) = verdict(estimate(SENSOR, 0.0, 0), SENSOR, ())
    assert "this estimator makes no test of how well the data agree" in summary


@pytest.mark.parametrize(("k1", "times"), [(-2.0, "-1"), (-0.6, "0.4"), (1.5, "2.5")])
def test_a_reversed_axis_or_a_wrong_scale_is_named(k1: float, times: str):
    lines = verdict(estimate(SENSOR, 10.0, 12, ay_k1=k1), SENSOR, ())
    (line,) = [line for line in lines if "nominal:" in line]
    assert line.startswith(f"ay.k1 is {times} times nominal: ")
    assert ("reversed" in line) == (k1 < -1)


def test_a_reversed_gyro_is_named():
    sensor = imu().with_coefficients("bias", "scale")
    lines = verdict(estimate(sensor, 10.0, 12, gz_scale=-2.0), sensor, ())
    assert [line for line in lines if line.startswith("gz.scale is -1 times nominal")]


def test_ordinary_scale_errors_and_large_biases_say_nothing():
    found = estimate(SENSOR, 10.0, 12, ax_k1=0.3, ay_k1=-0.3, az_k0=-3 * G0)
    assert not [line for line in verdict(found, SENSOR, ()) if "nominal:" in line]


def test_warnings_are_repeated_and_notes_are_not():
    findings = (Finding("warning", "gap", "a gap"), Finding("note", "jitter", "some jitter"))
    lines = verdict(estimate(SENSOR, 10.0, 12), SENSOR, findings)
    assert "a gap" in lines
    assert "some jitter" not in lines
