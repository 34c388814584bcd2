"""The first interval of a sensor by those of its type: from sensors whose drift is known."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.program import run_program
from tests.refusals import refused
from tests.store.calibration_generator import G0, IMU, Truth, content, hashed, write

from inercal.basics.errors import InputError
from inercal.laboratory.store import Register
from inercal.laboratory.store.history import CoefficientTrend
from inercal.laboratory.store.recalibration import recalibration
from inercal.laboratory.store.type_pool import pool_of_histories, type_pool

SPREAD = 60e-6 * G0  # of drifts a year from sensor to sensor
LIMIT = 0.4e-3 * G0
JOB = {"maker": "Q-Flex", "model": "QA 2000"}
OTHERS = 8


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return a register of eight sensors with four calibrations each, two new ones, and others."""
    folder = tmp_path_factory.mktemp("type")
    rng = np.random.default_rng(3)
    files: list[Path] = []

    def calibrate(name: str, count: int, job: dict[str, str], step: float = 1.0) -> None:
        drift = {f"{axis}.k0": SPREAD * rng.standard_normal() for axis in ("ax", "ay", "az")}
        truth = Truth(name, IMU, {}, drift)
        for k in range(count):
            hours = {"operating hours": f"{100 + 500 * k}"}
            made = content(truth, k * step, rng, job=job | hours)
            # A date of its own, for each is a recording of its own.
            made["provenance"]["recording sha256"] = f"{len(files):064x}"
            files.append(write(folder / f"{len(files)}.calibration.json", hashed(made)))

    for n in range(OTHERS):
        calibrate(f"IMU-{n}", 4, JOB)
    calibrate("NEW", 1, JOB)
    calibrate("TWICE", 2, JOB, 0.5)
    calibrate("UNKNOWN", 1, {})
    calibrate("STRANGE", 4, JOB | {"model": "QA 3000"})
    with Register(str(folder / "register.db")) as register:
        register.enter_calibrations(files)
    return str(folder / "register.db")


@pytest.mark.slow
def test_a_new_sensor_takes_its_first_interval_from_the_sensors_of_its_type(address: str):
    with Register(address) as register:
        history = register.history("NEW")
        pool = type_pool(register, history)
    assert pool is not None
    assert pool.type_name == "Q-Flex QA 2000"
    # TWICE has two calibrations, and belongs to the type; STRANGE is of another model.
    assert sorted(pool.sensors) == [f"IMU-{n}" for n in range(OTHERS)] + ["TWICE"]
    found = recalibration(history, {"ax.k0": f"{LIMIT} m/s²"}, pool=pool)
    (row,) = found.rows
    assert row.sensors == OTHERS + 1
    assert row.prediction is not None
    # 9 sensors × 3 like axes: ν = 3 (8 × 3 + 1).
    change = pool.changes["ax.k0"]
    assert (change.dof, change.slope_dof) == (3 * (3 * OTHERS + 1), 3 * (OTHERS + 1))
    # Known: u = 20 µg, a spread of drifts of 60 µg a year; twice that is 0.4 mg after 3.3 years.
    assert 2.0 < row.prediction < 4.5
    trend = history.trend("ax.k0")
    reach = change.expanded_after(float(trend.std[0]) ** 2, 0.0, row.prediction)
    assert reach == pytest.approx(LIMIT, rel=1e-3)
    # Never beyond twice the longest interval that was seen in the type.
    assert found.years == pytest.approx(min(row.prediction, 2 * 1.0), rel=1e-3)
    assert row.chart is not None
    assert row.staircase is None


def test_without_its_type_a_new_sensor_has_no_interval(address: str):
    with Register(address) as register:
        history = register.history("NEW")
        assert type_pool(register, register.history("UNKNOWN")) is None
        named = type_pool(register, history, ["IMU-0", "IMU-1"])
        assert named is not None
        assert named.sensors == ("IMU-0", "IMU-1")
        with refused(InputError) as refusal:
            type_pool(register, history, ["absent"])
        assert "no sensor 'absent'" in str(refusal.value)
        full = register.history("IMU-0")
        full = replace(full, entries=full.entries * 2)
        with refused(InputError, key="--like"):
            recalibration(full, {}, pool=named)
    assert recalibration(history, {"ax.k0": "0.4 mg"}).years is None


@pytest.mark.slow
def test_a_sensor_that_scatters_more_than_its_type_is_not_pooled(address: str):
    with Register(address) as register:
        history = register.history("TWICE")
        pool = type_pool(register, history)
        assert pool is not None
        moved = replace(
            history,
            trends=tuple(
                replace(one, values=one.values + np.array([0.0, 0.05]))
                if one.name == "ax.k0"
                else one
                for one in history.trends
            ),
        )
        found = recalibration(moved, {"bias": "0.4 mg"}, pool=pool)
    by_name = {one.name: one for one in found.rows}
    assert by_name["ax.k0"].is_apart
    assert by_name["ax.k0"].prediction is None
    assert by_name["ay.k0"].sensors == OTHERS + 1


@pytest.mark.slow
def test_the_verb_and_the_page_say_over_how_many_sensors(address: str, tmp_path: Path):
    page = tmp_path / "new.html"
    ended = run_program(
        "store", "history", "NEW", "--limit", "bias=0.4 mg", "--register", address, "--out", page
    )
    assert ended.status == 0
    assert f"pooled over {OTHERS + 1} sensors of type Q-Flex QA 2000" in " ".join(
        ended.output.split()
    )
    assert f"Pooled over {OTHERS + 1} sensors" in page.read_text(encoding="utf-8")
    ended = run_program(
        "store", "history", "NEW", "--limit", "bias=0.4 mg", "--register", address, "--json"
    )
    found = json.loads(ended.output)["next_calibration"]
    assert found["pool"]["type"] == "Q-Flex QA 2000"
    assert found["coefficients"][0]["sensors"] == OTHERS + 1


def test_the_time_in_use_counts_operating_hours(address: str):
    with Register(address) as register:
        history = register.history("IMU-0")
    assert history.operating_hours == (100.0, 600.0, 1100.0, 1600.0)
    limit = {"ax.k0": "2 mg"}
    found = recalibration(history, limit)
    (row,) = found.rows
    assert row.prediction is not None
    assert row.hours is not None
    # 500 hours a year: the same line over another axis.
    assert row.hours == pytest.approx(500 * row.prediction, rel=2e-3)
    assert found.operating_hours == pytest.approx(1600 + min(row.hours, 2 * 500))


def _trend(rng: np.random.Generator, count: int, tau: float, q: float, b: float):
    """Return a simulated trend with own standard uncertainties of 1, one value a year."""
    t = np.arange(count, dtype=float)
    walk = np.concatenate([[0.0], np.cumsum(rng.normal(0, np.sqrt(q), count - 1))])
    y = 5 * rng.standard_normal() + b * rng.standard_normal() * t + walk
    y = y + np.hypot(tau, 1.0) * rng.standard_normal(count)
    return CoefficientTrend(
        "ax.k0", "", "g", 1.0, tuple(range(count)), t, y, np.ones(count),
        np.full(count - 1, np.sqrt(2)), np.zeros((count, count)),
    )  # fmt: skip


@pytest.mark.parametrize(("tau", "q", "b"), [evidence(1, 0, 0), (0.5, 0, 1), evidence(0.5, 1, 0)])
@pytest.mark.parametrize(("count", "least", "most"), [(2, 0.895, 1.0), (3, 0.895, 0.985)])
@pytest.mark.slow
def test_u_after_an_interval_covers_the_next_use_of_another_sensor(
    seed: int, count: int, least: float, most: float, tau: float, q: float, b: float
):
    """Eight sensors of a type, to another one: 95.45 %, up to twice the interval that was seen.

    With two calibrations each drift and scatter cannot be distinguished: U is larger.
    """
    from inercal.laboratory.store.type_pool import pooled_change

    rng = np.random.default_rng(seed)
    types, ahead = 150, np.array([0.5, 1.0, 2.0])
    covered = np.zeros(3)
    for _ in range(types):
        found = pooled_change([_trend(rng, count, tau, q, b) for _ in range(8)])
        for k, years in enumerate(ahead):
            u = found.expanded_after(1.0, 0.0, years)
            sd = np.sqrt(2 * tau**2 + 1 + q * years + b**2 * years**2)
            error = sd * rng.standard_normal(400)
            covered[k] += np.mean(np.abs(error) <= u)
    assert (covered / types > least).all()
    assert (covered / types < most).all()


def test_a_pool_of_none_is_none(address: str):
    with Register(address) as register:
        history = register.history("NEW")
    assert pool_of_histories(history, ()) is None
