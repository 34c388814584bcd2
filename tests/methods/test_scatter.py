"""What the residuals of rests and rotations say of their noise."""

from dataclasses import replace

import numpy as np
import pytest
from tests.accuracy.ferraris import DEGREE, mems
from tests.accuracy.handheld import Session, record

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.estimation.residual_scatter import ScatterModel
from inercal.methods import METHODS
from inercal.methods.multi_position.rest_observations import Rests, Scatter
from inercal.methods.multi_position.stages import fit_accelerometers, fit_gyros
from inercal.physics.sensors import imu
from inercal.recordings import Mark, Recording
from inercal.recordings.segments import (
    average_sections,
    holds_from_marks,
    transitions_between_rests,
)

METHOD = METHODS["multi_position"]
STILL = Session(latitude=47 * DEGREE, gravity_sd=2e-4)
INSIDE = 20  # samples of a rest that are left out at either end


def session(seed: int, **tremor: float) -> Rests:
    rng = np.random.default_rng(seed)
    device, session = mems(rng), replace(STILL, **tremor)
    sensor = METHOD.prepare(imu(), also=("g",))
    made = record(device, session, rng)
    recording = Recording(made.time, made.data[0], sensor.channels, ("SI",) * 6)
    marks = [Mark(f"r{k:02d}", a + INSIDE, b - INSIDE) for k, (a, b) in enumerate(made.rests)]
    seen = average_sections(recording, sensor, marks, holds_from_marks(marks), by_hand=True)
    seen = replace(seen, transitions=transitions_between_rests(recording, sensor, marks))
    return Rests(seen, sensor, Hand(Measured(session.gravity, 2e-4), session.latitude))


@pytest.mark.parametrize("seed", [1, 2])
def test_scatter_of_the_norms_does_not_hide_that_rotations_are_calm(seed: int):
    rests = session(seed, tremor_deg=0.05)
    first = fit_accelerometers(rests, ())
    calm = fit_gyros(rests, replace(first, scatter=Scatter()), ()).scatter.turn
    assert calm.share < 0.05
    scattered = replace(first, scatter=Scatter(force=ScatterModel(excess=0.02)))
    assert fit_gyros(rests, scattered, ()).scatter.turn.share == pytest.approx(calm.share, rel=0.1)


def test_noise_as_stated_is_left_as_it_is():
    rests = session(1)
    assert fit_gyros(rests, fit_accelerometers(rests, ()), ()).scatter == Scatter()


@pytest.mark.parametrize("estimator", ["joint", "sequential"])
def test_drift_that_all_rests_share_is_in_the_biases_once(estimator: str):
    rests = session(1)
    drift = np.full((24, 24, 6), 1e-4)
    seen = replace(rests.observations, drift=drift)
    fit = METHOD.estimator(estimator)
    without = fit(rests.observations, rests.sensor, rests.bench, ())
    with_it = fit(seen, rests.sensor, rests.bench, ())
    added = with_it.covariance - without.covariance
    names = [f"a{a}.k0" for a in "xyz"] + [f"g{a}.bias" for a in "xyz"]
    biases = [without.names.index(name) for name in names]
    expected = np.zeros_like(added)
    expected[biases, biases] = 1e-4
    assert added == pytest.approx(expected, abs=1e-12)
