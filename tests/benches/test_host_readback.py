"""What a bench host wrote of its readings goes with the samples, whichever the audit left."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from tests.refusals import refused

from inercal.benches.turntable.reading.host_readback import read_host_readback
from inercal.recordings import Recording

ROWS = 5


def recording(rows: int = ROWS, original: "list[int] | None" = None) -> Recording:
    return Recording(
        np.arange(rows, dtype=float),
        np.zeros((rows, 1)),
        ("ax",),
        ("g",),
        original=None if original is None else np.array(original),
    )


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "recording.h5"
    with h5py.File(path, "w") as made:
        group = made.create_group("bench")
        group["noise_gain"] = np.array([1.0, 0.7, np.inf, 0.9, 1.0])
        group["interpolation_sd"] = np.arange(ROWS, dtype=float)
        group.attrs.update(
            {
                "polls": 1000,
                "polls left out as implausible": 3,
                "samples with unusable angle": 1,
            }
        )
    return path


def test_the_quality_is_that_of_the_samples_that_are_left(file: Path):
    whole = read_host_readback(file, recording()).quality
    assert whole is not None
    assert whole.noise_gain.tolist() == [1.0, 0.7, np.inf, 0.9, 1.0]
    some = read_host_readback(file, recording(3, [0, 2, 4])).quality
    assert some is not None
    assert some.interpolation_sd.tolist() == [0.0, 2.0, 4.0]


def test_the_report_is_told_of_readings_that_were_left_out(file: Path):
    found = read_host_readback(file, recording()).findings
    assert [(one.what, one.severity) for one in found] == [
        ("implausible", "note"),
        ("angles", "note"),
    ]
    with h5py.File(file, "a") as made:
        made["bench"].attrs["polls left out as implausible"] = 20
    found = read_host_readback(file, recording()).findings
    assert [one.severity for one in found] == ["warning", "note"]


def test_a_quality_of_other_samples_is_refused(file: Path):
    for other in (recording(4), recording(2, [0, 5])):
        with refused(file="recording.h5"):
            read_host_readback(file, other)


def test_a_recording_of_before_has_none(tmp_path: Path):
    path = tmp_path / "old.h5"
    with h5py.File(path, "w") as made:
        made.create_group("bench")["time"] = np.zeros(3)
    assert read_host_readback(path, recording()).quality is None
    assert read_host_readback(tmp_path / "mimu.csv", recording()).quality is None


def test_a_damaged_file_is_refused(tmp_path: Path):
    path = tmp_path / "broken.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with refused(file="broken.h5"):
        read_host_readback(path, recording())
