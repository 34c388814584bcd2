"""Coefficients that methods by hand omit are named, in sessions simulated without inercal."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.ferraris import DEGREE, G0, FerrarisSession, Handling, mems
from tests.accuracy.ferraris import record as faces
from tests.accuracy.handheld import Session, record
from tests.accuracy.inercal_inputs import make_bench, make_marks, recording

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.calibration.agreement_text import cause_lines
from inercal.calibration.detectability import undetectable_causes
from inercal.calibration.grade import assess
from inercal.estimation import Estimate
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
Change = Callable[[Array], None]
ARCSEC = DEGREE / 3600
PRECISE = Handling(gravity_sd=1e-5, tilt=2 * ARCSEC)
SESSION = Session(positions=16, latitude=47 * DEGREE, gravity_sd=2e-4)
TRIAD = imu().select_axes("f")
TRIMMED = 20  # samples at either end of a true rest


def six(change: Change | None, seed: int = 1, estimator: str = "ml") -> Estimate:
    """Return six positions of navigation-grade accelerometers on faces true to 2″."""
    rng = np.random.default_rng([seed, 61])
    made = faces(mems(rng, white_a=5e-6 * G0), PRECISE, rng)
    data = made.data.copy()
    if change is not None:
        change(data[0])
    method = METHODS["six_position"]
    sensor, steps = method.prepare(imu().select_axes("f")), method.plan()
    changed = FerrarisSession(made.time, data, made.marks, made.gravity)
    seen = average_sections(recording(changed, 0), sensor, make_marks(changed), steps, found=True)
    return method.estimator(estimator)(seen, sensor, make_bench(PRECISE), steps)


def suspect_of(estimate: Estimate) -> tuple[str, tuple[str, ...]]:
    """Return the suspect's components and the suspects that are not separated from it."""
    found = assess(estimate, len(estimate.wanted)).suspect
    assert found is not None
    return ",".join(found.components), found.indistinguishable


def size_at(estimate: Estimate, name: str, eta: float) -> float:
    """Return the size of one candidate at which it is as visible as that, SI."""
    one = next(score for score in estimate.score_tests.scores if score.name == name)
    return eta * float(one.sd[0])


def test_six_positions_without_a_change_agree() -> None:
    assert not assess(six(None), 12).rejects


@pytest.mark.parametrize("estimator", ["ml", "classical"])
def test_k2_on_precise_faces_is_noticed_by_both_estimators(estimator: str) -> None:
    size = size_at(six(None), "ax.k2", 8.0)

    def bend(data: Array) -> None:
        data[:, 0] += size * data[:, 0] ** 2

    found = six(bend, estimator=estimator)
    assert assess(found, 12).rejects
    components, alike = suspect_of(found)
    assert "ax.k2" in {*components.split(","), *alike} or "k2" in alike


def test_classical_has_the_tests_of_the_readings() -> None:
    by_formulas, ml = six(None, estimator="classical"), six(None)
    assert by_formulas.dof == 0
    statistics = {test.statistic for test in by_formulas.tests}
    assert any(s == pytest.approx(float(ml.chi2), rel=1e-9) for s in statistics)
    assert len(by_formulas.tests) == len(ml.tests) + 1
    assert all(one.shift.shape == (12,) for one in by_formulas.score_tests.scores)


@pytest.mark.parametrize("estimator", ["ml", "classical"])
def test_terms_that_shift_a_coefficient_unseen_are_noted(estimator: str) -> None:
    """Even on faces true to 2″ a k2 that moves the bias by 5 u has η < 6; k3 is never seen."""
    estimate = six(None, estimator=estimator)
    ml = six(None)
    k2 = next(score for score in ml.score_tests.scores if score.name == "ax.k2")
    bias = ml.names.index("ax.k0")
    size = 5 * float(ml.std[bias]) * float(k2.size[0]) / float(k2.shift[bias])
    assert abs(size) < 6 * float(k2.sd[0])
    found = {
        one.name: one
        for one in undetectable_causes(estimate, METHODS["six_position"].prepare(TRIAD))
    }
    assert {"k2", "k3", "koq", "row"} <= set(found)
    smallest = min(
        5 * float(np.min(estimate.std[:12] / np.abs(score.shift[:12] / score.size[0])))
        for score in estimate.score_tests.scores
        if score.name in ("ax.k2", "ay.k2", "az.k2")
    )
    assert found["k2"].size == pytest.approx(smallest)


def hand_held(
    change: Callable[[Array, list[tuple[int, int]]], None] | None = None,
    seed: int = 1,
    session: Session = SESSION,
    k3: Array | float = 0.0,
) -> Estimate:
    rng = np.random.default_rng([seed, 62])
    made = record(mems(rng), session, rng, k3=k3)
    data = made.data[0]
    if change is not None:
        change(data, made.rests)
    sensor = METHODS["multi_position"].prepare(imu(), also=("g",))
    sections = [Mark(f"r{k:02d}", a + TRIMMED, b - TRIMMED) for k, (a, b) in enumerate(made.rests)]
    log = Recording(made.time, data, sensor.channels, ("m/s²",) * 3 + ("rad/s",) * 3)
    seen = average_sections(log, sensor, sections, holds_from_marks(sections), by_hand=True)
    seen = replace(seen, transitions=transitions_between_rests(log, sensor, sections))
    place = Hand(Measured(session.gravity, session.gravity_sd), session.latitude)
    return METHODS["multi_position"].estimator("joint")(
        seen, sensor, place, holds_from_observations(seen, sensor)
    )


def test_a_session_by_hand_that_holds_the_model_agrees() -> None:
    assert not assess(hand_held(), 30).rejects


def test_a_gyros_second_order_scale_is_named_with_its_size() -> None:
    size = 400e-6

    def bend(data: Array, rests: list[tuple[int, int]]) -> None:
        data[:, 4] += size * data[:, 4] ** 2

    found = hand_held(bend)
    suspect = assess(found, 30).suspect
    assert suspect is not None
    assert suspect.components == ("gy.scale2",)
    assert suspect.sizes[0] == pytest.approx(size, abs=4 * suspect.sds[0])


def test_accelerometers_of_third_order_are_named() -> None:
    k3 = np.array([0.0, 0.0, 3e-3 / G0**2])
    components, alike = suspect_of(hand_held(k3=k3))
    assert "az.k3" in {*components.split(","), *alike}


def test_an_outlying_rest_is_named_with_its_time() -> None:
    def push(data: Array, rests: list[tuple[int, int]]) -> None:
        start, stop = rests[9]
        data[start:stop, 1] += 5e-3 * G0

    suspect = assess(hand_held(push), 30).suspect
    assert suspect is not None
    assert suspect.kind == "row"
    assert suspect.name.startswith("r09 at ")


def test_a_step_along_gravity_within_a_rest_by_hand_is_named() -> None:
    def step(data: Array, rests: list[tuple[int, int]]) -> None:
        start, stop = rests[5]
        up = data[start:stop, :3].mean(axis=0)
        data[(start + stop) // 2 : stop, :3] += 5e-3 * G0 * up / np.linalg.norm(up)

    rejected = assess(hand_held(step), 30).rejecting_tests
    assert any(test.name.startswith("change within r05") for test in rejected)


def test_samples_lost_in_a_turn_are_named_as_a_possible_cause() -> None:
    def lose(data: Array, rests: list[tuple[int, int]]) -> None:
        middle = (rests[6][1] + rests[7][0]) // 2
        data[middle - 20 : middle + 20, 3:] = 0

    for change in (lose, None):
        estimate = hand_held(change)
        lines = cause_lines(estimate, assess(estimate, 30), imu(), {}, "rest")
        assert any("lost during a turn" in line for line in lines) == (change is lose)


@pytest.mark.parametrize("kind", ["accelerometers", "gyros"])
def test_a_drift_over_the_session_is_named(kind: str) -> None:
    first, size = (0, 3e-3 * G0) if kind == "accelerometers" else (3, 0.1 * DEGREE)

    def drift(data: Array, rests: list[tuple[int, int]]) -> None:
        ramp = np.arange(len(data)) / len(data) - 0.5
        data[:, first : first + 3] += size * ramp[:, None] * [1.0, -0.7, 0.8]

    suspect = assess(hand_held(drift), 30).suspect
    assert suspect is not None
    assert suspect.name == f"drift of {kind}"
