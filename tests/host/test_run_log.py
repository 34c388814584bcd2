"""The log of a run: sound whatever moment the host dies at."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.host.run_log import EVENT, IMU, TABLE, LogFrame, RunLog, file_sha256, read_frames

WRITTEN = [
    LogFrame(IMU, 0.01, b"\xfa\xff" + bytes(range(30))),
    LogFrame(TABLE, 0.02, b""),
    LogFrame(EVENT, 3.5, "begun: α".encode()),
]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    made = tmp_path / "run.log"
    with RunLog(made) as log:
        for frame in WRITTEN:
            log.append(*frame)
    return made


def test_frames_come_back_as_they_were_written_and_can_be_added_to(path: Path):
    assert list(read_frames(path)) == WRITTEN
    with RunLog(path) as log:
        assert log.incomplete_bytes == 0
        log.append(*WRITTEN[0])
    assert list(read_frames(path)) == [*WRITTEN, WRITTEN[0]]


def test_a_file_cut_at_any_byte_gives_its_whole_frames_and_takes_new_ones(path: Path):
    whole = path.read_bytes()
    ends = [0]
    for frame in WRITTEN:
        ends.append(ends[-1] + 23 + len(frame.payload))
    assert ends[-1] == len(whole)
    for cut in range(len(whole)):
        path.write_bytes(whole[:cut])
        kept = sum(end <= cut for end in ends) - 1
        assert list(read_frames(path)) == WRITTEN[:kept]
        with RunLog(path) as log:
            assert log.incomplete_bytes == cut - ends[kept]
            log.append(*WRITTEN[-1])
        assert list(read_frames(path)) == [*WRITTEN[:kept], WRITTEN[-1]]


def test_a_changed_byte_before_the_end_is_named_and_nothing_is_cut(path: Path):
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    for at in rng.choice(len(whole), 60, replace=False):
        spoilt = bytearray(whole)
        spoilt[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(spoilt)
        with refused(file=path):
            list(read_frames(path))
        with refused(file=path):
            RunLog(path)
        assert path.read_bytes() == spoilt


def test_another_file_is_no_log(tmp_path: Path):
    other = tmp_path / "notes.txt"
    other.write_text("warm up two minutes")
    with refused(file=other):
        RunLog(other)
    assert other.read_text() == "warm up two minutes"
    with refused(file="none.log"):
        list(read_frames(tmp_path / "none.log"))
    with refused(file="run.log"):
        RunLog(tmp_path / "none" / "run.log")


def test_the_digest_is_that_of_the_bytes(tmp_path: Path):
    file = tmp_path / "abc"
    file.write_bytes(b"abc")  # FIPS 180-2, B.1
    assert file_sha256(file) == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_a_frame_that_the_disk_took_in_part_is_cut_off_and_the_next_stands_behind_a_whole_one(
    path: Path, monkeypatch: pytest.MonkeyPatch
):
    write = os.write
    with RunLog(path) as log:
        with monkeypatch.context() as full:
            full.setattr(os, "write", lambda file, data: write(file, data[:10]))
            with refused(file=log.path):
                log.append(*WRITTEN[0])
        log.append(*WRITTEN[1])
    assert list(read_frames(path)) == [*WRITTEN, WRITTEN[1]]


def test_a_disk_that_does_not_take_a_log_at_its_end_is_told_in_words_and_the_log_is_closed(
    path: Path, monkeypatch: pytest.MonkeyPatch
):
    def fails(file: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    log = RunLog(path)
    with monkeypatch.context() as gone:
        gone.setattr(os, "fsync", fails)
        with refused(file=path):
            log.close()
    RunLog(path).close()  # no descriptor holds its lock


HOLDER = """
import sys
from inercal.host.run_log import IMU, RunLog
log = RunLog(sys.argv[1])
log.append(IMU, 1.0, b"held")
print("holds", flush=True)
sys.stdin.read()
"""


@pytest.mark.slow
def test_a_log_that_another_host_writes_is_refused_untouched_until_that_host_is_killed(path: Path):
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(path)], stdin=pipe, stdout=pipe
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"holds\n"
        # Half a frame, as it looks while the other host writes.
        with path.open("ab") as file:
            file.write(b"\xa5i\x01")
        was = path.read_bytes()
        with pytest.raises(InputError):
            RunLog(path)
        assert path.read_bytes() == was
        holder.kill()
        holder.wait()
        with RunLog(path) as log:
            assert log.incomplete_bytes == 3
    assert list(read_frames(path)) == [*WRITTEN, LogFrame(IMU, 1.0, b"held")]


def test_a_log_that_was_refused_can_be_opened_again_by_the_same_host(path: Path):
    whole = path.read_bytes()
    path.write_bytes(b"no" + whole)
    with refused(file=path):
        RunLog(path)
    path.write_bytes(whole)
    with RunLog(path), pytest.raises(InputError):
        RunLog(path)
    RunLog(path).close()
