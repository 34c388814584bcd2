"""The PDF of a certificate: PDF/A-3b by typst, with the DCC and the calibration file attached.

The date of issue is the document's date: the same certificate gives the same bytes.
"""

import json
import re
import unicodedata
from importlib.resources import files
from pathlib import Path

from inercal.basics.errors import InputError
from inercal.laboratory.certificate.content import Certificate
from inercal.laboratory.certificate.dcc import calibration_bytes
from inercal.laboratory.certificate.fonts import font_families
from inercal.laboratory.certificate.libraries import certificate_library
from inercal.laboratory.certificate.pages import page_data

STANDARD = "a-3b"
_MISSING = re.compile(r'the text `?"(.+?)"`? could not be displayed', re.DOTALL)


def write_pdf(
    certificate: Certificate, dcc: bytes, font: Path | None, *, signed: bool = False
) -> bytes:
    """Return the certificate as PDF/A-3b.

    Parameters
    ----------
    certificate : Certificate
    dcc : bytes
        The digital calibration certificate, which is attached as an alternative of the pages.
    font : Path or None
        A font file for characters that typst's own fonts lack.
    signed : bool
        Whether the file will be signed by key
        (`inercal.laboratory.certificate.signature.sign_pdf`), which the pages then say.

    Raises
    ------
    InputError
        A character that no font has, named, or a font that is none.
    """
    attached = {
        "dcc": dcc.decode(),
        "calibration": calibration_bytes(certificate.results[-1]).decode(),
    }
    return _compile(certificate, attached, font, STANDARD, signed=signed)


def write_pdf_a1(certificate: Certificate, font: Path | None) -> bytes:
    """Return the same pages as PDF/A-1b without attachments, which other validators know."""
    return _compile(certificate, {}, font, "a-1b")


def _compile(
    certificate: Certificate,
    attached: dict[str, str],
    font: Path | None,
    standard: str,
    *,
    signed: bool = False,
) -> bytes:
    typst = certificate_library("typst")
    source = files("inercal.laboratory.certificate").joinpath("certificate.typ").read_bytes()
    with font_families(font) as (families, folders):
        # PDFBox Preflight cannot read the destinations of typst's outline.
        data = page_data(certificate, families, bookmarked=standard == STANDARD, signed=signed)
        try:
            document = typst.compile(
                source,
                format="pdf",
                pdf_standards=[standard],
                ignore_system_fonts=True,
                font_paths=list(folders),
                sys_inputs={"data": json.dumps(data), **attached},
            )
        except typst.TypstError as error:
            raise _refusal(str(error)) from None
    assert isinstance(document, bytes)  # one format, no output path
    return document


def _refusal(message: str) -> InputError:
    if missing := _MISSING.search(message):
        character = missing[1][0]
        name = unicodedata.name(character, "a character without a name")
        return InputError(
            f"no font of the certificate has {character!r} (U+{ord(character):04X}, {name}); name "
            "a font file that has it by --font, or change the text",
            key="--font",
            names=(character,),
        )
    return InputError(f"typst refuses the certificate: {message}")
