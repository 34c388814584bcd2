"""What is refused, what is marked on every page, and that no option removes a mark."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.base_seeds import evidence
from tests.certificate.conftest import Laboratory
from tests.certificate.dcc_xml import etree
from tests.certificate.pdf_text import page_texts, squeezed
from tests.program import run_program

import inercal
from inercal.calibration.calibration import SIMULATED
from inercal.calibration.check_standard import CHECK_STANDARD
from inercal.calibration.explanation import NEXT_STEPS, REMARKS
from inercal.calibration.files import load
from inercal.cli import certificate_commands
from inercal.laboratory.certificate.content import Texts

Change = Callable[[Laboratory], None]


def change_calibration(laboratory: Laboratory, **content: Any) -> None:
    """Write the calibration with other content."""
    from inercal.calibration.files import canonical_text

    made: dict[str, Any] = json.loads(laboratory.calibration.read_text(encoding="utf-8"))
    made.pop("sha256")
    for key, value in content.items():
        made[key] = value(made[key])
    import hashlib

    made["sha256"] = hashlib.sha256(canonical_text(made).encode()).hexdigest()
    laboratory.calibration.write_text(json.dumps(made), encoding="utf-8")


def unreliable(laboratory: Laboratory) -> None:
    change_calibration(
        laboratory,
        verdict=lambda old: old | {"grade": "unreliable", "reasons": ["the fit did not converge"]},
    )


def untested(laboratory: Laboratory) -> None:
    change_calibration(laboratory, verdict=lambda _: None)


def simulated(laboratory: Laboratory) -> None:
    change_calibration(
        laboratory, provenance=lambda old: old | {SIMULATED: "[sensor.truth] of the run file"}
    )


def out_of_control(laboratory: Laboratory) -> None:
    reason = "the check standard is out of control"
    change_calibration(
        laboratory,
        verdict=lambda old: (
            old | {"grade": "reservations", "reasons": [reason], "warned": [CHECK_STANDARD]}
        ),
        conditions=lambda old: old | {CHECK_STANDARD: "REF-1: out of control on 2026-11-20"},
    )


def outside_capability(laboratory: Laboratory) -> None:
    laboratory.change('misalignment = "10 ″"\n', "")


def outside_range(laboratory: Laboratory) -> None:
    laboratory.change('["-1.1 g", "1.1 g"]', '["-0.9 g", "0.9 g"]')


def overdue(laboratory: Laboratory) -> None:
    laboratory.change("2027-03-01", "2026-11-24")


CASES: dict[str, tuple[Change, str, str]] = {  # what is wrong, key of [policy], mark
    "unreliable": (unreliable, "unreliable", "unreliable"),
    "untested": (untested, "unreliable", "untested"),
    "simulated": (simulated, "simulated", "simulation"),
    "coefficient": (outside_capability, "outside_capability", "outside_capability"),
    "range": (outside_range, "outside_capability", "outside_capability"),
    "overdue": (overdue, "overdue", "overdue"),
    "check standard": (out_of_control, "check_standard", "check_standard"),
}


def set_policy(laboratory: Laboratory, key: str, action: str) -> None:
    text = laboratory.lab.read_text(encoding="utf-8")
    lines = [
        f'{key} = "{action}"' if line.startswith(f"{key} = ") else line
        for line in text.splitlines()
    ]
    laboratory.lab.write_text("\n".join(lines), encoding="utf-8")


@pytest.mark.parametrize("case", CASES)
def test_the_laboratory_refuses(case: str, laboratory: Laboratory):
    wrong, key, _ = CASES[case]
    wrong(laboratory)
    set_policy(laboratory, key, "refuse")
    ended = laboratory.run()
    assert ended.status == 2
    assert f"{key} = " in ended.error
    assert not list(laboratory.folder.glob("IL-*"))
    assert not Path(laboratory.register).exists()  # no number is used


@pytest.mark.parametrize("language", ["en", evidence("de")])
@pytest.mark.parametrize("case", CASES)
def test_the_laboratory_marks_every_page_and_the_dcc(
    case: str, language: str, laboratory: Laboratory
):
    wrong, key, mark = CASES[case]
    wrong(laboratory)
    set_policy(laboratory, key, "mark")
    pdf = laboratory.issue("--language", language)
    word = Texts("de" if language == "de" else "en").word("mark", mark)
    for text in page_texts(pdf):
        assert text.count(squeezed(word)) >= 2  # in the band and behind the text
    root = etree.parse(pdf.with_suffix(".xml")).getroot()
    assert word in [one.text for one in root.iterfind(".//{*}statement/{*}name/{*}content")]


def test_a_certificate_without_reason_has_no_mark(laboratory: Laboratory):
    text = "".join(page_texts(laboratory.issue()))
    for mark in (
        "draft", "simulation", "unreliable", "untested", "outside_capability", "overdue",
        "check_standard",
    ):  # fmt: skip
        assert squeezed(Texts("en").word("mark", mark)) not in text


def test_the_worst_of_before_and_after_counts(laboratory: Laboratory):
    before = laboratory.calibration.with_name("before.calibration.json")
    before.write_bytes(laboratory.calibration.read_bytes())
    other = Laboratory(laboratory.folder)
    other.calibration = before
    simulated(other)
    pdf = laboratory.issue("--as-found", before)
    assert all(squeezed("SIMULATION") in text for text in page_texts(pdf))


def test_a_draft_is_marked_takes_no_number_and_shows_what_would_be_refused(laboratory: Laboratory):
    unreliable(laboratory)
    ended = laboratory.run("--draft")
    assert (ended.status, laboratory.calibration.name in ended.error) == (0, True)
    assert not Path(laboratory.register).exists()
    for text in page_texts(laboratory.folder / "run.draft.pdf"):
        assert squeezed("DRAFT – NOT A CERTIFICATE") in text
        assert squeezed("NOT TO BE RELIED ON") in text


def test_no_option_removes_a_mark(laboratory: Laboratory):
    names = {option for command in ("issue", "verify", "copy") for option in _options(command)}
    assert not [name for name in names if "mark" in name or name.startswith("--no-")]


def _options(command: str) -> list[str]:
    import typer.main

    group = typer.main.get_command(certificate_commands.app)
    found = group.commands[command]  # pyright: ignore[reportAttributeAccessIssue]
    return [option for parameter in found.params for option in parameter.opts]


def test_a_calibration_of_simulated_data_says_so(tmp_path: Path):
    root = Path(__file__).parents[2] / "examples"
    run = inercal.calibrate(root / "certificate" / "run.toml")
    assert SIMULATED not in run.calibration.provenance
    text = (root / "certificate" / "run.toml").read_text(encoding="utf-8")
    text = text.replace("[bench]", '[sensor.truth]\n"ax.k0" = "4 mg"\n\n[bench]')
    for name in ("positions.csv", "lab.toml"):
        (tmp_path / name).write_bytes((root / "certificate" / name).read_bytes())
    (tmp_path / "run.toml").write_text(text, encoding="utf-8")
    made = inercal.save(
        inercal.calibrate(tmp_path / "run.toml").calibration, tmp_path / "run.calibration.json"
    )
    assert "sensor.truth" in load(made).provenance[SIMULATED]


@pytest.mark.parametrize("suffix", [".csv", evidence(".npz"), evidence(".parquet")])
def test_a_simulated_file_marks_a_calibration_whose_run_file_states_no_truth(
    suffix: str, tmp_path: Path
):
    text = (Path(__file__).parents[2] / "examples" / "ferraris_simulated" / "run.toml").read_text(
        encoding="utf-8"
    )
    before, _, after = text.partition("[sensor.truth]\n")
    without = before + after[after.index("\n[") :]
    (name,) = re.findall(r'^file = "(.+)"', text, re.MULTILINE)
    for file, content in (("run.toml", text), ("measured.toml", without)):
        content = content.replace(name, f"session{suffix}")
        (tmp_path / file).write_text(content, encoding="utf-8")
    assert run_program("simulate", tmp_path / "run.toml", "--seed", "4").status == 0
    found = inercal.calibrate(tmp_path / "measured.toml").calibration
    assert found.provenance[SIMULATED] == "simulation of run.toml, seed 4"


def test_no_key_and_no_option_is_on_a_certificate(laboratory: Laboratory):
    """Neither of the verdict nor of its notes, whose remedies name keys of the run file."""
    advised = ["gravity is stated without ±; state [bench] gravity", "Use --explain. It drifts."]

    def explained(old: dict[str, Any]) -> dict[str, Any]:
        steps = {"heading": NEXT_STEPS, "lines": ['Set in the run file: [method] also = ["k2"]']}
        return old | {"explanation": [{"heading": REMARKS, "lines": advised}, steps]}

    change_calibration(laboratory, verdict=explained)
    page = "".join(page_texts(laboratory.issue()))
    assert squeezed("gravity is stated without ±") in squeezed(page)
    assert squeezed("It drifts.") in squeezed(page)
    assert not re.search(r"\[(bench|method)\]|--explain", page)
