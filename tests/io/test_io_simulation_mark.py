"""A simulated recording is marked in its file, and readers find the mark in each format."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from inercal.recordings import Recording
from inercal.recordings.io.read import Columns, read_recording, read_table
from inercal.recordings.io.section_files import read_sections
from inercal.recordings.io.simulation_mark import read_simulation_mark
from inercal.recordings.io.write import write_recording, write_recordings

MARK = "simulation of run.toml, seed 3"
SUFFIXES = (".csv", ".npz", ".parquet")


def recording(n: int = 200, simulation: str = MARK) -> Recording:
    data = np.random.default_rng(5).normal(size=(n, 2))
    labels = np.where(np.arange(n) < 9, "up, # 1", "down")
    return Recording(
        np.arange(n) / 100, data, ("x", "y"), ("g", "g"), labels, simulation=simulation
    )


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_mark_comes_back_and_the_table_is_as_without_it(suffix: str, tmp_path: Path):
    marked, plain = tmp_path / f"marked{suffix}", tmp_path / f"plain{suffix}"
    columns = write_recording(recording(), marked)
    write_recording(recording(simulation=""), plain)
    read = read_recording(marked, columns)
    assert read.simulation == MARK
    np.testing.assert_array_equal(read.data, recording().data)
    np.testing.assert_array_equal(read.labels, recording().labels)
    assert read_recording(plain, columns).simulation == ""
    assert list(read_table(marked).columns) == list(read_table(plain).columns)
    # A copy that inercal writes in any format keeps it.
    for other in SUFFIXES:
        again = tmp_path / f"again{other}"
        write_recording(read, again)
        assert read_recording(again, columns).simulation == MARK


def test_the_mark_is_read_from_hdf5(tmp_path: Path):
    path = tmp_path / "run.h5"
    made = recording()
    with h5py.File(path, "w") as file:
        file["time"], file["x"], file["y"] = made.time, *made.data.T
    columns = Columns((("x", "x", "g"), ("y", "y", "g")), "time")
    assert read_recording(path, columns).simulation == ""
    with h5py.File(path, "a") as file:
        file.attrs["simulation"] = MARK
    assert read_recording(path, columns).simulation == MARK


def test_rows_of_a_marked_csv_have_the_lines_of_the_file(tmp_path: Path):
    path = tmp_path / "run.csv"
    columns = write_recording(recording(), path)
    read = read_recording(path, columns)
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[read.line(0) - 1].startswith("0.0,")  # pyright: ignore[reportOptionalOperand]


@pytest.mark.slow
def test_a_long_marked_csv_is_read_by_the_fast_parser(tmp_path: Path):
    from inercal.recordings.io.plain_numbers import SMALLEST, load_plain
    from inercal.recordings.io.text_layout import sniff

    path = tmp_path / "run.csv"
    n = 120_000
    write_recording(replace(recording(n), labels=None), path)
    assert path.stat().st_size > SMALLEST
    places = {str(k): np.empty(n) for k in range(3)}
    found = load_plain(path, sniff(path), places, ())
    assert found is not None
    assert found[1] == n
    np.testing.assert_array_equal(places["1"], recording(n).data[:, 0])


def test_a_spreadsheet_that_saves_the_csv_keeps_the_mark(tmp_path: Path):
    path = tmp_path / "run.csv"
    columns = write_recording(recording(), path)
    first, *rest = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([first + ",,", *rest]), encoding="utf-8-sig")
    assert read_recording(path, columns).simulation == MARK


def test_one_simulated_file_marks_what_is_joined_from_several(tmp_path: Path):
    made = replace(recording(), labels=None)
    files = {tmp_path / "rest_a.csv": replace(made, simulation=""), tmp_path / "rest_b.csv": made}
    write_recordings(files)
    columns = Columns((("x", "x", "g"), ("y", "y", "g")), "time")
    assert read_sections(tmp_path / "rest_*.csv", columns).simulation == MARK
    one = Columns((("x", "x", "g"),), "time", second=(("y", "y", "g"),))
    first, second = files
    assert read_recording(first, one, second=second).simulation == MARK


def test_a_name_cannot_break_the_line_of_the_mark(tmp_path: Path):
    path = tmp_path / "run.csv"
    columns = write_recording(recording(simulation="simulation of a\nb\x1b.toml, seed 0"), path)
    read = read_recording(path, columns)
    assert read.simulation == "simulation of a\\nb\\x1b.toml, seed 0"
    np.testing.assert_array_equal(read.data, recording().data)


@pytest.mark.parametrize("content", ["# logger 3\nx,y\n", "x,simulation of it\n"])
def test_other_comments_and_names_are_no_mark(content: str, tmp_path: Path):
    path = tmp_path / "run.csv"
    path.write_text(content + "1,2\n3,4\n", encoding="utf-8")
    assert read_simulation_mark(path) == ""
