"""Recordings over soaks on a turntable: their waits, and the errors that soaks have in common."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.host.soak_runs import soak_run
from tests.refusals import refused

from inercal.benches.turntable.reading.readback_angles import RecordingWithAngles, without_waits
from inercal.recordings import AngleQuality, Observations, Recording, Track
from inercal.recordings.environment import Environment
from inercal.recordings.soaks import changed_by_soak_errors

SOAKS = Environment("soaks", temperature_sd=0.5, force_repeatability=1e-3)
# Two soaks with two sections each, and a wait between them; in the second soak, the run was
# interrupted for so long that the temperature had left it.
LABELS = np.array([*"aa", "", *"bb", *[""] * 5, *"aa", *[""] * 5, *"bb"])
KELVIN = np.array([270.0] * 5 + [270, 275, 280, 290, 300] + [300] * 2 + [300, 290, 285, 295, 300] +
                  [300] * 2)  # fmt: skip


def recorded() -> RecordingWithAngles:
    n = LABELS.size
    made = Recording(
        time=np.arange(n, dtype=np.float64),
        data=np.arange(n, dtype=np.float64)[:, None],
        channels=("ax",),
        units=("g",),
        labels=LABELS,
        temperature=KELVIN,
        readback={"outer": 0.1 * np.arange(n, dtype=np.float64)},
    )
    bench: Any = None
    return RecordingWithAngles(
        made, bench, quality=AngleQuality(np.ones(n), np.arange(n, dtype=np.float64))
    )


def test_only_waits_in_which_the_temperature_changes_are_left_out():
    whole = recorded()
    shorter, found = without_waits(whole, SOAKS)
    kept = np.array([*range(5), 10, 11, 17, 18])
    np.testing.assert_array_equal(shorter.recording.time, kept)
    np.testing.assert_array_equal(shorter.recording.data[:, 0], kept)
    np.testing.assert_array_equal(shorter.recording.readback["outer"], 0.1 * kept)
    np.testing.assert_array_equal(shorter.recording.original, kept)
    assert shorter.quality is not None
    np.testing.assert_array_equal(shorter.quality.interpolation_sd, kept)
    # The interruption within a soak does not begin a new one.
    assert found.first_samples == (0, 5)
    assert [(one.start, one.stop) for one in found.waits] == [(4.0, 10.0), (11.0, 17.0)]


@pytest.mark.parametrize("environment", [None, Environment("ramp")])
def test_without_soaks_nothing_is_left_out(environment: Environment | None):
    whole = recorded()
    assert without_waits(whole, environment)[0] is whole


def test_the_errors_of_a_soak_change_the_samples_that_a_filter_follows(tmp_path: Path):
    sensor = soak_run(tmp_path / "plan").sensor.select_axes("f")
    time, kelvin = np.arange(8.0), np.repeat([270.0, 300.0], 4)
    track = Track(time, np.zeros((8, 3)), np.zeros((8, 3)), np.zeros(8, np.int64), kelvin)
    rows = Observations(
        mean=np.zeros((2, 3)),
        covariance=np.tile(np.eye(3), (2, 1, 1)),
        labels=("a", "a (2)"),
        duration=np.array([2.0, 2.0]),
        samples=np.array([2, 2]),
        time=np.array([0.0, 4.0]),
        channels=sensor.channels,
        temperature=np.array([270.0, 300.0]),
        track=track,
    )
    changed = list(changed_by_soak_errors(rows, sensor, SOAKS))
    first, second = slice(0, 4), slice(4, 8)
    for soak, (own, other) in enumerate([(first, second), (second, first)]):
        warmer, *moved = changed[4 * soak : 4 * soak + 4]
        assert warmer.track is not None
        assert warmer.track.temperature is not None
        np.testing.assert_array_equal(warmer.track.temperature[own], kelvin[own] + 0.5)
        np.testing.assert_array_equal(warmer.track.temperature[other], kelvin[other])
        for k, one in enumerate(moved):
            assert one.track is not None
            expected = np.zeros((8, 3))
            expected[own, k] = 1e-3
            np.testing.assert_array_equal(one.track.reading, expected)


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('limits = ["-30 °C", "70 °C"]', 'limits = ["-10 °C", "70 °C"]', "limits"),
        ('limits = ["-30 °C", "70 °C"]', 'limits = ["70 °C", "-30 °C"]', "limits"),
        ('drift = "2 K/min"', 'drift = "0 K/min"', "drift"),
        ('kind = "soaks" ', 'kind = "ramp" ', "tolerance"),
    ],
)
def test_criteria_that_cannot_be_kept_are_refused(tmp_path: Path, old: str, new: str, key: str):
    with refused(key=f"[environment] {key}"):
        soak_run(tmp_path / "plan", "", (old, new))


def test_the_criteria_of_the_run_file_reach_the_run(tmp_path: Path):
    run = soak_run(tmp_path / "plan")
    assert run.environment is not None
    criteria = run.environment.criteria
    assert criteria.tolerance == 0.5
    assert criteria.drift == pytest.approx(2 / 60)
    assert criteria.steady_time == 10.0
    assert criteria.longest_wait == 7200.0
    assert criteria.limits == pytest.approx((243.15, 343.15))
    assert criteria.max_rate == pytest.approx(100 / 60)
