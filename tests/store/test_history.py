"""Ten calibrations of a sensor that drifts, and of one that does not."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.refusals import refused
from tests.store.calibration_generator import (
    DRIFTING,
    G0,
    IMU,
    Truth,
    content,
    hashed,
    stds,
    ten,
    write,
)

from inercal.basics.errors import InputError
from inercal.calibration.comparison import compare
from inercal.calibration.comparison.changes import CHANCE_FRACTION
from inercal.calibration.files import load
from inercal.laboratory.store import Register
from inercal.laboratory.store.history import SensorHistory
from inercal.physics.sensors import SI_UNITS

STEADY = Truth("steady", IMU, {"ay.k0": 1e-3 * G0}, {})
Change = Callable[[dict[str, Any]], object]


def of(register: Register, *paths: Path) -> SensorHistory:
    register.enter_calibrations(paths)
    return register.history(load(paths[0]).sensor.name)


@pytest.fixture
def register(tmp_path: Path) -> Register:
    return Register(str(tmp_path / "register.db"))


def two(folder: Path, *changes: Change, truth: Truth = STEADY, seed: int = 1) -> list[Path]:
    """Write two calibrations half a year apart, the first of them changed."""
    rng = np.random.default_rng(seed)
    first, second = (content(truth, years, rng) for years in (0.0, 0.5))
    for change in changes:
        change(first)
    return [
        write(folder / "first.calibration.json", hashed(first)),
        write(folder / "second.calibration.json", second),
    ]


def test_the_drift_of_a_sensor_is_found_within_its_uncertainty(address: str, tmp_path: Path):
    with Register(address) as register:
        history = of(register, *ten(tmp_path))
    assert len(history.entries) == 10
    for name, drift in DRIFTING.drift.items():
        course = history.trend(name)
        assert course.line is not None
        assert course.verdict == "drifts"
        assert abs(course.line.slope.slope - drift) < course.line.slope.expanded
        # At its mean time the line has the value that is true then.
        truth = DRIFTING.start.get(name, 0.0) + drift * course.line.time
        off = abs(course.line.beta[0] - truth)
        assert off < 1.5 * course.line.expanded(np.array([course.line.time]))[0]
    # Half a year of it is less than U; E_n exceeds 1 now and then, over four and a half years much.
    whole = compare(load(tmp_path / "0.calibration.json"), load(tmp_path / "9.calibration.json"))
    en = dict(zip(whole.names, whole.normalised_errors, strict=True))
    assert en["ax.k0"] > 3
    assert en["gz.scale"] < -3
    assert whole.joint_test is not None
    assert whole.joint_test.p_value < 1e-6


@pytest.mark.slow
def test_a_slope_errs_by_what_it_states_and_steady_ones_are_called_so(
    register: Register, tmp_path: Path, seed: int
):
    apart: list[float] = []
    called = beyond = steps = 0
    for k in range(4):
        truth = replace(STEADY, sensor=f"steady {k}", drift={"gx.scale": 5e-6})
        folder = tmp_path / str(k)
        folder.mkdir()
        history = of(register, *ten(folder, truth, 100 * (10 + seed) + k))
        for course in history.trends:
            assert course.line is not None
            off = course.line.slope.slope - truth.drift.get(course.name, 0.0)
            apart.append(off / course.line.slope.std)
            called += course.name not in truth.drift and course.verdict != "steady"
        beyond, steps = beyond + history.exceedances, steps + history.comparison_count
    # Coefficients of one calibration are correlated a little: some slack on 96 independent ones.
    assert float(np.std(apart)) == pytest.approx(1, abs=4.5 / np.sqrt(2 * len(apart)))
    assert abs(np.mean(apart)) < 4.5 / np.sqrt(len(apart))
    assert called < 18  # of 92, one in 18 expected
    assert abs(beyond / steps - CHANCE_FRACTION) < 0.02


def test_a_repeat_within_u_is_not_called_a_change(address: str, tmp_path: Path):
    paths = two(tmp_path)
    second = json.loads(paths[1].read_text(encoding="utf-8"))
    first = json.loads(paths[0].read_text(encoding="utf-8"))
    for row, (before, std) in zip(
        second["coefficients"],
        zip((c["value"] for c in first["coefficients"]), stds(STEADY.names), strict=True),
        strict=True,
    ):
        # U of each is 2 std, of the difference 2.8: 2.7 of it is just within.
        row["value"] = before + 2.7 * std * (-1) ** len(row["name"])
    write(paths[1], hashed(second))
    with Register(address) as register:
        history = of(register, *paths)
        assert history.verdicts == {"steady": tuple(STEADY.names)}
        assert history.exceedances == 0


def test_what_exceeds_u_between_two_calibrations_is_a_change(register: Register, tmp_path: Path):
    def shifted(first: dict[str, Any]) -> None:
        first["coefficients"][0]["value"] += 12 * stds(STEADY.names)[0]

    history = of(register, *two(tmp_path, shifted))
    assert "ax.k0" in history.verdicts["changed"]
    assert history.trend("ax.k0").normalised_errors[1] < -1
    assert history.trend("ax.k0").line is None


def test_one_calibration_is_a_history_without_a_verdict(register: Register, tmp_path: Path):
    history = of(register, two(tmp_path)[0])
    assert history.verdicts == {"too few": tuple(STEADY.names)}
    assert (history.comparison_count, history.exceedances, history.joint_test) == (0, 0, (None,))


def triangular(made: dict[str, Any]) -> None:
    made["frame"] = "triangular"


def test_another_frame_is_brought_to_that_of_the_newest(register: Register, tmp_path: Path):
    paths = two(tmp_path)
    newest = json.loads(paths[1].read_text(encoding="utf-8"))
    in_frame = load(paths[1]).in_frame("triangular")
    newest["frame"], newest["mount"] = "triangular", in_frame.mount.tolist()
    newest["covariance"] = in_frame.covariance.tolist()
    newest["coefficients"] = [
        {
            "name": n,
            "value": v,
            "std": s,
            "unit": SI_UNITS[in_frame.sensor.coefficient(n).unit],
        }
        for n, v, s in zip(
            in_frame.sensor.coefficients,
            in_frame.values.tolist(),
            in_frame.std.tolist(),
            strict=True,
        )
    ]
    write(paths[1], hashed(newest))
    history = of(register, *paths)
    assert len(history.entries) == 2
    # Three misalignments of the accelerometers are zero by the frame, with no uncertainty.
    held = {"ax.delta_o", "ax.delta_p", "ay.delta_o"}
    kept = {course.name for course in history.trends}
    assert kept & held == set()
    assert any("not measured" in line and "ax.delta_o" in line for line in history.exclusions)
    expected = load(paths[0]).in_frame("triangular")
    for name in kept & set(expected.sensor.coefficients):
        assert history.trend(name).values[0] == pytest.approx(expected.value(name), abs=1e-15)
    # A rotation of both leaves the test as it was, but for the angles of the mounting.
    assert history.joint_test[1] is not None
    assert history.joint_test[1].rank == history.joint_test[1].size


def test_a_newest_in_the_mount_frame_takes_the_frame_that_all_can_have(
    register: Register, tmp_path: Path
):
    paths = two(tmp_path, triangular)
    history = of(register, *paths)
    assert [entry.id for entry in history.entries] == [1, 2]
    assert {one.frame for one in history.calibrations} == {"triangular"}
    assert any("all are compared in the triangular frame" in line for line in history.exclusions)
    expected = load(paths[1]).in_frame("triangular")
    for trend in history.trends:
        assert trend.values[-1] == pytest.approx(expected.value(trend.name), abs=1e-15)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c["sensor"]["axes"][0]["readout"].update(scale=2.0), "nominally 2 m/s² per SI"),
        (lambda c: c["sensor"]["axes"][1]["readout"].update(unit="g"), "1 g per SI unit"),
        (lambda c: c["sensor"]["axes"][2].update(i=[0, 0, -1]), "axis az"),
    ],
)
def test_other_terms_are_left_out_with_the_reason(
    register: Register, tmp_path: Path, change: Change, words: str
):
    history = of(register, *two(tmp_path, change))
    assert len(history.entries) == 1
    assert words in history.exclusions[0]
    first, second = two(tmp_path, change)
    with refused(InputError):
        compare(load(first), load(second))


def test_of_calibrations_of_one_recording_the_last_entered_counts(
    register: Register, tmp_path: Path
):
    def of_the_other(first: dict[str, Any]) -> None:
        first["provenance"]["recording sha256"] = recording

    recording = content(STEADY, 0.5, np.random.default_rng(1))["provenance"]["recording sha256"]
    paths = two(tmp_path, of_the_other)
    history = of(register, *paths)
    assert [entry.id for entry in history.entries] == [2]
    (line,) = history.exclusions
    assert "#1" in line
    assert "#2" in line
    assert compare(load(paths[0]), load(paths[1])).same_recording
    assert not compare(*(load(path) for path in two(tmp_path))).same_recording


def test_coefficients_that_the_newest_lacks_are_named(register: Register, tmp_path: Path):
    rng = np.random.default_rng(3)
    whole = content(STEADY, 0.0, rng)
    part = content(replace(STEADY, axes=("ax", "ay", "az")), 0.5, rng)
    paths = [write(tmp_path / f"{k}.json", made) for k, made in enumerate((whole, part))]
    history = of(register, *paths)
    assert len(history.trends) == 12
    (line,) = history.exclusions
    assert "gx.bias, gx.delta_o" in line
    compared = compare(load(paths[0]), load(paths[1]))
    assert len(compared.names) == 12
    assert compared.exclusions[0].startswith("only the first has gx.bias")
    backwards = compare(load(paths[1]), load(paths[0]))
    assert backwards.exclusions[0].startswith("only the second has gx.bias")
    np.testing.assert_allclose(backwards.difference, -compared.difference)


def test_coefficients_are_chosen_by_name_group_and_axis(register: Register, tmp_path: Path):
    history = of(register, *two(tmp_path))
    assert [c.name for c in history.select(["ax.k0"]).trends] == ["ax.k0"]
    assert [c.name for c in history.select(["gx.misalignment", "ay.bias"]).trends] == [
        "ay.k0",
        "gx.delta_o",
        "gx.delta_p",
    ]
    assert history.select([]) is history
    with refused(InputError) as refusal:
        history.select(["k9"])
    assert "'k9'" in str(refusal.value)
    with refused(InputError, names=("k2",)):
        history.select(["k2"])
    with refused(InputError, names=("x.k0",)):
        history.trend("x.k0")


def test_calibrations_follow_one_another_as_they_were_measured(register: Register, tmp_path: Path):
    paths = ten(tmp_path)
    for path in reversed(paths):
        register.enter_calibration(path)
    late = register.enter_calibration(
        write(tmp_path / "late.json", content(DRIFTING, 9.0, np.random.default_rng(1))),
        measured="2019-01-01",
    )
    history = register.history(DRIFTING.sensor)
    assert [entry.id for entry in history.entries] == [late, *range(10, 0, -1)]
    assert history.date(0.0) == "2019-01-01T00:00:00+00:00"
