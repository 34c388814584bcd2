"""Normal gravity against printed values and against the ellipsoid's exact field."""

from math import atan, atan2, cos, hypot, pi, sin, sqrt

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.refusals import refused

from inercal.physics.earth import (
    EARTH_RATE,
    earth_rate_up_north,
    gravity_at_unknown_height,
    normal_gravity,
)

A, F, GM, OMEGA = 6378137.0, 1 / 298.257223563, 3986004.418e8, 7.292115e-5  # WGS 84, defining


def exact_normal_gravity(latitude: float, height: float) -> float:
    """Gravity of the level ellipsoid in closed form, in ellipsoidal coordinates u, β.

    Heiskanen and Moritz, Physical Geodesy (1967), 2-7 and 2-8; NIMA TR8350.2, 4-5 to 4-15. It
    takes nothing but the four defining constants.
    """
    b = A * (1 - F)
    e2 = 1 - (b / A) ** 2
    linear = A * sqrt(e2)  # linear eccentricity E

    def q(u: float) -> float:
        return ((1 + 3 * (u / linear) ** 2) * atan(linear / u) - 3 * u / linear) / 2

    def q_prime(u: float) -> float:
        return 3 * (1 + (u / linear) ** 2) * (1 - u / linear * atan(linear / u)) - 1

    normal = A / sqrt(1 - e2 * sin(latitude) ** 2)
    p = (normal + height) * cos(latitude)
    z = (normal * (1 - e2) + height) * sin(latitude)
    d = p**2 + z**2 - linear**2
    u = sqrt(d / 2 * (1 + sqrt(1 + (2 * linear * z / d) ** 2)))
    v = hypot(u, linear)
    beta = atan2(z * v, u * p)
    w = sqrt(u**2 + (linear * sin(beta)) ** 2) / v
    whirl = (OMEGA * A) ** 2 / q(b)
    along_u = (
        GM / v**2
        + whirl * linear / v**2 * q_prime(u) * (sin(beta) ** 2 / 2 - 1 / 6)
        - OMEGA**2 * u * cos(beta) ** 2
    ) / w
    along_beta = (whirl / v * q(u) - OMEGA**2 * v) * sin(beta) * cos(beta) / w
    return hypot(along_u, along_beta)


@pytest.mark.parametrize(
    ("degrees", "printed"),
    # TR8350.2, chapter 3; its pole is one below in the last digit: exactly it is 9.83218493786.
    [(0, 9.7803253359), (90, 9.8321849378), (-90, 9.8321849378)],
)
def test_gravity_on_the_ellipsoid_is_as_printed(degrees: float, printed: float):
    assert normal_gravity(degrees * pi / 180, 0.0).value == pytest.approx(printed, abs=1.1e-10)


@pytest.mark.parametrize("latitude", np.linspace(-pi / 2, pi / 2, 25))
def test_somigliana_is_exact_on_the_ellipsoid(latitude: float):
    exact = exact_normal_gravity(latitude, 0.0)
    assert normal_gravity(latitude, 0.0).value == pytest.approx(exact, abs=1e-11)


@pytest.mark.parametrize(("height", "within"), [(-1e3, 1.2e-7), (1e3, 1.1e-7), (5e3, 4.3e-7)])
@pytest.mark.parametrize("latitude", np.linspace(0, pi / 2, 10))
def test_height_series_stays_near_the_exact_field(latitude: float, height: float, within: float):
    exact = exact_normal_gravity(latitude, height)
    assert normal_gravity(latitude, height).value == pytest.approx(exact, abs=within)


def test_height_series_is_within_its_stated_error_to_the_top_of_its_range():
    for latitude in np.linspace(0, pi / 2, 10):
        error = normal_gravity(latitude, 20e3).value - exact_normal_gravity(latitude, 20e3)
        assert abs(error) < 1.5e-6


def test_gravity_falls_by_the_free_air_gradient():
    fall = normal_gravity(pi / 4, 1000.0).value - normal_gravity(pi / 4, 0.0).value
    assert fall == pytest.approx(-3.086e-3, rel=1e-3)


def test_computed_gravity_is_uncertain_by_the_local_anomaly():
    assert normal_gravity(0.8, 200.0).sd == pytest.approx(40e-5)  # 40 mGal


@pytest.mark.parametrize("degrees", [90.001, -91, 4500, float("nan"), float("inf")])
def test_latitudes_beyond_the_poles_are_refused(degrees: float):
    with refused(key="latitude") as refusal:
        normal_gravity(degrees * pi / 180, 0.0)
    assert "[bench]" in str(refusal.value)
    with refused(key="latitude"):
        earth_rate_up_north(degrees * pi / 180)


@pytest.mark.parametrize("height", [-1001, 20001, 4e5, float("nan")])
def test_heights_off_the_series_are_refused(height: float):
    with refused(key="height"):
        normal_gravity(0.0, height)


def test_earth_rate_points_up_at_the_north_pole_and_north_at_the_equator():
    assert_allclose(earth_rate_up_north(pi / 2), [EARTH_RATE, 0], atol=1e-20)
    assert_allclose(earth_rate_up_north(0.0), [0, EARTH_RATE], atol=1e-20)
    assert_allclose(earth_rate_up_north(-pi / 6), EARTH_RATE * np.array([-0.5, sqrt(0.75)]))


def test_earth_turns_once_in_a_sidereal_day():
    assert 2 * pi / EARTH_RATE == pytest.approx(86164.1, abs=0.05)


@pytest.mark.parametrize("height", [0.0, 300.0, 1500.0, 2000.0])
def test_gravity_without_a_height_is_within_its_u_of_every_likely_height(height: float):
    for latitude in (0.0, pi / 4, pi / 2):
        known = gravity_at_unknown_height(latitude)
        there = normal_gravity(latitude, height)
        assert abs(known.value - there.value) <= 2 * known.sd
        assert known.sd == pytest.approx(1.826e-3, rel=0.01)
