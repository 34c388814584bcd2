"""The memory of the command on long hand-held recordings."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.long_recording import NAMES, SAVE, measure_command, run_file, write_raw_file

SIZES = (500_000, 1_500_000)
RATE, EVERY = 1000.0, 5.0  # Hz, s from one rest to the next: 100 rests, and 300
NUMBERS = 8 * len(NAMES)  # bytes of a sample


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[NDArray[np.float64]]:
    folder = tmp_path_factory.mktemp("long")
    return [write_raw_file(folder / f"{n}.npy", n, RATE, EVERY) for n in SIZES]


@pytest.mark.evidence
@pytest.mark.parametrize(
    "suffix",
    [s if s == ".npz" else pytest.param(s, marks=pytest.mark.evidence) for s in SAVE],
)
def test_a_longer_recording_takes_less_than_twice_its_numbers(
    tmp_path: Path, recordings: list[NDArray[np.float64]], suffix: str
):
    memory: list[float] = []
    for columns in recordings:
        path = tmp_path / f"{columns.shape[1]}{suffix}"
        SAVE[suffix](path, columns)
        memory.append(measure_command(run_file(path)).memory)
    # At 10⁷ samples 1.4 GB in all, with 0.3 GB for the program itself.
    assert memory[1] - memory[0] < 2 * NUMBERS * (SIZES[1] - SIZES[0])
