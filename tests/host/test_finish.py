"""What is made of a run at its end: when digests are kept, and how often files are read for them.

Calibration and report are stand-ins here; whole runs with true ones are in `test_bench_register`.
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import h5py
import pytest
from tests.host.bench_log import PATH, Bench, run_file

from inercal.errors import InputError
from inercal.host import finish as finishing
from inercal.host import record
from inercal.host.finish import finish
from inercal.host.folder import Folder, begin
from inercal.host.journal import Journal
from inercal.host.log import digest

ADDRESSES = (
    "pmac://10.0.0.5:1025?motors=1,2,3&counts=3600000",
    "tcp://10.0.0.6:1?preset=fixed",
    "",
)
RAW = {"mimu.toml", "run.log", "mimu.h5"}


@pytest.fixture
def ended(tmp_path: Path) -> Iterator[tuple[Folder, Journal]]:
    """Give a run of which the table has done all."""
    (tmp_path / "plan").mkdir()
    run = run_file(tmp_path / "plan", PATH)
    folder, journal = begin(tmp_path / "run", run, ADDRESSES)
    Bench(folder.run, seed=1).log(folder.log)
    with journal:
        yield folder, journal


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count how often each file is read for its digest."""
    counted: Counter[str] = Counter()

    def counting(path: Path) -> str:
        counted[path.name] += 1
        return digest(path)

    monkeypatch.setattr(finishing, "digest", counting)
    monkeypatch.setattr(record, "digest", counting)
    return counted


def test_each_file_is_read_for_its_digest_once(
    ended: tuple[Folder, Journal], read: Counter[str], monkeypatch: pytest.MonkeyPatch
):
    folder, journal = ended

    def written(_: object, path: Path, *__: object) -> Path:
        path.write_text("made")
        return path

    monkeypatch.setattr(finishing, "calibrate", lambda _: SimpleNamespace(calibration=None))
    monkeypatch.setattr(finishing, "save", written)
    monkeypatch.setattr(finishing, "write_report", written)
    finish(folder, journal)
    made = {"mimu.calibration.json", "mimu.report.html"}
    assert read == dict.fromkeys(RAW | made, 1)
    for name, (size, sha256) in journal.files().items():
        path = folder.path / name
        assert (size, sha256) == (path.stat().st_size, digest(path))
    assert set(journal.files()) == RAW | made
    with h5py.File(folder.path / "mimu.h5") as file:
        assert file["bench"].attrs["log sha256"] == digest(folder.log)
    assert journal.header().state == "done"


def test_the_digests_of_the_raw_data_are_kept_before_calibration_begins(
    ended: tuple[Folder, Journal], monkeypatch: pytest.MonkeyPatch
):
    folder, journal = ended

    def fails(_: object) -> None:
        raise InputError("nothing can be found")

    monkeypatch.setattr(finishing, "calibrate", fails)
    with pytest.raises(InputError, match="nothing can be found"):
        finish(folder, journal)
    assert set(journal.files()) == RAW
