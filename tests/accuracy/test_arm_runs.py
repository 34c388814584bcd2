"""Arm runs by the generator, through dwells and `ml`: what is stated is what it scatters by."""

from math import radians

import numpy as np
import pytest
from tests.accuracy.arm_runs import record
from tests.accuracy.centrifuge import PAPER_G, Triad, full_circle
from tests.base_seeds import sampled

from inercal.basics.units import Measured
from inercal.benches import Centrifuge
from inercal.methods.centrifuge_norm import ml
from inercal.physics.sensors import Readout, triad
from inercal.recordings import Recording
from inercal.recordings.segments import average_dwells, find_dwells

DEVICE = Triad()
NOMINAL = 1.25
LATITUDE = radians(39)


def normalised(rng: np.random.Generator, *, locked: bool, sense: int) -> tuple[float, float]:
    """Return NEES over nine, and χ² over its degrees of freedom, of one session."""
    error, lean = 1e-6, 2e-5
    run = record(
        DEVICE,
        full_circle(),
        rng,
        turns=6,
        noise=2e-4,
        lean=(lean * rng.standard_normal(), lean * rng.standard_normal()),
        locked=locked,
        error=error * rng.standard_normal(),
        wander=5e-7,
        sense=sense,
        latitude=LATITUDE,
    )
    made = Recording(
        run.time,
        run.output,
        ("x", "y", "z"),
        ("V",) * 3,
        run.position,
        None,
        {"arm_rate": run.rate},
    )
    sensor = triad("triad", "f", "", Readout(NOMINAL / PAPER_G, 0.0, "V"))
    sensor = sensor.with_coefficients("k0", "k1", "k2")
    bench = Centrifuge(
        Measured(PAPER_G, 0.0),
        Measured(1.0, 0.0),
        Measured(LATITUDE, 0.0),
        rate=error,
        lean=lean,
        dwell_rate=5e-7,
        platform="locked" if locked else "counter-rotating",
        sense=1 if sense > 0 else -1,
    )
    dwells, _ = find_dwells(made)
    seen, steps = average_dwells(made, sensor, dwells, 0 if locked else 2, sense)
    found = ml(seen, sensor, bench, steps)
    exact = {
        "k0": DEVICE.bias * PAPER_G / NOMINAL,
        "k1": DEVICE.scale / NOMINAL - 1,
        "k2": DEVICE.bend * DEVICE.scale / NOMINAL / PAPER_G,
    }
    names = [name.split(".") for name in sensor.coefficients]
    off = found.value[:9] - np.array([exact[term]["xyz".index(axis)] for axis, term in names])
    nees = float(off @ np.linalg.solve(found.covariance[:9, :9], off)) / 9
    return nees, float(found.chi2 / found.dof)


KINDS = {"locked": (True, 1), "clockwise": (True, -1), "counter-rotating": (False, 1)}


def assert_consistent(kind: str, seed: int, trials: int) -> None:
    locked, sense = KINDS[kind]
    rng = np.random.default_rng([seed, 40])
    both = [normalised(rng, locked=locked, sense=sense) for _ in range(trials)]
    nees, chi2 = np.mean(both, axis=0)
    print(f"{kind}: NEES {nees:.3f}, χ²/ν {chi2:.3f}")
    # The noise is found with 100 degrees of freedom (500 at azimuths) for three channels.
    assert nees == pytest.approx(1, abs=4 * np.sqrt(2 / 9 / trials) + 0.04)
    assert chi2 == pytest.approx(1, abs=4 * np.sqrt(2 / 51 / trials) + 0.04)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_arm_runs_scatter_as_stated(kind: str):
    assert_consistent(kind, 1, 4)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("seed", "sessions"), sampled(25, 60))
def test_many_arm_runs_scatter_as_stated(kind: str, seed: int, sessions: int):
    assert_consistent(kind, seed, sessions)
