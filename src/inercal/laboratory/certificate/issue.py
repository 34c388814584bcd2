"""Issue a certificate: assign a number, make the files and enter them in the register.

typst writes the PDF as PDF/A-3b and attaches the DCC and the calibration file. The date in the
document is the date of issue, so the same certificate always gives the same bytes. The font is one
that comes with typst, or a font file for Chinese.

The laboratory's key signs the PDF with PAdES (B-B) and the DCC with XAdES (enveloped). It is read
from a PKCS#12 file for each certificate and is never stored. Signatures have no time stamp (B-T),
because a time stamp needs a service on the network.
"""

import json
import re
import shutil
import tempfile
import unicodedata
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import Any

from inercal.basics.errors import InputError
from inercal.basics.small_files import read_small_file
from inercal.laboratory.certificate import content
from inercal.laboratory.certificate.content import Language
from inercal.laboratory.certificate.dcc import calibration_bytes, write_dcc
from inercal.laboratory.certificate.dcc_elements import (
    certificate_library,
    etree,
    signature_library,
)
from inercal.laboratory.certificate.dcc_reading import schema_defects
from inercal.laboratory.certificate.pages import page_data
from inercal.laboratory.store import (
    CertificateEntry,
    CertificateFiles,
    CertificateRequest,
    Register,
)
from inercal.laboratory.store.certificates import DEFAULT_SERIES, require_series

_FIELD = "inercal_certificate"


@dataclass(frozen=True, eq=False)
class SigningKey:
    """A signing key with its certificate, and the certificates of the issuers.

    Parameters
    ----------
    key, certificate : objects of the package cryptography
    chain : tuple
        Certificates of the issuers.
    content : bytes
        The PKCS#12 file.
    passphrase : bytes
    """

    key: Any
    certificate: Any
    chain: tuple[Any, ...]
    content: bytes
    passphrase: bytes

    def __repr__(self) -> str:
        return f"<SigningKey of {self.certificate.subject.rfc4514_string()}>"


def read_signing_key(path: Path, passphrase: str) -> SigningKey:
    """Read a key from a PKCS#12 file.

    Raises
    ------
    InputError
        If the file cannot be read, the passphrase is wrong, or a key or certificate is missing.
    MissingExtra
        If the packages for signatures are not installed.
    """
    pkcs12 = signature_library("cryptography.hazmat.primitives.serialization.pkcs12")
    content = read_small_file(path, "PKCS#12 file")
    try:
        key, certificate, chain = pkcs12.load_key_and_certificates(content, passphrase.encode())
    except ValueError as error:
        raise InputError(
            f"--sign {path} is not a PKCS#12 file, or the passphrase is wrong: {error}",
            file=path,
            key="--sign",
        ) from None
    if key is None or certificate is None:
        raise InputError(
            f"--sign {path} does not contain a key together with its certificate",
            file=path,
            key="--sign",
        )
    return SigningKey(key, certificate, tuple(chain), content, passphrase.encode())


def sign_dcc(document: bytes, key: SigningKey) -> bytes:
    """Return the DCC with an XAdES signature as the last child of its root."""
    enveloped = signature_library("signxml").methods.enveloped
    signer = signature_library("signxml.xades").XAdESSigner(method=enveloped)
    chain = [key.certificate, *key.chain]
    signed = signer.sign(etree.fromstring(document), key=key.key, cert=chain)
    return bytes(etree.tostring(signed, xml_declaration=True, encoding="UTF-8")) + b"\n"


def sign_pdf(document: bytes, key: SigningKey) -> bytes:
    """Return the PDF with a PAdES signature, which is appended to the unchanged bytes.

    Raises
    ------
    InputError
        If the key cannot sign a PDF.
    """
    signers = signature_library("pyhanko.sign.signers")
    pades = signature_library("pyhanko.sign.fields").SigSeedSubFilter.PADES
    writer = signature_library("pyhanko.pdf_utils.incremental_writer").IncrementalPdfFileWriter
    signer = signers.SimpleSigner.load_pkcs12_data(key.content, (), key.passphrase)
    if signer is None:
        raise InputError("--sign: a key of this kind cannot sign a PDF; give an RSA or ECDSA key")
    metadata = signers.PdfSignatureMetadata(
        field_name=_FIELD, subfilter=pades, md_algorithm="sha256"
    )
    output = BytesIO()
    signers.sign_pdf(writer(BytesIO(document)), metadata, signer=signer, output=output)
    return output.getvalue()


@dataclass(frozen=True)
class IssueOptions:
    """Options for making the files of a certificate.

    Parameters
    ----------
    font, schema : Path or None
    key : SigningKey or None
    change : "", "amended" or "substituted"
    previous, reason : str
        Number of the certificate to change, and the reason for the change.
    """

    font: Path | None = None
    schema: Path | None = None
    key: SigningKey | None = None
    change: content.Change = ""
    previous: str = ""
    reason: str = ""


def make_files(
    given: content.CertificateInput,
    number: str,
    options: IssueOptions,
    previous: CertificateEntry | None = None,
) -> CertificateFiles:
    """Make the files of a certificate and return them.

    Raises
    ------
    InputError
        See `make_certificate`, `find_font` and `write_pdf`. The error is also raised if the DCC
        does not conform to the schema.
    """
    font = find_font(given.language, options.font)
    change = content.CertificateChange()
    if previous is not None:
        change = content.CertificateChange(
            options.change, previous.number, previous.dcc_sha256, options.reason
        )
    certificate = content.make_certificate(given, number, change)
    dcc = write_dcc(certificate)
    if options.key is not None:
        dcc = sign_dcc(dcc, options.key)
    if options.schema is not None and (defects := schema_defects(dcc, options.schema)):
        raise InputError(
            f"the DCC does not conform to {options.schema}: {defects[0]}",
            file=options.schema,
            key="--schema",
        )
    pdf = write_pdf(certificate, dcc, font, signed=options.key is not None)
    if options.key is not None:
        pdf = sign_pdf(pdf, options.key)
    return CertificateFiles(pdf, dcc)


def issue(
    source: Path, given: content.CertificateInput, options: IssueOptions, register: Register
) -> CertificateEntry:
    """Issue a certificate with the next number of the laboratory.

    Raises
    ------
    InputError
        See `make_files`. The error is also raised if the register refuses the entry. The number
        then remains unused.
    """
    series = given.laboratory.certificate_number or DEFAULT_SERIES
    require_series(series)
    # The files are made once before the register is created or locked, because errors should come
    # early.
    make_files(given, "0", IssueOptions(options.font, options.schema))
    request = CertificateRequest(
        series,
        given.issued,
        options.change,
        options.previous,
        lambda number, previous: make_files(given, number, options, previous),
    )
    assert given.job.measured is not None  # `make_files`
    return register.issue_certificate(source, request, given.job.measured.isoformat())


STANDARD = "a-3b"
_MISSING = re.compile(r'the text `?"(.+?)"`? could not be displayed', re.DOTALL)


def write_pdf(
    certificate: content.Certificate, dcc: bytes, font: Path | None, *, signed: bool = False
) -> bytes:
    """Return the certificate as PDF/A-3b.

    Parameters
    ----------
    certificate : Certificate
    dcc : bytes
        The digital calibration certificate; it is attached as an alternative to the pages.
    font : Path or None
        A font file for characters that are missing in typst's own fonts.
    signed : bool
        Whether the file will be signed electronically
        (`inercal.laboratory.certificate.issue.sign_pdf`). If so, the pages say this.

    Raises
    ------
    InputError
        If no font contains one of the characters (the message names this character), or the font
        file is not a font.
    """
    attached = {
        "dcc": dcc.decode(),
        "calibration": calibration_bytes(certificate.results[-1]).decode(),
    }
    return _compile(certificate, attached, font, STANDARD, signed=signed)


def write_pdf_a1(certificate: content.Certificate, font: Path | None) -> bytes:
    """Return the same pages as PDF/A-1b, without attachments, because some validators need this."""
    return _compile(certificate, {}, font, "a-1b")


def _compile(
    certificate: content.Certificate,
    attached: dict[str, str],
    font: Path | None,
    standard: str,
    *,
    signed: bool = False,
) -> bytes:
    typst = certificate_library("typst")
    source = files("inercal.laboratory.certificate").joinpath("certificate.typ").read_bytes()
    with font_families(font) as (families, folders):
        # PDFBox Preflight cannot read the link destinations in typst's outline.
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
    assert isinstance(document, bytes)  # because there is one format and no output path
    return document


def _refusal(message: str) -> InputError:
    if missing := _MISSING.search(message):
        character = missing[1][0]
        name = unicodedata.name(character, "a character without a name")
        return InputError(
            f"the fonts of the certificate do not contain the character {character!r} "
            f"(U+{ord(character):04X}, {name}); give a font file that contains it with --font, "
            "or change the text",
            key="--font",
            names=(character,),
        )
    return InputError(f"typst could not typeset the certificate: {message}")


_OWN_FONT = "Libertinus Serif"  # included in typst
_CHINESE_FONTS = tuple(
    Path("/usr/share/fonts/opentype/noto") / name
    for name in ("NotoSerifCJK-Regular.ttc", "NotoSansCJK-Regular.ttc")
)  # from Debian's fonts-noto-cjk


def find_font(language: Language, font: Path | None) -> Path | None:
    """Return the font file that a language needs, or None if typst's own fonts are enough.

    Raises
    ------
    InputError
        If the text is Chinese but no Chinese font is given or installed, or if the file does not
        exist.
    """
    if font is not None:
        if not font.is_file():
            raise InputError(f"--font {font}: there is no such file; check the path", key="--font")
        return font
    if language != "zh":
        return None
    for path in _CHINESE_FONTS:
        if path.is_file():
            return path
    raise InputError(
        "a Chinese certificate needs a font with Chinese characters: install Debian's "
        f"fonts-noto-cjk ({_CHINESE_FONTS[0]}), or give a font file with --font",
        key="--font",
    )


@contextmanager
def font_families(font: Path | None) -> Generator[tuple[list[str], list[str]]]:
    """Yield the font families for the text, and the folders where typst finds them.

    Raises
    ------
    InputError
        If the file is not a font.
    """
    if font is None:
        yield [_OWN_FONT], []
        return
    with tempfile.TemporaryDirectory() as folder:
        # typst accepts only folders. This folder contains only the font file, and no other fonts.
        for file in {font, font.with_name(font.name.replace("Regular", "Bold"))}:
            if file.is_file():
                shutil.copy(file, folder)
        typst = certificate_library("typst")
        found: list[str] = typst.Fonts(
            include_system_fonts=False, include_embedded_fonts=False, font_paths=[folder]
        ).families()
        if not found:
            raise InputError(
                f"--font {font} is not a font; give a .ttf, .otf or .ttc file", key="--font"
            )
        # If the file is a collection for several regions, the simplified characters are used.
        simplified = [name for name in found if name.endswith(" SC") and "Mono" not in name]
        yield [_OWN_FONT, (simplified or found)[0]], [folder]
