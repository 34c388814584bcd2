"""Soaks of six positions: errors against what is stated, and against fits in two stages."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import chdtri
from tests.accuracy import soaks
from tests.base_seeds import SEEDS
from tests.evidence import temperature_soaks

from inercal.recordings.environment import Environment

Array = NDArray[np.float64]


def covariance_of_means(c: Array, names: list[str], temperature: Array, up: Array) -> Array:
    """Return the covariance of all readings of a triad, (3 r, 3 r), from the generator's sizes."""
    r = len(up)
    of_soak = np.repeat(np.arange(r // 6), 6)
    warmth = temperature - soaks.REFERENCE
    named = dict(zip(names, c.tolist(), strict=True))
    slope = np.zeros((r, 3))
    for i, axis in enumerate("xyz"):
        f = soaks.GRAVITY[0] * up
        slope[:, i] = sum(k * named[f"a{axis}.k0_dT{k if k > 1 else ''}"] * warmth ** (k - 1)
                          for k in (1, 2, 3))  # fmt: skip
        slope[:, i] += (named[f"a{axis}.k1_dT"] + 2 * named[f"a{axis}.k1_dT2"] * warmth) * f[:, i]
        slope[:, i] += named[f"a{axis}.delta_o_dT"] * f[:, (i + 1) % 3]
        slope[:, i] -= named[f"a{axis}.delta_p_dT"] * f[:, (i + 2) % 3]
    # The triad reads what leans through I + S(T).
    response = np.tile(np.eye(3), (r, 1, 1))
    for i, axis in enumerate("xyz"):
        scale = [named[f"a{axis}.k1{order}"] for order in ("", "_dT", "_dT2")]
        response[:, i, i] += sum(c * warmth**k for k, c in enumerate(scale))
        for j, sign, base in (((i + 1) % 3, 1, "delta_o"), ((i + 2) % 3, -1, "delta_p")):
            terms = [named[f"a{axis}.{base}{order}"] for order in ("", "_dT")]
            response[:, i, j] += sign * (terms[0] + terms[1] * warmth)
    columns: list[Array] = [soaks.GRAVITY[1] * (response @ up[..., None])]
    for k in range(r // 6):
        member = (of_soak == k).astype(float)
        columns.append((soaks.TEMPERATURE_SD * slope * member[:, None])[..., None])
        columns.append(soaks.REPEATABILITY * member[:, None, None] * np.eye(3))
    for k in range(r):
        lean = np.zeros((r, 3, 3))
        lean[k] = soaks.PLACEMENT * soaks.GRAVITY[0] * np.cross(np.eye(3), up[k]).T
        columns.append(response @ lean)
    for face in range(6):
        lean = np.zeros((r, 3, 3))
        lean[face::6] = soaks.FIXTURE * soaks.GRAVITY[0] * np.cross(np.eye(3), up[face]).T
        columns.append(response @ lean)
    effect = np.concatenate(columns, axis=-1).reshape(3 * r, -1)
    return effect @ effect.T + soaks.NOISE**2 * np.eye(3 * r)


def design_of_soak(up: Array) -> Array:
    """Return the derivatives of six readings to bias, scale factor and misalignments, (18, 12)."""
    f, design = soaks.GRAVITY[0] * up, np.zeros((6, 3, 12))
    for i in range(3):
        own = (np.ones(6), f[:, i], f[:, (i + 1) % 3], -f[:, (i + 2) % 3])
        for k, column in enumerate(own):
            design[:, i, 4 * i + k] = column
    return design.reshape(18, 12)


def two_stages(made: soaks.SoakedTriads, trial: int, covariance: Array, names: list[str]) -> Array:
    """Return coefficients by least squares in each soak, then over the soaks."""
    up, count = made.up, len(made.up) // 6
    gains = np.zeros((12 * count, 18 * count))
    for k in range(count):
        rows = slice(18 * k, 18 * k + 18)
        weight = np.linalg.inv(covariance[rows, rows])
        design = design_of_soak(up[6 * k : 6 * k + 6])
        gains[12 * k : 12 * k + 12, rows] = np.linalg.solve(
            design.T @ weight @ design, design.T @ weight
        )
    stated = soaks.GRAVITY[0] * up
    soaked = gains @ (made.mean[trial] - stated).ravel()
    return weighed(gains @ polynomials(made, names), gains @ covariance @ gains.T, soaked)


def all_soaks(made: soaks.SoakedTriads, trial: int, covariance: Array, names: list[str]) -> Array:
    """Return coefficients by least squares over all readings."""
    away = (made.mean[trial] - soaks.GRAVITY[0] * made.up).ravel()
    return weighed(polynomials(made, names), covariance, away)


def polynomials(made: soaks.SoakedTriads, names: list[str]) -> Array:
    """Return the derivatives of all readings to the coefficients, (3 r, p)."""
    f, warmth = soaks.GRAVITY[0] * made.up, made.temperature - soaks.REFERENCE
    by = np.zeros((len(f), 3, len(names)))
    for at, name in enumerate(names):
        axis, _, term = name.partition(".")
        base, _, order = term.partition("_dT")
        i = "xyz".index(axis[-1])
        basis = {
            "k0": np.ones(len(f)),
            "k1": f[:, i],
            "delta_o": f[:, (i + 1) % 3],
            "delta_p": -f[:, (i + 2) % 3],
        }[base]
        by[:, i, at] = basis * warmth ** (0 if "_dT" not in term else int(order or 1))
    return by.reshape(-1, len(names))


def weighed(by: Array, covariance: Array, y: Array) -> Array:
    """Return the generalised least squares solution."""
    scale = np.abs(by).max(axis=0)
    weight = np.linalg.inv(covariance)
    scaled = by / scale
    return np.linalg.solve(scaled.T @ weight @ scaled, scaled.T @ weight @ y) / scale


@pytest.mark.slow
def test_all_soaks_together_agree_with_two_stages_that_carry_their_covariance():
    # Least squares in each soak loses a little by not knowing the others: .3 u of single ones.
    found, away = temperature_soaks.fits(5, 3), list[Array]()
    names, p = list(found.sensor.coefficients), len(found.sensor.coefficients)
    for trial, value in enumerate(found.estimate.value[:, :p]):
        made = found.made
        covariance = covariance_of_means(value, names, made.temperature, made.up)
        staged = two_stages(made, trial, covariance, names)
        u = np.sqrt(np.diag(found.estimate.covariance[trial])[:p])
        away.append((staged - value) / u)
        at_once = all_soaks(made, trial, covariance, names)
        assert np.abs((at_once - value) / u).max() < 0.1
    assert np.sqrt(np.mean(np.square(away))) < 0.15
    assert np.mean(np.abs(away) < 0.3) > 0.95


@pytest.mark.slow
def test_a_bias_that_does_not_come_back_shows_where_it_is_not_stated():
    stated = temperature_soaks.fits(6, 4)
    silent = Environment("soaks", soaks.TEMPERATURE_SD)
    bare = temperature_soaks.fits(6, 4, environment=silent)
    assert (stated.estimate.chi2 < 150).all()
    assert (bare.estimate.chi2 > 1.1 * stated.estimate.chi2).all()


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_errors_over_triads_are_as_stated(seed: int):
    found = temperature_soaks.fits(seed, 50)
    made = temperature_soaks.table(found)
    dof = made.trials * len(found.sensor.coefficients)
    low, high = (float(chdtri(dof, tail)) / dof for tail in (0.9995, 0.0005))
    assert low < made.nees < high
    # Rows of one triad correlate: 150 to 300 values count as about half as many.
    assert all(0.89 < row.coverage <= 1.0 for row in made.rows)
    assert 0.89 < made.covered <= 1.0
    chosen = temperature_soaks.orders_chosen(found)
    assert sum(one == temperature_soaks.TRUE_ORDERS for one in chosen) >= 0.75 * len(chosen)


@pytest.mark.evidence
def test_orders_too_low_leave_chi_square_per_degree_above_a_hundred():
    for orders in ((1, 0, 0), (2, 1, 0), (3, 1, 1)):
        estimate = temperature_soaks.fits(7, 20, orders).estimate
        assert np.median(estimate.chi2 / estimate.dof) > 100
