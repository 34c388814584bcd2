"""When a sensor should be calibrated next: by each method, from histories whose answer is known."""

from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused
from tests.store.calibration_generator import DRIFTING, G0, content, ten, write

from inercal.basics.errors import InputError
from inercal.laboratory.store import Register, SensorHistory
from inercal.laboratory.store.history_text import (
    expanded_text,
    history_lines,
    interval_text,
    limit_text,
    newest_change_text,
    newest_run_to_run,
    recalibration_lines,
)
from inercal.laboratory.store.recalibration import LONGER, SHORTER, expanded_after, recalibration
from inercal.laboratory.store.type_pool import type_pool


@pytest.fixture(scope="module")
def history(tmp_path_factory: pytest.TempPathFactory) -> SensorHistory:
    folder = tmp_path_factory.mktemp("ten")
    with Register(str(folder / "register.db")) as register:
        register.enter_calibrations(ten(folder))
        return register.history(DRIFTING.sensor)


def test_the_prediction_ends_where_u_and_the_drift_reach_the_limit(history: SensorHistory):
    found = recalibration(history, {"ax.k0": "0.4 mg"})
    (row,) = found.rows
    trend = history.trend("ax.k0")
    assert trend.verdict == "drifts"
    assert row.prediction is not None
    reach = expanded_after(trend, row.prediction)
    reach += abs(trend.courses.line.slope.slope) * row.prediction  # type: ignore[union-attr]
    assert reach == pytest.approx(0.4e-3 * G0, rel=1e-3)
    # 60 µg a year are known to be the drift: less than 0.4 mg / 60 µg.
    assert 1 < row.prediction < 400 / 60
    assert row.chart is not None
    assert row.staircase == pytest.approx(LONGER * float(np.diff(trend.time)[-1]))


def test_no_interval_is_longer_than_twice_the_longest_that_was_seen(history: SensorHistory):
    found = recalibration(history, {"ax.k0": "0.4 mg"}, in_use=0.25)
    longest = float(np.diff(history.trend("ax.k0").time).max())
    assert found.years == found.longest == pytest.approx(2 * longest)
    assert found.decided_by == "house rule"
    assert found.hours_in_use == pytest.approx(found.longest * 8766 / 4)
    assert found.date is not None
    assert found.date > history.entries[-1].measured


def test_a_limit_below_u_is_exceeded_now(history: SensorHistory):
    found = recalibration(history, {"bias": "1 ng", "gx.scale": "10 %"})
    assert found.years == 0
    assert found.decided_by.endswith(".k0")
    assert found.date == history.entries[-1].measured[:10]
    staircase = next(one.staircase for one in found.rows if one.name == "ax.k0")
    assert staircase == pytest.approx(SHORTER * float(np.diff(history.trends[0].time)[-1]))


def test_days_hours_and_date_agree_and_the_earlier_limit_leads(
    history: SensorHistory, monkeypatch: pytest.MonkeyPatch
):
    newest = date.fromisoformat(history.entries[-1].measured[:10])
    for limit in np.arange(80.0, 120.0, 4.0).tolist():
        found = recalibration(history, {"ax.k0": f"{limit} µg"}, 0.2)
        assert found.date is not None
        days = int(interval_text(found.years))
        assert (date.fromisoformat(found.date) - newest).days == days > 0, limit
    found = recalibration(history, {"ax.k0": "0.61 mg"}, 0.2)
    hours = tuple(100.0 * k for k in range(len(history.entries)))
    monkeypatch.setitem(vars(history), "operating_hours", hours)
    for left in (64.0, 1e5):
        one = replace(found, rows=tuple(replace(row, hours=left) for row in found.rows))
        assert one.operating_hours == hours[-1] + min(left, 200.0)
        assert found.hours_in_use is not None
        leads = "operating hours" in recalibration_lines(one)[0]
        assert leads == (min(left, 200.0) < found.hours_in_use)


def test_the_u_that_exceeds_a_limit_is_stated(history: SensorHistory):
    found = recalibration(history, {"bias": "1 ng"})
    for row in found.rows:
        trend = history.trend(row.name)
        assert row.expanded == pytest.approx(expanded_after(trend, 0.0))
        assert row.limit.expanded is not None
        assert row.expanded is not None
        assert row.expanded > row.limit.expanded
    line = recalibration_lines(found)[0]
    assert found.decided_by in line
    assert expanded_text(found, found.rows[0]) in line
    assert limit_text(found, found.rows[0]) in line


def test_a_drift_is_named_although_its_newest_step_is_within_the_scatter(
    history: SensorHistory, tmp_path: Path
):
    with Register(str(tmp_path / "register.db")) as register:
        register.enter_calibrations(ten(tmp_path)[:9])
        nine = register.history(DRIFTING.sensor)
    for one, names in ((nine, {"ax.k0"}), (history, set())):
        ordinary = newest_run_to_run(one)
        assert ordinary is not None
        assert set(ordinary.within) & set(one.verdicts["drifts"]) == names
        named = [line for line in history_lines(one) if line.endswith("show a drift")]
        assert [line.partition(":")[0] for line in named] == sorted(names)


def test_a_jump_since_the_previous_calibration_is_said_and_chance_is_not(tmp_path: Path):
    steady = replace(DRIFTING, drift={})
    shocked = replace(steady, start={**steady.start, "az.k1": 1e-3})  # 50 u of a difference
    said: dict[tuple[str, int], str] = {}
    for name, last in (("steady", steady), ("shocked", shocked)):
        rng = np.random.default_rng(5)
        with Register(str(tmp_path / f"{name}.db")) as register:
            for k in range(8):
                truth = last if k == 7 else steady
                made = content(truth, k / 2, rng)
                register.enter_calibration(write(tmp_path / f"{name}{k}.json", made))
                said[name, k] = newest_change_text(register.history(steady.sensor))
    assert [at for at, text in said.items() if text] == [("shocked", 7)]
    named = said["shocked", 7].partition(": ")
    assert "#7" in named[0]
    assert named[2].startswith("az.k1 by ")


def test_two_calibrations_of_one_sensor_alone_predict_nothing(tmp_path: Path):
    with Register(str(tmp_path / "register.db")) as register:
        register.enter_calibrations(ten(tmp_path)[:2])
        history = register.history(DRIFTING.sensor)
        pool = type_pool(register, history)
    found = recalibration(history, {"bias": "1 mg"}, pool=pool)
    assert (found.years, found.pool) == (None, None)
    assert "2 calibrations" in recalibration_lines(found)[0]


def test_without_limits_there_is_no_date(history: SensorHistory):
    found = recalibration(history)
    assert (found.rows, found.years, found.date, found.decided_by) == ((), None, None, "")


@pytest.mark.parametrize(
    ("stated", "in_use", "words"),
    [
        ({"k9": "1 mg"}, None, "k9"),
        ({"ax.k0": "1 °"}, None, "--limit ax.k0"),
        ({"ax.k0": "-1 mg"}, None, "positive"),
        ({"k2": "1 µg/g²"}, None, "k2"),
        ({}, 2.0, "--in-use"),
    ],
)
def test_limits_that_cannot_be_are_refused(
    history: SensorHistory, stated: dict[str, str], in_use: float | None, words: str
):
    with refused(InputError) as refusal:
        recalibration(history, stated, in_use)
    assert words in str(refusal.value)
