"""Blocks that are corrected while they arrive equal the recording that `apply` corrects."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.host.correction.cases import HEADER, NAMED, NUMBERED, calibration_of, lines, run_of
from tests.refusals import refused

from inercal.calibration.validity import Validity
from inercal.host.correction.outputs import csv_format
from inercal.host.correction.text_rows import TextRows
from inercal.pipeline import apply
from inercal.pipeline.calibration_record import CROSSED_COLUMNS, crossed_columns
from inercal.pipeline.correction import as_written, significant
from inercal.pipeline.live_correction import CorrectedBlock, LiveCorrector, SampleFlag
from inercal.runfile import read

SIZES = (1, 2, 3, 17, 1, 40, 100, 1, 36)
LINEAR = ("bias", "scale", "misalignment")
TERMS = {
    "affine": LINEAR,
    "nonlinear": (*LINEAR, "k2"),
    "temperature": (*LINEAR, "k0_dT", "k1_dT", "bias_dT"),
}


def corrected_in_blocks(corrector: LiveCorrector, rows: list[str]) -> list[CorrectedBlock]:
    parser, start = TextRows(corrector.run, "test"), 0
    blocks: list[CorrectedBlock] = []
    parser.feed(f"{HEADER}\n".encode())
    for size in SIZES:
        found = parser.feed("".join(rows[start : start + size]).encode())
        start += size
        if found is not None:
            blocks.append(corrector.correct(found.time, found.readings, found.kelvin))
    assert start == len(rows)
    return blocks


@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
def test_the_printed_numbers_equal_those_of_apply(terms: tuple[str, ...], tmp_path: Path):
    run = run_of(tmp_path, NAMED)
    rows = lines(sum(SIZES), 8)
    (tmp_path / "samples.csv").write_text(HEADER + "\n" + "".join(rows), encoding="utf-8")
    calibration = calibration_of(run, *terms)
    expected = as_written(apply(calibration, run), run, text=True)
    corrector = LiveCorrector(calibration, run)
    blocks = corrected_in_blocks(corrector, rows)
    text = b"".join(map(csv_format(corrector.names).block, blocks)).decode()
    printed = np.array([line.split(",") for line in text.splitlines()], float)
    readback = np.column_stack(list(expected.readback.values()))
    wanted = np.column_stack([expected.time, expected.data, readback])
    assert corrector.names == (*expected.channels, *expected.readback)
    np.testing.assert_array_equal(printed[:, 1:-1], wanted[:, 1:])
    np.testing.assert_allclose(printed[:, 0], wanted[:, 0], atol=1e-7)


def test_a_number_in_a_file_is_the_one_that_a_stream_prints():
    rng = np.random.default_rng(0)
    values = rng.normal(size=2000) * 10.0 ** rng.integers(-320, 300, 2000)
    ties = rng.integers(2**29, 2**29 + 2**20, 500) + 0.5  # 9 digits and exactly a half
    values = np.concatenate([values, ties, [0.0, -0.0, 1e308, 999999999.7]])
    printed = [float(f"{value:.9g}") for value in values.tolist()]
    np.testing.assert_array_equal(significant(values), printed)


def test_one_axis_gives_the_component_that_apply_gives(tmp_path: Path):
    text = Path(run_of(tmp_path).path).read_text(encoding="utf-8")
    text = text.replace('unit = "°/s"', 'unit = "°/s"\naxis = [[0.6, 0, 0.8]]')
    text = text.replace("gyro = [5, 6, 7]", "gyro = [5]")
    path = tmp_path / "one.toml"
    path.write_text(text, encoding="utf-8")
    run = read(path)
    rows = lines(50)
    (tmp_path / "samples.csv").write_text("".join(rows), encoding="utf-8")
    calibration = calibration_of(run, "bias", "scale")
    corrector = LiveCorrector(calibration, run)
    found = TextRows(run, "test").feed("".join(rows).encode())
    assert found is not None
    values = corrector.correct(found.time, found.readings).values
    np.testing.assert_array_equal(values, apply(calibration, run).data)


def test_each_flag_marks_its_samples_and_only_these(tmp_path: Path):
    run = run_of(tmp_path, NAMED)
    limits = Validity(rate=(-0.1, 0.1), temperature=(290.0, 300.0))
    terms = (*LINEAR, "k0_dT")
    calibration = replace(calibration_of(run, *terms, validity=limits), method="rates_and_poses")
    readings = np.zeros((5, 6))
    readings[1, 0] = 4.0  # g, the end of the range
    readings[3, 5] = 90.0  # °/s
    kelvin = np.array([295.0, 295.0, 310.0, 295.0, 300.5])
    for extrapolate in (False, True):
        block = LiveCorrector(calibration, run, extrapolate=extrapolate).correct(
            np.arange(5.0), readings, kelvin
        )
        flags = [0, SampleFlag.SATURATED, SampleFlag.TEMPERATURE, SampleFlag.RATE, 0]
        assert block.flags.tolist() == flags
        missing = np.isnan(block.values[:, :6]).any(axis=1)
        assert missing.tolist() == [False, False, not extrapolate, False, False]
        np.testing.assert_allclose(block.values[:, 6], kelvin - 273.15, atol=1e-6)


def test_a_reading_that_no_motion_gives_has_a_flag_and_no_values(tmp_path: Path):
    run = run_of(tmp_path)
    calibration = calibration_of(run, "k2")
    calibration.values[calibration.sensor.coefficients.index("ax.k2")] = -0.02  # s²/m: fold at 25
    readings = np.zeros((3, 6))
    readings[1, 0] = 3.9  # g, beyond the largest reading of the model
    block = LiveCorrector(calibration, run).correct(np.arange(3.0), readings)
    assert block.flags.tolist() == [0, SampleFlag.NO_MOTION, 0]
    assert np.isnan(block.values[1]).all()
    assert np.isfinite(block.values[[0, 2]]).all()


@pytest.mark.parametrize("terms", [("k0_dT",), ("k0_dTdt",)], ids=["no temperature", "rate"])
def test_terms_that_a_stream_does_not_have_are_refused(terms: tuple[str, ...], tmp_path: Path):
    run = run_of(tmp_path)
    with refused(file="run.toml"):
        LiveCorrector(calibration_of(run, *terms), run)


def test_a_calibration_of_other_axes_or_units_is_refused(tmp_path: Path):
    run = run_of(tmp_path)
    text = run.path.read_text(encoding="utf-8")
    path = tmp_path / "other.toml"
    path.write_text(text.replace('unit = "g"', 'unit = "m/s²"').replace("4 g", "40 m/s²"), "utf-8")
    with refused(names=("ax",)):
        LiveCorrector(calibration_of(read(path)), run)
    lone = text.replace('[sensor.gyro]\nunit = "°/s"', "").replace("gyro = [5, 6, 7]", "")
    path.write_text(lone.replace('"ferraris"', '"six_position"'), encoding="utf-8")
    with refused(names=("gx", "gy", "gz")):
        LiveCorrector(calibration_of(run), read(path))


def test_columns_of_two_files_are_refused(tmp_path: Path):
    run = run_of(tmp_path, NUMBERED + '\ngyro_file = "gyro.csv"')
    with refused(key="[data] accelerometer"):
        TextRows(run, "test")


@pytest.mark.parametrize(
    ("columns", "made_with", "told"),
    [
        ('["gy", "gx", "gz"]', "", True),
        ('["-gx", "gy", "gz"]', "", True),
        ('["-gx", "gy", "gz"]', "gx = -gx", False),
        ('["gx", "gy", "gz"]', "gx = -gx", True),
        ('["gx", "gy", "gz"]', "", False),
    ],
)
def test_columns_in_another_order_than_for_the_calibration_are_reported(
    columns: str, made_with: str, told: bool, tmp_path: Path
):
    data = NAMED.replace('["gx", "gy", "gz"]', columns).replace("-ay", "ay")
    run = run_of(tmp_path, data)
    (tmp_path / "samples.csv").write_text(HEADER + "\n" + "".join(lines(20, 8)), encoding="utf-8")
    conditions = {CROSSED_COLUMNS: made_with} if made_with else {}
    calibration = replace(calibration_of(run), conditions=conditions)
    found = [one.what for one in apply(calibration, run).findings if one.severity == "warning"]
    assert ("axes" in found) == told
    if made_with and not told:
        assert crossed_columns(run) == made_with


@pytest.mark.parametrize(
    "form",
    [
        "a{}_mg",
        "a{}_ms2",
        "a{}_raw",
        "a{}_ug",
        "acc_{}_g",
        "Acc{}(g)",
        "imu.accel.{}",
        "{}-axis [mg]",
        "a{} [mg]",
        "a{}_m/s^2",
        "acc{}.run7",
        "{}_accel",
        "(a{})",
        "A_{}_unit2",
        "gyro_{}_dps",
    ],
)
def test_an_exchanged_column_is_recognised_by_any_form_of_its_name(form: str, tmp_path: Path):
    names = [form.format(axis) for axis in "yxz"]
    data = NAMED.replace('["gx", "gy", "gz"]', str(names).replace("'", '"')).replace("-ay", "ay")
    assert crossed_columns(run_of(tmp_path, data)) == "gx = gy, gy = gx"


def test_a_missing_temperature_is_refused_with_the_key_of_the_run_file(tmp_path: Path):
    run = run_of(tmp_path, "\n".join(one for one in NAMED.split("\n") if "temperature" not in one))
    (tmp_path / "samples.csv").write_text(HEADER + "\n" + "".join(lines(20, 8)), encoding="utf-8")
    with refused(file=run.path, key="[data] temperature"):
        apply(calibration_of(run, *LINEAR, "k0_dT"), run)


@pytest.mark.parametrize(
    ("readout", "differs"),
    [({"offset": 3.0}, "1 g/g and 3"), ({"scale": 0.2}, "1 g/g and 0")],
)
def test_another_readout_than_that_of_the_calibration_is_refused(
    readout: dict[str, float], differs: str, tmp_path: Path
):
    run = run_of(tmp_path)
    made = calibration_of(run)
    axis = made.sensor.axes[0]
    other = replace(axis, readout=replace(axis.readout, **readout))
    sensor = replace(made.sensor, axes=(other, *made.sensor.axes[1:]))
    with refused(names=("ax",)) as refusal:
        apply(replace(made, sensor=sensor), run)
    assert differs in str(refusal.value)
    assert ("offset" in readout) == ("only" in str(refusal.value))


def test_the_calibration_of_another_sensor_is_refused_by_number_and_named_by_name(tmp_path: Path):
    run = replace(run_of(tmp_path, NAMED), job={"serial number": "5512"})
    (tmp_path / "samples.csv").write_text(HEADER + "\n" + "".join(lines(20, 8)), encoding="utf-8")
    made = calibration_of(run)
    other = replace(made, sensor=replace(made.sensor, name="TRIAD-9"))
    apply(replace(other, job=run.job), run)
    found = {one.what for one in apply(other, run).findings}
    assert "sensor" in found
    with refused(key="[job] serial_number"):
        apply(replace(made, job={"serial number": "9"}), run)
