"""Sections of one recording on a rate platform, found by the gyros; of a file each; settling.

Recordings are of plain numpy: rates with ramps between, and the case turned over by hand between
settings.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.base_seeds import evidence
from tests.refusals import refused
from tests.runfile.key_sweep import EXAMPLES, example, toml

from inercal.benches.rate_platform.kind import KIND
from inercal.benches.rate_platform.section_finder import find_sections
from inercal.benches.rate_platform.sections import KnownTurn, RateDwell, step_of_label
from inercal.physics.sensors import triad
from inercal.pipeline import apply_data_columns, calibrate, simulate
from inercal.recordings import Recording
from inercal.recordings.data.recording_loader import load_recording
from inercal.recordings.io.write import write_recording
from inercal.runfile import Run, read

Array = NDArray[np.float64]
HZ = 50.0
RAMP = 50.0  # °/s²
RATES = (0.0, 30.0, 60.0, -60.0, -30.0, 0.0)
BIAS = (0.3, -0.2, 0.1)
UP = np.degrees(7.292115e-5 * np.sin(np.radians(50)))  # °/s, earth's rate; no level part


def carried(rng: np.random.Generator, seconds: float = 4.0) -> Array:
    """Return what the gyros read while the case is turned over, °/s."""
    t = np.arange(round(seconds * HZ)) / HZ
    waves = rng.uniform(20, 60, (3, 1)) * np.sin(2 * np.pi * rng.uniform(0.3, 0.8, (3, 1)) * t)
    return waves.T


def profile(rates: Sequence[float], seconds: float) -> tuple[Array, list[tuple[int, int]]]:
    """Return the rate about the table's axis, °/s, and where it is steady."""
    parts: list[Array] = []
    steady: list[tuple[int, int]] = []
    count, before = 0, rates[0]
    for rate in rates:
        ramp = np.linspace(before, rate, round(abs(rate - before) / RAMP * HZ) + 1)[1:]
        stay = np.full(round(seconds * HZ), rate)
        count += ramp.size
        steady.append((count, count + stay.size))
        count += stay.size
        parts += [ramp, stay]
        before = rate
    return np.concatenate(parts), steady


def session(
    rng: np.random.Generator,
    rates: Sequence[float] = RATES,
    seconds: float = 14.0,
    noise: float = 0.02,
) -> tuple[Array, list[str], list[tuple[int, int]]]:
    """Return readings, °/s (n, 3), labels of the sections and where each is steady."""
    parts: list[Array] = []
    labels: list[str] = []
    spans: list[tuple[int, int]] = []
    count = 0
    for k, axis in enumerate("xyz"):
        along, steady = profile(rates, seconds)
        w = np.zeros((along.size, 3))
        w[:, k] = along + UP
        parts += [w, carried(rng)]
        spans += [(count + a, count + b) for a, b in steady]
        count += along.size + len(parts[-1])
        labels += [f"{axis} {rate:+g}" if rate else f"{axis} rest" for rate in rates]
    read = np.concatenate(parts) + BIAS
    return read + noise * rng.standard_normal(read.shape), labels, spans


def recording(read: Array, labels: NDArray[np.str_] | None = None) -> Recording:
    time = np.arange(len(read)) / HZ
    return Recording(time, read, ("gx", "gy", "gz"), ("°/s",) * 3, labels=labels)


SENSOR = triad("t", "w", "g")


def in_si(read: Array) -> Recording:
    return Recording(np.arange(len(read)) / HZ, np.radians(read), SENSOR.channels, ("rad/s",) * 3)


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.2])
def test_all_sections_are_found_and_none_touches_a_ramp(noise: float, seed: int):
    read_, labels, spans = session(np.random.default_rng([seed, 1]), noise=noise)
    stated = [step_of_label(f"{label} ({k})", 1.0) for k, label in enumerate(labels)]
    marks, steps = find_sections(in_si(read_), SENSOR, stated)
    assert [mark.label for mark in marks] == [step.label for step in stated]
    for mark, step, (start, stop) in zip(marks, steps, spans, strict=True):
        assert start <= mark.start < mark.stop <= stop
        assert mark.stop - mark.start > 0.4 * (stop - start)  # 60 °/s: one turn of 6 s
        assert isinstance(step, RateDwell)
        turns = abs(step.rate) * step.seconds / (2 * np.pi)
        assert abs(turns - round(turns)) < 0.01 or turns < 1


def test_turns_by_an_angle_lie_between_rests():
    rng = np.random.default_rng(2)
    read_, _, spans = session(rng, (0.0, 90.0, 0.0, -90.0, 0.0), 6.0)
    stated = [
        step_of_label(f"{axis} {what} ({k})", 1.0)
        for k, (axis, what) in enumerate(
            (axis, what)
            for axis in "xyz"
            for what in ("rest", "turn +702", "rest", "turn -702", "rest")
        )
    ]
    marks, steps = find_sections(in_si(read_), SENSOR, stated)
    for k, (mark, step) in enumerate(zip(marks, steps, strict=True)):
        if isinstance(step, KnownTurn):
            assert mark.start < spans[k][0] - 90 / RAMP * HZ < spans[k][1] < mark.stop
            assert np.degrees(abs(step.angle)) == pytest.approx(702)
            assert step.seconds == pytest.approx((mark.stop - mark.start) / HZ, rel=1e-2)
    along = read_[marks[1].start : marks[1].stop, 0] - BIAS[0]
    assert along.sum() / HZ == pytest.approx(702, abs=0.5)


@pytest.mark.parametrize("bias", [0.0, 2.0])
def test_turns_without_a_steady_part_lie_between_rests(bias: float):
    rng = np.random.default_rng(4)
    rest = np.zeros((round(12 * HZ), 3))
    parts, stated, spans = [rest], ["x rest"], []
    for k, axis in enumerate("xyz"):
        for sense in (1, -1):
            seconds = 6.0 + 2 * k + sense  # turned by hand, so no two turns are alike
            at = np.arange(round(seconds * HZ)) / HZ
            turn = np.zeros((at.size, 3))
            turn[:, k] = sense * 360 * (1 - np.cos(2 * np.pi * at / seconds)) / seconds
            start = sum(map(len, parts))
            spans.append((start, start + at.size))
            parts += [turn, rest]
            stated += [f"{axis} turn {sense * 360:+d}", f"{axis} rest"]
    read_ = np.concatenate(parts) + bias * np.array(BIAS)
    read_ = read_ + 0.02 * rng.standard_normal(read_.shape)
    wanted = [step_of_label(f"{what} ({k})", 1.0) for k, what in enumerate(stated)]
    marks, steps = find_sections(in_si(read_), SENSOR, wanted)
    turns = [m for m, s in zip(marks, steps, strict=True) if isinstance(s, KnownTurn)]
    assert len(turns) == len(spans)
    for mark, (start, stop) in zip(turns, spans, strict=True):
        assert mark.start < start < stop < mark.stop


LISTS: Mapping[str, tuple[slice, int]] = {
    "one less": (slice(None, -1), 0),
    "one setting less": (slice(None, 12), 0),
}


@pytest.mark.parametrize("name", LISTS)
def test_another_number_of_sections_is_refused_with_what_was_found(name: str):
    read_, labels, _ = session(np.random.default_rng(3))
    some, _ = LISTS[name]
    stated = [step_of_label(f"{label} ({k})", 1.0) for k, label in enumerate(labels)]
    with refused(key="[data] marks") as refusal:
        find_sections(in_si(read_), SENSOR, stated[some])
    assert f"{len(labels)} sections" in str(refusal.value)
    with refused(key="[data] marks", names=("z again",)):
        find_sections(in_si(read_), SENSOR, [*stated, RateDwell("z again", "z", 0.0)])


RUN = """[sensor.gyro]
unit = "°/s"
[bench]
kind = "rate_platform"
latitude = "50 °"
rate_scale = "5 ppm"
rate_asymmetry = "0 ppm"
rate_stability = "0 ppm"
setting = "0.02 °"
[data]
file = "log.csv"
time = "time"
gyro = ["gx", "gy", "gz"]
SECTIONS
[method]
name = "rates_and_poses"
"""


def written(path: Path, read_: Array) -> None:
    table = np.column_stack([np.arange(len(read_)) / HZ, read_])
    np.savetxt(path, table, fmt="%.7g", delimiter=",", header="time,gx,gy,gz", comments="")


def run_of(folder: Path, data: str, file: str = "log.csv") -> Run:
    path = folder / "run.toml"
    text = RUN.replace("SECTIONS", data).replace("log.csv", file)
    path.write_text(text, encoding="utf-8")
    return read(path)


def listed(labels: Sequence[str]) -> str:
    return f"sections = {list(labels)!r}".replace("'", '"')


@pytest.mark.parametrize(("rate", "fits"), [("1000 Hz", False), (f"{1.1 * HZ:g} Hz", True)])
def test_a_stated_rate_must_agree_with_the_times(tmp_path: Path, rate: str, fits: bool):
    written(tmp_path / "log.csv", np.zeros((600, 3)) + np.arange(600)[:, None] % [7, 11, 13])
    run = run_of(tmp_path, f'rate = "{rate}"\n{listed(["z 0 °/s"])}')
    if fits:
        assert load_recording(run).rate_hz == pytest.approx(HZ)
    else:
        with refused(file=run.path, key="[data] rate"):
            load_recording(run)


def test_rows_without_a_turn_do_not_need_errors_of_rates(tmp_path: Path):
    (tmp_path / "log.csv").write_text("up,table,gx,gy,gz\nz,0,0.1,0.2,0.3\n")
    run = run_of(tmp_path, 'kind = "means"\naxis = "up"\ntable_rate = "table"', "log.csv")
    text = run.path.read_text(encoding="utf-8").replace('time = "time"\n', "")
    run.path.write_text(f'{text}[data.sd]\ngyro = "2 °/h"\n', encoding="utf-8")
    with refused(file=run.path, key="[bench] rate_scale") as refusal:
        KIND.observe(read(run.path))
    assert "no row turns" in str(refusal.value)


def test_a_run_finds_its_sections_and_the_biases(tmp_path: Path):
    read_, labels, _ = session(np.random.default_rng(4))
    written(tmp_path / "log.csv", read_)
    outcome = calibrate(run_of(tmp_path, listed(labels)))
    assert outcome.verdict.grade == "consistent"
    found = outcome.calibration
    for name, bias in zip(("gx", "gy", "gz"), BIAS, strict=True):
        assert abs(found.value(f"{name}.bias") - np.radians(bias)) < 4 * found.uncertainty(
            f"{name}.bias"
        )
        assert abs(found.value(f"{name}.scale")) < 4 * found.uncertainty(f"{name}.scale")


def test_rates_in_another_order_are_refused_by_row(tmp_path: Path):
    read_, labels, _ = session(np.random.default_rng(4))
    written(tmp_path / "log.csv", read_)
    wrong = [labels[0], labels[4], labels[2], labels[3], labels[1], *labels[5:]]
    with refused(names=("x -30",)):
        KIND.observe(run_of(tmp_path, listed(wrong)))


def test_a_file_for_each_section_is_labelled_by_its_name(tmp_path: Path):
    read_, labels, spans = session(np.random.default_rng(5))
    for k, (label, (start, stop)) in enumerate(zip(labels, spans, strict=True)):
        name = f"{label.replace(' ', '_').replace('-', '–')}_({k}).csv"
        written(tmp_path / f"log_{name}", read_[start:stop])
    found = KIND.observe(run_of(tmp_path, "", "log_*.csv"))
    dwells = [step for step in found.steps if isinstance(step, RateDwell)]
    assert len({step.label for step in dwells}) == len(labels)
    assert sorted(round(np.degrees(step.rate)) for step in dwells) == sorted(RATES * 3)


def test_the_time_to_settle_is_left_out(tmp_path: Path):
    read_, labels, spans = session(np.random.default_rng(6))
    for k, (start, _) in enumerate(spans):
        if (rate := RATES[k % len(RATES)]) != 0:
            t = np.arange(100) / HZ
            read_[start : start + 100, k // len(RATES)] += 0.02 * rate * np.exp(-t / 0.4)
    column = np.full(len(read_), "", dtype="U12")
    for k, (label, (start, stop)) in enumerate(zip(labels, spans, strict=True)):
        column[start:stop] = f"{label} ({k})"
    lines = ["time,gx,gy,gz,label"]
    lines += [
        f"{k / HZ:.3f},{','.join(f'{x:.6f}' for x in row)},{name}"
        for k, (row, name) in enumerate(zip(read_, column.tolist(), strict=True))
    ]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    marked = 'label = "label"\nmarks = "labels"\n'
    with refused(names=("x +30 (1)",)):
        KIND.observe(run_of(tmp_path, marked))
    found = KIND.observe(run_of(tmp_path, marked + 'settle = "3 s"'))
    assert {round(step.seconds) for step in found.steps} == {11}
    with refused(key="[data] settle"):
        KIND.observe(run_of(tmp_path, marked + 'settle = "14 s"'))
    with refused(key="[data] sections"):
        KIND.observe(run_of(tmp_path, marked + listed(labels)))


@pytest.mark.parametrize("key", ['settle = "2 s"', 'sections = ["x rest"]'])
def test_a_table_of_means_has_no_sections_to_find(tmp_path: Path, key: str):
    with refused():
        run_of(tmp_path, f'kind = "means"\naxis = "axis"\ntable_rate = "rate"\n{key}')


@pytest.mark.parametrize("key", ['table_rate_unit = "rpm"', 'angle_unit = "rad"'])
def test_a_unit_needs_the_column_that_it_is_for(tmp_path: Path, key: str):
    with refused(key="[data]"):
        run_of(tmp_path, f'label = "label"\nmarks = "labels"\n{key}')


def test_labels_in_another_unit_are_refused_with_advice_for_labels(tmp_path: Path):
    lines = ["time,gx,gy,gz,label"]
    for k, rate in enumerate((0, 60, -60)):
        label = f"x {rate / 6:+g}" if rate else "x rest"
        lines += [f"{(k * 500 + j) / HZ:.3f},{rate},{j % 3},{j % 2},{label}" for j in range(500)]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    with refused(key="[data] label", names=("rpm",)):
        KIND.observe(run_of(tmp_path, 'label = "label"\nmarks = "labels"'))


def test_found_sections_leave_the_settling_out_too(tmp_path: Path):
    read_, labels, spans = session(np.random.default_rng(7))
    written(tmp_path / "log.csv", read_)
    found = KIND.observe(run_of(tmp_path, listed(labels) + '\nsettle = "4 s"'))
    for mark, (start, _) in zip(found.marks, spans, strict=True):
        assert mark.start >= start + 3.5 * HZ  # a block may begin in the section before


def test_motion_within_a_turn_is_no_noise(tmp_path: Path):
    read_, _, _ = session(np.random.default_rng(8), (0.0, 90.0, 0.0, -90.0, 0.0), 6.0)
    written(tmp_path / "log.csv", read_)
    turns = ("rest", "turn +702", "rest", "turn -702", "rest")
    of_turns = 'turn_angle = "0.01 °"\n[data]'
    run = run_of(tmp_path, listed([f"{axis} {what}" for axis in "xyz" for what in turns]))
    text = run.path.read_text(encoding="utf-8").replace("[data]", of_turns)
    of_rates = ("rate_scale", "rate_asymmetry", "rate_stability")
    text = "\n".join(line for line in text.splitlines() if not line.startswith(of_rates))
    run.path.write_text(text, encoding="utf-8")
    outcome = calibrate(run.path)
    assert outcome.verdict.grade == "consistent"
    seen = outcome.observations
    sd = np.sqrt(seen.covariance[:, 0, 0] * seen.samples)
    assert np.degrees(sd) == pytest.approx(0.02, rel=0.5)


UPWARDS = (10.0, 30.0, 60.0, 100.0, 150.0, 200.0)
THROUGH = (*UPWARDS, *UPWARDS[-2::-1])


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0017 * HZ**0.5, evidence(0.005 * HZ**0.5), 0.2])
def test_all_sections_of_a_full_plan_are_found(noise: float, seed: int):
    """With the level earth's rate, which turns against the case, and a table whose rate ripples."""
    rates = (0.0, *THROUGH, 0.0, *(-rate for rate in THROUGH), 0.0)
    for trial in range(5):
        rng = np.random.default_rng([seed, 9, trial])
        read_, labels, spans = session(rng, rates, 36.0, noise)
        angle = np.radians(np.cumsum(read_ - BIAS, axis=0).sum(axis=1) / HZ)
        level = np.degrees(7.292115e-5 * np.cos(np.radians(50)))
        for k in range(3):
            read_[:, k] += level * np.sin(angle + 2 * np.pi * k / 3)
            read_[:, k] *= 1 + 5e-5 * np.sin(angle)
        stated = [step_of_label(f"{label} ({k})", 1.0) for k, label in enumerate(labels)]
        marks, _ = find_sections(in_si(read_), SENSOR, stated)
        for mark, (start, stop) in zip(marks, spans, strict=True):
            assert start <= mark.start < mark.stop <= stop


def test_a_simulated_plan_is_found_section_by_section(tmp_path: Path):
    plan_keys = '"rates_and_poses"\npositions = 3\nseconds = "12 s"\nrates = ["60 °/s"]\n'
    run = run_of(tmp_path, "rate = '50 Hz'", "log.npz")
    text = run.path.read_text(encoding="utf-8").replace('"rates_and_poses"\n', plan_keys)
    run.path.write_text(text.replace('unit = "°/s"', 'unit = "°/s"\nwhite = "0.1 °/√h"'))
    run = read(run.path)
    made = simulate(run, 1)
    assert made.labels is not None
    write_recording(apply_data_columns(run, made), run.file(run.data.file))
    found = KIND.observe(run)
    assert len(found.marks) == len(run.steps) == 12
    for mark in found.marks:
        assert set(made.labels[mark.start : mark.stop].tolist()) == {mark.label}


def test_sections_of_milliseconds_are_refused(tmp_path: Path):
    lines = ["time,gx,gy,gz,label"]
    for k, rate in enumerate((0, 60, -60)):
        label = f"x {rate:+g}" if rate else "x rest"
        lines += [f"{k * 500 + j},{rate + j % 5},{j % 3},{j % 2},{label}" for j in range(500)]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    marked = 'label = "label"\nmarks = "labels"\ntime_unit = "ms"'
    with refused(key="[data] time_unit"):
        KIND.observe(run_of(tmp_path, marked))


@pytest.mark.parametrize("unit", ["m/s²", "mg"])
def test_accelerometers_that_do_not_read_gravity_at_rest_are_refused(unit: str, tmp_path: Path):
    data = ("data", "file", str(EXAMPLES / "rate_platform" / "imu.csv"))
    path = tmp_path / "run.toml"
    stated = ("sensor.accelerometer", "unit", unit)
    path.write_text(toml(example("rate_platform/imu.toml", data, stated)), encoding="utf-8")
    with refused(file=Path(data[2])):
        KIND.observe(read(path))
