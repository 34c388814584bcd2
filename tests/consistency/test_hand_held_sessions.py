"""Whether multi_position errs by as much as it says, on sessions made by another route.

Every band is four standard deviations of what is averaged.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.ferraris import DEGREE, mems
from tests.accuracy.handheld import Session, record, triangular
from tests.base_seeds import evidence, sampled

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.methods import METHODS
from inercal.physics.sensors import imu
from inercal.recordings import Mark, Recording
from inercal.recordings.segments import (
    average_sections,
    holds_from_marks,
    holds_from_observations,
    transitions_between_rests,
)

Array = NDArray[np.float64]
METHOD = METHODS["multi_position"]
STILL = Session(latitude=47 * DEGREE, gravity_sd=2e-4)
TREMBLING = replace(STILL, tremor_deg=0.05, tremor_push=0.02)  # rms degrees and m/s²
TRIMMED = 20  # samples at either end of a true rest


@dataclass(frozen=True, eq=False)
class Judged:
    """The results of a run of sessions; χ² of norms, rates and rotations."""

    error: Array  # (trials, p)
    covariance: Array  # (trials, p, p)
    chi2: Array  # (trials, 3)
    dof: Array  # (3,)
    flagged: NDArray[np.bool_]  # (trials,), by χ²

    @property
    def nees(self) -> Array:
        weighed = np.linalg.solve(self.covariance, self.error[..., None])[..., 0]
        return (self.error * weighed).sum(-1) / self.error.shape[1]


def judge(
    seed: int, session: Session, estimator: str, trials: int, *, stable: bool = False
) -> Judged:
    """Judge sessions; of stable accelerometers it is stated that they do not drift."""
    rng = np.random.default_rng([seed, 2_026])
    device = mems(rng)
    sensor = METHOD.prepare(imu(), also=("g",))
    if stable:
        axes = [
            replace(axis, noise=replace(axis.noise, bias_instability=1e-7)) for axis in sensor.axes
        ]
        sensor = replace(sensor, axes=tuple(axes))
    named = triangular(device).coefficients()
    truth = np.array([named[name] for name in sensor.coefficients])
    bench = Hand(Measured(session.gravity, session.gravity_sd), session.latitude)
    units = ("m/s²",) * 3 + ("rad/s",) * 3
    made = record(device, session, rng, trials=trials)
    marks = [Mark(f"r{k:02d}", a + TRIMMED, b - TRIMMED) for k, (a, b) in enumerate(made.rests)]
    errors: list[Array] = []
    covariances: list[Array] = []
    chi2: list[list[float]] = []
    dof: list[int] = []
    flagged: list[bool] = []
    for data in made.data:
        recording = Recording(made.time, data, sensor.channels, units)
        seen = average_sections(recording, sensor, marks, holds_from_marks(marks), by_hand=True)
        seen = replace(seen, transitions=transitions_between_rests(recording, sensor, marks))
        found = METHOD.estimator(estimator)(
            seen, sensor, bench, holds_from_observations(seen, sensor)
        )
        assert found.converged
        errors.append(found.value[: truth.size] - truth)
        covariances.append(found.covariance[: truth.size, : truth.size])
        chi2.append([group.chi2 for group in found.groups])
        dof = [group.dof for group in found.groups]
        flagged.append(not found.consistent)
    return Judged(
        np.array(errors), np.array(covariances), np.array(chi2), np.array(dof), np.array(flagged)
    )


def assert_consistent(judged: Judged) -> None:
    trials, p = judged.error.shape
    band = 4 * np.sqrt(2 / (p * trials))
    print(f"NEES {judged.nees.mean():.3f}, band {band:.3f}")
    assert judged.nees.mean() == pytest.approx(1, abs=band)


def assert_consistent_by_its_own_spread(judged: Judged) -> None:
    """NEES of noise that is found from few residuals has a longer tail than χ² has.

    Its spread is judged too, as else one session that is far off would widen its own band.
    """
    band = 4 * judged.nees.std(ddof=1) / np.sqrt(judged.nees.size)
    print(f"NEES {judged.nees.mean():.3f}, band {band:.3f}")
    assert judged.nees.mean() == pytest.approx(1, abs=band)
    assert judged.nees.std(ddof=1) < 1.5 * np.sqrt(2 / judged.error.shape[1])
    assert judged.nees.max() < 4


def assert_unbiased(judged: Judged) -> None:
    standard_error = judged.error.std(axis=0, ddof=1) / len(judged.error) ** 0.5
    assert np.abs(judged.error.mean(axis=0) / standard_error).max() < 4


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["joint", "sequential"])
def test_few_rests_err_and_are_judged_as_stated(estimator: str):
    """What norms leave open of the accelerometers, rotations must not be blamed for.

    Ten rests cannot exclude a drift, which would be in U: here it is stated that there is none.
    """
    judged = judge(1, replace(STILL, positions=10), estimator, 30, stable=True)
    assert_consistent(judged)
    band = 4 * np.sqrt(2 * judged.dof / len(judged.chi2))
    assert np.all(np.abs(judged.chi2.mean(axis=0) - judged.dof) < band)


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["joint", "sequential"])
@pytest.mark.parametrize(("seed", "sessions"), sampled(24, 150))
def test_many_sessions_err_as_stated(seed: int, sessions: int, estimator: str):
    judged = judge(seed, STILL, estimator, sessions)
    assert_consistent(judged)
    assert_unbiased(judged)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "sessions"), sampled(60, 300))
def test_sessions_of_a_trembling_hand_err_as_stated(seed: int, sessions: int):
    """With the wobble taken as noise, the stated deviations were more than twice too large."""
    judged = judge(seed, TREMBLING, "joint", sessions)
    assert_consistent_by_its_own_spread(judged)
    assert_unbiased(judged)
    assert judged.flagged.mean() < 0.25  # χ² of three kinds, each beyond its bound in one of 20


@pytest.mark.slow
@pytest.mark.parametrize("sessions", [4, evidence(10)])
def test_a_drift_that_the_model_does_not_know_is_said_by_chi_squared(sessions: int):
    drifting = replace(STILL, drift_a=0.02, drift_g=0.005)
    assert judge(1, drifting, "joint", sessions).flagged.all()
