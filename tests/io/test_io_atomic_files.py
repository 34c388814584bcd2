"""Files of one result: all are written, or none."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from tests.refusals import refused

from inercal.basics import atomic_files
from inercal.basics.atomic_files import atomic_write, atomic_write_all


def test_files_appear_together_when_all_are_written(tmp_path: Path):
    targets = [tmp_path / "one.json", tmp_path / "two.csv", tmp_path / "three.html"]
    with atomic_write_all(targets) as parts:
        parts[0].write_text("1")
        parts[1].write_text("2")
        assert not any(target.exists() for target in targets)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.json", "two.csv"]


def write_then_stop(path: Path) -> None:
    path.write_text("new")
    raise FileNotFoundError


def test_a_block_that_fails_leaves_all_as_they_were(tmp_path: Path):
    targets = [tmp_path / "one.json", tmp_path / "two.csv"]
    targets[0].write_text("old")
    with pytest.raises(FileNotFoundError), atomic_write_all(targets) as parts:
        write_then_stop(parts[0])
    assert [path.name for path in tmp_path.iterdir()] == ["one.json"]
    assert targets[0].read_text() == "old"


def test_a_folder_in_the_place_of_one_is_refused_before_any_is_written(tmp_path: Path):
    (tmp_path / "two.csv").mkdir()
    targets = [tmp_path / "one.json", tmp_path / "two.csv"]
    with refused(file="two.csv"), atomic_write_all(targets):
        raise AssertionError


WRITE = """
import os, signal, sys
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from inercal.basics.atomic_files import atomic_write
with atomic_write(Path(sys.argv[1])) as temporary:
    temporary.write_text("half")
    if len(sys.argv) > 2:
        os.kill(os.getpid(), signal.SIGKILL)
"""


def write_in_a_program(path: Path, *more: str) -> int:
    return subprocess.run([sys.executable, "-c", WRITE, str(path), *more], check=False).returncode


@pytest.mark.skipif(find_spec("fcntl") is None, reason="the system has no locks of files")
def test_what_a_killed_program_left_is_removed_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    assert write_in_a_program(tmp_path / "backup.db", "be killed") < 0
    (left,) = tmp_path.iterdir()
    (tmp_path / "notes.part").mkdir()
    with atomic_write(tmp_path / "one.json") as temporary:
        temporary.write_text("1")
        assert not left.exists()
        monkeypatch.setattr(atomic_files, "_looked_through", set())
        with atomic_write(tmp_path / "two.json") as other:  # as another program that writes
            other.write_text("2")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "notes.part", "one.json", "two.json",
    ]  # fmt: skip
