"""Charts of a bench by what its own runs show of it: from estimates whose truth is known."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.check_standard.history import day
from tests.program import run_program
from tests.refusals import refused
from tests.store.calibration_generator import IMU, Truth, content, hashed, write

from inercal.basics.errors import InputError
from inercal.calibration.shared_errors import BenchEstimate
from inercal.laboratory.check_standard.bench_charts import ChartedRun, bench_charts
from inercal.laboratory.store import Register

SCATTER, OWN = 3e-6, 2e-6  # m, of the radius from day to day and by a run's noise


def runs(
    rng: np.random.Generator, days: int, *, each: int = 1, step: float = 0.0, since: int = 10**9,
    until: int = 10**9,
) -> list[ChartedRun]:  # fmt: skip
    """Return runs whose radius is `step` larger from a day on; each tells the lean, too."""
    found: list[ChartedRun] = []
    for number in range(days):
        moved = step if since <= number < until else 0.0
        radius = 1.0 + moved + SCATTER * rng.standard_normal()
        for k in range(each):
            parts = (
                _bench_estimate("radius", "m", radius + OWN * rng.standard_normal(), OWN),
                _bench_estimate("lean1", "rad", 1e-5 + 1e-6 * rng.standard_normal(), 1e-6),
            )
            found.append(ChartedRun(f"#{len(found)}", f"{day(number)}T{8 + k:02d}:00:00", parts))
    return found


def _bench_estimate(name: str, unit: str, value: float, own: float) -> BenchEstimate:
    return BenchEstimate(name, unit, name, value, 2 * own, own, value, 10 * own)


def test_a_step_of_the_radius_is_found_and_the_bench_is_doubtful_around_it():
    found = bench_charts("arm", runs(np.random.default_rng(2), 40, step=3e-5, since=30, until=36))
    assert [one.name for one in found.charts] == ["radius", "lean1"]
    out = [point for point in found.points if not point.in_control]
    assert out[0].measured.startswith(day(30))
    assert out[0].signals["Shewhart"] == ("radius",)
    assert found.episodes[0].since == f"{day(29)}T08:00:00"
    assert found.episodes[0].holds(f"{day(33)}T12:00:00")
    chart = found.charts[0]
    assert chart.mean == pytest.approx(1.0, abs=3e-6)
    assert chart.scatter == pytest.approx(SCATTER, rel=0.5)


def test_in_control_few_days_signal_and_z_has_unit_variance(seed: int):
    rng = np.random.default_rng(seed)
    squares: list[float] = []
    beyond = days = 0
    for _ in range(20):
        found = bench_charts("arm", runs(rng, 50, each=2))
        squares += [float(np.mean(one.shewhart[20:] ** 2)) for one in found.charts]
        beyond += sum(not one.in_control for one in found.points)
        days += len(found.points)
    assert days == 20 * 30
    # 600 days of a run length of 370 or more; a mean that is off signals on several days.
    assert beyond <= 12
    assert float(np.mean(squares)) == pytest.approx(1.05, abs=0.25)


def test_a_restart_forgets_what_was_before_the_repair():
    moved = runs(np.random.default_rng(2), 40, step=3e-5, since=30, until=36)
    found = bench_charts("arm", moved, restarts=[day(36)])
    assert found.in_control
    assert found.episodes[-1].until == f"{day(36)}T08:00:00"


def test_a_new_reference_begins_since_a_day_and_a_cusum_finds_a_small_step():
    moved = runs(np.random.default_rng(2), 70, step=6e-6, since=30)
    found = bench_charts("arm", moved, lasting="CUSUM")
    assert any("radius" in one.signals.get("CUSUM", ()) for one in found.points)
    later = bench_charts("arm", moved[30:], lasting="CUSUM")
    assert later.in_control


def test_a_parameter_with_fewer_days_than_the_reference_is_named():
    given = runs(np.random.default_rng(2), 30)
    late = [
        replace(
            one, bench_estimates=(*one.bench_estimates, _bench_estimate("g", "m/s²", 9.81, 1e-5))
        )
        if k >= 20
        else one
        for k, one in enumerate(given)
    ]
    found = bench_charts("arm", late)
    assert found.too_few == {"g": 10}
    assert len(found.charts) == 2
    assert found.single_run_length == 4 * 370


def test_runs_that_show_nothing_and_too_few_days_are_refused():
    given = runs(np.random.default_rng(2), 12)
    with refused(InputError) as refusal:
        bench_charts("arm", [replace(one, bench_estimates=()) for one in given])
    assert "states bench estimates" in str(refusal.value)
    for reference in (20, 3):
        with refused(InputError, key="--reference"):
            bench_charts("arm", given, reference=reference)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return a register with 14 calibrations of sensors on an arm that grows by 30 µm."""
    folder = tmp_path_factory.mktemp("arm")
    rng = np.random.default_rng(5)
    files: list[Path] = []
    for k, run in enumerate(runs(rng, 14, step=3e-5, since=12)):
        bench_estimates = [vars(one) for one in run.bench_estimates]
        made = content(
            Truth(f"IMU-{k % 3}", IMU, {}, {}),
            0.0,
            rng,
            "centrifuge_norm",
            bench_estimates=bench_estimates,
        )
        made["conditions"]["bench"] = "arm 1"
        made["provenance"] |= {"created": run.measured, "recording sha256": f"{k:064x}"}
        files.append(write(folder / f"{k}.calibration.json", hashed(made)))
    with Register(str(folder / "register.db")) as register:
        register.enter_calibrations(files)
    return str(folder / "register.db")


@pytest.mark.slow
def test_the_verb_charts_a_bench_of_the_register(address: str, tmp_path: Path):
    given = ("control", "--bench", "arm 1", "--register", address, "--reference", "10")
    ended = run_program(*given, "--json")
    assert ended.status == 0, ended.error
    found = json.loads(ended.output)
    assert not found["in_control"]
    assert [one["name"] for one in found["parameters"]] == ["radius", "lean1"]
    assert [one["sensor"] for one in found["doubtful"]] == ["IMU-0", "IMU-1"]
    ended = run_program(*given, "--out", tmp_path)
    assert ended.status == 0, ended.error
    stored = json.loads((tmp_path / "arm_1.bench_control.json").read_text(encoding="utf-8"))
    assert stored["episodes"] == found["episodes"]
    page = (tmp_path / "arm_1.bench_control.html").read_text(encoding="utf-8")
    assert "out of control on 2026-01-14" in page.lower()
    assert page.count("<svg") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--bench", "arm 9"), "'arm 1'"),
        (("--bench", "arm 1", "--sensor", "IMU-0"), "only one way"),
        (("--bench", "arm 1", "--same", "day"), "--same"),
        (("--bench", "arm 1"), "14 days"),
        (("--bench", "arm 1", "--since", "2027-01-01"), "--since 2027-01-01"),
        (("--bench", "arm 1", "--since", "then"), "--since 'then'"),
    ],
)
def test_what_cannot_be_charted_is_refused(address: str, arguments: tuple[str, ...], words: str):
    ended = run_program("control", *arguments, "--register", address)
    assert ended.status == 2
    assert words in ended.error
