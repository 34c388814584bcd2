"""Every broken input ends in one line that names it, status 2, and nothing written."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from tests.runfile.run_file_texts import FERRARIS, SIX_POSITIONS, run_file

from inercal.cli.app import main
from inercal.pipeline import apply_data_columns, simulate
from inercal.recordings.io.write import write_recording
from inercal.runfile import read

LABELLED = ('time = "time"\n', 'time = "time"\nmarks = "labels"\nlabel = "label"\n')
FERRARIS_LABELLED = ('marks = "found"', 'marks = "labels"\nlabel = "label"')
HEADER = "time,acc_x,acc_y,acc_z,label"


@dataclass(frozen=True)
class Broken:
    """Changes to a run file and to the bytes of its recording, and what the line must hold."""

    words: tuple[str, ...]
    spoil: Callable[[bytes], bytes | None] = lambda content: content
    changes: tuple[tuple[str, str], ...] = ()
    text: str = SIX_POSITIONS
    more: dict[str, str] = field(default_factory=dict)


def row(number: int, change: Callable[[list[str]], list[str]]) -> Callable[[bytes], bytes]:
    """Change the cells of one line, counted from 1."""

    def spoil(content: bytes) -> bytes:
        lines = content.decode().split("\n")
        lines[number - 1] = ",".join(change(lines[number - 1].split(",")))
        return "\n".join(lines).encode()

    return spoil


def header(old: str, new: str) -> Callable[[bytes], bytes]:
    return row(1, lambda cells: [new if cell == old else cell for cell in cells])


def cells(change: Callable[[list[str]], list[str]]) -> Callable[[bytes], bytes]:
    """Change the cells of every line of data."""

    def spoil(content: bytes) -> bytes:
        first, *lines = content.decode().splitlines()
        return "\n".join([first, *(",".join(change(x.split(","))) for x in lines), ""]).encode()

    return spoil


def saturated(row: list[str]) -> list[str]:
    return [*row[:3], str(min(float(row[3]), 0.99)), row[4]]


def without(*labels: str) -> Callable[[bytes], bytes]:
    """Cut sections out; time goes on, as if the sensor had rested somewhere else."""

    def spoil(content: bytes) -> bytes:
        first, *lines = content.decode().splitlines()
        kept = [x for x in lines if x.rpartition(",")[2].strip('"') not in labels]
        return "\n".join([first, *kept, ""]).encode()

    return spoil


def marks(**sections: tuple[int, int]) -> dict[str, str]:
    content = {label: {"start": a, "end": b} for label, (a, b) in sections.items()}
    return {"marks.json": json.dumps(content)}


FROM_FILE = ('time = "time"\n', 'time = "time"\nmarks = "marks.json"\n')
JUNK = np.random.default_rng(1).integers(0, 256, 100_000, dtype=np.uint8).tobytes()
INPUTS = {
    "no recording": Broken(("log.csv", "no such file"), lambda _: None),
    "empty": Broken(("log.csv is empty",), lambda _: b""),
    "only a header": Broken(("log.csv", "no data"), lambda _: HEADER.encode() + b"\n"),
    "truncated row": Broken(("log.csv line 1701", "truncated"), lambda c: c[:-30]),
    "wrong column name": Broken(
        ("log.csv has no column 'acc_y'", "ACC_Y"), header("acc_y", "ACC_Y")
    ),
    "one name twice": Broken(("log.csv has 2 columns 'acc_x'",), header("acc_y", "acc_x")),
    "NaN": Broken(
        ("log.csv", "without a finite number", "az at line 500"),
        row(500, lambda r: [*r[:3], "nan", r[4]]),
    ),
    "an empty cell": Broken(
        ("log.csv", "az at line 500"), row(500, lambda r: [*r[:3], "", r[4]])
    ),
    "a word": Broken(
        ("log.csv line 500, column 'acc_z'", "ERR"), row(500, lambda r: [*r[:3], "ERR", r[4]])
    ),
    "g declared as m/s²": Broken(
        ("log.csv", 'state unit = "g"'), changes=(('unit = "g"', 'unit = "m/s²"'),)
    ),
    "m/s² declared as g": Broken(
        ("log.csv", 'state unit = "m/s²"'),
        cells(lambda r: [r[0], *(str(9.80665 * float(x)) for x in r[1:4]), r[4]]),
    ),
    "time backwards": Broken(
        ("log.csv", "time decreases", "line 500"),
        row(500, lambda r: ["1.0", *r[1:]]),
    ),
    "time stands still": Broken(
        ("log.csv", "line 3"), cells(lambda r: ["0.0", *r[1:]])
    ),
    "saturated inside a section": Broken(
        ("log.csv: section z_p", "az is at the end of its range"), cells(saturated)
    ),
    "saturated by a stated range": Broken(
        ("log.csv: section x_p", "ax is at the end of its range"),
        changes=(('unit = "g"', 'unit = "g"\nfull_scale = "1.02 g"'),),
    ),
    "a dead channel": Broken(
        ("log.csv: ay reads 0.01 throughout",), cells(lambda r: [*r[:2], "0.01", *r[3:]])
    ),
    "binary junk": Broken(("log.csv line",), lambda _: JUNK),
    "zeros": Broken(("log.csv line 1", "binary"), lambda _: bytes(100_000)),
    "UTF-16": Broken(("log.csv is UTF-16",), lambda c: c.decode().encode("utf-16")),
    "one line of 10⁸ characters": Broken(
        ("log.csv line 2", "without a line end"), lambda _: HEADER.encode() + b"\n" + b"1" * 10**8
    ),
    "no −z": Broken(("az.k0 and az.k1", "z_a (−z up)"), without("z_a"), (LABELLED,)),
    "all in one plane": Broken(
        ("az.k1", "z_p (+z up), z_a (−z up)"), without("z_p", "z_a"), (LABELLED,)
    ),
    "one position": Broken(
        ("ax.k0", "z_a (−z up)"),
        without("x_a", "y_p", "y_a", "z_p", "z_a"),
        (LABELLED,),
    ),
    "rotation about two axes only": Broken(
        ("gz.scale", "z_rot (turn by +360° about +z)"),
        without("z_rot"),
        (FERRARIS_LABELLED,),
        FERRARIS,
    ),
    "°/s declared as rad/s": Broken(
        ("section x_rot", "°/s taken for rad/s"),
        changes=(('unit = "°/s"', 'unit = "rad/s"'), FERRARIS_LABELLED),
        text=FERRARIS,
    ),
    "swapped columns": Broken(
        ("section x_p should have +x up", "swapped"),
        cells(lambda r: [r[0], r[2], r[1], *r[3:]]),
        (LABELLED,),
    ),
    "no label column": Broken(
        ("log.csv", "no label column"),
        changes=(('time = "time"\n', 'time = "time"\nmarks = "labels"\n'),),
    ),
    "a label that returns": Broken(
        ("log.csv: label 'x_p' appears again at line 1000",),
        row(1000, lambda r: [*r[:4], "x_p"]),
        (LABELLED,),
    ),
    "no file of marks": Broken(("marks.json: no such file",), changes=(FROM_FILE,)),
    "a mark beyond the end": Broken(
        ("log.csv: mark x_p is samples 1600 to 1701",),
        changes=(FROM_FILE,),
        more=marks(x_p=(1600, 1701)),
    ),
    "marks that overlap": Broken(
        ("log.csv: marks x_p (10 to 200) and x_a (150 to 400) overlap",),
        changes=(FROM_FILE,),
        more=marks(x_a=(150, 400), x_p=(10, 200)),
    ),
    "a mark too short": Broken(
        ("log.csv: section x_p has 10 samples",), changes=(FROM_FILE,), more=marks(x_p=(10, 20))
    ),
    "marks of nothing": Broken(
        ("log.csv: no section is marked",), changes=(FROM_FILE,), more=marks(up=(10, 200))
    ),
    "broken marks": Broken(
        ("marks.json", "not a JSON file"), changes=(FROM_FILE,), more={"marks.json": "{"}
    ),
    "junk for a run file": Broken(("run.toml", "TOML"), changes=(("[sensor]\n", "[sensor\n"),)),
    "a rate and no time": Broken(("run.toml", "[data] rate is missing"), changes=(
        ('rate = "50 Hz"\ntime = "time"\n', ""),
    )),
}  # fmt: skip


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return the good recording of each run file."""
    found: dict[str, bytes] = {}
    for text in (SIX_POSITIONS, FERRARIS):
        run = read(run_file(tmp_path_factory.mktemp("good"), text))
        path = run.file("log.csv")
        made = apply_data_columns(run, simulate(run, 1))
        write_recording(replace(made, simulation=""), path)  # the header in line 1
        found[text] = path.read_bytes()
    return found


def failure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str | Path
) -> str:
    """Run the program; return the one line that it ends with."""
    monkeypatch.setattr("sys.argv", ["inercal", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        main()
    printed = capsys.readouterr()
    assert stop.value.code == 2
    assert printed.out == ""
    assert printed.err.startswith("inercal: ")
    assert printed.err.endswith("\n")
    assert printed.err.count("\n") == 1
    assert len(printed.err) < 600
    return printed.err.removeprefix("inercal: ").rstrip("\n")


@pytest.mark.parametrize("broken", INPUTS.values(), ids=INPUTS)
def test_broken_input_is_one_line_and_leaves_nothing_behind(
    tmp_path: Path,
    recordings: dict[str, bytes],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    broken: Broken,
):
    path = run_file(tmp_path, broken.text, *broken.changes)
    content = broken.spoil(recordings[broken.text])
    if content is not None:
        (tmp_path / "log.csv").write_bytes(content)
    for name, text in broken.more.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    before = sorted(tmp_path.iterdir())
    # With a report a page would show what was found: tests/cli/test_refused_recordings.py.
    line = failure(monkeypatch, capsys, "calibrate", path, "--out", tmp_path, "--no-report")
    assert all(word in line for word in broken.words), line
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.slow
def test_the_recordings_are_good_before_they_are_broken(
    tmp_path: Path,
    recordings: dict[str, bytes],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    for text, content in recordings.items():
        for labelled in ((), (LABELLED if text is SIX_POSITIONS else FERRARIS_LABELLED,)):
            path = run_file(tmp_path, text, *labelled)
            (tmp_path / "log.csv").write_bytes(content)
            out = ("--out", str(tmp_path), "--no-report", "--force")
            monkeypatch.setattr("sys.argv", ["inercal", "calibrate", str(path), *out])
            with pytest.raises(SystemExit) as stop:
                main()
            assert not stop.value.code, capsys.readouterr().err


@pytest.mark.parametrize("verb", ["apply", "report", "simulate"])
def test_every_verb_refuses_a_broken_run_file_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: str
):
    path = run_file(tmp_path, SIX_POSITIONS, ('unit = "g"', 'unit = "gee"'))
    calibration = tmp_path / "known.json"
    arguments = [calibration, path] if verb == "apply" else [path]
    line = failure(monkeypatch, capsys, verb, *arguments, "--out", tmp_path / "out.csv")
    expected = f"{calibration}: no such" if verb == "apply" else f"{path}: [sensor.accelerometer]"
    assert line.startswith(expected)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("verb", "out", "words"),
    [
        ("calibrate", "log.csv", "Not a directory"),
        ("simulate", "log.csv/log.csv", "Not a directory"),
        ("simulate", "log.xlsx", ".parquet"),
        ("report", "log.csv/page.html", "Not a directory"),
    ],
)
def test_a_place_that_cannot_be_written_is_refused(
    tmp_path: Path,
    recordings: dict[str, bytes],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    verb: str,
    out: str,
    words: str,
):
    path = run_file(tmp_path, SIX_POSITIONS)
    (tmp_path / "log.csv").write_bytes(recordings[SIX_POSITIONS])
    before = sorted(tmp_path.iterdir())
    line = failure(monkeypatch, capsys, verb, path, "--out", tmp_path / out)
    assert str(tmp_path / out) in line
    assert words in line
    assert sorted(tmp_path.iterdir()) == before


def test_a_calibration_that_was_changed_is_not_applied(
    tmp_path: Path,
    recordings: dict[str, bytes],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    path = run_file(tmp_path, SIX_POSITIONS)
    (tmp_path / "log.csv").write_bytes(recordings[SIX_POSITIONS])
    out = ("--out", str(tmp_path), "--no-report")
    monkeypatch.setattr("sys.argv", ["inercal", "calibrate", str(path), *out])
    with pytest.raises(SystemExit):
        main()
    capsys.readouterr()
    calibration = tmp_path / "run.calibration.json"
    text = calibration.read_text(encoding="utf-8")
    calibration.write_text(text.replace('"offset": 0.0', '"offset": 0.1', 1), encoding="utf-8")
    before = sorted(tmp_path.iterdir())
    corrected = tmp_path / "corrected.csv"
    line = failure(monkeypatch, capsys, "apply", calibration, path, "--out", corrected)
    assert line.startswith(f"{calibration}: the file was changed since it was written")
    assert sorted(tmp_path.iterdir()) == before


def test_a_demonstration_into_a_file_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    taken = tmp_path / "taken"
    taken.write_text("mine", encoding="utf-8")
    line = failure(monkeypatch, capsys, "demo", "--out", taken)
    assert line.startswith(f"{taken} is a file")
    assert taken.read_text(encoding="utf-8") == "mine"
