"""What a run file says of its columns, and the recording made from it."""

from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.recordings.io.mean_tables import read_columns
from inercal.recordings.io.read import Columns, read_recording

XY = (("x", "acc", "g"), ("y", "rate", "°/s"))
TEXT = "ms,acc,rate,T,angle,part\n" + "".join(
    f"{10 * k},{k},{k * k},{20 + k / 2},{90 * k},p{k // 2}\n" for k in range(5)
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "run.csv"
    path.write_text(TEXT)
    return path


def test_readings_stay_as_they_came_and_the_rest_is_si(file: Path):
    read = read_recording(
        file,
        Columns(
            XY,
            time="ms",
            time_unit="ms",
            label="part",
            temperature="T",
            readback=(("table", "angle", "°"),),
        ),
    )
    assert read.data[2].tolist() == [2, 4]
    np.testing.assert_allclose(read.time, np.arange(5) / 100)
    assert read.temperature is not None
    np.testing.assert_allclose(read.temperature, 293.15 + np.arange(5) / 2)
    np.testing.assert_allclose(read.readback["table"], np.arange(5) * np.pi / 2)
    assert read.labels is not None
    assert read.labels.tolist() == ["p0", "p0", "p1", "p1", "p2"]
    assert (read.units, read.where(0)) == (("g", "°/s"), "line 2")


def test_time_is_counted_where_there_is_no_clock(file: Path):
    read = read_recording(file, Columns(XY, rate_hz=50))
    np.testing.assert_allclose(read.time, np.arange(5) / 50)
    counted = read_recording(file, Columns(XY, time="ms", time_unit="sample", rate_hz=50))
    np.testing.assert_allclose(counted.time, np.arange(5) / 5)


@pytest.mark.parametrize(
    ("columns", "key", "names"),
    [
        ({}, "rate_hz", ()),
        ({"time": "ms", "time_unit": "sample"}, "rate_hz", ()),
        ({"time": "ms", "rate_hz": 1.0}, "rate_hz", ()),
        ({"rate_hz": -1.0}, "rate_hz", ()),
        ({"rate_hz": 1.0, "channels": (*XY, ("z", "acc", "g"))}, None, ["acc"]),
        ({"rate_hz": 1.0, "channels": (("x", "acc", "furlong"),)}, None, ["furlong"]),
    ],
)
def test_a_contradiction_is_refused_before_the_file_is_read(
    columns: dict[str, object], key: str | None, names: list[str]
):
    with refused(key=key, names=names):
        Columns(**({"channels": XY} | columns))  # type: ignore[arg-type]


def test_a_time_unit_that_is_none_is_refused(file: Path):
    with refused(names=["m"]):
        read_recording(file, Columns(XY, time="ms", time_unit="m"))


@pytest.mark.parametrize("labels", [("1", "2", "12r"), ("x", "1", "2"), ("1", "02", "3")])
def test_labels_are_text_even_if_the_first_looks_like_a_number(
    tmp_path: Path, labels: tuple[str, ...]
):
    path = tmp_path / "means.csv"
    path.write_text("position,ax\n" + "".join(f"{one},0.5\n" for one in labels))
    table = read_columns(path, Columns((("ax", "ax", "g"),), rate_hz=1.0, label="position"), [])
    assert table.columns["position"].tolist() == list(labels)
    assert table.numbers("ax").tolist() == [0.5] * len(labels)
    path.write_text("ax\n0.5\n0.25\n")
    both = read_columns(path, Columns((("ax", "ax", "g"),), rate_hz=1.0, label="ax"), [])
    assert both.numbers("ax").tolist() == [0.5, 0.25]
