"""Whether `multi_position` errs by as much as it says: hand-held sessions made by another route.

Every band is four standard deviations of what is averaged. Rests are where they were made: how they
are found is another matter.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.generator import DEGREE, Imu, mems
from tests.accuracy.handheld import Handheld, Session, record, triangular

from inercal.benches import Hand
from inercal.estimate import Estimate
from inercal.methods.multi_position import METHOD, joint, sequential
from inercal.methods.rests import Rests
from inercal.methods.stages import accelerometers, gyros, together
from inercal.recording import Mark, Observations, Recording
from inercal.segments.average import observe
from inercal.segments.passages import between_rests
from inercal.sensors import Sensor, imu
from inercal.units import Measured

Array = NDArray[np.float64]
SESSION = Session(latitude=47 * DEGREE, gravity_sd=2e-4)
BENCH = Hand(Measured(SESSION.gravity, SESSION.gravity_sd), SESSION.latitude)
INSIDE = 10  # samples of a rest that are left out at either end
SEEDS = [(seed, 60) for seed in (1, 2, 3)]
MANY = [pytest.param((seed, 300), marks=pytest.mark.slow) for seed in (1, 2, 3)]
both = pytest.mark.parametrize("estimator", ["joint", "sequential"])


@dataclass(frozen=True, eq=False)
class Judged:
    """Errors (trials, p), their stated covariances, and the estimates."""

    names: tuple[str, ...]
    error: Array
    covariance: Array
    estimates: list[Estimate]

    @property
    def nees(self) -> Array:
        """Normalised error squared over p, (trials,)."""
        weighed = np.linalg.solve(self.covariance, self.error[..., None])[..., 0]
        return (self.error * weighed).sum(-1) / len(self.names)

    @property
    def band(self) -> float:
        """Four standard deviations of the mean of `nees`."""
        return 4 * np.sqrt(2 / self.error.size)


def with_g() -> Sensor:
    """Return the sensor with the gyros' sensitivity to acceleration, which `mems` has."""
    return METHOD.prepare(imu(), also=("g",))


def made_by(seed: int, trials: int, session: Session) -> tuple[Imu, Handheld]:
    rng = np.random.default_rng([seed, 20_262])
    device = mems(rng)
    return device, record(device, session, rng, trials=trials)


def observed(made: Handheld, sensor: Sensor) -> Iterator[Observations]:
    marks = [Mark(f"r{k:02d}", a + INSIDE, b - INSIDE) for k, (a, b) in enumerate(made.rests)]
    steps = METHOD.plan(positions=len(marks))
    steps = [replace(step, label=mark.label) for step, mark in zip(steps, marks, strict=True)]
    for data in made.data:
        output = np.ascontiguousarray(data)
        recording = Recording(made.time, output, sensor.channels, ("SI",) * 6)
        seen = observe(recording, sensor, marks, steps)
        yield replace(seen, passages=between_rests(recording, sensor, marks))


def judged(device: Imu, sensor: Sensor, estimates: list[Estimate]) -> Judged:
    named, p = triangular(device).coefficients(), len(sensor.coefficients)
    truth = np.array([named[name] for name in sensor.coefficients])
    error = np.array([estimate.value[:p] for estimate in estimates]) - truth
    covariance = np.array([estimate.stated_covariance[:p, :p] for estimate in estimates])
    return Judged(sensor.coefficients, error, covariance, estimates)


def judge(seed: int, trials: int, session: Session) -> Judged:
    sensor = with_g()
    device, made = made_by(seed, trials, session)
    return judged(device, sensor, [joint(o, sensor, BENCH, ()) for o in observed(made, sensor)])


@pytest.fixture(scope="module", params=[*SEEDS, *MANY], ids=lambda given: f"{given[0]}-{given[1]}")
def sessions(request: pytest.FixtureRequest) -> dict[str, Judged]:
    """Return both estimators' errors; `sequential` is where `joint` starts, and is kept."""
    sensor = with_g()
    device, made = made_by(*request.param, SESSION)
    found: dict[str, list[Estimate]] = {"joint": [], "sequential": []}
    for observations in observed(made, sensor):
        rests = Rests(observations, sensor, BENCH)
        halfway = gyros(rests, accelerometers(rests, ()), ())
        found["sequential"].append(halfway.estimate)
        found["joint"].append(together(rests, halfway, ()).estimate)
    return {name: judged(device, sensor, estimates) for name, estimates in found.items()}


def test_the_stages_judged_here_are_the_estimators():
    sensor = with_g()
    _, made = made_by(1, 1, SESSION)
    observations = next(observed(made, sensor))
    rests = Rests(observations, sensor, BENCH)
    halfway = gyros(rests, accelerometers(rests, ()), ())
    last = together(rests, halfway, ())
    for estimator, stage in ((sequential, halfway), (joint, last)):
        estimate = estimator(observations, sensor, BENCH, ())
        np.testing.assert_array_equal(estimate.value, stage.estimate.value)
        np.testing.assert_array_equal(estimate.covariance, stage.estimate.covariance)


@both
def test_normalised_error_squared_is_one(sessions: dict[str, Judged], estimator: str):
    of = sessions[estimator]
    assert all(estimate.converged for estimate in of.estimates)
    assert of.nees.mean() == pytest.approx(1, abs=of.band)


@both
def test_no_coefficient_is_biased(sessions: dict[str, Judged], estimator: str):
    error = sessions[estimator].error
    standard_errors = error.mean(axis=0) / (error.std(axis=0, ddof=1) / len(error) ** 0.5)
    assert np.abs(standard_errors).max() < 4


@both
def test_each_coefficient_errs_by_its_stated_deviation(sessions: dict[str, Judged], estimator: str):
    of = sessions[estimator]
    variance = np.diagonal(of.covariance, axis1=-2, axis2=-1)
    ratio = np.sqrt(np.mean(of.error**2 / variance, axis=0))
    np.testing.assert_allclose(ratio, 1, rtol=0, atol=4 / np.sqrt(2 * len(of.error)))


def test_chi_squared_of_each_kind_of_rows_is_its_degrees_of_freedom(sessions: dict[str, Judged]):
    estimates = sessions["joint"].estimates
    for kind in zip(*(estimate.groups for estimate in estimates), strict=True):
        dof = kind[0].dof
        band = 4 * np.sqrt(2 / (dof * len(kind)))
        assert np.mean([group.chi2 for group in kind]) / dof == pytest.approx(1, abs=band)


def test_excess_is_found_where_there_is_none_in_one_session_of_twenty(sessions: dict[str, Judged]):
    estimates = sessions["joint"].estimates
    flags = [[group.excess > 0 for group in estimate.groups] for estimate in estimates]
    band = 4 * np.sqrt(0.05 * 0.95 / len(flags))
    np.testing.assert_allclose(np.mean(flags, axis=0), 0.05, rtol=0, atol=band)


@pytest.mark.parametrize("trials", [20, pytest.param(100, marks=pytest.mark.slow)])
def test_with_a_hand_that_trembles_normalised_error_squared_is_one(trials: int):
    of = judge(4, trials, replace(SESSION, tremor_deg=0.05, tremor_push=0.02))
    assert of.nees.mean() == pytest.approx(1, abs=of.band)


def test_drift_that_the_model_does_not_know_shows_in_chi_squared():
    of = judge(5, 10, replace(SESSION, drift_a=0.02, drift_g=0.005))
    told = [not estimate.consistent for estimate in of.estimates]
    assert np.mean(told) >= 0.9
    assert told == [any(g.excess > 0 for g in estimate.groups) for estimate in of.estimates]
