"""Times from the counter of packets."""

import re
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.recordings.io.read import Columns, read_recording
from inercal.recordings.io.time_stamps import times_from_counter


def test_times_from_a_counter_have_gaps_where_packets_are_lost():
    sent = np.arange(5000)
    kept = np.random.default_rng(2).random(sent.size) > 0.05
    kept[0] = True
    for modulus in (16, 256, 65536):
        times = times_from_counter(sent[kept] % modulus, modulus, 200.0)
        np.testing.assert_allclose(times, sent[kept] / 200.0, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("counter", "modulus", "key"),
    [
        ([0, 1, 1, 2], 256, None),
        ([0, 1, 3, 2, 4], 256, None),
        ([0, 1, 256], 256, None),
        ([0, 1.5], 256, None),
        ([0, float("nan")], 256, None),
        ([0, 1], 2, "modulus"),
        ([*range(256)] * 3, 65536, "modulus"),
        ([0, 1, 2, 3, 200], 256, None),
    ],
)
def test_impossible_counters_are_refused(counter: list[float], modulus: int, key: str | None):
    with refused(key=key):
        times_from_counter(counter, modulus, 100.0)


COLUMNS = Columns((("ax", "x", "g"),), "packet", "sample", 100.0, modulus=16)


def saved(folder: Path, counts: list[int]) -> Path:
    rows = [f"{count},{k % 7}" for k, count in enumerate(counts)]
    path = folder / "log.csv"
    path.write_text("\n".join(["packet,x", *rows]) + "\n", encoding="utf-8")
    return path


def test_a_recording_has_the_times_of_its_packets_and_a_finding_of_those_lost(tmp_path: Path):
    sent = [k for k in range(400) if k not in (100, 101, 250)]
    read = read_recording(saved(tmp_path, [k % 16 for k in sent]), COLUMNS)
    np.testing.assert_allclose(read.time, np.array(sent) / 100, rtol=0, atol=1e-12)
    (gap,) = (finding for finding in read.findings if finding.what == "gap")
    assert (gap.start, gap.stop) == (99, 101)
    assert len(read.gaps) == 2


@pytest.mark.parametrize(("rate", "unit", "size"), [(104.0, "ms", 1e3), (400.0, "us", 1e6)])
def test_times_that_were_stated_as_a_counter_are_refused_with_their_unit(
    tmp_path: Path, rate: float, unit: str, size: float
):
    stamps = np.floor(np.arange(500) * size / (1.004 * rate)).astype(int).tolist()
    columns = Columns((("ax", "x", "g"),), "packet", "sample", rate)
    with refused(file="log.csv", key="time_unit", names=("packet",)) as refusal:
        read_recording(saved(tmp_path, stamps), columns)
    assert f'time_unit = "{unit}"' in str(refusal.value)
    (found,) = re.findall(r"gives ([\d.]+) Hz", str(refusal.value))
    assert float(found) == pytest.approx(1.004 * rate, rel=1e-3)


def test_a_counter_of_which_every_tenth_sample_is_stored_is_accepted(tmp_path: Path):
    counts = list(range(0, 4000, 10))
    read = read_recording(
        saved(tmp_path, counts), Columns((("ax", "x", "g"),), "packet", "sample", 1000.0)
    )
    np.testing.assert_allclose(read.time, np.array(counts) / 1000, rtol=0, atol=1e-12)
    assert not len(read.gaps)


def test_an_impossible_counter_names_its_file(tmp_path: Path):
    with refused(file="log.csv"):
        read_recording(saved(tmp_path, [0, 1, 2, 2, 3]), COLUMNS)


def test_a_modulus_without_a_time_column_is_refused():
    with refused(key="modulus"):
        Columns((("ax", "x", "g"),), rate_hz=100.0, modulus=16)
