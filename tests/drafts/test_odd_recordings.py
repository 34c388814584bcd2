"""Recordings as loggers write them: drafted, calibrated, and compared with the truth."""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import chosen, evidence
from tests.drafts.hand_recording import TRUTH, Array, Hand, by_hand
from tests.refusals import refused
from tests.reports import report_file

import inercal
from inercal.basics.units import si_factor
from inercal.cli import init_command
from inercal.pipeline.drafts import draft_run_file
from inercal.pipeline.drafts.column_roles import ColumnRoles, unknown_accelerometers
from inercal.pipeline.drafts.rest_recording import read_rest_recording
from inercal.recordings.io.read import read_table

HZ = 50.0
UNITS = {"k0": "µg", "k1": "ppm", "bias": "°/h", "scale": "ppm"}
NAMES = ("ax", "ay", "az", "gx", "gy", "gz")


@cache
def hand() -> Hand:
    return by_hand(HZ, rests=14)


def readings() -> Array:
    return np.round(np.hstack(hand()), 4)


def written(path: Path, columns: Mapping[str, Sequence[object]]) -> Path:
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def with_readings(stamps: Mapping[str, Sequence[object]]) -> dict[str, Sequence[object]]:
    return {**stamps, **dict(zip(NAMES, readings().T.tolist(), strict=True))}


def calibrated(log: Path, stated: Mapping[str, str], folder: Path) -> dict[str, object]:
    """Draft a run file and calibrate with it: the truth is within 1.5 U; return the keys."""
    draft = draft_run_file([log], folder / "run.toml", stated)
    assert not draft.questions
    (folder / "run.toml").write_text(draft.text, encoding="utf-8")
    calibration = inercal.calibrate(folder / "run.toml").calibration
    for name, true in TRUTH.items():
        unit = si_factor(UNITS[name.partition(".")[2]])
        off = calibration.value(name) - true * unit
        assert abs(off) < 1.5 * 2 * calibration.uncertainty(name), name
    return {f"{one.section}.{one.key}": one.value for one in draft.entries}


COUNT = np.arange(len(hand().force))
STAMPS = {
    "8 bits": ({"counter": (COUNT + 200) % 256}, {"data.rate": "50 Hz"}, 256),
    "16 bits": ({"packet_counter": (COUNT + 65000) % 65536}, {"data.rate": "50 Hz"}, 65536),
    "16 bits with a sign": (
        {"counter": (COUNT + 64000) % 65536 - 32768},
        {"data.rate": "50 Hz"},
        65536,
    ),
    "32 bits of µs": ({"micros": (COUNT * 20000 + 2**32 - 300000) % 2**32}, {}, 2**32),
    "32 bits of ms": ({"millis": (COUNT * 20 + 2**32 - 9000) % 2**32}, {}, 2**32),
    "16 bits of ms": ({"millis": (COUNT * 20 + 1000) % 65536}, {}, 65536),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", chosen(STAMPS, ["16 bits with a sign", "32 bits of µs"]))
def test_stamps_that_restart_are_unwrapped_by_one_key(tmp_path: Path, name: str):
    stamps, stated, modulus = STAMPS[name]
    columns = {column: values.tolist() for column, values in stamps.items()}
    log = written(tmp_path / "log.csv", with_readings(columns))
    keys = calibrated(log, stated, tmp_path)
    assert keys["data.counter_modulus"] == modulus
    run = tmp_path / "run.toml"
    without = [line for line in run.read_text("utf-8").splitlines() if "_modulus" not in line]
    run.write_text("\n".join(without) + "\n", encoding="utf-8")
    with refused(key="[data] counter_modulus") as caught:
        inercal.calibrate(run)
    assert str(modulus) in str(caught.value)


def test_the_noise_of_stamps_that_restart_is_that_of_even_ones(tmp_path: Path):
    stamps, _, modulus = STAMPS["32 bits of ms"]
    log = written(tmp_path / "log.csv", with_readings({k: v.tolist() for k, v in stamps.items()}))
    stated = {"sensor.gyro.unit": "°/s", "sensor.accelerometer.unit": "m/s²"}
    for more in ({}, {"data.counter_modulus": str(modulus)}):
        found = read_rest_recording(log, stated | more)
        np.testing.assert_allclose(found.time, COUNT / HZ, rtol=0, atol=1e-9)
    with refused():
        read_rest_recording(log, stated | {"data.counter_modulus": "70000"})


def test_a_clock_that_was_reset_is_not_unwrapped(tmp_path: Path):
    seconds = np.concatenate([COUNT[:1500], COUNT[:-1500]]) / HZ
    log = written(tmp_path / "log.csv", with_readings({"time": seconds.tolist()}))
    with refused() as caught:
        draft_run_file([log], tmp_path / "run.toml")
    assert "counter_modulus" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    "stamps",
    [
        evidence((COUNT // 50).tolist()),
        (COUNT // 8 * 0.16).round(3).tolist(),
        evidence((COUNT // 8 * 160 + 1_700_000_000_000).tolist()),
        evidence([3.0] * len(COUNT)),
    ],
    ids=["whole seconds", "bursts", "bursts in ms", "no clock"],
)
def test_stamps_that_stand_still_are_one_sentence_and_the_rate_helps(
    tmp_path: Path, stamps: list[float]
):
    log = written(tmp_path / "log.csv", with_readings({"stamp": stamps}))
    stated = {"data.time": "stamp"}
    units = {"sensor.gyro.unit": "°/s", "sensor.accelerometer.unit": "m/s²"}
    with refused(key="data.time", names=("stamp",)) as caught:
        draft_run_file([log], tmp_path / "run.toml", stated)
    assert len(set(stamps)) == 1 or '"50 Hz"' in str(caught.value)
    for columns in ({}, {"data.accelerometer": "[]"}):
        with refused(key="data.time"):
            read_rest_recording(log, stated | units | columns)
    asked = draft_run_file([log], tmp_path / "run.toml").questions
    assert [one.key for one in asked] == ["rate"]
    assert len(set(stamps)) == 1 or '"50 Hz"' in asked[0].ask
    calibrated(log, {"data.rate": "50 Hz"}, tmp_path)


def test_only_gyros_are_read_where_the_accelerometers_are_an_empty_list(tmp_path: Path):
    log = written(tmp_path / "log.csv", with_readings({"time": (COUNT / HZ).tolist()}))
    stated = {"data.accelerometer": "[]", "sensor.gyro.unit": "°/s"}
    assert read_rest_recording(log, stated).channels == ("gx", "gy", "gz")
    with refused(key="data.accelerometer"):
        draft_run_file([log], tmp_path / "run.toml", {"data.accelerometer": "[]"})


@pytest.mark.parametrize("stated", [{}, {"data.accelerometer": "[]"}])
@pytest.mark.parametrize("count", [1, 3])
def test_gyros_on_a_rate_table_are_not_advised_as_accelerometers(
    tmp_path: Path, stated: dict[str, str], count: int
):
    columns = with_readings({"time_s": (COUNT / HZ).tolist(), "set_rate_dps": [30] * len(COUNT)})
    gyros = {name: column for name, column in columns.items() if not name.startswith("a")}
    logs = [written(tmp_path / f"mount_{axis}.csv", gyros) for axis in "xyz"[:count]]
    with refused(key="data.accelerometer") as caught:
        draft_run_file(logs, tmp_path / "run.toml", stated)
    assert "--set data.accelerometer" not in str(caught.value)
    assert "x_+50.csv" in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize(("per_g", "per_degree"), [(16384 / 2, 131 / 2), evidence(2048, 16.4)])
def test_signed_counts_written_as_unsigned_get_their_signs(
    tmp_path: Path, per_g: float, per_degree: float
):
    counts = np.rint(np.hstack([hand().force * per_g / 9.80665, hand().rate * per_degree]))
    columns: dict[str, Sequence[object]] = {"millis": (COUNT * 20).tolist()}
    columns |= dict(zip(NAMES, (counts.astype(int) % 65536).T.tolist(), strict=True))
    log = written(tmp_path / "log.csv", columns)
    gyro = f"{per_degree} LSB/(°/s)"
    stated = {"sensor.accelerometer.scale": f"{per_g} LSB/g", "sensor.accelerometer.unit": "LSB"}
    stated |= {"sensor.gyro.unit": "LSB", "sensor.gyro.scale": gyro}
    assert calibrated(log, stated, tmp_path)["data.signed_bits"] == 16
    run = tmp_path / "run.toml"
    without = [line for line in run.read_text("utf-8").splitlines() if "signed_bits" not in line]
    run.write_text("\n".join(without) + "\n", encoding="utf-8")
    with refused() as caught:
        inercal.calibrate(run)
    assert "signed_bits = 16" in str(caught.value)


@pytest.mark.slow
def test_counts_with_signs_are_not_given_others(tmp_path: Path):
    log = written(tmp_path / "log.csv", with_readings({"time": (COUNT / HZ).tolist()}))
    assert "data.signed_bits" not in calibrated(log, {}, tmp_path)
    run = tmp_path / "run.toml"
    text = run.read_text("utf-8").replace("[data]", "[data]\nsigned_bits = 16")
    run.write_text(text, encoding="utf-8")
    with refused(key="[data] signed_bits"):
        inercal.calibrate(run)


@pytest.mark.slow
def test_lines_are_skipped_while_a_run_file_is_drafted(tmp_path: Path):
    log = written(tmp_path / "log.csv", with_readings({"time": (COUNT / HZ).tolist()}))
    text = log.read_text("utf-8")
    log.write_text(f"1,2,3\n4,5,6\n{text}", encoding="utf-8")
    calibrated(log, {"data.skip": "2"}, tmp_path)
    for above in ("a,b,c,d,e,f,g\n1,2,3,4,5,6,7\n", "x y z\n7\t8\t9\n"):
        log.write_text(above + text, encoding="utf-8")
        draft = draft_run_file([log], tmp_path / "run.toml", {"data.skip": "2"})
        assert ("data", "skip", 2) in [(one.section, one.key, one.value) for one in draft.entries]
        units = {"sensor.gyro.unit": "°/s", "sensor.accelerometer.unit": "m/s²"}
        assert read_rest_recording(log, {"data.skip": "2"} | units).time.size == COUNT.size


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "stated", "keys"),
    [
        # Like the recordings above; a packet counter is the one form that they do not have.
        (
            "10_packet_counter_16bit.txt",
            {"data.rate": "25 Hz"},
            {"data.counter_modulus": 65536, "data.time_unit": "sample"},
        ),
        evidence(
            "10_micros_32bit.csv", {}, {"data.counter_modulus": 2**32, "data.time_unit": "µs"}
        ),
        evidence("11_whole_seconds.csv", {"data.rate": "25 Hz"}, {}),
        evidence(
            "15_int16_as_uint16.csv",
            {"sensor.gyro.unit": "LSB", "sensor.gyro.scale": "65.5 LSB/(°/s)"},
            {"data.signed_bits": 16},
        ),
    ],
)
def test_reported_recordings_calibrate(
    name: str, stated: dict[str, str], keys: dict[str, object], tmp_path: Path
):
    """Their gyros' scale factors are left out, which the files do not have as stated."""
    draft = draft_run_file([report_file(name)], tmp_path / "run.toml", stated)
    drafted = {f"{one.section}.{one.key}": one.value for one in draft.entries}
    assert keys.items() <= drafted.items()
    (tmp_path / "run.toml").write_text(draft.text, encoding="utf-8")
    calibration = inercal.calibrate(tmp_path / "run.toml").calibration
    for coefficient, true in TRUTH.items():
        short = coefficient.partition(".")[2]
        if short != "scale":
            off = calibration.value(coefficient) - true * si_factor(UNITS[short])
            assert abs(off) < 2 * 2 * calibration.uncertainty(coefficient), coefficient


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("14_preamble_padded.csv", 8),
        ("14_unit_row.csv", 8),
        ("14_serial_monitor.txt", 6),
        ("14_serial_plotter.txt", 6),
        ("14_prefix_column.txt", 6),
    ],
)
def test_reported_rows_are_read(name: str, columns: int):
    from inercal.recordings.io.read import read_table

    table = read_table(report_file(name))
    assert len(table.names) == columns
    assert all(column.dtype.kind == "f" for column in table.columns.values())


@pytest.mark.parametrize(
    ("name", "of", "value"),
    [
        ("16_ardupilot_by_qgroundcontrol.params", "ardupilot", -1.1),
        ("16_px4_two_columns.params", "px4", -0.04),
    ],
)
def test_reported_parameters_are_imported(name: str, of: str, value: float):
    assert inercal.import_calibration(report_file(name), of).value("ax.k0") == value


@pytest.mark.slow
@pytest.mark.parametrize("share", [evidence(0.0), 0.02])
def test_bursts_of_a_link_are_reported_as_bursts(share: float, tmp_path: Path):
    stamps = (COUNT // 10 * 10 + share * (COUNT % 10)) / HZ
    log = written(tmp_path / "log.csv", with_readings({"t": stamps.tolist()}))
    (question,) = draft_run_file([log], tmp_path / "run.toml").questions
    assert question.name == "[data] rate"
    assert "bursts" in question.question
    calibrated(log, {"data.rate": "50 Hz"}, tmp_path)


@pytest.mark.parametrize("names", [("Euler_X", "Euler_Y", "Euler_Z", "Mag_X", "Mag_Y", "Mag_Z"),
                                   ("roll", "pitch", "yaw", "mx", "my", "mz")])  # fmt: skip
def test_attitudes_and_magnetic_fields_are_not_offered_to_the_noise_analysis(
    names: tuple[str, ...], tmp_path: Path
):
    data = np.random.default_rng(1).normal(size=(1000, 6))
    columns = {
        "t": (np.arange(1000) / 100).tolist(),
        **dict(zip(names, data.T.tolist(), strict=True)),
    }
    log = written(tmp_path / "log.csv", columns)
    with refused(file=log, key="data.accelerometer") as refusal:
        read_rest_recording(log, {})
    assert "--set" not in str(refusal.value)


@pytest.mark.parametrize("odd", [0, 1, 2])
def test_the_file_with_other_columns_than_most_is_named(tmp_path: Path, odd: int):
    logs = [
        written(tmp_path / f"{k}.csv", {"t": range(9), f"a{k == odd}": range(9)}) for k in range(3)
    ]
    with refused(file=f"{odd}.csv"):
        draft_run_file(logs, tmp_path / "run.toml")


def test_three_columns_named_after_axes_are_proposed_as_accelerometers(tmp_path: Path):
    names = ("Pos", "psi", "theta", "Ux [V]", "Uy [V]", "Uz [V]")
    log = written(tmp_path / "log.csv", {name: range(9) for name in names})
    error = unknown_accelerometers(log, read_table(log), ColumnRoles({}, {}))
    assert '["Ux [V]", "Uy [V]", "Uz [V]"]' in str(error)


def test_a_run_file_is_no_recording_to_draft_from(tmp_path: Path):
    file = tmp_path / "head.toml"
    file.write_text("[sensor]\n")
    with refused(file="head.toml"):
        init_command.run([file], out=tmp_path / "new.toml")
