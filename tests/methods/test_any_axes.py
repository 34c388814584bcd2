"""One to six axes in any direction: errors as stated, and the same as those of a triad.

Devices are of a generator that imports nothing of inercal, `axis_devices`.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2
from tests.accuracy import ramps
from tests.accuracy.dividing_head import Bench, draw
from tests.base_seeds import chosen
from tests.methods import axis_devices
from tests.methods.axis_calibrations import (
    CALIBRATED,
    Kind,
    drifted,
    estimated,
    joined,
    means,
    on_head,
    sensor_along,
    tumbled,
    turned,
    warmed,
)
from tests.methods.axis_devices import DIRECTIONS
from tests.methods.dual_orthogonal_cases import case
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches.dividing_head.bench import position_plan
from inercal.estimation import Estimate
from inercal.methods import hand_likelihood
from inercal.methods.tumble import least_squares

SEEDS = (1, 2, 3)
N = 200  # devices for each seed
MADE = {"f": axis_devices.accelerometers, "w": axis_devices.gyros}
METHOD_OF = {"f": "six_position", "w": "rates_and_poses"}
TRIAD = DIRECTIONS["three"]


@pytest.mark.parametrize("which", chosen(DIRECTIONS, [*DIRECTIONS][::3]))
@pytest.mark.parametrize("kind", ["f", "w"])
def test_errors_are_as_stated(kind: Kind, which: str):
    directions = DIRECTIONS[which]
    found = joined([CALIBRATED[METHOD_OF[kind]](directions, N, seed) for seed in SEEDS])
    p, n = 4 * len(directions), len(found.nees)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], n * p) / (n * p)
    assert min(low, 0.95) < found.nees.mean() < max(high, 1.05)
    # Coefficients of a device share the errors of the bench: its devices are what is independent.
    low, high = binom.ppf([5e-4, 1 - 5e-4], n, 0.9545) / n
    assert min(low, 0.94) < found.inside.mean() < max(high, 0.97)


def require_same(one: Estimate, whole: Estimate) -> None:
    """Require the values of `one` within 1e-9 u, and the same uncertainties."""
    for name in one.wanted:
        i, j = one.names.index(name), whole.names.index(name)
        u = np.sqrt(one.covariance[..., i, i])
        assert np.all(np.abs(one.value[..., i] - whole.value[..., j]) < 1e-9 * u), name
        assert np.allclose(u, np.sqrt(whole.covariance[..., j, j]), rtol=1e-9)


@pytest.mark.parametrize("kind", ["f", "w"])
def test_an_uncoupled_axis_gets_the_result_of_the_triad(kind: Kind):
    made = MADE[kind](np.array(TRIAD, dtype=float), 3, np.random.default_rng(5))
    whole = estimated(kind, TRIAD, made, exact=True)
    for k, axis in enumerate("xyz"):
        alone = replace(made, reading=made.reading[..., [k]], sd=made.sd[[k]])
        one = estimated(kind, [TRIAD[k]], alone, exact=True)
        prefix = f"{'a' if kind == 'f' else 'g'}{axis}."
        assert all(name.startswith(prefix) for name in one.wanted)
        require_same(one, whole)


def test_an_axis_turned_by_hand_gets_the_result_of_the_triad(monkeypatch: pytest.MonkeyPatch):
    # The vertical in a turn is not read. It is common to all gyros, and couples them by 1e-7 u.
    monkeypatch.setattr(hand_likelihood, "_UNREAD", 0.0)
    made = axis_devices.by_hand(np.array(TRIAD, dtype=float), 3, np.random.default_rng(5))
    gyros = replace(made, reading=made.reading[..., 3:], sd=made.sd[3:])
    whole = turned(TRIAD, gyros, exact=True)
    for k, direction in enumerate(TRIAD):
        alone = replace(gyros, reading=gyros.reading[..., [k]], sd=gyros.sd[[k]])
        require_same(turned([direction], alone, exact=True), whole)


def test_an_axis_along_a_ramp_of_known_lag_gets_the_result_of_the_triad():
    made = axis_devices.warmed(np.array(TRIAD, dtype=float), np.random.default_rng(5))
    lag = Measured(ramps.LAG, 0.0)
    whole = warmed(TRIAD, made, lag)
    for k, direction in enumerate(TRIAD):
        alone = replace(made, reading=made.reading[:, [k]])
        require_same(warmed([direction], alone, lag), whole)


@pytest.mark.slow
def test_the_noise_of_an_axis_is_that_in_the_triad():
    reading = axis_devices.drifting(np.array(TRIAD, dtype=float), 5)
    value, u = drifted(TRIAD, reading)
    for k, direction in enumerate(TRIAD):
        alone, its_u = drifted([direction], reading[:, [k]])
        assert np.all(np.abs(alone[0] - value[k]) < 1e-9 * u[k])
        assert np.allclose(its_u[0], u[k], rtol=1e-9)


def test_tumble_gets_the_result_of_an_axis_of_a_pair_on_an_exact_head():
    exact = Bench(head=0.0, collimator=0.0, collimated="none", base=0.0, cross=0.0)
    given = case(5, 3, exact)
    require_same(on_head(given, "a"), on_head(given, "ab"))


def test_tumble_of_a_cluster_gets_the_results_of_its_axes_on_an_exact_head():
    exact = Bench(head=0.0, collimator=0.0, collimated="none", base=0.0, cross=0.0)
    ahead = [0.3, 2.0, -1.1]
    _, _, y = draw(5, 2, exact, ahead=ahead)
    whole = tumbled(y, ahead, exact)
    for k, angle in enumerate(ahead):
        require_same(tumbled(y[..., [k]], [angle], exact, first=k + 1), whole)


def test_tumble_refuses_an_axis_out_of_the_plane_of_rotation():
    directions = DIRECTIONS["three"]
    made = axis_devices.accelerometers(np.array(directions, float), 1, np.random.default_rng(5))
    sensor = sensor_along(directions, "f").with_coefficients("k0", "k1")
    steps = position_plan(len(axis_devices.FACES))
    seen = means(made, sensor, [step.label for step in steps], [1.0] * len(steps))
    with refused(key="[sensor]", names=sensor.channels):
        least_squares(seen, sensor, case(5, 1, Bench()).bench, steps)
