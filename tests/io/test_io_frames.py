"""Tables in memory are recordings like those of files."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests.refusals import refused

from inercal.recordings.io.column_table import ReadRequest
from inercal.recordings.io.frames import recording_from_frame, table_from_frame
from inercal.recordings.io.read import Columns, read_recording

pd: Any = pytest.importorskip("pandas", reason="pandas is of the development environment")
N = 200
RNG = np.random.default_rng(3)
DATA: dict[str, Any] = {
    "t": np.arange(N) / 100,
    "ax": RNG.normal(size=N),
    "ay": RNG.normal(size=N).astype(np.float32),
    "n": RNG.integers(-3000, 3000, N),
    "label": [f"p{k // 50}" for k in range(N)],
    "temp": np.linspace(20, 25, N),
}
COLUMNS = Columns(
    (("x", "ax", "g"), ("y", "ay", "g"), ("z", "n", "LSB")),
    time="t",
    label="label",
    temperature="temp",
)


def structured(data: dict[str, Any]) -> np.ndarray:
    kinds = [(name, np.asarray(column).dtype) for name, column in data.items()]
    made = np.empty(N, np.dtype(kinds))
    for name, column in data.items():
        made[name] = column
    return made


FRAMES: dict[str, Callable[[dict[str, Any]], Any]] = {
    "mapping": dict,
    "structured": structured,
    "pandas": pd.DataFrame,
    "pandas by time": lambda data: pd.DataFrame(data).set_index("t"),
    "pandas category": lambda data: pd.DataFrame(data).astype({"label": "category"}),
    "arrow": pa.table,
    "arrow batch": lambda data: pa.table(data).to_batches()[0],
    "arrow chunks": lambda data: pa.concat_tables(
        [pa.table(data).slice(0, 70), pa.table(data).slice(70)]
    ),
    "arrow dictionary": lambda data: pa.table(
        data | {"label": pa.array(data["label"]).dictionary_encode()}
    ),
}


@pytest.mark.parametrize("kind", FRAMES)
def test_a_table_in_memory_is_the_recording_of_its_file(kind: str, tmp_path: Path):
    path = tmp_path / "a.npz"
    np.savez(path, allow_pickle=False, **{k: np.asarray(v) for k, v in DATA.items()})
    expected = read_recording(path, COLUMNS)
    found = recording_from_frame(FRAMES[kind](DATA), COLUMNS)
    assert found.data.tobytes() == expected.data.tobytes()
    assert found.time.tobytes() == expected.time.tobytes()
    assert found.labels is not None
    assert expected.labels is not None
    assert found.labels.tolist() == expected.labels.tolist()
    assert found.temperature is not None
    assert expected.temperature is not None
    assert found.temperature.tobytes() == expected.temperature.tobytes()
    assert found.findings == expected.findings


def test_the_hash_is_that_of_the_values_whatever_the_table():
    digests = {recording_from_frame(make(DATA), COLUMNS).sha256 for make in FRAMES.values()}
    assert len(digests) == 1
    other = DATA | {"ax": DATA["ax"] + 1e-12}
    assert recording_from_frame(other, COLUMNS).sha256 not in digests


def test_the_table_is_not_changed():
    frame = pd.DataFrame(DATA)
    frame.loc[7, "ax"] = np.nan
    before = frame.copy()
    columns = Columns(COLUMNS.channels, time="t", nonfinite="drop")
    found = recording_from_frame(frame, columns)
    assert found.time.size == N - 1
    pd.testing.assert_frame_equal(frame, before)


@pytest.mark.parametrize("zone", [None, "UTC", "Europe/Paris"])
def test_dates_are_times(zone: str | None):
    at = pd.date_range("2026-11-25T14:00:00.25", periods=N, freq="10ms", tz=zone)
    found = recording_from_frame(pd.DataFrame(DATA | {"t": at}), COLUMNS)
    np.testing.assert_allclose(found.time, DATA["t"], atol=1e-9)
    assert found.origin == at[0].tz_localize(zone or "UTC").value if zone is None else at[0].value
    again = recording_from_frame(pd.DataFrame(DATA).set_index(at.rename("when")), COLUMNS)
    assert again.time.size == N


def test_durations_are_seconds():
    at = pd.to_timedelta(DATA["t"], unit="s")
    found = recording_from_frame(pd.DataFrame(DATA | {"t": at}), COLUMNS)
    np.testing.assert_allclose(found.time, DATA["t"], atol=1e-9)


@pytest.mark.parametrize("missing", [None, pd.NA])
def test_missing_numbers_are_not_finite(missing: Any):
    counts: list[Any] = DATA["n"].tolist()
    counts[9] = missing
    frame = pd.DataFrame(DATA | {"n": pd.array(counts, dtype="Int64")})
    with refused(names=("z",)):
        recording_from_frame(frame, COLUMNS)
    table = pa.table(DATA | {"n": pa.array([None if c is pd.NA else c for c in counts])})
    with refused(names=("z",)):
        recording_from_frame(table, COLUMNS)


@pytest.mark.parametrize(
    ("frame", "data"),
    [
        ([1, 2, 3], {}),
        (DATA | {"ax": DATA["ax"][1:]}, {}),
        (DATA | {"ax": DATA["ax"] + 1j}, {"names": ("ax",)}),
        (DATA | {"ax": np.zeros((N, 2))}, {"names": ("ax",)}),
        (DATA | {"ax": ["word"] * N}, {"names": ("ax",)}),
        ({k: v for k, v in DATA.items() if k != "ay"}, {"names": ("ay",)}),
        ({k: v[:0] for k, v in DATA.items()}, {}),
    ],
)
def test_what_is_no_table_of_these_columns_is_refused(frame: Any, data: dict[str, Any]):
    with refused(**data) as caught:
        recording_from_frame(frame, COLUMNS, name="session")
    assert "session" in str(caught.value)


def test_a_second_file_has_no_place_in_memory():
    columns = Columns(COLUMNS.channels, time="t", second=(("gx", "gx", "°/s"),))
    with refused(key="columns"):
        recording_from_frame(DATA, columns)


def test_whole_numbers_are_labels_where_labels_are_wanted():
    request = ReadRequest(["n"], ["n"])
    assert table_from_frame(DATA, request).columns["n"].tolist() == [str(k) for k in DATA["n"]]


def test_the_snippet_of_the_page_makes_a_recording(capsys: pytest.CaptureFixture[str]):
    page = Path(__file__).parents[2] / "docs/how-to/recordings.md"
    snippets = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.S)
    (snippet,) = (one for one in snippets if "frame" in one)
    exec(snippet, {})
    rate, digest = capsys.readouterr().out.split()
    assert float(rate) == pytest.approx(100)
    assert len(digest) == 64
