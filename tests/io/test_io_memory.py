"""A recording of hours takes little more memory than its numbers, whatever the file."""

import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv  # here: its modules are no memory of a table
import pyarrow.parquet as pq
import pytest
from tests.base_seeds import evidence

from inercal.physics.sensors import imu
from inercal.recordings import Recording
from inercal.recordings.io.audit import audit
from inercal.recordings.io.column_table import BLOCK_ROWS
from inercal.recordings.io.read import Columns, read_recording
from inercal.recordings.io.rest_norm import audit_rest_norm

pa.array([1.0]).to_numpy()  # here: it imports pandas, which is no memory of a table either
N = 200_000
AXES = ("ax", "ay", "az", "gx", "gy", "gz")
COLUMNS = Columns(tuple((a, a, "m/s²" if a[0] == "a" else "rad/s") for a in AXES), time="time")
SIZE = 7 * 8 * N  # bytes of the numbers themselves


def values(step: float = 0.0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(4)
    made = {name: rng.normal(scale=0.02, size=N) for name in AXES}
    made["az"] += 9.81
    if step:
        made = {name: np.round(column / step) * step for name, column in made.items()}
    return {"time": np.arange(N) / 100} | made


def save_csv(path: Path, columns: dict[str, np.ndarray]) -> None:
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(columns) + "\n")
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        file.writelines(f"{','.join(f'{value:.4f}' for value in row)}\n" for row in rows)


def save_npz(path: Path, columns: dict[str, np.ndarray]) -> None:
    np.savez(path, allow_pickle=False, **columns)


def save_parquet(path: Path, columns: dict[str, np.ndarray]) -> None:
    pq.write_table(pa.table(columns), path)


def save_hdf5(path: Path, columns: dict[str, np.ndarray]) -> None:
    h5py = pytest.importorskip("h5py", reason="HDF5 files need the extra inercal[io]")
    with h5py.File(path, "w") as file:
        for name, column in columns.items():
            file.create_dataset(name, data=column, chunks=(50_000,), compression="gzip")


@pytest.fixture
def peak() -> Iterator[Callable[[], int]]:
    """Most bytes that NumPy and Python have held since the test asked first."""
    tracemalloc.start()
    yield lambda: tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()


@pytest.mark.slow
@pytest.mark.parametrize("save", [save_csv, evidence(save_npz), evidence(save_parquet), save_hdf5])
def test_reading_and_auditing_need_less_than_double(
    tmp_path: Path,
    save: Callable[[Path, dict[str, np.ndarray]], None],
    request: pytest.FixtureRequest,
):
    suffix = save.__name__.removeprefix("save_")
    path = tmp_path / f"run.{suffix}"
    save(path, values())
    peak: Callable[[], int] = request.getfixturevalue("peak")
    read = audit_rest_norm(read_recording(path, COLUMNS), imu(), 9.81)
    assert peak() < 1.75 * SIZE
    assert read.findings == ()
    assert read.data.flags.c_contiguous
    assert read.data.shape == (N, 6)


@pytest.mark.parametrize("fault", ["nan", "repeated", "quantised"])
def test_a_faulty_recording_needs_no_second_copy(
    tmp_path: Path, fault: str, request: pytest.FixtureRequest
):
    columns = values(step=0.02 if fault == "quantised" else 0)
    if fault == "nan":
        columns["gy"][7] = np.nan
    if fault == "repeated":
        for column in columns.values():
            column[1::1000] = column[::1000]
    save_npz(tmp_path / "run.npz", columns)
    dropping = Columns(COLUMNS.channels, time="time", nonfinite="drop")
    peak: Callable[[], int] = request.getfixturevalue("peak")
    read = read_recording(tmp_path / "run.npz", dropping)
    assert peak() < 1.95 * SIZE
    assert len(read.time) == N - {"nan": 1, "repeated": N // 1000, "quantised": 0}[fault]
    if read.original is not None:
        np.testing.assert_array_equal(read.data[:, 4], columns["gy"][read.original])
        np.testing.assert_array_equal(read.time, columns["time"][read.original])


def test_an_audit_leaves_the_recording_it_is_given_unless_told_otherwise():
    columns = values()
    columns["gy"][7] = np.nan
    data = np.stack([columns[name] for name in AXES], axis=-1)
    made = Recording(columns["time"], data, AXES, ("1",) * 6, labels=np.repeat(["a", "b"], N // 2))
    copied = audit(made, nonfinite="drop")
    assert np.isnan(made.data[7, 4])
    moved = audit(made, nonfinite="drop", in_place=True)
    for name in ("time", "data", "labels", "original"):
        np.testing.assert_array_equal(getattr(moved, name), getattr(copied, name))
    assert moved.findings == copied.findings
    assert np.shares_memory(moved.data, made.data)


def test_what_is_found_does_not_depend_on_where_blocks_end():
    rng = np.random.default_rng(8)
    n = 2 * BLOCK_ROWS + 1
    step = np.full(n - 1, 0.01) + rng.normal(scale=1e-4, size=n - 1)
    step[[BLOCK_ROWS - 2, BLOCK_ROWS - 1, BLOCK_ROWS, 2 * BLOCK_ROWS - 1]] = 1.0
    time = np.concatenate([[0.0], np.cumsum(step)])
    made = Recording(time, rng.normal(size=(n, 1)), ("x",), ("g",))
    ordinary = np.delete(np.diff(time), made.gaps[:, 0]) - made.median_step
    gap, jitter = audit(made).findings
    assert gap.message.startswith("4 gaps, 3.96 s lost")
    assert f"vary by {np.sqrt(np.mean(ordinary**2)):.3g} s rms" in jitter.message


@pytest.mark.parametrize("extra", [-1, 0, 1])
def test_text_is_read_whole_around_the_end_of_a_block(tmp_path: Path, extra: int):
    path = tmp_path / "run.csv"
    n = BLOCK_ROWS + extra
    rows = [f"{k},p{k % 3}" for k in range(n)]
    path.write_text("t,part\n" + "\n".join(rows) + "\n\n")
    read = read_recording(path, Columns((("x", "t", "g"),), rate_hz=1.0, label="part"))
    np.testing.assert_array_equal(read.data[:, 0], np.arange(n))
    assert read.labels is not None
    assert read.labels[-1] == f"p{(n - 1) % 3}"
    assert read.where(n - 1) == f"line {n + 1}"
