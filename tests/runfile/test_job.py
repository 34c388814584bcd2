"""[job] and the laboratory's file: texts in the calibration, warnings, refusals."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import inercal
from inercal.basics.errors import InputError
from inercal.runfile import read

EXAMPLE = Path(__file__).parents[2] / "examples" / "six_position"


@pytest.fixture
def job(tmp_path: Path) -> Path:
    return shutil.copytree(EXAMPLE, tmp_path / "run") / "job.toml"


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


@pytest.mark.slow
def test_a_job_changes_no_number_and_stands_in_calibration_and_report(job: Path):
    outcome = inercal.calibrate(job)
    plain = inercal.calibrate(job.with_name("run.toml")).calibration
    np.testing.assert_array_equal(outcome.calibration.values, plain.values)
    np.testing.assert_array_equal(outcome.calibration.covariance, plain.covariance)
    stated = outcome.calibration.job
    assert stated["customer"] == "Basin No. 3"
    assert stated["measured"] == "2026-11-25"
    assert stated["laboratory"] == "Inertial Laboratory"
    assert "PTB 4711/25" in stated["instrument levelled plate"]
    file = inercal.save(outcome.calibration, job.with_name("run.calibration.json"))
    assert inercal.load(file).job == stated
    page = inercal.write_report(outcome, job.with_name("page.html")).read_text(encoding="utf-8")
    assert all(text in page for text in stated.values())
    assert outcome.verdict.grade == "consistent"


def test_an_overdue_instrument_is_a_warning(job: Path):
    change(job.with_name("lab.toml"), "2027-03-01", "2026-03-01")
    outcome = inercal.calibrate(job)
    assert [one.what for one in outcome.findings if one.severity == "warning"] == ["instrument"]
    assert outcome.verdict.grade == "reservations"


def test_the_last_day_of_the_measurement_decides_whether_an_instrument_is_overdue(job: Path):
    change(job.with_name("lab.toml"), "2027-03-01", "2026-11-25")
    assert not [one for one in inercal.calibrate(job).findings if one.what == "instrument"]
    change(job, "measured = 2026-11-25", "measured = 2026-11-25\nmeasured_until = 2026-11-26")
    assert [one for one in inercal.calibrate(job).findings if one.what == "instrument"]


@pytest.mark.parametrize(
    ("file", "old", "new", "key"),
    [
        ("lab.toml", "approved_by", "approved", "approved"),
        ("lab.toml", "due = 2027-03-01", 'due = "soon"', "[instrument] due"),
        ("job.toml", "operator", "operater", "[job] operater"),
        ("job.toml", "measured = 2026-11-25", 'measured = "today"', "[job] measured"),
    ],
)
def test_other_keys_and_dates_are_refused(job: Path, file: str, old: str, new: str, key: str):
    change(job.with_name(file), old, new)
    with pytest.raises(InputError) as caught:
        read(job)
    assert caught.value.key == key


def test_a_missing_file_of_the_laboratory_is_named(job: Path):
    job.with_name("lab.toml").unlink()
    with pytest.raises(InputError) as caught:
        read(job)
    assert caught.value.file == job.with_name("lab.toml")
