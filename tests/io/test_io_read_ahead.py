"""Long files of one recording are read at the same time, with the same result."""

import threading
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inercal.basics.errors import InputError
from inercal.recordings import Recording
from inercal.recordings.io import read
from inercal.recordings.io.read import Columns, read_recording
from inercal.recordings.io.section_files import read_sections

COLUMNS = Columns((("x", "x", "g"), ("y", "y", "g")), time="t")
N = 500
Read = Callable[[], Recording]


def _write_csv(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    rows = np.column_stack([*columns.values()])
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="")


def _write_h5(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file.create_dataset(name, data=values, compression="gzip")


WRITERS: dict[str, Callable[..., Any]] = {
    ".csv": _write_csv,
    ".npz": lambda path, columns: np.savez_compressed(path, **columns),
    ".h5": _write_h5,
}


def written(folder: Path, suffix: str, count: int = 5) -> list[Path]:
    """Write files whose times do not overlap."""
    rng = np.random.default_rng(4)
    paths = [folder / f"rest_{k}{suffix}" for k in range(count)]
    for k, path in enumerate(paths):
        x, y = rng.normal(size=(2, N))
        WRITERS[suffix](path, {"t": np.arange(N) / 100 + 10 * k, "x": x, "y": y})
    return paths


def one_by_one(monkeypatch: pytest.MonkeyPatch, work: Read) -> Recording:
    """Read as on a machine with one core."""
    with monkeypatch.context() as patch:
        patch.setattr(read, "available_cores", lambda: 1)
        return work()


@pytest.fixture
def readers(monkeypatch: pytest.MonkeyPatch) -> set[int]:
    """Count short files as long, on a machine with three cores; collect the reading threads."""
    found, read_one = set[int](), read._read  # pyright: ignore[reportPrivateUsage]

    def noted(*arguments: Any) -> object:
        found.add(threading.get_ident())
        return read_one(*arguments)

    monkeypatch.setattr(read, "_read", noted)
    monkeypatch.setattr(read, "_LONG", 0)
    monkeypatch.setattr(read, "available_cores", lambda: 3)
    return found


def require_equal(one: Recording, other: Recording) -> None:
    for field in fields(Recording):
        found, expected = getattr(one, field.name), getattr(other, field.name)
        if isinstance(expected, np.ndarray):
            np.testing.assert_array_equal(found, expected)
        else:
            assert found == expected, field.name


@pytest.mark.parametrize("suffix", [".h5", ".npz"])
def test_files_read_ahead_give_the_same_recording(
    monkeypatch: pytest.MonkeyPatch, readers: set[int], tmp_path: Path, suffix: str
):
    written(tmp_path, suffix)

    def work() -> Recording:
        return read_sections(tmp_path / f"rest_*{suffix}", COLUMNS)

    expected = one_by_one(monkeypatch, work)
    assert readers == {threading.get_ident()}
    require_equal(work(), expected)
    assert len(readers) > 1


@pytest.mark.parametrize("second_time", [None, "t"])
def test_a_second_file_is_read_ahead_with_the_same_result(
    monkeypatch: pytest.MonkeyPatch, readers: set[int], tmp_path: Path, second_time: str | None
):
    first, other = written(tmp_path, ".npz", 2)
    with np.load(first) as columns:
        WRITERS[".npz"](other, {**columns, "x": -columns["x"], "y": -columns["y"]})
    second = (("u", "x", "°/s"), ("v", "y", "°/s"))
    columns = replace(COLUMNS, second=second, second_time=second_time)

    def work() -> Recording:
        return read_recording(first, columns, second=other)

    expected = one_by_one(monkeypatch, work)
    require_equal(work(), expected)
    assert len(readers) > 1


@pytest.mark.parametrize("suffix", [".h5", ".npz"])
def test_the_error_of_the_first_wrong_file_is_reported(
    monkeypatch: pytest.MonkeyPatch, readers: set[int], tmp_path: Path, suffix: str
):
    paths = written(tmp_path, suffix)
    paths[1].write_bytes(paths[1].read_bytes()[:-40])
    paths[2].write_bytes(b"")
    paths[4].write_bytes(b"\x1f\x8b")

    def message() -> str:
        with pytest.raises(InputError) as found:
            read_sections(tmp_path / f"rest_*{suffix}", COLUMNS)
        return f"{found.value} {found.value.line} {found.value.file}"

    with monkeypatch.context() as patch:
        patch.setattr(read, "available_cores", lambda: 1)
        expected = message()
    assert "rest_1" in expected
    assert [message() for _ in range(3)] == [expected] * 3
    assert len(readers) > 1


@pytest.mark.parametrize(("suffix", "long"), [(".npz", 1 << 20), (".csv", 0)])
def test_short_files_and_text_are_read_by_this_thread(
    monkeypatch: pytest.MonkeyPatch, readers: set[int], tmp_path: Path, suffix: str, long: int
):
    written(tmp_path, suffix)
    monkeypatch.setattr(read, "_LONG", long)
    read_sections(tmp_path / f"rest_*{suffix}", COLUMNS)
    assert readers == {threading.get_ident()}
