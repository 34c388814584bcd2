"""The standard uncertainties for a number of rests and a range of tilts.

The expected values are from separate computations with NumPy only: `sim.dense_covariance`, and
figures with two digits.
"""
# Arrays and records without annotations, because a plain script is easier to compare with formulas.
# pyright: reportUnknownParameterType=false

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.magnetometer import generator as sim
from tests.magnetometer.cases import fit, linear_model

_DRAWS = 40
_SYMMETRIC, _SKEW = ((1.0, 1.0), (0.5, -0.5))


def uncertainties(found, rng):
    """Return u of offset (µT), scale (‰), non-orthogonality, alignment, dip and heading (°)."""
    own, model = found.covariance[:12, :12], linear_model()
    mat = model.directions[:, :, :3].reshape(12, 9).T
    axes = (mat @ own @ mat.T).reshape(3, 3, 3, 3)
    angles = []
    for upper, lower in (_SYMMETRIC, _SKEW):
        angles.append(
            [
                upper**2 * axes[i, j, i, j]
                + 2 * upper * lower * axes[i, j, j, i]
                + lower**2 * axes[j, i, j, i]
                for i, j in ((0, 1), (0, 2), (1, 2))
            ]
        )
    variance = np.diagonal(found.covariance)
    level = sim.scattered(rng, 40, np.radians(15))
    strength, dip = found.value[13], found.value[12]
    h = level.swapaxes(1, 2) @ (strength * np.array([np.cos(dip), 0, -np.sin(dip)]))
    d = model.matrices(found.value[:12], np.zeros(1))[0, :, :3]
    moves = np.linalg.inv(d) @ model.derivatives(h, np.zeros(40))
    heading = np.einsum("ki,kip->kp", level[:, 1], moves) / (strength * np.cos(dip))
    return [
        1e6 * np.sqrt(np.median(variance[0:12:4])),
        1e3 * np.sqrt(np.median(variance[1:12:4])),
        *np.degrees([np.sqrt(np.median(angle)) for angle in angles]),
        np.degrees(np.sqrt(variance[12])),
        np.degrees(np.sqrt(np.mean(np.einsum("kp,pq,kq->k", heading, own, heading)))),
    ]


def draw(make):
    rows = []
    for k in range(_DRAWS):
        rng = np.random.default_rng([3, k])
        rows.append(uncertainties(fit(make(rng)), rng))
    return np.array(rows)


def assert_medians(rows, expected, digits):
    """Compare medians within 4 standard errors of both computations, and with half a digit."""
    spread = 1.4826 * np.median(np.abs(rows - np.median(rows, axis=0)), axis=0)
    error = 1.2533 * spread / np.sqrt(_DRAWS)
    assert np.all(np.abs(np.median(rows, axis=0) - expected) < 4 * np.sqrt(2) * error + digits)


def rests(n, tilt=180.0, **options):
    return lambda rng: sim.rests(
        rng, sim.scattered(rng, n, np.radians(tilt)), sim.device(rng), **options
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "expected"),
    [
        evidence(rests(12), (0.049, 1.5, 0.14, 0.086, 0.05, 0.29)),
        evidence(rests(16), (0.039, 1.2, 0.11, 0.067, 0.04, 0.21)),
        (rests(24), (0.028, 0.91, 0.080, 0.049, 0.03, 0.16)),
        evidence(rests(40), (0.021, 0.68, 0.058, 0.036, 0.02, 0.12)),
        evidence(rests(80), (0.014, 0.47, 0.040, 0.024, 0.014, 0.08)),
        evidence(rests(30, sigma_m=0.3e-6), (0.073, 2.4, 0.21, 0.12, 0.07, 0.41)),
        (rests(30, sigma_f=0.05), (0.034, 1.0, 0.09, 0.105, 0.06, 0.28)),
    ],
    ids=["12", "16", "24", "40", "80", "noisy magnetometer", "noisy accelerometer"],
)
def test_uncertainties_for_a_number_of_rests(make, expected):
    digits = [0.0005 if e < 0.2 else 0.05 if e > 0.9 else 0.005 for e in expected]
    digits[4], digits[5] = 0.005, 0.005
    assert_medians(draw(make), expected, digits)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tilt", "offset", "alignment"),
    [
        (10, 0.74, 0.44),
        evidence(20, 0.36, 0.22),
        evidence(30, 0.23, 0.14),
        evidence(45, 0.14, 0.091),
        evidence(60, 0.089, 0.069),
        evidence(90, 0.045, 0.050),
        evidence(180, 0.025, 0.042),
    ],
)
def test_uncertainties_for_a_range_of_tilts(tilt, offset, alignment):
    rows = draw(rests(30, tilt))[:, [0, 3]]
    assert_medians(rows, (offset, alignment), (0.005 if tilt < 60 else 0.0005, 0.0005))


@pytest.mark.slow
def test_gyros_reduce_the_uncertainty_of_twelve_rests():
    def linked(rng):
        attitude = sim.scattered(rng, 12)
        data = sim.rests(rng, attitude, sim.device(rng))
        gyro = [1e-3] * 9 + [1e-5] * 3
        return sim.add_turns(rng, data, sim.turns_between(attitude), gyro=gyro, about_up=True)

    expected = (0.033, 1.15, 0.095, 0.050, 0.040, 0.18)
    assert_medians(draw(linked), expected, (0.0005, 0.005, 0.0005, 0.0005, 0.0005, 0.005))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("azimuths", "offset", "heading"),
    [(2, 0.0434, 0.289), evidence(3, 0.029, 0.18), evidence(4, 0.026, 0.15)],
)
def test_uncertainties_of_six_faces(azimuths, offset, heading):
    def faces(rng):
        return sim.rests(rng, sim.six_faces(rng, azimuths), sim.device(rng))

    assert_medians(draw(faces)[:, [0, 5]], (offset, heading), (0.0005, 0.005))


@pytest.mark.parametrize(
    "attitudes",
    [lambda rng: sim.scattered(rng, 20), lambda rng: sim.six_faces(rng, 2)],
    ids=["scattered", "six faces"],
)
def test_covariance_is_the_inverse_of_the_whole_information(attitudes):
    rng = np.random.default_rng(5)
    attitude, own = attitudes(rng), sim.device(rng)
    found = fit(sim.rests(rng, attitude, own, noise=0.0))
    mat = np.concatenate([linear_model().directions.reshape(12, 12).T, np.zeros((12, 1))], axis=1)
    mat = np.concatenate([mat, np.eye(13)[12:]])
    covariance = mat @ found.covariance[:13, :13] @ mat.T
    sd = np.sqrt(np.diagonal(covariance))
    error = covariance - sim.dense_covariance(attitude, own)
    assert np.max(np.abs(error / np.outer(sd, sd))) < 1e-5
