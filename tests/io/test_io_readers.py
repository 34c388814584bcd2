"""Readers declare how to recognise their files; readers of other packages work like ours."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from tests.refusals import refused
from tests.runfile.run_file_texts import changed

from inercal.pipeline import calibrate
from inercal.recordings.data.recording_loader import file_reader_options, reader_columns
from inercal.recordings.io.read import Columns, detect_reader, read_recording, read_table
from inercal.recordings.io.readers import READERS, Option, Reader
from inercal.recordings.io.text import read_text
from inercal.runfile import read

ROOT = Path(__file__).parents[2]
SIX = (ROOT / "examples/six_position/run.toml").read_text(encoding="utf-8")
POSITIONS = ROOT / "examples/six_position/positions.csv"


def page() -> str:
    """Return the reader that the guide shows."""
    text = (ROOT / "docs/how-to/recordings.md").read_text(encoding="utf-8")
    (snippet,) = (s for s in re.findall(r"```python\n(.*?)```", text, flags=re.S) if "READER" in s)
    return snippet


@pytest.fixture
def flight_log() -> Iterator[Reader]:
    scope: dict[str, Any] = {}
    exec(page(), scope)
    reader = scope["READER"]
    with READERS.with_(reader.name, reader):
        yield reader


def log(path: Path, **topics: list[dict[str, float | str]]) -> Path:
    """Write messages, those of the topics in turn."""
    turns = [
        {"topic": topic, **messages[k]}
        for k in range(max(map(len, topics.values())))
        for topic, messages in topics.items()
        if k < len(messages)
    ]
    lines = ["FLIGHT LOG 1", *map(json.dumps, turns)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def messages(count: int, first: float = 0.0) -> list[dict[str, float | str]]:
    return [{"t": k / 100, "x": first + k, "part": f"p{k // 3}"} for k in range(count)]


def six_positions(folder: Path, more: str = "", file: str = "positions.bin") -> Path:
    """Write the six positions as topic "lab" of a flight log, and a run file that names it."""
    table = read_table(POSITIONS, text=["position"])
    rows = [
        {n: x if n == "position" else float(x) for n, x in zip(table.columns, r, strict=True)}
        for r in zip(*(column.tolist() for column in table.columns.values()), strict=True)
    ]
    log(folder / "positions.bin", imu=messages(9), lab=rows)
    path = folder / "run.toml"
    text = changed(SIX, ('file = "positions.csv"', f'file = "{file}"\n{more}'))
    path.write_text(text, encoding="utf-8")
    return path


def test_each_format_of_ours_is_recognised_by_content_whatever_its_name(tmp_path: Path):
    x = np.arange(3.0)
    files = {name: tmp_path / f"{name}.csv" for name in ("npz", "mat", "hdf5", "parquet")}
    with files["npz"].open("wb") as file:
        np.savez(file, x=x)
    with files["mat"].open("wb") as file:
        scipy.io.savemat(file, {"x": x})
    files["hdf5"].write_bytes(b"\x89HDF\r\n\x1a\n")
    files["parquet"].write_bytes(b"PAR1")
    assert {name: detect_reader(path).name for name, path in files.items()} == {n: n for n in files}
    (tmp_path / "new.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + bytes(400))
    assert detect_reader(tmp_path / "new.mat").name == "hdf5"


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("a.mat", b"1 2\n3 4\n", "text"),
        ("a.mat", b"\0\0\0\0\3\0\0\0", "mat"),
        ("a.H5", b"no signature", "hdf5"),
        ("a.pq", b"no signature", "parquet"),
        ("a.npz", b"no signature", "npz"),
        ("a.txt", b"x\n1\n", "text"),
        ("a", b"1 2\n", "text"),
    ],
)
def test_a_suffix_decides_where_content_does_not(
    name: str, content: bytes, expected: str, tmp_path: Path
):
    (tmp_path / name).write_bytes(content)
    assert detect_reader(tmp_path / name).name == expected


def test_readers_have_the_names_they_are_registered_by():
    logs = ("ulog", "dataflash", "rosbag")
    packed = ("hdf5", "mat", "npz", "parquet")
    assert tuple(READERS) == (*logs, "xlsx", *packed, "text")
    keys = dict.fromkeys(logs, ("corrections", "most_values"))
    keys |= dict.fromkeys(packed, ("most_values",)) | {"rosbag": ("stamp", "most_values")}
    keys["xlsx"] = ("sheet", "most_values")
    assert {one.name: one.keys for one in READERS.values()} == keys | {"text": ("skip",)}


@pytest.mark.slow
def test_no_reader_is_imported_before_a_file_is_read():
    text = (
        "import sys, inercal.cli.app, inercal.recordings.io.read; "
        "print([n for n in ('hdf5', 'mat', 'npz', 'text') "
        "if f'inercal.recordings.io.{n}' in sys.modules])"
    )
    made = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert made.stdout.strip() == "[]"


@pytest.mark.usefixtures("flight_log")
@pytest.mark.parametrize("name", ["a.flog", "a.csv", "a"])
def test_a_foreign_reader_reads_its_files_by_content(name: str, tmp_path: Path):
    path = log(tmp_path / name, imu=messages(6), imu_2=messages(9, 100.0))
    assert read_table(path, ["x"]).numbers("x").tolist() == [0, 1, 2, 3, 4, 5]
    second = read_table(path, ["x", "part"], ["part"], {"topic": "imu_2", "skip": 7})
    assert second.numbers("x").tolist() == [107, 108]
    assert second.columns["part"].tolist() == ["p2", "p2"]


def test_a_foreign_reader_reads_its_files_by_suffix(flight_log: Reader, tmp_path: Path):
    (tmp_path / "a.flog").write_text("FLIGHT LOG 2\n", encoding="utf-8")
    assert detect_reader(tmp_path / "a.flog") is flight_log
    with refused(file="a.flog"):
        read_table(tmp_path / "a.flog")


@pytest.mark.usefixtures("flight_log")
def test_a_recording_of_a_foreign_format_is_a_recording(tmp_path: Path):
    rng = np.random.default_rng(1)
    rows = [{"t": k / 100, "x": float(rng.normal()), "part": "p"} for k in range(40)]
    path = log(tmp_path / "a.flog", imu_2=rows)
    wanted = Columns((("ax", "x", "g"),), time="t", label="part", options={"topic": "imu_2"})
    found = read_recording(path, wanted)
    assert found.data[:, 0].tolist() == [row["x"] for row in rows]
    assert found.labels is not None
    assert set(found.labels.tolist()) == {"p"}


@pytest.mark.usefixtures("flight_log")
def test_a_run_file_states_the_option_of_a_foreign_reader(tmp_path: Path):
    found = calibrate(six_positions(tmp_path, 'topic = "lab"')).calibration
    ours = calibrate(ROOT / "examples/six_position/run.toml").calibration
    assert found.values.tobytes() == ours.values.tobytes()
    assert found.covariance.tobytes() == ours.covariance.tobytes()


@pytest.mark.usefixtures("flight_log")
@pytest.mark.parametrize(
    ("more", "file", "key"),
    [
        ('topic = "lab"', str(POSITIONS), "[data] topic"),
        ("topic = 7", "positions.bin", "[data] topic"),
        ("skip = true", "positions.bin", "[data] skip"),
    ],
)
def test_an_option_out_of_place_is_refused(more: str, file: str, key: str, tmp_path: Path):
    with refused(key=key):
        calibrate(six_positions(tmp_path, more, file))


@pytest.mark.usefixtures("flight_log")
def test_a_misspelt_option_is_refused_with_the_option_meant(tmp_path: Path):
    with refused() as refusal:
        read(six_positions(tmp_path, 'topick = "lab"'))
    assert "did you mean topic?" in str(refusal.value)


def test_an_option_of_no_reader_is_an_unknown_key(tmp_path: Path):
    with refused():
        read(six_positions(tmp_path, 'topic = "lab"'))


def test_a_reader_may_not_take_a_key_that_data_has(tmp_path: Path):
    greedy = Reader(
        "greedy", read_text, options=(Option("time", str, "", ""), Option("a", int, 0, ""))
    )
    with READERS.with_("greedy", greedy), refused():
        read(six_positions(tmp_path, "a = 1"))


def test_an_option_takes_the_types_that_it_declares():
    column = Option("stamp", str | int, None, "column of time")
    assert [column.accepts(v) for v in ("t", 1, 1.0, True, None)] == [
        True,
        True,
        False,
        False,
        False,
    ]
    assert column.accepted_types == "text or a whole number"
    rate = Option("rate", float, 0.0, "")
    assert [rate.accepts(v) for v in (1, 2.5, "1", True)] == [True, True, False, False]


@pytest.mark.usefixtures("flight_log")
def test_an_option_may_be_that_of_the_readback_s_file_alone(tmp_path: Path):
    text = (ROOT / "examples/turntable/two_clocks.toml").read_text(encoding="utf-8")
    (name,) = re.findall(r'table_file = "(.*?)"', text)
    text = changed(text, (f'table_file = "{name}"', 'table_file = "t.flog"\ntopic = "table"'))
    (tmp_path / "run.toml").write_text(text, encoding="utf-8")
    for other in re.findall(r'"(\w+\.csv)"', text):
        source = ROOT / "examples/turntable" / other
        (tmp_path / other).write_bytes(source.read_bytes() if source.exists() else b"x\n1\n")
    log(tmp_path / "t.flog", table=messages(3))
    run = read(tmp_path / "run.toml")
    assert file_reader_options(run, "t.flog") == {"topic": "table"}
    assert reader_columns(run).options == {}
    (tmp_path / "t.flog").unlink()
    assert reader_columns(run).options == {"topic": "table"}


@pytest.mark.slow
def test_an_installed_package_brings_a_reader(tmp_path: Path):
    site = tmp_path / "site"
    info = site / "theirs-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    points = "[inercal.readers]\nflight_log = their_log:READER\n"
    (info / "entry_points.txt").write_text(points)
    (site / "their_log.py").write_text(page(), encoding="utf-8")
    run = six_positions(tmp_path, 'topic = "lab"')
    made = subprocess.run(
        [sys.executable, "-m", "inercal", "calibrate", str(run), "--no-report"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    ours = calibrate(ROOT / "examples/six_position/run.toml").calibration
    written = json.loads((tmp_path / "run.calibration.json").read_text(encoding="utf-8"))
    assert [c["value"] for c in written["coefficients"]] == ours.values.tolist()
