"""Journals of an archive: they are read, and nothing is written beside them."""

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

from tests.refusals import refused

from inercal.host.journal import Journal
from inercal.host.run_folder import JOURNAL
from inercal.host.web.folders import UNREADABLE, Runs


def make_journal(folder: Path) -> Path:
    folder.mkdir(parents=True)
    path = folder / JOURNAL
    with Journal.create(path, "plan.toml", ("pmac://a:1025", "tcp://b:1", ""), 0.02, 3) as journal:
        journal.record_section(0, "p0", "done", 5.5)
    return path


def test_a_journal_is_read_without_a_file_beside_it(tmp_path: Path):
    path = make_journal(tmp_path / "run")
    before = {one.name: one.stat().st_mtime_ns for one in path.parent.iterdir()}
    with Journal(path, read_only=True) as journal:
        assert journal.header().run_file == "plan.toml"
        assert journal.completed_steps() == 1
        assert [one.name for one in path.parent.iterdir()] == list(before)
        with refused(file=path):
            journal.set_state("done")
    assert {one.name: one.stat().st_mtime_ns for one in path.parent.iterdir()} == before


def test_what_a_killed_host_left_in_its_log_is_read_too(tmp_path: Path):
    path, copy = make_journal(tmp_path / "run"), tmp_path / "copy"
    with Journal(path) as journal:
        journal.record_section(1, "p1", "done", 7.5)
        shutil.copytree(path.parent, copy)  # with its write-ahead log, as after a kill
    left = sorted(one.name for one in copy.iterdir())
    assert f"{JOURNAL}-wal" in left
    with Journal(copy / JOURNAL, read_only=True) as journal:
        assert journal.completed_steps() == 2
    assert sorted(one.name for one in copy.iterdir()) == left


def test_a_journal_without_a_row_is_refused_and_shown_with_the_reason(tmp_path: Path):
    path = make_journal(tmp_path / "empty")
    make_journal(tmp_path / "good")
    (tmp_path / "none").mkdir()
    (tmp_path / "none" / JOURNAL).write_bytes(b"not SQLite")
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("DELETE FROM run")
    with Journal(path, read_only=True) as journal, refused(file=path):
        journal.header()
    runs = {name: one.summary for name, one in Runs(tmp_path).all().items()}
    assert {name: one["state"] for name, one in runs.items()} == {
        "good": "interrupted",
        "empty": UNREADABLE,
        "none": UNREADABLE,
    }
    assert JOURNAL in runs["empty"]["trouble"]


def test_a_folder_that_is_gone_has_no_runs(tmp_path: Path):
    runs = Runs(tmp_path / "gone")
    assert runs.all() == {}
    assert runs.active_folders() == []
