"""What is said of a file of another kind, of an open question, and of an unfinished table."""

from pathlib import Path

import pytest
from tests.refusals import refused
from tests.runfile.run_file_texts import SIX_POSITIONS, run_file

from inercal.basics.errors import InercalError, InputError
from inercal.calibration.files import load
from inercal.cli import apply_command, log_drafts
from inercal.recordings.io.read import read_table
from inercal.runfile import read


def test_apply_says_which_file_is_wanted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    plan = run_file(tmp_path, SIX_POSITIONS)
    log, file = tmp_path / "log.csv", tmp_path / "run.calibration.json"
    for path in (log, file):
        path.write_text("t,ax\n0,1\n1,2\n", encoding="utf-8")

    def corrected(first: Path, second: Path) -> InercalError:
        with refused(InputError) as caught:
            apply_command.run(first, second, out=tmp_path / "out.csv", force=False, json=False)
        return caught.value

    swapped = corrected(plan, file)
    assert swapped.file == plan
    assert "calibration file first" in str(swapped)
    assert corrected(log, plan).file == log
    monkeypatch.setattr("inercal.calibration.files.load", lambda _: None)
    no_run_file = corrected(file, log)
    assert no_run_file.file == log
    assert f"inercal init {log}" in str(no_run_file)


def test_an_existing_file_is_no_folder_of_a_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    plan = run_file(tmp_path, SIX_POSITIONS)
    monkeypatch.setattr("inercal.calibration.files.load", lambda _: None)
    (existing := tmp_path / "full").write_text("")
    for out, advice in ((existing, "ends in .csv"), (tmp_path, "new folder")):
        with refused(InputError, key="--out", file=out) as caught:
            apply_command.run(tmp_path, plan, out, None, None, None, None, False, False, False)
        assert advice in str(caught.value)


def test_an_open_question_of_a_draft_is_named_with_its_line(tmp_path: Path):
    path = run_file(tmp_path, SIX_POSITIONS)
    text = (
        path.read_text(encoding="utf-8") + '\n[data.sd]\ngyro = "?"  # please tell: the deviation\n'
    )
    path.write_text(text, encoding="utf-8")
    with refused(InputError) as caught:
        read(path)
    assert caught.value.line == text.count("\n")
    assert caught.value.key == "gyro"
    assert "the deviation" in str(caught.value)


def test_in_a_terminal_init_asks_for_the_accelerometers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    log = tmp_path / "log.csv"
    log.write_text(
        "position,AX1,AX2,AX3,AX5\nx_p,1,0,0,7\nx_a,-1,0,0,3\ny_p,0,1,0,5\ny_a,0,-1,0,4\n"
        "z_p,0,0,1.01,6\nz_a,0,0,-1,2\n",
        encoding="utf-8",
    )
    answers = iter(["AX1,AX2", "AX1,AX2,AX4", "AX1,AX2,AX3"])
    monkeypatch.setattr("builtins.input", lambda _: next(answers))
    known: dict[str, str] = {}
    draft = log_drafts._draft([log], tmp_path / "run.toml", known, asks=True, yes=False)
    assert known == {"data.accelerometer": "AX1,AX2,AX3"}
    assert draft.roles.triads["accelerometer"] == ("AX1", "AX2", "AX3")
    printed = capsys.readouterr()
    assert "AX1, AX2, AX3" in printed.out
    assert "AX4" in printed.err


def test_a_certificate_is_sent_to_its_verb_and_a_run_file_to_calibrate(tmp_path: Path):
    certificates = (
        b"%PDF-1.7\n",
        b'<?xml version="1.0"?>\n<dcc:digitalCalibrationCertificate schemaVersion="3.2.1">\n',
    )
    for k, content in enumerate(certificates):
        path = tmp_path / f"{k}.csv"
        path.write_bytes(content)
        with refused(file=path) as caught:
            read_table(path)
        assert "inercal certificate verify" in str(caught.value)
    plan = run_file(tmp_path, SIX_POSITIONS)
    with refused(file=plan) as caught:
        load(plan)
    assert f"inercal calibrate {plan}" in str(caught.value)
