"""Recordings of fourteen formats with bytes changed anywhere: read, or refused by one line."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from tests.base_seeds import evidence, slow
from tests.fuzz.recording_mutations import FORMATS, outcomes

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", FORMATS)
def test_a_mutated_recording_is_read_or_refused_by_one_line(name: str, tmp_path: Path):
    told = outcomes(name, tmp_path, 0, 3)["told"]
    assert sum(told.values()) == 3


@pytest.mark.parametrize(
    ("name", "count"),
    [
        *(slow(name, 20) for name in list(FORMATS)[::2]),
        *(evidence(name, 1430) for name in FORMATS),  # 20 020 of all formats
    ],
)
def test_no_mutation_takes_a_gigabyte_or_ends_the_program(name: str, count: int):
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz.recording_mutations", name, str(count), str(count)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert sum(found["told"].values()) == count
    assert found["told"]["refused"] > count / 3
    assert max(found["memory"]) < 1_000_000  # kB
