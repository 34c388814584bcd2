"""A certificate issued: number, files and register in one step."""

from dataclasses import dataclass
from pathlib import Path

from inercal.basics.errors import InputError
from inercal.laboratory.certificate.content import (
    CertificateChange,
    CertificateInput,
    Change,
    make_certificate,
)
from inercal.laboratory.certificate.dcc import write_dcc
from inercal.laboratory.certificate.fonts import find_font
from inercal.laboratory.certificate.pdf import write_pdf
from inercal.laboratory.certificate.schema import schema_defects
from inercal.laboratory.certificate.signature import SigningKey, sign_dcc, sign_pdf
from inercal.laboratory.store import (
    CertificateEntry,
    CertificateFiles,
    CertificateRequest,
    Register,
)
from inercal.laboratory.store.certificates import DEFAULT_SERIES, require_series


@dataclass(frozen=True)
class IssueOptions:
    """How the files of a certificate are made.

    Parameters
    ----------
    font, schema : Path or None
    key : SigningKey or None
    change : "", "amended" or "substituted"
    previous, reason : str
        Number of the certificate that is changed, and why.
    """

    font: Path | None = None
    schema: Path | None = None
    key: SigningKey | None = None
    change: Change = ""
    previous: str = ""
    reason: str = ""


def make_files(
    given: CertificateInput,
    number: str,
    options: IssueOptions,
    previous: CertificateEntry | None = None,
) -> CertificateFiles:
    """Return the files of a certificate.

    Raises
    ------
    InputError
        What `make_certificate`, `find_font` and `write_pdf` refuse, or a DCC that contradicts the
        schema.
    """
    font = find_font(given.language, options.font)
    change = CertificateChange()
    if previous is not None:
        change = CertificateChange(
            options.change, previous.number, previous.dcc_sha256, options.reason
        )
    certificate = make_certificate(given, number, change)
    dcc = write_dcc(certificate)
    if options.key is not None:
        dcc = sign_dcc(dcc, options.key)
    if options.schema is not None and (defects := schema_defects(dcc, options.schema)):
        raise InputError(
            f"the DCC contradicts {options.schema}: {defects[0]}",
            file=options.schema,
            key="--schema",
        )
    pdf = write_pdf(certificate, dcc, font, signed=options.key is not None)
    if options.key is not None:
        pdf = sign_pdf(pdf, options.key)
    return CertificateFiles(pdf, dcc)


def issue(
    source: Path, given: CertificateInput, options: IssueOptions, register: Register
) -> CertificateEntry:
    """Issue a certificate with the next number of the laboratory.

    Raises
    ------
    InputError
        As `make_files`, or what the register refuses; no number is used then.
    """
    series = given.laboratory.certificate_number or DEFAULT_SERIES
    require_series(series)
    # A rehearsal: what is refused is refused before the register is created or locked.
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
