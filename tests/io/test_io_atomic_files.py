"""Files of one result: all are written, or none."""

from pathlib import Path

import pytest
from tests.refusals import refused

from inercal.io.atomic_files import atomic_write_all


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
