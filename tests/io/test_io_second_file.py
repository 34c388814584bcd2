"""Gyros in a file of their own, sampled together with the accelerometers."""

from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused
from tests.runfile.run_file_texts import FERRARIS, SIX_POSITIONS, run_file

from inercal.io.read import Columns, read_recording
from inercal.io.write import write_recording
from inercal.pipeline import apply_data_columns, calibrate, simulate
from inercal.recording import Recording
from inercal.runfile import read

ACC = (("ax", "x", "g"), ("ay", "y", "g"))
COLUMNS = Columns(ACC, time="t", second=(("gx", "x", "°/s"), ("gy", "y", "°/s")))
N = 200


def lines(scale: float, t: np.ndarray | None = None) -> list[str]:
    """Return a header and rows; those of x and y follow one another in no run."""
    t = np.arange(N) / 100 if t is None else t
    rows = [f"{a:.6f},{scale * (k % 7)},{scale * (k % 5)}" for k, a in enumerate(t)]
    return ["t,x,y", *rows]


def saved(folder: Path, first: list[str], second: list[str]) -> tuple[Path, Path]:
    paths = folder / "acc.csv", folder / "gyr.csv"
    for path, text in zip(paths, (first, second), strict=True):
        path.write_text("\n".join(text) + "\n", encoding="utf-8")
    return paths


def test_the_channels_of_both_files_are_one_recording(tmp_path: Path):
    first, second = saved(tmp_path, lines(1), lines(10))
    read = read_recording(first, COLUMNS, second=second)
    assert (read.channels, read.units) == (("ax", "ay", "gx", "gy"), ("g", "g", "°/s", "°/s"))
    np.testing.assert_array_equal(read.data[:, 2:], 10 * read.data[:, :2])
    assert read.data.flags.c_contiguous
    assert (read.source, read.where(0)) == ("acc.csv and gyr.csv", "line 2")
    assert read.sha256 == sha256(first.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("second", "line", "names"),
    [
        (lines(10)[:-1], None, ()),
        (lines(10, np.arange(N) / 100 + 0.0051), 2, ()),
        (lines(10, np.arange(N) / 99.7), 169, ()),
        ([line.replace("0.070000,", ",") for line in lines(10)], 9, ()),
        (["t,x,z", *lines(10)[1:]], None, ["y"]),
        (["k,x,y", *lines(10)[1:]], None, ["t"]),
        (["t,x,y", "s,°/s,°/s", *lines(10)[1:]], None, ["x"]),
    ],
)
def test_files_that_were_not_sampled_together_are_refused(
    tmp_path: Path, second: list[str], line: int | None, names: list[str]
):
    with refused(file="gyr.csv", line=line, names=names):
        read_recording(*_arguments(saved(tmp_path, lines(1), second)))


def _arguments(paths: tuple[Path, Path]) -> tuple[Path, Columns, None, Path]:
    return paths[0], COLUMNS, None, paths[1]


def test_clocks_may_differ_by_half_a_step(tmp_path: Path):
    late = lines(10, np.arange(N) / 100 + 0.005)
    read = read_recording(*_arguments(saved(tmp_path, lines(1), late)))
    np.testing.assert_allclose(read.time, np.arange(N) / 100)


def test_without_a_time_column_the_rows_alone_go_together(tmp_path: Path):
    first, second = saved(tmp_path, lines(1), lines(10, np.arange(N) / 7))
    columns = replace(COLUMNS, time=None, rate_hz=100.0)
    assert read_recording(first, columns, second=second).data.shape == (N, 4)


@pytest.mark.parametrize("number", [0, 1])
def test_a_missing_value_is_named_with_its_line_where_both_files_have_the_same(
    tmp_path: Path, number: int
):
    both = [lines(1), lines(10)]
    both[number][8] = both[number][8].rpartition(",")[0] + ","
    paths = saved(tmp_path, *both)
    with refused(file="acc.csv and gyr.csv", line=9, names=[f"{'ag'[number]}y"]):
        read_recording(*_arguments(paths))
    # Where the headers have different lengths, there is no common line.
    both[0] = ["# logger 7", *both[0]]
    paths = saved(tmp_path, *both)
    with refused(line=None, names=[f"{'ag'[number]}y"]):
        read_recording(*_arguments(paths))
    read = read_recording(paths[0], replace(COLUMNS, nonfinite="drop"), second=paths[1])
    np.testing.assert_array_equal(read.data[:, 2:], 10 * read.data[:, :2])
    assert read.data.shape == (N - 1, 4)


def test_the_audit_looks_at_the_second_file_too(tmp_path: Path):
    still = [line.rpartition(",")[0] + ",3" for line in lines(10)[1:]]
    with refused(names=["gy"]):
        read_recording(*_arguments(saved(tmp_path, lines(1), ["t,x,y", *still])))


def test_a_second_file_and_its_columns_go_together(tmp_path: Path):
    first, second = saved(tmp_path, lines(1), lines(10))
    for columns, path in ((COLUMNS, None), (replace(COLUMNS, second=()), second)):
        with refused(file=first):
            read_recording(first, columns, second=path)
    with refused(names=["x"]):
        replace(COLUMNS, second=(("gx", "x", "°/s"), ("gy", "x", "°/s")))


def test_real_accelerometers_and_gyros_of_two_files_go_together(data_dir: Path):
    folder = data_dir / "xsens_mti_multiposition"
    three = tuple(("xyz"[k], str(k + 2)) for k in range(3))
    columns = Columns(
        tuple((f"a{axis}", column, "LSB") for axis, column in three),
        time="1",
        second=tuple((f"g{axis}", column, "LSB") for axis, column in three),
    )
    read = read_recording(folder / "xsens_acc.mat", columns, second=folder / "xsens_gyro.mat")
    assert read.data.shape == (51175, 6)
    np.testing.assert_array_equal(read.data[0, 3:], np.loadtxt(folder / "xsens_gyro.mat")[0, 1:])
    assert {finding.severity for finding in read.findings} <= {"note"}


TWO_FILES = ('file = "log.csv"', 'file = "acc.csv"\ngyro_file = "gyr.npz"')


def _simulated(folder: Path) -> None:
    run = read(run_file(folder, FERRARIS))
    made = apply_data_columns(run, simulate(run, 1))
    for name, part in (("acc.csv", slice(0, 3)), ("gyr.npz", slice(3, 6)), ("log.csv", slice(6))):
        write_recording(_some(made, part), folder / name)


def _some(made: Recording, part: slice) -> Recording:
    return replace(
        made, data=made.data[:, part], channels=made.channels[part], units=made.units[part]
    )


def test_a_run_file_with_two_files_gives_what_one_file_gives(tmp_path: Path):
    _simulated(tmp_path)
    one = calibrate(run_file(tmp_path, FERRARIS))
    two = calibrate(run_file(tmp_path, FERRARIS, TWO_FILES))
    np.testing.assert_array_equal(two.calibration.values, one.calibration.values)
    provenance = two.calibration.provenance
    assert (provenance["recording"], provenance["gyro recording"]) == ("acc.csv", "gyr.npz")
    for key, name in (("recording sha256", "acc.csv"), ("gyro recording sha256", "gyr.npz")):
        assert provenance[key] == sha256((tmp_path / name).read_bytes()).hexdigest()
    assert "gyro recording" not in one.calibration.provenance


def test_a_method_without_gyros_leaves_their_file_alone(tmp_path: Path):
    gyro = ("[sensor.truth]", '[sensor.gyro]\nunit = "°/s"\n\n[sensor.truth]')
    run = read(run_file(tmp_path, SIX_POSITIONS, gyro))
    write_recording(apply_data_columns(run, simulate(run, 1)), run.file(run.data.file))
    name = f'file = "{run.data.file}"'
    missing = (name, f'{name}\ngyro_file = "none.csv"')
    outcome = calibrate(run_file(tmp_path, SIX_POSITIONS, gyro, missing))
    assert "gyro recording" not in outcome.calibration.provenance


def test_a_table_of_means_and_a_simulation_are_one_file(tmp_path: Path):
    with refused():
        read(run_file(tmp_path, FERRARIS, TWO_FILES, ("[data]", '[data]\nkind = "means"')))
    run = read(run_file(tmp_path, FERRARIS, TWO_FILES))
    with refused():
        apply_data_columns(run, simulate(run, 1))
