"""Charts of a check standard over simulated laboratories: what signals, and since when."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.check_standard.history import checked_sessions, day
from tests.refusals import refused
from tests.repeatability.laboratory import MICRO, NAMES, Laboratory

from inercal.basics.documents import document_text
from inercal.basics.errors import InputError
from inercal.calibration.check_standard import load_check_standard
from inercal.laboratory.check_standard import control_charts
from inercal.laboratory.check_standard.chart_texts import control_charts_object, control_lines

STEP = np.where(np.array(NAMES) == "ax.k0", 400 * MICRO, 0.0)


def test_a_step_is_found_and_the_bench_is_doubtful_around_it():
    rng = np.random.default_rng(2)
    sessions = checked_sessions(Laboratory(), 40, rng, shift=STEP, shifted=(30, 36))
    found = control_charts(sessions)
    out = [k for k, point in enumerate(found.points) if not point.in_control]
    assert out[0] == 10
    assert all("ax.k0" in found.points[k].signals["Shewhart"] for k in range(10, 16))
    (episode,) = found.episodes
    assert episode.since == f"{day(29)}T08:00:00"
    # The EWMA remembers: without a restart it leads beyond the repair.
    repaired = control_charts(sessions, restarts=[day(36)])
    (after,) = repaired.episodes
    assert after.until == f"{day(36)}T08:00:00"
    assert repaired.in_control
    assert after.holds(f"{day(32)}T12:00:00")
    assert not after.holds(f"{day(29)}T07:00:00")
    assert not after.holds(f"{day(36)}T12:00:00")


def test_a_step_within_the_reference_is_named_and_nothing_is_in_control_yet():
    rng = np.random.default_rng(2)
    steady = control_charts(checked_sessions(Laboratory(), 20, rng))
    assert (steady.in_control, steady.reference_shift) == (None, None)
    sessions = checked_sessions(Laboratory(), 20, rng, shift=STEP, shifted=(14, 20))
    found = control_charts(sessions)
    shift = found.reference_shift
    assert shift is not None
    assert (shift.name, shift.since[:10], shift.until[:10]) == ("ax.k0", day(13), day(14))
    assert shift.shift == pytest.approx(400 * MICRO, rel=0.2)
    assert control_charts_object(found)["in_control"] is None
    assert "ax.k0 changed by 37.8 µg (5.9 σ" in control_lines(found)[1]


@pytest.mark.slow
def test_of_a_steady_bench_few_days_signal(seed: int):
    """370 days to a false signal of all charts, at least: of 8 × 40 days less than one."""
    rng = np.random.default_rng(seed)
    beyond, squares = 0, []
    for _ in range(8):
        found = control_charts(checked_sessions(Laboratory(), 60, rng))
        beyond += sum(not one.in_control for one in found.points)
        squares.append(float(np.mean(found.values.t2)))
    assert beyond <= 8  # a mean that is off by chance signals on several days
    # T² has the mean of χ² where the covariance is what it is taken for.
    assert float(np.mean(squares)) == pytest.approx(12, abs=1.3)


@pytest.mark.slow
def test_sessions_of_a_day_are_one_point_of_the_right_size(seed: int):
    """Four a day, with half of their variance in common: as 4 × as many points they would lie."""
    rng = np.random.default_rng(seed)
    laboratory = Laboratory(turn_on=(40, 20, 0), day=(40, 20, 10), mount=0)
    squares: list[float] = []
    for _ in range(4):
        found = control_charts(checked_sessions(laboratory, 34, rng, each=4), reference=8)
        assert len(found.points) == 26
        assert all(len(one.labels) == 4 for one in found.points)
        squares.append(float(np.mean(found.values.shewhart[:, ::4] ** 2)))
    assert float(np.mean(squares)) == pytest.approx(1, abs=0.5)


def test_what_all_sessions_share_is_no_signal_and_a_new_determination_widens():
    rng = np.random.default_rng(2)
    sessions = checked_sessions(Laboratory(), 30, rng)
    found = control_charts(sessions)
    last = sessions[-1].session
    assert last.calibration.shared is not None
    renewed = tuple(replace(one, determination="e" * 64) for one in last.calibration.shared)
    again = replace(last, calibration=replace(last.calibration, shared=renewed))
    wider = control_charts([*sessions[:-1], replace(sessions[-1], session=again)])
    shared = [k for k, name in enumerate(NAMES) if name.endswith((".k1", ".delta_o"))]
    before, after = (np.abs(one.values.shewhart[-1]) for one in (found, wider))
    assert (after[shared] < before[shared]).all()
    np.testing.assert_allclose(wider.values.shewhart[:-1], found.values.shewhart[:-1], rtol=1e-9)


@pytest.mark.slow
def test_an_axis_that_scatters_more_takes_its_own_limits(seed: int):
    rng = np.random.default_rng(seed)
    beyond = 0
    for _ in range(4):
        found = control_charts(checked_sessions(Laboratory(odd=3.0), 50, rng))
        beyond += sum("ax.k0" in one.signals.get("Shewhart", ()) for one in found.points)
    assert beyond <= 2


@pytest.mark.slow
def test_sessions_that_state_nothing_shared_are_charted_and_named():
    rng = np.random.default_rng(5)
    found = control_charts(checked_sessions(Laboratory(), 30, rng, stated=False))
    assert found.in_control
    assert any("do not state" in line for line in control_lines(found))


def test_a_cusum_in_place_of_the_ewma_finds_a_small_lasting_change(tmp_path: Path):
    rng = np.random.default_rng(2)
    sessions = checked_sessions(Laboratory(), 80, rng, shift=0.4 * STEP, shifted=(30, 10**9))
    found = control_charts(sessions, reference=30, lasting="CUSUM")
    signals = [one.signals for one in found.points]
    assert any("ax.k0" in one.get("CUSUM", ()) for one in signals)
    assert not any("EWMA" in one for one in signals)
    assert all(name == "ax.k0" for one in signals for name in one.get("CUSUM", ()))
    stored = json.loads(document_text(control_charts_object(found)))
    assert stored["lasting"] == "CUSUM"
    k = NAMES.index("ax.k0")
    assert stored["points"][-1]["cusum"][k] > stored["coefficients"][k]["cusum_limit"]


@pytest.mark.parametrize(
    ("days", "reference", "run_length", "words"),
    [
        (10, 20, 370.0, "10 days"),
        (10, 3, 370.0, "--reference 3"),
        (10, 5, 3.0, "--run-length"),
    ],
)
def test_what_cannot_be_charted_is_refused(
    days: int, reference: int, run_length: float, words: str
):
    sessions = checked_sessions(Laboratory(), days, np.random.default_rng(1))
    with refused(InputError) as refusal:
        control_charts(sessions, reference=reference, run_length=run_length)
    assert words in str(refusal.value)


def test_the_order_in_which_sessions_are_given_does_not_matter():
    sessions = checked_sessions(Laboratory(), 12, np.random.default_rng(1), each=2)
    expected = control_charts(sessions, reference=5)
    found = control_charts([*sessions[14:], *sessions[:14][::-1]], reference=5)
    assert [one.measured for one in found.sessions] == [one.measured for one in sessions]
    assert found.episodes == expected.episodes
    np.testing.assert_allclose(found.values.t2, expected.values.t2, rtol=1e-9)


def test_days_whose_times_overlap_are_refused():
    sessions = checked_sessions(Laboratory(), 10, np.random.default_rng(1), each=2)
    late = replace(sessions[0], measured=sessions[-1].measured)
    with refused(InputError) as refusal:
        control_charts([late, *sessions[1:]], reference=5)
    assert "sort them by time" in str(refusal.value)


def test_the_file_says_of_a_day_what_the_charts_say(tmp_path: Path):
    from datetime import date

    rng = np.random.default_rng(2)
    sessions = checked_sessions(Laboratory(), 40, rng, shift=STEP, shifted=(30, 36))
    file = tmp_path / "TRIAD-1.control.json"
    charts = control_charts(sessions, restarts=[day(36)])
    file.write_text(document_text(control_charts_object(charts)), encoding="utf-8")
    found = load_check_standard(file)

    def warnings(number: int, longest: float | None = None) -> tuple[str, ...]:
        return found.state(date.fromisoformat(day(number)), longest).warnings

    assert warnings(25) == ()
    (before,) = warnings(29)  # the next day is out of control
    assert f"doubtful since {day(29)}" in before
    assert len(warnings(30)) == 2  # this day and the next
    assert len(warnings(35)) == 1
    assert warnings(36) == ()
    assert warnings(50) == ()
    (old,) = warnings(50, 86_400.0)
    assert "11 days before the run" in old
    assert warnings(40, 86_400.0) == ()
    assert "not checked" in warnings(5)[0]
    assert found.state(None, None).warnings == ()
    with refused(InputError) as refusal:
        found.state(None, 1.0)
    assert "[job] measured" in str(refusal.value)
