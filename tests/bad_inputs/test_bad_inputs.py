"""Inputs that a user may give by mistake: one clear line, status 2, and nothing left behind."""

import shutil
import warnings
from pathlib import Path

import pytest
from tests.bad_inputs import calibrations, options, recordings, run_files
from tests.bad_inputs.bad_input import BadInput
from tests.program import Ended, run_program
from tests.runfile.run_file_texts import FERRARIS, SIX_POSITIONS, changed

EXAMPLES = Path(__file__).parents[2] / "examples"
COPIES = {
    "means.toml": "six_position/run.toml",
    "positions.csv": "six_position/positions.csv",
    "plate.toml": "measure/plate.toml",
    "mimu.toml": "turntable/mimu.toml",
    "path.csv": "turntable/path.csv",
    "marks.json": "logs/marks.json",
}
CASES = {
    f"{part.__name__.rpartition('.')[2]}: {name}": one
    for part in (recordings, run_files, calibrations, options)
    for name, one in part.CASES.items()
}
LONGEST = 700  # characters, besides the folder


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of good files: two run files with their results, and a register."""
    folder = tmp_path_factory.mktemp("good")
    labels = 'marks = "labels"\nlabel = "label"'
    triad = changed(SIX_POSITIONS, ('time = "time"', f'time = "time"\n{labels}'))
    imu = changed(FERRARIS, ('marks = "found"', labels), ("log.csv", "imu.csv"))
    for name, text in (("run", triad), ("imu", imu)):
        path = folder / f"{name}.toml"
        path.write_text(text, encoding="utf-8")
        assert run_program("simulate", path).status == 0
        assert run_program("calibrate", path, "--out", folder, "--no-report").status == 0
        log = folder / f"{'log' if name == 'run' else name}.csv"
        # Changes count lines: the header is the first without the mark of a simulation.
        log.write_text(log.read_text(encoding="utf-8").split("\n", 1)[1], encoding="utf-8")
    for name, source in COPIES.items():
        shutil.copy(EXAMPLES / source, folder / name)
    entered = folder / "run.calibration.json"
    assert not run_program("store", "import", entered, "--register", folder / "reg.db").status
    return folder


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}


def prepare(good: Path, folder: Path, bad: BadInput) -> None:
    """Write the good files and the changes to them."""
    shutil.copytree(good, folder)
    for name, change in bad.files.items():
        path = folder / name
        content = change(path.read_text(encoding="utf-8")) if callable(change) else change
        path.write_bytes(content if isinstance(content, bytes) else content.encode())


def run_in(folder: Path, bad: BadInput) -> Ended:
    words = bad.command.split() if isinstance(bad.command, str) else bad.command
    return run_program(*(word.replace("@", f"{folder}/", 1) for word in words))


def test_there_are_60_at_least_and_every_verb_is_among_them():
    verbs = {
        (c.split() if isinstance(c, str) else c)[0] for c in (b.command for b in CASES.values())
    }
    assert len(CASES) >= 60
    assert verbs == {
        "apply", "bench", "budget", "calibrate", "compare", "demo", "init", "measure", "noise",
        "plan", "predict",
        "report", "reproduce", "show", "simulate", "store",
    }  # fmt: skip


@pytest.mark.parametrize("bad", CASES.values(), ids=CASES)
def test_a_bad_input_is_one_line_that_names_it_and_leaves_nothing(
    good: Path, tmp_path: Path, bad: BadInput
):
    folder = tmp_path / "run"
    prepare(good, folder, bad)
    before = contents(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ended = run_in(folder, bad)
    assert ended.status == 2, ended
    assert ended.output == ""
    assert ended.error.startswith("inercal: ")
    line = ended.error.replace(f"{folder}/", "").replace(str(folder), "")
    assert len(line) <= LONGEST, line
    assert line.rstrip("\n").isprintable()
    assert all(word in line for word in bad.words), line
    assert contents(tmp_path) == before


@pytest.mark.parametrize("name", ["run.toml", "log.csv", "run.calibration.json"])
def test_the_line_ends_and_the_mark_of_windows_are_no_fault(good: Path, tmp_path: Path, name: str):
    folder = tmp_path / "run"
    bad = BadInput("apply @run.calibration.json @run.toml --out @c.csv", ())
    prepare(good, folder, bad)
    text = (folder / name).read_text(encoding="utf-8")
    (folder / name).write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    assert run_in(folder, bad).status == 0
