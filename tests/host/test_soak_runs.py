"""Whole runs in a simulated chamber: interlocks, kills, resumed runs, and their calibration."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.stats import chi2
from tests.base_seeds import slow
from tests.host.in_process_bench import InProcessBench
from tests.host.journal_sections import sections_done
from tests.host.simulated_runs import HEAD
from tests.host.soak_runs import chamber_bench, soak, soak_run, soak_until
from tests.host.watched_runs import Watched

from inercal.calibration import Calibration
from inercal.host.journal import Journal
from inercal.host.run_execution import finish_run
from inercal.host.run_folder import reopen_run
from inercal.runfile import Run

TURN = HEAD + "rest,position,0,0,0,2,,,\nz+,rotation,0,0,0,,outer,3600,30\n"
Faulty = Callable[[InProcessBench], None]


def run_away(bench: InProcessBench) -> None:
    """Let the heater run, much faster than permitted."""
    assert bench.chamber is not None
    bench.chamber._ramp = 5.0
    bench.chamber.fault("overtemperature")


def heat(bench: InProcessBench) -> None:
    """Let the sensor be as hot as only its own fault makes it."""
    assert bench.chamber is not None
    bench.chamber._case = 373.15


def fault(words: str) -> Faulty:
    def act(bench: InProcessBench) -> None:
        assert bench.chamber is not None
        bench.chamber.fault(words)

    return act


@pytest.mark.slow
@pytest.mark.parametrize(
    ("disturb", "named"),
    [
        (fault("door"), "door"),
        slow(fault("sensor"), "sensor failure"),
        slow(heat, "the sensor is at"),
        (run_away, "K/min"),
        (fault("silent"), "does not answer"),
    ],
)
def test_a_fault_of_the_chamber_stops_the_turning_table_within_a_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, disturb: Faulty, named: str
):
    run = soak_run(tmp_path / "plan", TURN, ('"-20 °C", "25 °C"', '"25 °C"'))
    bench = chamber_bench(run)
    bench.install(monkeypatch)
    assert bench.chamber is not None
    chamber = bench.chamber
    begun: list[float] = []
    reacted: list[float] = []

    def act(driven: Watched) -> None:
        rate = bench.device.controller.table.state.rate[0]
        if not begun and rate > 0.5:
            begun.append(bench.time)
            disturb(bench)
        elif begun and not reacted and rate < 0.51:
            reacted.append(bench.time)
        if begun and bench.time > begun[0] + 10:
            driven.request("stop")

    ended = soak(tmp_path / "run", run, act)
    assert not ended.done
    assert reacted
    assert reacted[0] - begun[0] < 1.0
    assert abs(bench.device.controller.table.state.rate[0]) < 1e-3
    said = [one for one in ended.events if one.level in ("alarm", "warning") and named in one.words]
    assert said
    assert said[0].time is not None
    if "silent" not in chamber.faults:
        assert chamber.set_point is None


def finished(folder: Path) -> Calibration:
    made, journal = reopen_run(folder)
    with journal:
        return finish_run(made, journal).outcome.calibration


class Undisturbed:
    """A run at three temperatures that nothing happens to."""

    def __init__(self, folder: Path):
        self.run: Run = soak_run(folder / "plan")
        bench = chamber_bench(self.run)
        with pytest.MonkeyPatch.context() as patched:
            bench.install(patched)
            assert soak(folder / "run", self.run).done
        self.seconds, self.path = bench.time, folder / "run"
        self.found = finished(self.path)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    return Undisturbed(tmp_path_factory.mktemp("undisturbed"))


@pytest.mark.slow
def test_a_plan_at_three_temperatures_finds_the_true_temperature_coefficients(
    undisturbed: Undisturbed,
):
    found, run = undisturbed.found, undisturbed.run
    off = found.values - np.array([run.truth.get(one, 0.0) for one in found.sensor.coefficients])
    squared = float(off @ np.linalg.solve(found.covariance, off))
    assert chi2.ppf(0.001, off.size) < squared < chi2.ppf(0.999, off.size)
    assert found.verdict is not None
    assert found.verdict.grade == "consistent", found.verdict.lines
    for name in ("ax.k0_dT", "ay.k1_dT", "gx.bias_dT", "gz.scale_dT"):
        k = found.sensor.coefficients.index(name)
        assert abs(found.values[k]) > 10 * np.sqrt(found.covariance[k, k]), name


@pytest.mark.slow
def test_the_recording_has_the_temperatures_and_each_step_of_each_soak(undisturbed: Undisturbed):
    file: Any
    with h5py.File(undisturbed.path / "soaks.h5") as file:
        label, kelvin = file["step"].asstr()[:], file["temperature"][:] + 273.15
        target = file["bench"]["chamber_target"][:]
    assert np.unique(target.round(6)).tolist() == [253.15, 298.15, 333.15]
    for one in undisturbed.run.steps:
        at = kelvin[label == one.label]
        for soak_temperature in (253.15, 298.15, 333.15):
            assert np.count_nonzero(np.abs(at - soak_temperature) < 1.0) > 50, one.label


@pytest.mark.evidence
def test_a_run_killed_at_five_random_times_gives_the_same_calibration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, undisturbed: Undisturbed
):
    run, folder = undisturbed.run, tmp_path / "run"
    bench = chamber_bench(run)
    bench.install(monkeypatch)
    shares = np.sort(np.random.default_rng(20).uniform(0.02, 0.98, 5))
    passed = 0.0
    for k, share in enumerate(shares.tolist()):
        until = bench.time + share * undisturbed.seconds - passed
        assert soak_until(folder, until, bench, None if k else run)
        passed = share * undisturbed.seconds
    ended = soak(folder)
    assert ended.done, ended.trouble
    with Journal(folder / "run.journal") as journal:
        done = [label for label, _, _ in sections_done(journal)]
    assert done == [one.label for one in run.steps] * 3
    again = finished(folder)
    assert again.sensor.coefficients == undisturbed.found.sensor.coefficients
    sd = np.hypot(*(np.sqrt(np.diag(one.covariance)) for one in (again, undisturbed.found)))
    assert np.all(np.abs(again.values - undisturbed.found.values) < 5 * sd)
    assert again.verdict is not None
    assert again.verdict.grade == "consistent"
