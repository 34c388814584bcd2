"""Logs of flight controllers and robots, calibrated: the same samples give the same calibration."""

from pathlib import Path

import numpy as np
import pytest
from tests.io.log_files import BIAS, SAMPLES, SCALE, ardupilot_corrected, write_ardupilot
from tests.refusals import refused

from inercal.calibration import Calibration
from inercal.pipeline import apply, calibrate
from inercal.recordings import Recording
from inercal.recordings.io.write import write_recordings
from inercal.runfile import read

ROOT = Path(__file__).parents[2]
LOGS = ROOT / "examples" / "logs"
# Logs hold single precision: half a step at 10 m/s² is 5e-7 m/s², of corrected readings a few.
FLOAT32 = 3e-6
EXTRAS = {"px4": "pyulog", "ros": "rosbags", "workbook": "openpyxl"}
EXAMPLES = sorted(path.stem for path in LOGS.glob("*.toml"))


def calibrated(name: str) -> Calibration:
    if name in EXTRAS:
        pytest.importorskip(EXTRAS[name], reason=f"needs the extra for {EXTRAS[name]}")
    return calibrate(LOGS / f"{name}.toml").calibration


def reference(folder: Path) -> Calibration:
    """Return the calibration by a .npz file of the raw readings."""
    s = SAMPLES
    channels, units = ("acc_x", "acc_y", "acc_z"), ("m/s²",) * 3
    recording = Recording(s.time, s.acc.astype(float), channels, units)
    write_recordings({folder / "raw.npz": recording})
    text = (LOGS / "ardupilot.toml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith(("accel", "temperature"))]
    made = "\n".join(lines).replace("ardupilot.bin", "raw.npz")
    (folder / "raw.toml").write_text(made, encoding="utf-8")
    (folder / "marks.json").write_bytes((LOGS / "marks.json").read_bytes())
    return calibrate(folder / "raw.toml").calibration


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_log_gives_the_calibration_of_the_raw_readings(name: str, tmp_path: Path):
    found, expected = calibrated(name), reference(tmp_path)
    assert found.sensor.coefficients == expected.sensor.coefficients
    # The drift that slopes show carries the rounding of half a second over the whole run.
    rounded = np.maximum(FLOAT32, 0.05 * expected.std)
    assert (np.abs(found.values - expected.values) < rounded).all()
    np.testing.assert_allclose(found.std, expected.std, rtol=0.06)
    for axis, scale, bias in zip("xyz", SCALE, BIAS, strict=True):
        assert abs(found.value(f"a{axis}.k1") - (scale - 1)) < 3 * found.uncertainty(f"a{axis}.k1")
        assert abs(found.value(f"a{axis}.k0") - bias) < 3 * found.uncertainty(f"a{axis}.k0")


def variant(folder: Path, corrections: str, **parameters: float) -> Path:
    """Write a run file of a log of ArduPilot with other parameters."""
    folder.mkdir()
    (folder / "ardupilot.bin").write_bytes(write_ardupilot(parameters))
    (folder / "marks.json").write_bytes((LOGS / "marks.json").read_bytes())
    text = (LOGS / "ardupilot.toml").read_text(encoding="utf-8")
    text = text.replace("temperature =", f'corrections = "{corrections}"\ntemperature =')
    if corrections == "keep":  # ArduPilot turned these axes
        text = text.replace('"IMU.AccY", "IMU.AccZ"', '"-IMU.AccY", "-IMU.AccZ"')
    (folder / "run.toml").write_text(text, encoding="utf-8")
    return folder / "run.toml"


def test_a_kept_correction_is_a_condition_of_the_calibration(tmp_path: Path):
    kept = calibrate(variant(tmp_path / "kept", "keep")).calibration
    (stated,) = [text for text in kept.conditions.values() if "INS_ACCOFFS_Y 2.5" in text]
    assert "AHRS_ORIENTATION 8" in stated
    acc, _ = ardupilot_corrected(SAMPLES)
    half_sum = (acc[:25, 0].mean() + acc[30:55, 0].mean()) / 2
    assert abs(kept.value("ax.k0") - half_sum) < 2 * kept.uncertainty("ax.k0")
    assert abs(half_sum - SAMPLES.acc[:25, 0].mean()) > 20 * kept.uncertainty("ax.k0")


def test_nothing_is_corrected_twice_or_not_at_all(tmp_path: Path):
    undone = variant(tmp_path / "undone", "undo")
    kept = variant(tmp_path / "kept", "keep")
    other = variant(tmp_path / "other", "keep", INS_ACCOFFS_X=0.3)
    of_raw = calibrate(undone).calibration
    of_corrected = calibrate(kept).calibration
    for calibration, run in ((of_raw, undone), (of_corrected, kept)):
        norm = np.linalg.norm(apply(calibration, read(run)).data[:25, :3].mean(axis=0))
        assert norm == pytest.approx(9.81, abs=2e-3)
    for calibration, run in (
        (of_raw, kept),
        (of_raw, other),
        (of_corrected, undone),
        (of_corrected, other),
    ):
        with refused(file=run, key="[data] corrections"):
            apply(calibration, read(run))
    # What undoes by another log's own parameters is the same sensor.
    again = variant(tmp_path / "again", "undo", INS_ACCOFFS_X=0.3)
    norm = np.linalg.norm(apply(of_raw, read(again)).data[:25, :3].mean(axis=0))
    assert norm == pytest.approx(9.81, abs=2e-3)
