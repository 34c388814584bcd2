"""Signatures by the laboratory's key, and what `certificate verify` finds."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pikepdf
import pytest
from tests.base_seeds import slow
from tests.certificate.conftest import Laboratory, need_chinese
from tests.certificate.dcc_xml import etree
from tests.certificate.pdf_text import page_texts, squeezed
from tests.certificate.signing_keys import PASSPHRASE, write_chain
from tests.program import run_program

from inercal.cli.certificate_commands import PASSPHRASE as VARIABLE
from inercal.laboratory.certificate.content import LANGUAGES, Language, Texts
from inercal.laboratory.certificate.dcc_reading import schema_defects


def verified(*arguments: str | Path) -> tuple[int, dict[str, bool | None]]:
    """Return the exit status of `certificate verify`, and whether each check passed."""
    ended = run_program("certificate", "verify", *arguments, "--json")
    found: dict[str, Any] = json.loads(ended.output)
    assert found["authentic"] == (ended.status == 0)
    return ended.status, {one["name"]: one["passed"] for one in found["checks"]}


@pytest.mark.slow
def test_a_signed_certificate_is_verified_by_its_key(signed: Path, keys: Path, schema: Path):
    trust = ("--trust", keys / "own.pem")
    assert verified(signed, *trust) == (
        0,
        {"signature of the PDF": True, "signature of the DCC": True, "results 1": True},
    )
    dcc = signed.with_suffix(".xml")
    assert verified(dcc, *trust, "--schema", schema) == (
        0,
        {"signature of the DCC": True, "results 1": True, "schema": True},
    )
    assert schema_defects(dcc.read_bytes(), schema) == ()
    root = etree.parse(dcc).getroot()
    assert etree.QName(root[-1]).localname == "Signature"


def stroke_count(path: Path) -> int:
    """Return the number of stroked lines of all pages."""
    with pikepdf.open(path) as document:
        return sum(
            str(operator) == "S"
            for page in document.pages
            for _, operator in pikepdf.parse_content_stream(page)
        )


@pytest.mark.slow
@pytest.mark.parametrize("language", [x if x == "en" else slow(x) for x in LANGUAGES])
def test_a_signed_certificate_says_so_in_place_of_the_line_for_a_signature(
    language: Language,
    laboratory: Laboratory,
    keys: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    if language == "zh":
        need_chinese()
    monkeypatch.setenv(VARIABLE, PASSPHRASE)
    signed = laboratory.issue("--sign", keys / "own.p12", "--language", language)
    laboratory.register = str(tmp_path / "other.db")
    unsigned = laboratory.issue("--force", "--out", tmp_path, "--language", language)
    note = squeezed(Texts(language).text("signed_electronically"))
    assert "inercal" not in note  # the customer need not have the program
    assert note in "".join(page_texts(signed))
    assert note not in "".join(page_texts(unsigned))
    assert stroke_count(unsigned) == stroke_count(signed) + 1


def test_a_signature_leaves_the_bytes_and_the_standard_of_the_pdf(signed: Path):
    with pikepdf.open(signed) as document:
        assert document.open_metadata().pdfa_status == "3B"
        relations = {str(one.AFRelationship) for one in document.Root.AF}
        assert relations == {"/Alternative", "/Data"}
    content = signed.read_bytes()
    assert content.count(b"%%EOF") == 2  # the certificate, and the update with the signature


def test_a_signature_of_another_key_is_not_trusted(
    signed: Path, keys: Path, caplog: pytest.LogCaptureFixture
):
    for file in (signed, signed.with_suffix(".xml")):
        status, checks = verified(file, "--trust", keys / "other.pem")
        assert status == 3
        assert checks["signature of the DCC"] is False
    assert not caplog.records  # the library would print a traceback


@pytest.mark.slow
def test_a_certificate_of_the_key_may_lead_to_the_trusted_one_by_another(
    laboratory: Laboratory, keys: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    write_chain(tmp_path, "leaf")
    monkeypatch.setenv(VARIABLE, PASSPHRASE)
    pdf = laboratory.issue("--sign", tmp_path / "leaf.p12")
    for file in (pdf, pdf.with_suffix(".xml")):
        assert verified(file, "--trust", tmp_path / "root.pem")[0] == 0
        assert verified(file, "--trust", tmp_path / "leaf.pem")[0] == 0
        status, checks = verified(file, "--trust", keys / "own.pem")
        assert (status, checks["signature of the DCC"]) == (3, False)


def test_a_signature_alone_vouches_for_nobody(signed: Path):
    """Anybody can sign with a key of their own."""
    status, checks = verified(signed)
    assert status == 3
    assert checks["signature of the PDF"] is True


def test_a_changed_number_is_found_in_the_dcc(signed: Path, keys: Path):
    dcc = signed.with_suffix(".xml")
    text = dcc.read_text(encoding="utf-8")
    changed = text.replace("Basin No. 3", "Basin No. 4")
    assert changed != text
    dcc.write_text(changed, encoding="utf-8")
    status, checks = verified(dcc, "--trust", keys / "own.pem")
    assert (status, checks["signature of the DCC"]) == (3, False)


def test_a_pdf_changed_after_it_was_signed_is_found(signed: Path, keys: Path):
    content = bytearray(signed.read_bytes())
    place = content.index(b"/Producer") if b"/Producer" in content else len(content) // 2
    content[place + 1] ^= 1
    signed.write_bytes(content)
    ended = run_program("certificate", "verify", signed, "--trust", keys / "own.pem")
    assert ended.status in (2, 3)


def test_a_pdf_with_an_update_after_the_signature_is_found(signed: Path, keys: Path):
    with pikepdf.open(signed, allow_overwriting_input=True) as document:
        document.Root.Lang = pikepdf.String("de")
        document.save(signed)
    status, checks = verified(signed, "--trust", keys / "own.pem")
    assert (status, checks["signature of the PDF"]) == (3, False)


def test_a_signed_dcc_does_not_vouch_for_the_pages_that_it_is_attached_to(
    signed: Path, keys: Path, laboratory: Laboratory
):
    """The bytes before the update with the signature are a PDF with the signed DCC, unsigned."""
    content = signed.read_bytes()
    end = content.index(b"%%EOF") + len(b"%%EOF\n")
    pages = laboratory.folder / "pages.pdf"
    pages.write_bytes(content[:end])
    status, checks = verified(pages, "--trust", keys / "own.pem")
    assert status == 3
    assert checks["signature of the PDF"] is None
    assert checks["signature of the DCC"] is True


@pytest.mark.slow
def test_damaged_certificates_are_never_verified(signed: Path, keys: Path):
    damaged = signed.with_name("damaged")
    rng = np.random.default_rng(3)
    for file in (signed, signed.with_suffix(".xml")):
        whole = file.read_bytes()
        # The place of the signature itself ends with zeros, which are no part of anything.
        place_of_signature = range(start := whole.find(b"/Contents <"), whole.find(b">", start))
        for _ in range(12):
            content = bytearray(whole)
            place = int(rng.integers(100, len(content) - 400))
            if place in place_of_signature:
                continue
            if rng.random() < 0.5:
                content[place] ^= 1 << int(rng.integers(8))
            else:
                del content[place : place + int(rng.integers(1, 300))]
            damaged.write_bytes(content)
            ended = run_program("certificate", "verify", damaged, "--trust", keys / "own.pem")
            assert ended.status in (2, 3), place


@pytest.mark.slow
def test_the_register_vouches_for_an_unsigned_certificate(laboratory: Laboratory):
    pdf = laboratory.issue()
    for file in (pdf, pdf.with_suffix(".xml")):
        assert verified(file)[0] == 3
        status, checks = verified(file, "--register", laboratory.register)
        assert (status, checks["register"]) == (0, True)
    pdf.with_suffix(".xml").write_bytes(pdf.with_suffix(".xml").read_bytes() + b"\n")
    status, checks = verified(pdf.with_suffix(".xml"), "--register", laboratory.register)
    assert (status, checks["register"]) == (3, False)


@pytest.mark.slow
def test_a_replaced_certificate_is_not_verified_an_amended_one_is(laboratory: Laboratory):
    pdf = laboratory.issue()
    why = ("--reason", "the serial number was wrong")
    laboratory.issue("--amends", "IL-2026-0001", *why)
    assert verified(pdf, "--register", laboratory.register)[0] == 0
    laboratory.issue("--replaces", "IL-2026-0001", *why)
    status, checks = verified(pdf, "--register", laboratory.register)
    assert (status, checks["register"]) == (3, False)


def test_numbers_that_contradict_the_attached_calibration_are_found(laboratory: Laboratory):
    dcc = laboratory.issue().with_suffix(".xml")
    root = etree.parse(dcc).getroot()
    element = root.find(".//{*}quantity[@refType='inercal_coefficients']//{*}valueXMLList")
    numbers = str(element.text).split()
    numbers[0] = repr(2 * float(numbers[0]))
    element.text = " ".join(numbers)
    dcc.write_bytes(etree.tostring(root))
    assert verified(dcc)[1]["results 1"] is False


@pytest.mark.parametrize("content", [b"", b"%PDF-1.7\n", b"<a/>", b"{}"])
def test_what_is_no_certificate_is_refused(content: bytes, tmp_path: Path):
    path = tmp_path / "file.pdf"
    path.write_bytes(content)
    ended = run_program("certificate", "verify", path)
    assert ended.status == 2
    assert "file.pdf" in ended.error


def test_keys_are_refused_with_what_is_wrong(
    laboratory: Laboratory, keys: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.delenv(VARIABLE, raising=False)
    ended = laboratory.run("--sign", keys / "own.p12")
    assert ended.status == 2
    assert VARIABLE in ended.error
    monkeypatch.setenv(VARIABLE, "wrong")
    assert laboratory.run("--sign", keys / "own.p12").status == 2
    monkeypatch.setenv(VARIABLE, PASSPHRASE)
    assert laboratory.run("--sign", keys / "own.pem").status == 2
    assert laboratory.run("--sign", keys / "none.p12").status == 2
    assert not Path(laboratory.register).exists()
    assert not list(laboratory.folder.glob("IL-*"))
