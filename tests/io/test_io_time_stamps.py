"""Times of samples: units that stamps betray, ISO 8601 text, and stamps that come in bursts."""

from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.recordings import Recording
from inercal.recordings.io.audit import audit
from inercal.recordings.io.read import Columns, read_recording

CHANNELS = (("x", "ax", "g"), ("y", "ay", "g"))
N = 400


def log(folder: Path, times: list[str], name: str = "time", seed: int = 1) -> Path:
    """Write a log with these times beside two channels of noise."""
    data = np.random.default_rng(seed).normal(size=(len(times), 2))
    rows = [f"{t},{x:.6f},{y:.6f}" for t, (x, y) in zip(times, data.tolist(), strict=True)]
    path = folder / "run.csv"
    path.write_text("\n".join([f"{name},ax,ay", *rows]) + "\n", encoding="utf-8")
    return path


def read(path: Path, unit: str | None = None, name: str = "time") -> Recording:
    return read_recording(path, Columns(CHANNELS, time=name, time_unit=unit))


def stamps(step: float, start: float = 0.0) -> list[str]:
    return [f"{start + k * step:.9g}" for k in range(N)]


@pytest.mark.parametrize(("step", "fitting"), [(10.0, "ms"), (10_000.0, "us"), (1e7, "ns")])
def test_stamps_of_less_than_one_sample_a_second_are_refused(
    tmp_path: Path, step: float, fitting: str
):
    path = log(tmp_path, stamps(step))
    for unit in (None, "s"):
        with refused(file="run.csv", key="time_unit", names=["time"]) as refusal:
            read(path, unit)
        assert f'time_unit = "{fitting}" (100 Hz)' in str(refusal.value)
    assert read(path, fitting).rate_hz == pytest.approx(100)


def test_stamps_of_more_than_50_khz_are_refused(tmp_path: Path):
    path = log(tmp_path, stamps(0.005))
    with refused(key="time_unit") as refusal:
        read(path, "ms")
    assert 'time_unit = "s" (200 Hz)' in str(refusal.value)
    assert read(path).rate_hz == pytest.approx(200)


@pytest.mark.parametrize("rate", [1.0, 10.0, 1000.0, 50e3])
def test_rates_of_1_hz_to_50_khz_are_read(tmp_path: Path, rate: float):
    assert read(log(tmp_path, stamps(1 / rate)), "s").rate_hz == pytest.approx(rate)


@pytest.mark.parametrize("rate", [1000.0, 2000.0, 4000.0])
def test_fast_stamps_in_ms_do_not_pass_for_slow_ones_in_s(tmp_path: Path, rate: float):
    path = log(tmp_path, stamps(1000 / rate))
    with refused(key="time_unit") as refusal:
        read(path)
    assert f'time_unit = "ms" ({rate:.4g} Hz)' in str(refusal.value)
    assert read(path, "ms").rate_hz == pytest.approx(rate)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("time_ms", "ms"),
        ("t [ms]", "ms"),
        ("stamp.us", "us"),
        ("time_µs", "us"),
        ("TIMESTAMP_NS", "ns"),
        ("uptime(msec)", "ms"),
    ],
)
def test_a_column_named_by_another_unit_needs_a_stated_one(tmp_path: Path, name: str, unit: str):
    # At 0.01 between rows the rate would be plausible in s.
    path = log(tmp_path, stamps(0.01), name)
    with refused(key="time_unit", names=[name]) as refusal:
        read(path, name=name)
    assert f'time_unit = "{unit}"' in str(refusal.value)
    assert read(path, "s", name).rate_hz == pytest.approx(100)


@pytest.mark.parametrize("name", ["t_s", "time (s)", "uptime sec"])
def test_slow_logs_need_no_unit_if_the_column_names_seconds(tmp_path: Path, name: str):
    path = log(tmp_path, stamps(0.5), name)
    assert read(path, name=name).rate_hz == pytest.approx(2)
    with refused(key="time_unit"):
        read(log(tmp_path, stamps(0.5)))


@pytest.mark.parametrize("name", ["time", "items", "columns", "t_s", "bonus", "ms_time"])
def test_other_names_of_columns_say_nothing_of_units(tmp_path: Path, name: str):
    assert read(log(tmp_path, stamps(0.01), name), name=name).rate_hz == pytest.approx(100)


@pytest.mark.parametrize(("start", "unit"), [(1.795e12, "ms"), (1.795e15, "us"), (1.795e18, "ns")])
def test_stamps_since_1970_name_their_unit(tmp_path: Path, start: float, unit: str):
    step = {"ms": 10, "us": 10_000, "ns": 10**7}[unit]
    times = [str(int(start) + k * step) for k in range(N)]
    path = log(tmp_path, times)
    with refused(key="time_unit") as refusal:
        read(path)
    assert f'time_unit = "{unit}"' in str(refusal.value)
    assert read(path, unit).rate_hz == pytest.approx(100, rel=1e-4)


def test_seconds_since_1970_are_seconds(tmp_path: Path):
    times = [f"{1_795_000_000 + k / 100:.3f}" for k in range(N)]
    path = log(tmp_path, times)
    assert read(path).rate_hz == pytest.approx(100, rel=1e-3)
    with refused(key="time_unit"):
        read(path, "ms")


def iso(k: int, zone: timezone = UTC, fraction: str = "microseconds") -> str:
    at = datetime(2026, 11, 23, 23, 59, 58, tzinfo=zone) + timedelta(milliseconds=10 * k)
    return at.isoformat(timespec=fraction)


def test_iso_8601_times_are_seconds_from_the_first(tmp_path: Path):
    expected = np.arange(N) / 100  # across midnight
    east = timezone(timedelta(hours=5, minutes=30))
    for times in (
        [iso(k) for k in range(N)],
        [iso(k).replace("+00:00", "Z") for k in range(N)],
        [iso(k, fraction="milliseconds").replace("T", " ")[:-6] for k in range(N)],
        [iso(k).replace("-", "", 2).replace(":", "", 2) for k in range(N)],
        [iso(k).replace("000+00:00", "000000Z") for k in range(N)],
    ):
        np.testing.assert_allclose(read(log(tmp_path, times)).time, expected, atol=1e-12)
    mixed = [
        datetime.fromisoformat(iso(k)).astimezone(east if k % 2 else UTC).isoformat()
        for k in range(N)
    ]
    np.testing.assert_allclose(read(log(tmp_path, mixed)).time, expected, atol=1e-12)


@pytest.mark.parametrize(
    "bad",
    ["2026-13-23T03:10:09Z", "2026-11-23T03:10:61Z", "2026-11-23T03:10:09.123", "yesterday", ""],
)
def test_a_bad_iso_8601_time_is_refused_with_its_line(tmp_path: Path, bad: str):
    times = [iso(k) for k in range(N)]
    times[70] = bad
    with refused(file="run.csv", line=72, names=["time"]):
        read(log(tmp_path, times))


@pytest.mark.parametrize(
    "text", ["%H:%M:%S.%f", "%H:%M:%S:%f", "%Y/%m/%d %H:%M:%S.%f", "%Y%m%dT%H%M%S.%f"]
)
def test_times_of_day_and_other_dates_pass_midnight(tmp_path: Path, text: str):
    start = datetime(2026, 11, 29, 23, 59, 50, tzinfo=UTC)
    cells = [(start + timedelta(milliseconds=10 * k)).strftime(text) for k in range(2000)]
    found = read(log(tmp_path, cells))
    np.testing.assert_allclose(found.time, 0.01 * np.arange(2000), rtol=0, atol=1e-9)


def test_iso_8601_times_take_no_unit(tmp_path: Path):
    with refused(key="time_unit", names=["time"]):
        read(log(tmp_path, [iso(k) for k in range(N)]), "s")


def test_dates_of_two_files_of_one_recording_are_compared(tmp_path: Path):
    (tmp_path / "b").mkdir()
    first = log(tmp_path, [iso(k) for k in range(N)])
    columns = Columns(CHANNELS, time="time", second=(("p", "ax", "g"), ("q", "ay", "g")))
    same = log(tmp_path / "b", [iso(k) for k in range(N)], seed=2)
    assert read_recording(first, columns, second=same).time[-1] == pytest.approx((N - 1) / 100)
    later = log(tmp_path / "b", [iso(k + 100) for k in range(N)], seed=2)
    with refused(file="run.csv", line=2):
        read_recording(first, columns, second=later)


def bursts(n: int, size: int, rng: np.random.Generator, inside: float = 0.002) -> np.ndarray:
    """Return arrival times of samples at 100 Hz that are sent so many at a time."""
    sent = (np.arange(n) // size + 1) * size / 100
    late = np.repeat(rng.exponential(0.001, -(-n // size)), size)[:n]
    return sent + late + (np.arange(n) % size) * inside


def recording(time: np.ndarray) -> Recording:
    data = np.random.default_rng(2).normal(size=(time.size, 2))
    return Recording(time, data, ("x", "y"), ("g", "g"), source="run.csv")


@pytest.mark.parametrize("size", [3, 5, 10])
@pytest.mark.parametrize("pause", [0.0, 20.0])
def test_bursts_are_called_bursts_with_the_mean_rate(size: int, pause: float):
    time = bursts(20_000, size, np.random.default_rng(size))
    time[10_000 - 10_000 % size :] += pause
    found = audit(recording(time)).findings
    assert [(f.severity, f.what) for f in found] == [("refused", "bursts")]
    assert 'rate = "100 Hz"' in found[0].message


@pytest.mark.parametrize("kept", [0.95, 0.8, 0.65, 0.5, 0.3])
def test_lost_samples_are_no_bursts(kept: float):
    rng = np.random.default_rng(4)
    time = np.flatnonzero(rng.random(20_000) < kept) / 100
    assert "bursts" not in {f.what for f in audit(recording(time)).findings}
