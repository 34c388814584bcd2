"""Times from the counter of packets."""

from pathlib import Path

import numpy as np
import pytest

from inercal.errors import InputError
from inercal.io.packet_counter import times_from_counter
from inercal.io.read import Columns, read_recording


def test_times_from_a_counter_have_gaps_where_packets_are_lost():
    sent = np.arange(5000)
    kept = np.random.default_rng(2).random(sent.size) > 0.05
    kept[0] = True
    for modulus in (16, 256, 65536):
        times = times_from_counter(sent[kept] % modulus, modulus, 200.0)
        np.testing.assert_allclose(times, sent[kept] / 200.0, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("counter", "modulus", "said"),
    [
        ([0, 1, 1, 2], 256, "1 at sample 2 comes twice"),
        ([0, 1, 3, 2, 4], 256, "2 at sample 3 follows 3: packets out of order"),
        ([0, 1, 256], 256, "sample 2 has 256"),
        ([0, 1.5], 256, "sample 1 has 1.5"),
        ([0, float("nan")], 256, "sample 1 has nan"),
        ([0, 1], 2, "at least 3"),
        ([*range(256)] * 3, 65536, r"after 255 it begins again at 0 \(sample 256\), so that"),
        ([0, 1, 2, 3, 200], 256, "200 at sample 4 follows 3: packets out of order, or 128 packets"),
    ],
)
def test_counters_that_cannot_be_are_refused_in_one_line(
    counter: list[float], modulus: int, said: str
):
    with pytest.raises(InputError, match=said) as caught:
        times_from_counter(counter, modulus, 100.0)
    assert "\n" not in str(caught.value)


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
    assert gap.message.startswith("2 gaps, 0.03 s lost in all, 0.02 s in the longest")


def test_a_counter_that_cannot_be_names_its_file(tmp_path: Path):
    with pytest.raises(InputError, match=r"log.csv: counter: 2 at sample 3 comes twice"):
        read_recording(saved(tmp_path, [0, 1, 2, 2, 3]), COLUMNS)


def test_a_modulus_without_a_counter_is_refused():
    with pytest.raises(InputError, match="modulus 16 is of a time column that counts samples"):
        Columns((("ax", "x", "g"),), "packet", modulus=16)
