"""A recording with a file for each section."""

from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.pipeline import calibrate, simulate_files
from inercal.recordings.io.file_patterns import is_pattern, matching_files
from inercal.recordings.io.read import Columns
from inercal.recordings.io.section_files import read_sections
from inercal.runfile import read

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "logs" / "poses.toml"
COLUMNS = Columns((("x", "x", "g"), ("y", "y", "g")), time="t")
N = 30
RNG = np.random.default_rng(8)
VALUES = RNG.normal(size=(3, N, 2))


def written(folder: Path, starts: tuple[float, ...], names: tuple[str, ...]) -> Path:
    """Write a file for each section, whose times begin as stated."""
    for start, name, values in zip(starts, names, VALUES, strict=False):
        rows = [f"{start + k / 100:.6f},{x!r},{y!r}" for k, (x, y) in enumerate(values.tolist())]
        (folder / f"rest_{name}.csv").write_text("\n".join(["t,x,y", *rows]) + "\n")
    (folder / "notes.csv").write_text("a word\n")
    return folder / "rest_*.csv"


@pytest.mark.parametrize("labels", [("p1", "p2", "p10"), ("-10", "+5", "50")])
def test_files_are_sorted_by_label_with_numbers_by_value(labels: tuple[str, ...], tmp_path: Path):
    pattern = written(tmp_path, (0, 0, 0), labels[::-1])
    assert list(matching_files(pattern)) == list(labels)


def test_files_of_one_clock_are_joined_by_their_times(tmp_path: Path):
    pattern = written(tmp_path, (20, 5, 10), ("a", "b", "c"))
    found = read_sections(pattern, COLUMNS)
    assert found.labels is not None
    assert found.labels.tolist() == ["b"] * N + ["c"] * N + ["a"] * N
    step = np.arange(N) / 100
    np.testing.assert_allclose(found.time, np.concatenate([step, 5 + step, 15 + step]))
    np.testing.assert_allclose(found.stamps, found.time + 5)
    assert found.data.tolist() == VALUES[[1, 2, 0]].reshape(-1, 2).tolist()
    assert [f.what for f in found.findings if f.what == "sections"] == []


def test_files_of_their_own_clocks_come_one_after_the_other(tmp_path: Path):
    pattern = written(tmp_path, (0, 0, 7), ("a", "b", "c"))
    found = read_sections(pattern, COLUMNS)
    assert found.labels is not None
    assert found.labels.tolist() == ["a"] * N + ["b"] * N + ["c"] * N
    assert (np.diff(found.time) > 0).all()
    assert [f for f in found.findings if f.what == "gap"] == []  # their length is made up
    (note,) = (f for f in found.findings if f.what == "sections")
    assert note.severity == "note"
    stated = "".join(
        f"{k} {sha256((tmp_path / f'rest_{k}.csv').read_bytes()).hexdigest()}\n" for k in "abc"
    )
    assert found.sha256 == sha256(stated.encode()).hexdigest()


def test_dates_are_of_one_clock(tmp_path: Path):
    for k, name in enumerate(("later", "first")):
        rows = [f"2026-11-25T14:0{1 - k}:{s:02d}.000Z,{s % 3},{s % 4}" for s in range(N)]
        (tmp_path / f"rest_{name}.csv").write_text("\n".join(["t,x,y", *rows]) + "\n")
    found = read_sections(tmp_path / "rest_*.csv", COLUMNS)
    assert found.time[N] - found.time[0] == 60
    assert found.labels is not None
    assert found.labels[0] == "first"


def test_a_channel_may_be_constant_in_a_file_but_not_in_all(tmp_path: Path):
    for name, y in (("a", 1), ("b", 2), ("c", 3)):
        rows = [f"{k / 100},{k % 7},{y}" for k in range(N)]
        (tmp_path / f"rest_{name}.csv").write_text("\n".join(["t,x,y", *rows]) + "\n")
    assert read_sections(tmp_path / "rest_*.csv", COLUMNS).time.size == 3 * N
    for name in "bc":
        (tmp_path / f"rest_{name}.csv").write_bytes((tmp_path / "rest_a.csv").read_bytes())
    with refused(names=("y",)):
        read_sections(tmp_path / "rest_*.csv", COLUMNS)


def test_a_damaged_file_is_named_with_its_line(tmp_path: Path):
    pattern = written(tmp_path, (0, 0, 0), ("a", "b", "c"))
    with (tmp_path / "rest_b.csv").open("a") as file:
        file.write("0.5,nan,1\n")
    with refused(file="rest_b.csv", line=N + 2, names=("x",)):
        read_sections(pattern, COLUMNS)
    found = read_sections(pattern, replace(COLUMNS, nonfinite="drop"))
    (warning,) = (f for f in found.findings if f.what == "nonfinite")
    assert "rest_b.csv" in warning.message


@pytest.mark.parametrize("name", ["rest_*_*.csv", "none_*.csv", "no_folder/rest_*.csv"])
def test_a_pattern_without_files_is_refused(tmp_path: Path, name: str):
    written(tmp_path, (0,), ("a",))
    with refused(file=tmp_path / name):
        read_sections(tmp_path / name, COLUMNS)


def test_a_label_column_and_a_second_file_are_refused(tmp_path: Path):
    pattern = written(tmp_path, (0, 0, 0), ("a", "b", "c"))
    with refused(key="[data] label"):
        read_sections(pattern, replace(COLUMNS, label="x"))
    with refused(key="[data] gyro_file"):
        read_sections(pattern, replace(COLUMNS, second=(("gx", "y", "°/s"),)))


def test_a_file_with_a_star_in_its_name_is_a_file(tmp_path: Path):
    path = tmp_path / "a*.csv"
    assert is_pattern(path)
    path.write_text("x\n1\n")
    assert not is_pattern(path)


def run_file(folder: Path, old: str, new: str) -> Path:
    text = EXAMPLE.read_text(encoding="utf-8").replace("poses/", f"{EXAMPLE.parent}/poses/")
    assert old in text
    path = folder / "run.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def test_a_run_file_names_all_files_as_its_inputs():
    named = {path.name for path in read(EXAMPLE).input_files()}
    assert named == {"poses.toml"} | {f"pose_{k}_{s}.csv" for k in "xyz" for s in "pa"}


def test_a_file_of_marks_and_a_simulation_are_refused(tmp_path: Path):
    with refused(key="[data] marks"):
        calibrate(run_file(tmp_path, 'marks = "labels"', 'marks = "marks.json"'))
    with refused(key="[data] file"):
        simulate_files(read(run_file(tmp_path, 'time = "t"', 'time = "t"\nrate = "10 Hz"')))
