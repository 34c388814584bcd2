"""Registers of every revision so far: each is stored as the version of its time wrote it."""

import gzip
import re
from pathlib import Path

import pytest

import inercal.laboratory.store
from inercal.calibration.files import load
from inercal.laboratory.store import Register

STORED = sorted(Path(__file__).with_name("stored").glob("*.db.gz"))
CALIBRATIONS = Path(__file__).parents[1] / "calibration" / "stored"


def revision(path: Path) -> str:
    return path.name[len("register_") :].split(".")[0]


def test_a_register_of_every_revision_is_stored():
    versions = Path(inercal.laboratory.store.__file__).parent / "migrations" / "versions"
    made = {found[1] for one in versions.iterdir() if (found := re.match(r"r(\d+)_", one.name))}
    assert {revision(path) for path in STORED} == made
    page = (Path(__file__).parents[2] / "docs" / "reference" / "stability.md").read_text("utf-8")
    assert f"revision {max(made, key=int)}" in page


@pytest.mark.parametrize("path", STORED, ids=revision)
def test_a_register_of_that_revision_is_opened_with_its_calibrations(path: Path, tmp_path: Path):
    opened = tmp_path / "register.db"
    opened.write_bytes(gzip.decompress(path.read_bytes()))
    with Register(str(opened)) as register:
        (entry,) = register.calibrations()
        file = load(CALIBRATIONS / "calibration_2.json")
        rows = {name: value for name, value, *_ in register.coefficients(entry.id)}
        assert rows == dict(zip(file.sensor.coefficients, file.values.tolist(), strict=True))
        assert register.certificates() == ()
