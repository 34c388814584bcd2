"""A laboratory with its example, certificates of it, and the schemas of the DCC where they are."""

import shutil
from pathlib import Path

import pytest
from tests.certificate.signing_keys import PASSPHRASE, write_key
from tests.program import Ended, run_program

import inercal
from inercal.cli.certificate_commands import PASSPHRASE as PASSPHRASE_VARIABLE
from inercal.pipeline import calibrate

ROOT = Path(__file__).parents[2]
DATE = "2026-11-26"
CHINESE = Path("/usr/share/fonts/opentype/noto/NotoSerifCJK-Regular.ttc")


def need_chinese() -> None:
    """Skip a test where the system has no font with Chinese characters."""
    if not CHINESE.is_file():
        pytest.skip(f"no Chinese font: Debian's fonts-noto-cjk has {CHINESE}")


@pytest.fixture(scope="session")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the example with its calibration."""
    folder = tmp_path_factory.mktemp("certificate") / "example"
    shutil.copytree(ROOT / "examples" / "certificate", folder)
    inercal.save(calibrate(folder / "run.toml").calibration, folder / "run.calibration.json")
    return folder


class Laboratory:
    """A folder with the example, in which certificates are issued."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.lab = folder / "lab.toml"
        self.calibration = folder / "run.calibration.json"
        self.register = str(folder / "register.db")

    def change(self, old: str, new: str) -> None:
        """Change the laboratory's file."""
        text = self.lab.read_text(encoding="utf-8")
        assert old in text
        self.lab.write_text(text.replace(old, new), encoding="utf-8")

    def run(self, *options: str | Path, date: str = DATE) -> Ended:
        """Issue a certificate of the example, with options."""
        given = ("--lab", self.lab, "--register", self.register, "--out", self.folder)
        return run_program("certificate", self.calibration, *given, "--date", date, *options)

    def issue(self, *options: str | Path) -> Path:
        """Issue a certificate; return its PDF."""
        ended = self.run(*options)
        assert ended.status == 0, ended.error
        return Path(ended.output.splitlines()[0].removeprefix("wrote "))


@pytest.fixture
def laboratory(example: Path, tmp_path: Path) -> Laboratory:
    """Return a laboratory with a calibration."""
    return Laboratory(Path(shutil.copytree(example, tmp_path / "lab")))


@pytest.fixture(scope="session")
def schema(data_dir: Path) -> Path:
    """Return dcc.xsd, which is not part of the project."""
    path = data_dir / "dcc_schema" / "dcc-3.2.1.xsd"
    if not path.is_file():
        pytest.skip(f"no schema of the DCC at {path}")
    return path


@pytest.fixture(scope="session")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with own.p12, own.pem and other.pem."""
    folder = tmp_path_factory.mktemp("keys")
    for name in ("own", "other"):
        write_key(folder, name)
    return folder


@pytest.fixture(scope="session")
def signed_once(example: Path, keys: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the PDF of a signed certificate, which no test changes."""
    folder = Path(shutil.copytree(example, tmp_path_factory.mktemp("signed") / "lab"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(PASSPHRASE_VARIABLE, PASSPHRASE)
        return Laboratory(folder).issue("--sign", keys / "own.p12")


@pytest.fixture
def signed(signed_once: Path, laboratory: Laboratory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the PDF of a signed certificate of the laboratory."""
    monkeypatch.setenv(PASSPHRASE_VARIABLE, PASSPHRASE)
    shutil.copytree(signed_once.parent, laboratory.folder, dirs_exist_ok=True)
    return laboratory.folder / signed_once.name
