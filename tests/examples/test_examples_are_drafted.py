"""`inercal init` drafts a run file that calibrates from each recording among the examples.

What only the user can know is stated here, as with `--set`. If the example has a run file for the
same method, the drafted run file leads to the same values.
"""

import shutil
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from inercal.basics.errors import InputError
from inercal.pipeline import calibrate, simulate_files
from inercal.pipeline.drafts import Draft, draft_run_file
from inercal.recordings.io.write import write_recordings
from inercal.runfile import Run, read

EXAMPLES = Path(__file__).parents[2] / "examples"


class Example(NamedTuple):
    """Files of a recording, values that the user states, the expected method, and a run file.

    If there is no recording, the run file simulates it.
    """

    files: str
    stated: dict[str, str]
    method: str
    run_file: str = ""
    added: str = ""  # sections that a draft leaves to the user


SOAKS = """
[environment]
kind = "soaks"
temperature_sd = "0.1 K"
accelerometer_repeatability = "50 µg"
"""
GYRO_RATES = {
    "bench.latitude": "50 °",
    "bench.rate_scale": "5 ppm",
    "bench.rate_asymmetry": "0 ppm",
    "bench.rate_stability": "0 ppm",
    "bench.setting": "0.02 °",
}
IMU_RATES = GYRO_RATES | {
    "bench.rate_scale": "500 ppm",
    "bench.rate_asymmetry": "100 ppm",
    "bench.rate_stability": "100 ppm",
    "bench.setting": "0.05 °",
    "bench.attitude": "0.05 °",
    "bench.mounting": "0.1 °",
}
PLAYER = GYRO_RATES | {
    "bench.rate_scale": "0.2 %",
    "bench.rate_asymmetry": "100 ppm",
    "bench.rate_stability": "500 ppm",
    "bench.setting": "0.5 °",
}
CLUSTER = {
    "data.accelerometer": "s1,s2,s3,s4",
    "sensor.accelerometer.axis": "[[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]",
    "sensor.accelerometer.unit": "g",
}
TURNTABLE = {"bench.latitude": "38 °", "bench.gravity": "9.80123 m/s² ± 10 µm/s²"}
ARM = {"bench.radius": "1 m ± 10 µm", "bench.gravity": "9.80123 m/s² ± 0.1 mm/s²"}
LAB = {
    "bench.radius": "1.5 m ± 20 µm",
    "bench.gravity": "9.81262 m/s² ± 0.1 mm/s²",
    "sensor.accelerometer.scale": "0.1 V/g",
}
RAMP = {"sensor.gyro.unit": "°/s", "sensor.gyro.bias_instability": "5 °/h"}
HARMONICS = {"bench.harmonics": '["1.9 ″", "1.6 ″"]', "bench.division": "1.6 ″"}
HEAD = {"bench.gravity": "9.80123 m/s² ± 5 µm/s²", "sensor.accelerometer.scale": "1.3 V/g"}
QA = {"bench.gravity": "9.80665 m/s² ± 5 µm/s²", "sensor.accelerometer.scale": "3 V/g"}
EXAMPLE_LOGS = {
    "logger.csv": "logger", "ardupilot.bin": "ardupilot", "px4.ulg": "px4", "ros.mcap": "ros",
    "workbook.xlsx": "workbook", "poses": "poses",
}  # fmt: skip
CASES = [
    *(Example(f"logs/{f}", {}, "six_position", f"logs/{run}") for f, run in EXAMPLE_LOGS.items()),
    Example("six_position/positions.csv", {}, "six_position", "six_position/run"),
    Example("six_position/soaks.csv", {}, "six_position", "six_position/soaks"),
    Example("certificate/positions.csv", {}, "six_position", "certificate/run"),
    Example("check_standard/job.csv", {}, "six_position"),
    Example("fleet/recordings/A0417.csv", {}, "six_position"),
    Example("repeat/session_1.csv", {}, "six_position", "repeat/session_1"),
    Example("measure/readings.txt", {"sensor.accelerometer.scale": "2 V/g"}, "six_position"),
    Example("centrifuge/dwells.csv", {"bench.radius": "1 m ± 10 µm"}, "centrifuge_norm"),
    Example("centrifuge/lab.csv", LAB, "centrifuge_norm", "centrifuge/lab"),
    Example("dividing_head/lab.csv", HARMONICS, "dual_orthogonal", "dividing_head/lab"),
    Example("dividing_head/tumble.csv", HEAD, "tumble", "dividing_head/tumble"),
    Example("qualify/tumble.csv", HEAD, "tumble"),
    Example("prior/QA_21.csv", QA, "tumble", "prior/QA_21"),
    Example("prior/pair.csv", QA, "dual_orthogonal"),
    Example("rate_platform/gyros.csv", GYRO_RATES, "rates_and_poses", "rate_platform/gyros"),
    Example("rate_platform/imu.csv", IMU_RATES, "rates_and_poses", "rate_platform/imu"),
    Example("single_axis/record_player.csv", PLAYER, "rates_and_poses"),
    Example("single_axis/cluster.csv", CLUSTER, "six_position", "single_axis/cluster"),
    Example(
        "rate_table/ship.csv",
        {"sensor.accelerometer.scale": "16384 LSB/g"},
        "ship_multi_angle",
        "rate_table/ship",
    ),
    # simulated
    Example("hand_held.csv", {}, "multi_position", "hand_held/simulated"),
    Example("recording.csv", {}, "ferraris", "ferraris_simulated/run"),
    Example("ramp.npz", RAMP, "temperature_ramp", "temperature/ramp"),
    Example("soaks.npz", {}, "six_position", "temperature/soaks", SOAKS),
    Example("arm_run.csv", ARM, "centrifuge_norm", "centrifuge/arm_run"),
    Example("pair.csv", {}, "dual_orthogonal", "dividing_head/pair"),
    Example("ship_recording.csv", {}, "ship_multi_angle", "rate_table/ship_recording"),
    Example("mimu.csv", TURNTABLE, "turntable_kalman", "turntable/mimu"),
    Example(
        "mimu_packets.csv table.csv",
        TURNTABLE | {"data.rate": "100 Hz", "data.time": "packet"},
        "turntable_kalman",
        "turntable/two_clocks",
    ),
    Example("imu.csv", TURNTABLE, "turntable_kalman", "systematic/imu"),
]
OTHERS = [
    "bench/path.csv", "turntable/path.csv", "dividing_head/polygon.csv", "fleet/sensors.csv",
    "predict/points.csv", "live/lines.csv", "measure/voltages.txt", "export/results-imucam.txt",
    "qualify/counts.csv", "qualify/gravimeter.csv", "qualify/head.csv", "qualify/polygon.csv",
    "qualify/radius.csv", "one_axis_arm/arm.csv",
]  # fmt: skip
"""Files that are no recordings of an IMU and no tables of its readings on a bench of inercal."""

# Cases that take long, and those of a method and a form of data that a fast case has too.
_SLOW = {
    "hand_held.csv", "certificate/positions.csv",
    "logs/ardupilot.bin", "logs/px4.ulg", "logs/poses",
    "check_standard/job.csv", "repeat/session_1.csv", "qualify/tumble.csv", "prior/QA_21.csv",
    "prior/pair.csv", "single_axis/record_player.csv", "measure/readings.txt", "imu.csv",
    "arm_run.csv", "soaks.npz", "rate_platform/imu.csv", "mimu_packets.csv table.csv",
    "centrifuge/lab.csv", "ship_recording.csv", "pair.csv", "logs/ros.mcap",
}  # fmt: skip
_LIKE = ("fleet/recordings/A", "repeat/session_", "prior/", "logs/poses/", "arduino/")
"""Beginnings of the names of files of which one, or all together, is an example."""


def test_every_file_among_the_examples_is_a_recording_or_none():
    suffixes = {".csv", ".txt", ".bin", ".ulg", ".mcap", ".xlsx", ".npz", ".h5"}
    files = {
        path.relative_to(EXAMPLES).as_posix()
        for path in EXAMPLES.glob("**/*")
        if path.suffix in suffixes
    }
    known = {*OTHERS, *(case.files for case in CASES)}
    assert not [one for one in files if one not in known and not one.startswith(_LIKE)]


def require_names_and_units(draft: Draft, own: Run) -> None:
    """Check that a draft names the columns and units in which a run file simulates."""
    found = {f"{one.section}.{one.key}": one.value for one in draft.entries}
    assert found.get("data.accelerometer", []) == list(own.data.accelerometer)
    units = {axis.measures: axis.readout.unit for axis in own.sensor.axes}
    if units.get("f", "V") not in ("V", "LSB"):
        assert found["sensor.accelerometer.unit"] == units["f"]
    if "sensor.gyro.unit" in found:
        assert found["sensor.gyro.unit"] == units["w"]


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.files, marks=pytest.mark.slow if case.files in _SLOW else ())
        for case in CASES
    ],
)
def test_an_example_is_drafted_and_calibrates(case: Example, tmp_path: Path):
    own = None
    files = [EXAMPLES / name for name in case.files.split()]
    if case.run_file:
        own = read(EXAMPLES / f"{case.run_file}.toml")
    if simulated := not files[0].exists():
        folder = tmp_path / "example"
        shutil.copytree((EXAMPLES / case.run_file).parent, folder)
        own = read(folder / f"{Path(case.run_file).name}.toml")
        write_recordings({own.file(file): made for file, made in simulate_files(own).items()})
        files = [folder / name for name in case.files.split()]
    draft = draft_run_file(files, tmp_path / "run.toml", case.stated)
    assert not draft.questions
    if own is not None and simulated:
        require_names_and_units(draft, own)
    draft.path.write_text(draft.text + case.added, encoding="utf-8")
    drafted = read(draft.path)
    assert drafted.method.name == case.method
    found = calibrate(drafted)
    assert found.verdict.grade != "unreliable"
    if own is None or own.method.name != case.method:
        return
    expected = calibrate(own).calibration
    both = set(found.calibration.sensor.coefficients) & set(expected.sensor.coefficients)
    assert both
    for name in both:
        one, two = found.calibration, expected
        error = one.value(name) - two.value(name)
        assert abs(error) <= 2 * np.hypot(one.uncertainty(name), two.uncertainty(name)), name


@pytest.mark.parametrize("name", OTHERS)
def test_a_file_that_is_no_recording_is_refused(name: str, tmp_path: Path):
    with pytest.raises(InputError) as caught:
        draft_run_file([EXAMPLES / name], tmp_path / "run.toml")
    assert caught.value.file == EXAMPLES / name
