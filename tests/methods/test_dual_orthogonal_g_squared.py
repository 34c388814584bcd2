"""The g² observation and the four cardinal positions, by themselves."""

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy import dividing_head as made
from tests.accuracy.dividing_head import ARCSEC, TERMS, Bench, draw
from tests.methods.dual_orthogonal_cases import SENSOR, SI, nominal

from inercal.estimation.uncertainty import jacobian
from inercal.methods.dual_orthogonal import g_squared
from inercal.methods.dual_orthogonal.patent_estimator import four_points
from inercal.physics.sensors import G0

Array = NDArray[np.float64]


def test_g2_has_rank_8_and_three_null_vectors():
    for n, rank in ((6, 6), (7, 7), (8, 8), (9, 8), (12, 8), (16, 8)):
        rows = g_squared.design_matrix(made.angles(n))
        singular = np.linalg.svd(rows)[1]
        assert np.sum(singular > 1e-10 * singular[0]) == rank
        for _, weights in g_squared.NULL_DIRECTIONS:
            vector = np.array([weights.get(name, 0.0) for name in g_squared.TERMS])
            assert np.abs(rows @ vector).max() < 1e-12


def test_the_design_is_the_slope_of_the_exact_observation():
    y, _ = nominal()
    seen = g_squared.compare_with_gravity(SENSOR, y, np.zeros(12), G0)
    by_name = dict(
        zip(SENSOR.coefficients, (seen.jacobian * SENSOR.unit_scale).T / G0, strict=True)
    )
    assert np.abs(by_name["a.delta_o"] + by_name["b.delta_o"]).max() < 1e-15
    by_name["delta"] = by_name["b.delta_o"]
    slope = np.stack([by_name[name] for name in g_squared.TERMS], axis=-1)
    # A larger coefficient means a smaller force behind the same reading.
    assert -slope == pytest.approx(g_squared.design_matrix(made.angles(12)), abs=1e-14)


def test_slopes_of_the_exact_observation_away_from_nominal():
    rng = np.random.default_rng(5)
    y, _ = nominal()
    y = y + 1e-3 * G0 * rng.standard_normal(y.shape)
    c = 1e-3 * SENSOR.unit_scale * rng.standard_normal(12)
    seen = g_squared.compare_with_gravity(SENSOR, y, c, G0)
    by_c = jacobian(
        lambda x: np.stack(
            [g_squared.compare_with_gravity(SENSOR, y, row, G0).residual for row in x[None]]
        )[0],
        c,
        1e-4 * SENSOR.unit_scale,
    )
    assert -by_c / G0 == pytest.approx(seen.jacobian / G0, rel=1e-6, abs=1e-8)
    h = 1e-4
    moved = [
        g_squared.compare_with_gravity(SENSOR, y + h * np.eye(2)[k] * s, c, G0)
        for k in (0, 1)
        for s in (1, -1)
    ]
    by_y = [(moved[2 * k].residual - moved[2 * k + 1].residual) / (2 * h) for k in (0, 1)]
    assert -np.stack(by_y, axis=-1) == pytest.approx(seen.by_reading, abs=1e-8)


def test_g2_without_errors_of_reading_is_exact_at_any_angle():
    truth = {name: 1e-3 * np.array([[1.0, -0.7]]) for name in TERMS} | {
        "kip": np.zeros((1, 2)),
        "delta": 300 * ARCSEC * np.array([[1.0, -2.0]]),
    }
    psi = made.angles(12) + 0.01 * np.sin(np.arange(12))
    y = made.readings(truth, psi, np.zeros(1))[0] * G0
    c = np.zeros(12)
    for k, name in enumerate(SENSOR.coefficients):
        axis, _, short = name.partition(".")
        term = "delta" if short == "delta_o" else short
        c[k] = SI[term] * truth[term][0, "ab".index(axis)]
    assert np.abs(g_squared.compare_with_gravity(SENSOR, y, c, G0).residual).max() < 1e-14 * G0


def cardinal(delta: float) -> tuple[Array, dict[str, Array]]:
    zero = np.zeros((1, 2))
    truth = {
        "k0": 1e-6 * np.array([[300.0, -200.0]]),
        "k1": 1e-6 * np.array([[200.0, -100.0]]),
        "k2": 1e-6 * np.array([[10.0, -20.0]]),
        "k3": 1e-6 * np.array([[5.0, 4.0]]),
        "kip": zero,
        "delta": delta * np.array([[1.0, 1.0]]),
    }
    return made.readings(truth, made.angles(4), np.zeros(1))[0], truth


def test_four_points_are_exact_without_noise():
    y, truth = cardinal(0.0)
    found = four_points(y)
    assert found.k0 == pytest.approx(truth["k0"][0], abs=1e-15)
    assert found.gain == pytest.approx((truth["k1"] + truth["k3"])[0], abs=1e-15)
    assert found.k2 == pytest.approx(truth["k2"][0], abs=1e-15)


def test_a_mounting_angle_needs_the_correction():
    y, truth = cardinal(300 * ARCSEC)
    gain = (truth["k1"] + truth["k3"])[0]
    off = 1e6 * (four_points(y).gain - gain)
    assert np.abs(off).max() < 1e-4  # K3 and K2 along the turned axis
    missing = 1e6 * (four_points(y, corrected=False).gain - gain)
    assert missing == pytest.approx([-0.5e6 * (300 * ARCSEC) ** 2] * 2, rel=1e-3)


def test_mounting_angles_of_300_arcsec_leave_2_micro_g_without_the_correction():
    """1.83 µg by mounting alone, √3 · ½ δ²; the note has 1.9 µg."""
    quiet = Bench(noise=0.0, sizes=made.SIZES | {"delta": 300 * ARCSEC})
    _, truth, y = draw(1, 20000, quiet, 4)
    gain = truth["k1"] + truth["k3"]
    missing = 1e6 * (four_points(y, corrected=False).gain - gain)
    assert np.sqrt(np.mean(missing**2)) == pytest.approx(1.9, rel=0.06)
    assert np.sqrt(np.mean((1e6 * (four_points(y).gain - gain)) ** 2)) < 0.06
