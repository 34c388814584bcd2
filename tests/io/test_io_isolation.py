"""A file ends the process that reads it, never the program."""

import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.io import isolated_functions as functions
from tests.refusals import refused

from inercal.recordings.io import isolation
from inercal.recordings.io.isolation import Isolation, read_isolated, stream_isolated

ROOT = Path(__file__).parents[2]
KIND = Isolation("a file of a test", "write it again")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "a.dat").write_text("content", encoding="utf-8")
    return tmp_path / "a.dat"


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (functions.crash, "SIGSEGV"),
        (functions.be_killed, "memory"),
        (functions.hoard, "MB of memory to be read, the limit"),
        (functions.exhaust_the_stack, "is damaged"),
        pytest.param(functions.spin, "1 s of processor time", marks=pytest.mark.slow),
    ],
)
def test_what_ends_the_process_is_one_line_and_the_next_file_is_read(
    path: Path, function: Callable[..., Any], said: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(isolation, "_SECONDS", 1.0)
    monkeypatch.setattr(isolation, "_BASE", 1 << 27)
    with refused(file=path) as refusal:
        read_isolated(KIND, path, function)
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert read_isolated(KIND, path, functions.print_and_read) == "content"


def test_each_file_has_a_process_of_its_own(path: Path):
    seen = {read_isolated(KIND, path, functions.process_id) for _ in range(3)} | {os.getpid()}
    assert len(seen) == 4


def test_a_table_comes_as_it_was_made(path: Path):
    made, got = functions.table(path), read_isolated(KIND, path, functions.table)
    assert vars(got).keys() == vars(made).keys()
    assert list(got.columns) == list(made.columns)
    for name, column in made.columns.items():
        assert got.columns[name].tobytes() == column.tobytes()
        assert got.columns[name].dtype == column.dtype
        shared = np.shares_memory(made.columns[name], made.block)
        assert np.shares_memory(got.columns[name], got.block) == shared
        assert got.columns[name].flags.writeable
    assert made.block is not None
    assert got.block.tobytes() == made.block.tobytes()


def test_a_stream_that_breaks_off_leaves_nothing_of_it_to_the_next_file(path: Path):
    some = stream_isolated(KIND, path, functions.blocks, 4)
    assert next(some)[0, 0] == 0
    some.close()
    assert read_isolated(KIND, path, functions.print_and_read) == "content"
    whole = [block[0, 0] for block in stream_isolated(KIND, path, functions.blocks, 4)]
    assert whole == [0, 1, 2, 3]
    with refused(file=path):
        list(stream_isolated(KIND, path, functions.blocks, 6))


def test_threads_read_at_once(path: Path):
    with ThreadPoolExecutor(4) as threads:
        tasks = [threads.submit(read_isolated, KIND, path, functions.table) for _ in range(12)]
        expected = functions.table(path).block
        assert expected is not None
        for task in tasks:
            assert task.result().block.tobytes() == expected.tobytes()


@pytest.mark.slow
def test_what_is_stated_raises_the_limits(path: Path):
    with refused(key="[data] most_values") as refusal:
        read_isolated(KIND, path, functions.hoard)
    assert "537 MB" in str(refusal.value)
    with refused(key="[data] most_values") as refusal:
        read_isolated(KIND, path, functions.hoard, most_values=10**6)
    assert "569 MB" in str(refusal.value)


FORKED = """
import os, sys
from pathlib import Path
from tests.io.isolated_functions import print_and_read
from inercal.recordings.io.isolation import Isolation, read_isolated
path = Path(sys.argv[1])
texts = [read_isolated(Isolation("a"), path, print_and_read)]
forked = os.fork()
texts += [read_isolated(Isolation("a"), path, print_and_read) for _ in range(20)]
if forked == 0:
    sys.exit(texts != ["content"] * 21)
print(os.waitpid(forked, 0)[1], set(texts))
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")
def test_a_fork_of_the_program_reads_by_a_process_of_its_own(path: Path):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", FORKED, str(path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("0 {'content'}\n", "")
