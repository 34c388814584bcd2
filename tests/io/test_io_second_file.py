"""Gyros in a file of their own, sampled together with the accelerometers."""

from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused
from tests.runfile.run_file_texts import FERRARIS, SIX_POSITIONS, run_file

from inercal.pipeline import apply_data_columns, calibrate, simulate
from inercal.recordings import Recording
from inercal.recordings.io.read import Columns, read_recording
from inercal.recordings.io.write import write_recording
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
        (["t,x,y", *lines(10)[1:3], "s,°/s,°/s", *lines(10)[3:]], 4, ["t"]),
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_run_file_with_gyro_times_joins_what_one_file_gives(tmp_path: Path):
    _simulated(tmp_path)
    run = read(run_file(tmp_path, FERRARIS))
    made = _some(apply_data_columns(run, simulate(run, 1)), slice(3, 6))
    late = replace(made, time=made.time + 0.001, time_name="gyro_time")
    write_recording(late, tmp_path / "gyr.npz")
    one = calibrate(run_file(tmp_path, FERRARIS))
    (name, two) = TWO_FILES
    found = calibrate(run_file(tmp_path, FERRARIS, (name, f'{two}\ngyro_time = "gyro_time"')))
    np.testing.assert_array_equal(found.calibration.values, one.calibration.values)
    with refused():
        read(run_file(tmp_path, FERRARIS, (name, f'{name}\nkind = "means"\ngyro_time = "t"')))


def test_a_method_without_gyros_leaves_their_file_alone(tmp_path: Path):
    run = read(run_file(tmp_path, SIX_POSITIONS))
    write_recording(apply_data_columns(run, simulate(run, 1)), run.file(run.data.file))
    name = f'file = "{run.data.file}"'
    missing = (name, f'{name}\ngyro_file = "none.csv"')
    outcome = calibrate(run_file(tmp_path, SIX_POSITIONS, missing))
    assert "gyro recording" not in outcome.calibration.provenance


def test_a_table_of_means_and_a_simulation_are_one_file(tmp_path: Path):
    with refused():
        read(run_file(tmp_path, FERRARIS, TWO_FILES, ("[data]", '[data]\nkind = "means"')))
    run = read(run_file(tmp_path, FERRARIS, TWO_FILES))
    with refused():
        apply_data_columns(run, simulate(run, 1))


OWN_TIMES = Columns(
    ACC, time="t", second=(("gx", "x", "°/s"), ("gy", "y", "°/s")), second_time="gyro_time"
)


def gyro_lines(t: np.ndarray) -> list[str]:
    """Return rows of gyros at other times, whose x is their number."""
    return ["gyro_time,x,y", *(f"{a:.6f},{k},{k % 3}" for k, a in enumerate(t))]


@pytest.mark.parametrize(("rate", "count"), [(100, 220), (250, 600), (40, 75)])
def test_gyros_of_other_times_are_joined_by_the_nearest(tmp_path: Path, rate: int, count: int):
    t = 0.0013 + np.arange(count) / rate
    first, second = saved(tmp_path, lines(1), gyro_lines(t))
    found = read_recording(first, OWN_TIMES, second=second)
    times = np.arange(N) / 100
    base = times if rate >= 100 else t[t < times[-1] + 0.0075]
    np.testing.assert_allclose(found.time, base, atol=1e-9)
    assert found.data[:, 2].tolist() == [np.abs(t - a).argmin() for a in base]
    assert found.data[:, 0].tolist() == [np.abs(times - a).argmin() % 7 for a in base]
    assert (found.channels, found.source) == (("ax", "ay", "gx", "gy"), "acc.csv and gyr.csv")


def test_a_missing_value_is_named_with_its_file_and_line_if_the_times_differ(tmp_path: Path):
    wrong = lines(1)
    wrong[60] = "0.59,,1"
    shifted = np.arange(N) / 100 + 0.0021
    first, second = saved(tmp_path, wrong, lines(10, shifted))
    timed = replace(COLUMNS, second_time="t")
    with refused(file="acc.csv") as refusal:
        read_recording(first, timed, second=second)
    assert "line 61" in str(refusal.value)


def test_samples_without_a_partner_are_a_gap(tmp_path: Path):
    t = np.delete(np.arange(N) / 100, slice(60, 80))
    first, second = saved(tmp_path, lines(1), gyro_lines(t))
    found = read_recording(first, OWN_TIMES, second=second)
    assert found.time.size == N - 20
    assert [f.what for f in found.findings if f.what == "gap"] == ["gap"]


def test_a_second_pair_of_columns_may_be_in_the_same_file(tmp_path: Path):
    path = tmp_path / "both.csv"
    t = np.arange(N) / 100
    rows = [f"{a:.4f},{k % 7},{k % 5},{a + 0.004:.4f},{k}" for k, a in enumerate(t)]
    path.write_text("\n".join(["t,x,y,gyro_time,w", *rows]) + "\n", encoding="utf-8")
    columns = Columns(ACC, time="t", second=(("gx", "w", "°/s"),), second_time="gyro_time")
    found = read_recording(path, columns, second=path)
    assert found.data[:, 2].tolist() == list(range(N))
    assert found.source == "both.csv"


@pytest.mark.parametrize("times", ["later", "back", "missing"])
def test_times_that_cannot_be_joined_are_refused(tmp_path: Path, times: str):
    t = np.arange(N) / 100
    t = {"later": t + 100, "back": np.roll(t, 50), "missing": np.where(t == 0.5, np.nan, t)}[times]
    first, second = saved(tmp_path, lines(1), gyro_lines(t))
    line = {"later": None, "back": 52, "missing": 52}[times]
    with refused(line=line):
        read_recording(first, OWN_TIMES, second=second)


@pytest.mark.parametrize(
    "changes", [{"second": ()}, {"time": None, "rate_hz": 100.0}, {"time_unit": "sample"}]
)
def test_a_second_time_needs_a_second_file_and_a_first_time(changes: dict[str, object]):
    with refused():
        replace(OWN_TIMES, **changes)  # type: ignore[arg-type]
