"""What is made of a run at its end: when digests are kept, and how often files are read for them.

Calibration and report are stand-ins here; whole runs with true ones are in `test_bench_register`.
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import h5py
import pytest
from tests.host.synthetic_log import PATH, Bench, run_file
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.host import recording_writer
from inercal.host import run_execution as finishing
from inercal.host.journal import Journal
from inercal.host.run_execution import finish_run
from inercal.host.run_folder import RunFolder, create_run
from inercal.host.run_log import file_sha256

ADDRESSES = (
    "pmac://10.0.0.5:1025?motors=1,2,3&counts=3600000",
    "tcp://10.0.0.6:1?preset=fixed",
    "",
)
RAW = {"mimu.toml", "run.log", "mimu.h5"}


@pytest.fixture
def ended(tmp_path: Path) -> Iterator[tuple[RunFolder, Journal]]:
    """Give a run of which the table has done all."""
    (tmp_path / "plan").mkdir()
    run = run_file(tmp_path / "plan", PATH)
    folder, journal = create_run(tmp_path / "run", run, ADDRESSES)
    Bench(folder.run, seed=1).log(folder.log)
    with journal:
        yield folder, journal


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count how often each file is read for its digest."""
    counted: Counter[str] = Counter()

    def counting(path: Path) -> str:
        counted[path.name] += 1
        return file_sha256(path)

    monkeypatch.setattr(finishing, "file_sha256", counting)
    monkeypatch.setattr(recording_writer, "file_sha256", counting)
    return counted


@pytest.mark.slow
def test_each_file_is_read_for_its_digest_once(
    ended: tuple[RunFolder, Journal], read: Counter[str], monkeypatch: pytest.MonkeyPatch
):
    folder, journal = ended

    def written(_: object, path: Path, *__: object) -> Path:
        path.write_text("made")
        return path

    monkeypatch.setattr(finishing, "calibrate", lambda _: SimpleNamespace(calibration=None))
    monkeypatch.setattr(finishing, "save", written)
    monkeypatch.setattr(finishing, "write_report", written)
    finish_run(folder, journal)
    made = {"mimu.calibration.json", "mimu.report.html"}
    assert read == dict.fromkeys(RAW | made, 1)
    for name, (size, sha256) in journal.files().items():
        path = folder.path / name
        assert (size, sha256) == (path.stat().st_size, file_sha256(path))
    assert set(journal.files()) == RAW | made
    with h5py.File(folder.path / "mimu.h5") as file:
        assert file["bench"].attrs["log sha256"] == file_sha256(folder.log)
    assert journal.header().state == "done"


@pytest.mark.slow
def test_the_digests_of_the_raw_data_are_kept_before_calibration_begins(
    ended: tuple[RunFolder, Journal], monkeypatch: pytest.MonkeyPatch
):
    folder, journal = ended

    def fails(_: object) -> None:
        raise InputError("the data are not enough", key="calibrate")

    monkeypatch.setattr(finishing, "calibrate", fails)
    with refused(key="calibrate"):
        finish_run(folder, journal)
    assert set(journal.files()) == RAW
