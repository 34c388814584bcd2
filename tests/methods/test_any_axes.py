"""One to six axes in any direction: errors as stated, and the same as those of a triad.

Devices are of a generator that imports nothing of inercal, `axis_devices`.
"""

from typing import Any, Literal

import numpy as np
import pytest
from tests.methods import axis_devices
from tests.methods.axis_accuracy import errors, require_stated_accuracy
from tests.methods.axis_devices import DIRECTIONS, FACES, RATES, Devices

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.benches.rate_platform import RatePlatform
from inercal.benches.rate_platform.sections import RateDwell
from inercal.estimation import Estimate
from inercal.methods import hand_likelihood, rates_and_poses
from inercal.physics.plan import six_positions
from inercal.physics.sensors import Sensor, axes_along
from inercal.recordings import Observations

Kind = Literal["f", "w"]
MADE = {"f": axis_devices.accelerometers, "w": axis_devices.gyros}
SEEDS = (1, 2, 3)
N = 200  # devices for each seed


def estimated(
    kind: Kind, directions: list[tuple[float, float, float]], made: Devices, *, exact: bool = False
) -> Estimate:
    axes = axes_along(directions, kind, "a" if kind == "f" else "g")
    sensor = Sensor("s", axes).with_coefficients("bias", "scale", "misalignment")
    labels = [*FACES] if kind == "f" else [f"{k} {row.name}" for k, row in enumerate(RATES)]
    r, m = len(labels), len(axes)
    observations = Observations(
        labels=tuple(labels),
        mean=made.reading,
        covariance=np.broadcast_to(made.sd**2 * np.eye(m), (r, m, m)),
        duration=np.array([1.0] * r if kind == "f" else [row.seconds for row in RATES]),
        samples=np.ones(r, dtype=np.int64),
        time=np.arange(r, dtype=float),
        channels=sensor.channels,
        timed=False,
    )
    if kind == "f":
        gravity = Measured(axis_devices.G, 0.0 if exact else axis_devices.GRAVITY_SD)
        hand = Hand(gravity, tilt=0.0 if exact else axis_devices.TILT)
        return hand_likelihood.ml(observations, sensor, hand, six_positions())
    table: dict[str, Any] = axis_devices.PLAIN.stated()
    table = dict.fromkeys(table, 0.0) if exact else table
    # At a pole, no level part of the earth's rate couples the gyros.
    latitude = Measured(np.pi / 2 if exact else np.radians(50.0), 0.0)
    platform = RatePlatform(Measured(axis_devices.G, 1e-4), latitude, **table)
    steps = [
        RateDwell(label, row.name, row.rate, row.seconds, row.setting)
        for label, row in zip(labels, RATES, strict=True)
    ]
    return rates_and_poses.ml(observations, sensor, platform, steps)


def pooled(kind: Kind, which: str, n: int) -> tuple[np.ndarray, np.ndarray]:
    directions = DIRECTIONS[which]
    off: list[np.ndarray] = []
    covariances: list[np.ndarray] = []
    for seed in SEEDS:
        made = MADE[kind](np.array(directions, dtype=float), n, np.random.default_rng(seed))
        found = estimated(kind, directions, made)
        assert found.converged.all()
        one, covariance = errors(made.truth, found)
        off.append(one)
        covariances.append(covariance)
    return np.concatenate(off), np.concatenate(covariances)


@pytest.mark.parametrize("which", DIRECTIONS)
@pytest.mark.parametrize("kind", ["f", "w"])
def test_errors_are_as_stated(kind: Kind, which: str):
    require_stated_accuracy(*pooled(kind, which, N))


@pytest.mark.parametrize("kind", ["f", "w"])
def test_an_uncoupled_axis_gets_the_result_of_the_triad(kind: Kind):
    triad = DIRECTIONS["three"]
    made = MADE[kind](np.array(triad, dtype=float), 3, np.random.default_rng(5))
    whole = estimated(kind, triad, made, exact=True)
    for k, axis in enumerate("xyz"):
        alone = Devices(made.reading[..., k : k + 1], made.sd, {})
        one = estimated(kind, [triad[k]], alone, exact=True)
        prefix = f"{'a' if kind == 'f' else 'g'}{axis}."
        assert all(name.startswith(prefix) for name in one.wanted)
        for name in one.wanted:
            i, j = one.names.index(name), whole.names.index(name)
            u = np.sqrt(one.covariance[..., i, i])
            assert np.all(np.abs(one.value[:, i] - whole.value[:, j]) < 1e-9 * u), name
            assert np.allclose(u, np.sqrt(whole.covariance[..., j, j]), rtol=1e-9)
