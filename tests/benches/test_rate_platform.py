"""A rate platform: its motion, its labels, its tables and what is refused."""

import csv
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches.rate_platform import RatePlatform, linearity
from inercal.benches.rate_platform.kind import KIND
from inercal.benches.rate_platform.linearity import SpeedScale, straight_lines
from inercal.benches.rate_platform.sections import (
    KnownTurn,
    Pose,
    RateDwell,
    dwell_label,
    pose_label,
    step_of_label,
    whole_turns,
)
from inercal.estimation.input_output_tests import linearity_error, scale_factor
from inercal.physics.earth import EARTH_RATE
from inercal.physics.motion import Motion
from inercal.physics.sensors import imu, triad
from inercal.pipeline import apply_data_columns, simulate
from inercal.recordings import Observations
from inercal.recordings.io.write import write_recording
from inercal.runfile import Run, read

G, LATITUDE = 9.81, 0.8
BENCH = RatePlatform(
    Measured(G, 1e-4),
    Measured(LATITUDE, 0.0),
    *(5e-4, 1e-4, 1e-4, 2e-5, 9e-4, 5e-3, 3e-4, 9e-4, 2e-3),
    rate_hysteresis=1e-5,
    settling=1e-4,
)
STEPS = (
    RateDwell("x rest", "x", 0.0, 36.0),
    RateDwell("-x partial", "-x", 0.5, 37.3),
    RateDwell("y", "y", -3.0, 36.0),
    RateDwell("y slower", "y", -1.0, 36.0),
    RateDwell("z", "z", 1.0, 2 * np.pi),
    Pose("leaning", 0.3, 0.2, 10.0),
    Pose("steep", 1.5, 1.4, 10.0),
)
IMU = imu().with_coefficients("bias", "scale", "g")


def test_derivatives_of_rates_and_poses_are_those_of_the_motion(seed: int):
    rng = np.random.default_rng(seed)
    declared = BENCH.nuisances(STEPS, IMU)
    at = {n: np.array(p.value + p.sd * rng.standard_normal()) for n, p in declared.items()}
    made = BENCH.mean_motion(STEPS, at)
    assert len(declared) == 56
    for name, p in declared.items():
        step = 0.1 * p.sd
        low, high = (BENCH.mean_motion(STEPS, at | {name: at[name] + k * step}) for k in (-1, 1))
        for part, by in (("f", made.df), ("w", made.dw)):
            change = getattr(high.motion, part) - getattr(low.motion, part)
            told = by.get(name, np.zeros(())) * 2 * step
            assert np.abs(change - told).max() < 1e-11 + 1e-3 * np.abs(told).max(), name


def test_a_gyro_reads_the_rate_with_the_sign_of_the_axis_that_is_up():
    still = BENCH.mean_motion(STEPS, {}).motion
    up = EARTH_RATE * np.sin(LATITUDE)
    np.testing.assert_allclose(still.w[0], [up, 0, 0], atol=1e-18)
    np.testing.assert_allclose(still.w[1], [-0.5 - up, 0, 0], atol=1e-15)
    np.testing.assert_allclose(still.f[1], [-G, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("roll", "pitch", "up"),
    [(0, 0, (0, 0, 1)), (90, 0, (0, 1, 0)), (0, 90, (-1, 0, 0)), (180, 0, (0, 0, -1))],
)
def test_a_pose_has_the_axis_up_that_roll_and_pitch_say(
    roll: float, pitch: float, up: Sequence[float]
):
    pose = Pose("p", float(np.radians(roll)), float(np.radians(pitch)))
    np.testing.assert_allclose(pose.up, up, atol=1e-15)


def test_means_of_a_simulation_are_the_mean_motion():
    """Of the earth's rate over a part of a turn too, in either sense and with either side up."""
    made = KIND.simulate(BENCH, STEPS, 50.0, np.random.default_rng(1), 2, IMU, False)
    done = made.simulated_motion
    expected = BENCH.mean_motion(STEPS, done.bench_errors).motion
    for k, step in enumerate(STEPS):
        own = done.labels == step.label
        assert own.sum() == round(step.seconds * 50)
        np.testing.assert_allclose(
            done.motion.w[:, own].mean(axis=1), expected.w[:, k], atol=1e-3 * EARTH_RATE
        )
        np.testing.assert_allclose(done.motion.f[:, own].mean(axis=1), expected.f[:, k], atol=1e-12)


@pytest.mark.parametrize("step", [s for s in STEPS if isinstance(s, RateDwell)])
def test_the_label_of_a_dwell_says_what_it_is(step: RateDwell):
    label = dwell_label(step.axis, step.rate)
    for text in (label, f"{label} (2)", label.replace("-", "−"), label.removesuffix(" °/s")):
        found = step_of_label(text, 3.0)
        assert isinstance(found, RateDwell)
        assert (found.axis, found.seconds) == (step.axis, 3.0)
        assert found.rate == pytest.approx(step.rate, rel=1e-5)


def test_the_label_of_a_pose_says_what_it_is():
    found = step_of_label(pose_label(0.3, -0.2), 3.0)
    assert isinstance(found, Pose)
    assert (found.roll, found.pitch) == (
        pytest.approx(0.3, rel=1e-5),
        pytest.approx(-0.2, rel=1e-5),
    )


@pytest.mark.parametrize("text", ["", "a +50", "x", "x fast", "roll 90", "+50 x"])
def test_another_label_is_refused(text: str):
    with refused(names=(text,)):
        step_of_label(text, 1.0)


def test_whole_turns_are_the_longest_within_a_time():
    assert whole_turns(2 * np.pi / 10, 36.0) == pytest.approx(30.0)
    assert whole_turns(2 * np.pi / 50, 36.0) == 36.0
    assert whole_turns(0.0, 36.0) == 36.0


def test_line_of_a_cubic_gyro_has_the_linearity_error_of_the_standard():
    """κ₃ 60 ppm/(rad/s)² and κ′ 300 ppm over ±200 °/s: 372 ppm of full scale, slope off by 454."""
    up = [10, 30, 60, 100, 150, 200]
    through = [*up, *up[-2::-1]]
    rates = [0, *through, 0, *(-rate for rate in through), 0]
    steps = [RateDwell(str(k), "x", float(np.radians(r))) for k, r in enumerate(rates)]
    sensor = triad("t", "w", "g").with_coefficients("gx.scale3", "gx.scale_prime")
    bench = RatePlatform(Measured(G, 0.0), Measured(0.0, 0.0), 0.0, 0.0, 0.0, 0.0, 0.0)
    motion = bench.mean_motion(steps, {}).motion
    mean = sensor.forward(Motion(motion.f, motion.w), np.array([60e-6, 300e-6]))
    seen = Observations(
        labels=tuple(s.label for s in steps),
        mean=mean,
        covariance=np.tile(1e-12 * np.eye(3), (len(steps), 1, 1)),
        duration=np.ones(len(steps)),
        samples=np.ones(len(steps), dtype=np.int64),
        time=np.arange(len(steps), dtype=float),
        channels=sensor.channels,
        timed=False,
    )
    (fit,) = straight_lines(seen, sensor, bench, steps)
    w = np.radians(rates)
    y = w + 60e-6 * w**3 + 150e-6 * np.abs(w)
    slope = np.sum((w - w.mean()) * y) / np.sum((w - w.mean()) ** 2)
    off = y - y.mean() - slope * (w - w.mean())
    line, linearity = scale_factor(fit.table).value, linearity_error(fit.table).value
    assert line == pytest.approx(slope, rel=1e-12)
    assert linearity == pytest.approx(np.abs(off).max() / (slope * w.max()), rel=1e-9)
    assert 1e6 * linearity == pytest.approx(372, abs=0.5)
    assert 1e6 * (line - 1) == pytest.approx(454.5, abs=0.5)


RUN = """[sensor.gyro]
unit = "°/s"
{sensor}
[bench]
kind = "rate_platform"
latitude = "50 °"
{bench}
[data]
file = "table.csv"
kind = "means"
{data}
[data.sd]
gyro = "1 °/h"
{sd}
[method]
name = "rates_and_poses"
{method}
"""
ERRORS = {
    "rate_scale": "5 ppm",
    "rate_asymmetry": "0 ppm",
    "rate_stability": "0 ppm",
    "setting": "0.02 °",
}
COLUMNS = {"axis": "axis", "table_rate": "rate", "gyro": ["gx", "gy", "gz"]}
Table = list[dict[str, object]]


def table(rates: Sequence[float] = (0, 50, -50, 100, -100)) -> Table:
    """Return a table of means, °/s, of gyros without errors but a bias."""
    rows: Table = []
    for k, axis in enumerate("xyz"):
        for rate in rates:
            read = [0.1, -0.2, 0.05]
            read[k] += rate
            row: dict[str, object] = {"axis": axis, "rate": rate}
            row |= zip(("gx", "gy", "gz"), (f"{x + 1e-5 * k:g}" for x in read), strict=True)
            rows.append(row)
    return rows


def run_of(
    folder: Path, rows: Table, bench: dict[str, str] | None = None, sensor: str = "", **data: object
) -> Run:
    with (folder / "table.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    stated = ERRORS if bench is None else bench
    columns = COLUMNS | data
    text = RUN.format(
        bench="\n".join(f'{key} = "{value}"' for key, value in stated.items()),
        data="\n".join(
            f"{key} = {value!r}".replace("'", '"') for key, value in columns.items() if value
        ),
        sensor=sensor,
        sd="",
        method="",
    )
    path = folder / "run.toml"
    path.write_text(text, encoding="utf-8")
    return read(path)


def test_exchanged_columns_of_gyros_that_never_turn_are_listed_as_unseen(tmp_path: Path):
    whole = KIND.observe(run_of(tmp_path, table()))
    assert not any(one.what == "unseen" for one in whole.findings)
    one_axis = [
        row | {"gx": f"0.1{k}", "gy": f"-0.2{k}"}
        for k, row in enumerate(row for row in table() if row["axis"] == "z")
    ]
    (found,) = [f for f in KIND.observe(run_of(tmp_path, one_axis)).findings if f.what == "unseen"]
    assert "columns of gx and gy" in found.message
    assert "gz" not in found.message


def test_a_table_of_gyros_alone_is_read(tmp_path: Path):
    run = run_of(tmp_path, table())
    found = KIND.observe(run)
    assert run.sensor.channels == ("gx", "gy", "gz")
    assert found.observations.labels[:3] == ("x rest", "x +50 °/s", "x -50 °/s")
    assert len(found.notes) == 3  # one a gyro


def test_rows_may_come_again_and_settings_have_names(tmp_path: Path):
    rows = [row | {"place": f"on face {row['axis']}"} for row in table()]
    run = run_of(tmp_path, [*rows, *rows], setting="place")
    found = KIND.observe(run)
    assert found.observations.labels[15] == "x rest (2)"
    places = {step.place for step in found.steps if isinstance(step, RateDwell)}
    assert places == {f"on face {axis}" for axis in "xyz"}


@pytest.mark.parametrize(
    ("factor", "unit"), [(180 / np.pi, "rad/s"), (6, "rpm"), (360, "rev/s")], ids=str
)
def test_rates_in_another_unit_are_refused_with_the_unit(tmp_path: Path, factor: float, unit: str):
    rows = [row | {"rate": float(str(row["rate"])) / factor} for row in table()]
    with refused(key="[data] table_rate_unit", names=(unit,)):
        KIND.observe(run_of(tmp_path, rows))
    assert KIND.observe(run_of(tmp_path, rows, table_rate_unit=unit)).steps


def test_a_rate_of_the_other_sign_is_refused_with_its_row(tmp_path: Path):
    rows = table()
    rows[6] = rows[6] | {"gy": "-49.8"}
    with refused(names=("y +50 °/s",)):
        KIND.observe(run_of(tmp_path, rows))


@pytest.mark.parametrize(
    ("row", "wrong"),
    [(3, 10.0), (3, 20.0), (3, 75.0), (1, 500.0), (2, -5.0), (3, 0.0), (0, 50.0), (6, 57.0 / 2)],
    ids=str,
)
def test_a_rate_of_another_size_is_refused_with_its_row(tmp_path: Path, row: int, wrong: float):
    rows = table()
    rows[row] = rows[row] | {"rate": wrong}
    label = f"{rows[row]['axis']} rest (2)" if not wrong else ""
    with refused() as error:
        KIND.observe(run_of(tmp_path, rows))
    assert error.value.names == (label or f"{rows[row]['axis']} {wrong:+g} °/s",)


@pytest.mark.parametrize("scale", [0.7, 0.9, 1.1, 1.4])
def test_gyros_of_different_scales_and_clipped_ones_have_no_wrong_rate(
    tmp_path: Path, scale: float
):
    rows = [row | {"gy": str(float(str(row["gy"])) * scale)} for row in table()]
    rows[-2], rows[-1] = rows[-2] | {"gz": "70.0"}, rows[-1] | {"gz": "-70.0"}
    assert len(KIND.observe(run_of(tmp_path, rows)).steps) == len(rows)


def test_another_axis_than_stated_is_refused_with_its_row(tmp_path: Path):
    rows = table()
    rows[6] = rows[6] | {"axis": "z"}
    with refused(names=("z +50 °/s",)):
        KIND.observe(run_of(tmp_path, rows))


@pytest.mark.parametrize("key", ERRORS)
def test_an_error_that_is_not_stated_is_refused(tmp_path: Path, key: str):
    stated = {name: text for name, text in ERRORS.items() if name != key}
    with refused(key=f"[bench] {key}"):
        KIND.observe(run_of(tmp_path, table(), stated))


@pytest.mark.parametrize(
    ("key", "text"), [("arm", "5 mm"), ("attitude", "0.1 °"), ("mounting", "0.1 °")]
)
def test_an_error_that_acts_nowhere_is_refused(tmp_path: Path, key: str, text: str):
    with refused(key=f"[bench] {key}"):
        KIND.observe(run_of(tmp_path, table(), ERRORS | {key: text}))


RECORDED = RUN.replace('kind = "means"', 'rate = "20 Hz"\nlabel = "label"\nmarks = "labels"')
RECORDED = RECORDED.replace('[data.sd]\ngyro = "1 °/h"\n', "").replace("table.csv", "log.npz")


def test_a_section_with_a_ramp_in_it_is_refused_with_its_name(tmp_path: Path):
    path = tmp_path / "run.toml"
    stated = "\n".join(f'{key} = "{value}"' for key, value in ERRORS.items())
    path.write_text(
        RECORDED.format(sensor='white = "0.1 °/√h"', bench=stated, data="", sd="", method=""),
        encoding="utf-8",
    )
    run = read(path)
    made = simulate(run, 1)
    write_recording(apply_data_columns(run, made), run.file(run.data.file))
    found = KIND.observe(run)
    assert found.observations.labels[1] == "x +50 °/s"
    assert made.labels is not None
    own = np.flatnonzero(made.labels == "x +50 °/s")[:20]
    made.data[own, made.channels.index("gx")] *= np.linspace(0.9, 1.0, own.size)
    write_recording(apply_data_columns(run, made), run.file(run.data.file))
    with refused(names=("x +50 °/s",)):
        KIND.observe(run)


def test_turns_by_an_angle_are_rows_without_a_rate(tmp_path: Path):
    rows: Table = []
    for k, axis in enumerate("xyz"):
        for angle in ("", "360", "", "-361.5", ""):
            read = [0.01, -0.02, 0.03]
            read[k] += float(angle or 0) / 5
            cells = {"axis": axis, "rate": "" if angle else "0", "turn": angle, "seconds": "5"}
            cells |= zip(("gx", "gy", "gz"), (f"{x:g}" for x in read), strict=True)
            rows.append({**cells})
    stated = {"turn_angle": "0.01 °", "setting": "0.05 °"}
    run = run_of(tmp_path, rows, stated, turn="turn", seconds="seconds")
    found = KIND.observe(run)
    step = found.steps[3]
    assert isinstance(step, KnownTurn)
    assert step.label == "x turn -361.5°"
    assert np.degrees(step.angle) == pytest.approx(-361.5)
    again = step_of_label(step.label, 5.0)
    assert isinstance(again, KnownTurn)
    assert again.rate == pytest.approx(step.rate)
    with refused(key="[bench] turn_angle"):
        KIND.observe(run_of(tmp_path, rows, {"setting": "0.05 °"}, turn="turn", seconds="seconds"))
    with refused(key="[data] seconds"):
        KIND.observe(run_of(tmp_path, rows, stated, turn="turn"))


def test_an_angle_read_back_needs_durations(tmp_path: Path):
    with refused(key="[data] seconds"):
        KIND.observe(run_of(tmp_path, table(), ERRORS | {"angle_reading": "5 ″"}))


@pytest.mark.parametrize(
    ("cell", "column", "line"),
    [
        ({"axis": "u"}, "axis", 3),
        ({"axis": ""}, "axis", 3),
        ({"rate": ""}, "rate", 3),
        ({"rate": "fast"}, "rate", 3),
        ({"gy": ""}, "gy", 3),
    ],
    ids=str,
)
def test_a_cell_that_cannot_be_read_is_refused_with_its_line(
    tmp_path: Path, cell: dict[str, object], column: str, line: int
):
    rows = table()
    rows[1] = rows[1] | cell
    with refused(line=line, names=(column,)):
        KIND.observe(run_of(tmp_path, rows))


def test_a_mean_at_full_scale_is_refused(tmp_path: Path):
    with refused(names=("gx",)):
        KIND.observe(run_of(tmp_path, table(), sensor='full_scale = "100 °/s"'))


@pytest.mark.parametrize(
    ("columns", "key"),
    [
        ({"table_rate": None}, "[data] table_rate"),
        ({"axis": None, "table_rate": None}, "[data] axis"),
        ({"roll": "roll"}, "[data] pitch"),
    ],
    ids=str,
)
def test_a_column_that_is_not_named_is_refused(
    tmp_path: Path, columns: dict[str, object], key: str
):
    with refused(key=key):
        KIND.observe(run_of(tmp_path, table(), ERRORS, "", **columns))


def test_accelerometers_are_stated_in_both_sections_or_in_none(tmp_path: Path):
    with refused(key="[sensor.accelerometer]"):
        run_of(tmp_path, table(), accelerometer=["gx", "gy", "gz"])
    with refused(key="[data] accelerometer"):
        run_of(tmp_path, table(), sensor='[sensor.accelerometer]\nunit = "g"')


def test_a_rate_beyond_the_full_scale_is_refused(tmp_path: Path):
    run = run_of(tmp_path, table(), sensor='full_scale = "80 °/s"')
    with refused(key="[sensor.gyro] full_scale", names=("x +100 °/s",)):
        run.bench.nuisances(KIND.observe(run_of(tmp_path, table())).steps, run.sensor)


def test_a_rate_read_by_a_level_gyro_is_refused(tmp_path: Path):
    rows: Table = [{"axis": "z", "rate": rate, "gx": rate + 0.01} for rate in (0, 50, -50)]
    run = run_of(tmp_path, rows, sensor='axis = "x"', gyro=["gx"])
    with refused(names=("z +50 °/s",)):
        KIND.observe(run)


@pytest.mark.parametrize(("axis", "possible"), [("[0, 0, 1]", True), ("[1, 0]", False)])
def test_one_direction_is_a_list_of_three_numbers(tmp_path: Path, axis: str, possible: bool):
    rows: Table = [{"axis": "z", "rate": rate, "gx": rate + 0.01} for rate in (0, 50, -50)]
    if possible:
        run = run_of(tmp_path, rows, sensor=f"axis = {axis}", gyro=["gx"])
        assert [one.i for one in run.sensor.axes] == [(0, 0, 1)]
        return
    with refused():
        run_of(tmp_path, rows, sensor=f"axis = {axis}", gyro=["gx"])


def test_speeds_in_the_table_of_scale_factors_are_round(monkeypatch: pytest.MonkeyPatch):
    rows = [SpeedScale("gz", "z", float(np.radians(v)), 1.0, 1e-6, 0.0, 1e-7)
            for v in (5.00000002, 9.99999999, 0.1234567)]  # fmt: skip
    monkeypatch.setattr(linearity, "speed_scales", lambda *_: rows)
    shown = SimpleNamespace(bench=BENCH, steps=(), observations=None, sensor=None)
    table = linearity.output_tables(cast(Any, None), cast(Any, shown))["scale_factors"]
    assert list(table["speed, °/s"]) == [5.0, 10.0, 0.1234567]


def test_roll_and_pitch_of_a_table_with_three_axes_are_those_of_the_page():
    """Outer axis z, middle axis x and inner axis y, multiplied out as rotations."""
    for outer, m, i in np.random.default_rng(5).uniform(-1.5, 1.5, (20, 3)):
        about_z = np.array([[np.cos(outer), -np.sin(outer), 0], [np.sin(outer), np.cos(outer), 0]])
        about_z = np.vstack([about_z, [0, 0, 1]])
        about_x = np.array([[1, 0, 0], [0, np.cos(m), -np.sin(m)], [0, np.sin(m), np.cos(m)]])
        about_y = np.array([[np.cos(i), 0, np.sin(i)], [0, 1, 0], [-np.sin(i), 0, np.cos(i)]])
        up = (about_z @ about_x @ about_y).T @ [0, 0, 1]
        pitch = np.arcsin(np.sin(i) * np.cos(m))
        roll = np.arctan2(np.sin(m), np.cos(i) * np.cos(m))
        np.testing.assert_allclose(Pose("", roll, pitch).up, up, atol=1e-12)
