"""The journal of a run: what is kept, and what a killed host leaves."""

import os
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
from tests.host.journal_sections import sections_done
from tests.refusals import refused

from inercal.host.journal import Journal


@pytest.fixture
def path(tmp_path: Path) -> Path:
    made = tmp_path / "run.sqlite"
    Journal.create(made, "plan.toml", ("pmac://a:1025", "tcp://b:1", ""), 0.02, 3).close()
    return made


def test_a_journal_says_again_what_it_was_told(path: Path):
    with Journal(path) as journal:
        header = journal.header()
        assert header[1:] == ("plan.toml", "pmac://a:1025", "tcp://b:1", "", 0.02, 3, "running")
        assert journal.completed_steps() == 0
        assert sections_done(journal) == ()
        journal.record_section(0, "warm-up", "begun", 1.5)
        journal.record_section(0, "warm-up", "void", 2.5)
        journal.record_section(0, "warm-up", "begun", 3.5)
        journal.record_section(0, "warm-up", "done", 5.5)
        journal.record_section(1, "p1", "begun", 6.0)
        journal.record_event("alarm", "axis 1: amplifier fault", 6.5)
        journal.record_event("info", "resumed")
        journal.record_file("run.log", 12, "ab")
        journal.record_file("run.log", 13, "cd")
        journal.set_state("interrupted")
    with Journal(path) as journal:
        assert journal.completed_steps() == 1
        assert sections_done(journal) == (("warm-up", 3.5, 5.5),)
        assert [e[1:] for e in journal.events()] == [
            (6.5, "alarm", "axis 1: amplifier fault"),
            (None, "info", "resumed"),
        ]
        assert journal.files() == {"run.log": (13, "cd")}
        assert journal.header().state == "interrupted"


def test_what_is_no_journal_is_refused_in_one_line(path: Path, tmp_path: Path):
    with refused(file=path.name):
        Journal.create(path, "", ("", "", ""), 0.02, 0)
    with refused(file="none.sqlite", key=None):
        Journal(tmp_path / "none.sqlite")
    (tmp_path / "text").write_text("no database at all, but longer than a hundred bytes " * 4)
    with refused(file="run.sqlite"):
        Journal.create(tmp_path / "text" / "run.sqlite", "", ("", "", ""), 0.02, 0)
    with refused(file="text", key=None):
        Journal(tmp_path / "text")
    db = sqlite3.connect(tmp_path / "other.sqlite")
    db.execute("CREATE TABLE t (a)")
    db.close()
    with refused(file="other.sqlite", key="user_version"):
        Journal(tmp_path / "other.sqlite")


BEGINNER = """
import os, signal, sys
from inercal.host.journal import Journal
seen = 0
def kill(frame, what, about):
    global seen
    if frame.f_code.co_filename.endswith(("journal.py", "atomic_files.py")):
        seen += what == "line"
        if seen == int(sys.argv[2]):
            os.kill(os.getpid(), signal.SIGKILL)
    return kill
sys.settrace(kill)
Journal.create(sys.argv[1], "plan.toml", ("", "", ""), 0.02, 3)
"""


@pytest.mark.slow
def test_a_host_killed_at_any_line_of_create_leaves_a_whole_journal_or_none(tmp_path: Path):
    left: list[bool] = []
    code = -1
    for line in range(1, 200):
        path = tmp_path / f"{line}.sqlite"
        code = subprocess.run([sys.executable, "-c", BEGINNER, str(path), str(line)]).returncode
        left.append(path.exists())
        if not path.exists():
            Journal.create(path, "plan.toml", ("", "", ""), 0.02, 3).close()
        with Journal(path) as journal:
            assert journal.header().run_file == "plan.toml"
        if code == 0:
            break
        assert code == -signal.SIGKILL
    assert left == sorted(left)
    assert left.count(False) > 5
    assert code == 0


WRITER = """
import sys
from inercal.host.journal import Journal
journal = Journal(sys.argv[1])
for k in range(10**6):
    journal.record_section(k, "p", "done", float(k))
    print(k, flush=True)
"""


@pytest.mark.slow
def test_every_step_that_was_told_done_is_there_after_a_kill(tmp_path: Path):
    for k in range(5):
        path = tmp_path / f"{k}.sqlite"
        Journal.create(path, "", ("", "", ""), 0.02, 3).close()
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True
        ) as writer:
            assert writer.stdout is not None
            for line in writer.stdout:
                if int(line) == 20:
                    os.kill(writer.pid, signal.SIGKILL)
                    break
            told = [20, *(int(line) for line in writer.stdout if line.endswith("\n"))]
        with Journal(path) as journal:
            assert journal.completed_steps() - 1 - told[-1] in (0, 1)
            assert len(sections_done(journal)) == journal.completed_steps()
        check = sqlite3.connect(path)
        assert check.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        check.close()
