"""Issue certificates in the register: each number is used only once, and without gaps.

A number is the text `series`, in which "{year}" and "{sequence}" (or "{sequence:4}" for 4 digits)
are filled in. The sequence starts at 1 in each year. The number, the files that contain it and the
row in the register are made in one transaction that locks the register. If the files cannot be
made, the number remains unused.
"""

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from typing import NamedTuple

from sqlalchemy import Connection, func, select

from inercal.basics.documents import attributes
from inercal.basics.errors import InputError
from inercal.laboratory.store.insertions import EntryAuthor, insert_row
from inercal.laboratory.store.register_tables import calibration, certificate, sensor

DEFAULT_SERIES = "{year}-{sequence:4}"
_SERIES = re.compile(r"(?:[A-Za-z0-9._-]|\{year\}|\{sequence(?::[1-9])?\})+")
_SEQUENCE = re.compile(r"\{sequence(?::([1-9]))?\}")


@dataclass(frozen=True)
class CertificateFiles:
    """The files of a certificate: the PDF, and the DCC as XML."""

    pdf: bytes
    dcc: bytes


@dataclass(frozen=True)
class CertificateEntry:
    """A certificate in the register.

    Parameters
    ----------
    number : str
    calibration : int
        Number of the calibration in the register.
    issued : str
        Date of issue, ISO 8601.
    change : "", "amended" or "substituted"
        How the certificate changes an earlier certificate; empty if it changes none.
    previous : str
        Number of the earlier certificate; empty if there is none.
    files : CertificateFiles
    pdf_sha256, dcc_sha256 : str
    by, at : str
        Author and time of issue, ISO 8601, UTC.
    """

    number: str
    calibration: int
    issued: str
    change: str
    previous: str
    files: CertificateFiles
    pdf_sha256: str
    dcc_sha256: str
    by: str
    at: str


class CertificateSummary(NamedTuple):
    """A certificate without its files; the fields are the same as in `CertificateEntry`."""

    number: str
    issued: str
    sensor: str
    calibration: int
    change: str
    previous: str
    by: str


@dataclass(frozen=True)
class CertificateRequest:
    """The data that the register needs before it issues a certificate.

    Parameters
    ----------
    series : str
        Pattern of the number.
    issued : date
    change, previous : str
        See `CertificateEntry`.
    make : callable
        Function that makes the files from the number and, if any, the earlier certificate.
    """

    series: str
    issued: date
    change: str
    previous: str
    make: Callable[[str, CertificateEntry | None], CertificateFiles]


def require_series(series: str) -> None:
    """Raise an error if numbers from a pattern would not be unique or could not be file names.

    Raises
    ------
    InputError
    """
    if not _SERIES.fullmatch(series) or "{year}" not in series or not _SEQUENCE.search(series):
        raise InputError(
            f"certificate_number: {series!r} is not a valid pattern; use letters, digits, "
            f"points and hyphens with {{year}} and {{sequence}}, such as "
            f'"IL-{{year}}-{{sequence:4}}"',
            key="certificate_number",
        )


def number_text(series: str, year: int, sequence: int) -> str:
    """Return the text of a certificate number in a series.

    Examples
    --------
    >>> number_text("IL-{year}-{sequence:4}", 2026, 7)
    'IL-2026-0007'
    """
    digits = _SEQUENCE.sub(lambda found: str(sequence).zfill(int(found[1] or 1)), series)
    return digits.replace("{year}", str(year))


def issue_certificate(
    db: Connection, calibration_id: int, wanted: CertificateRequest, who: EntryAuthor
) -> CertificateEntry:
    """Issue the next certificate of a series with its files, and return the entry.

    Raises
    ------
    InputError
        If the earlier certificate is not in the register, or the number belongs to another series.
    """
    require_series(wanted.series)
    previous = find_certificate(db, wanted.previous) if wanted.previous else None
    year = wanted.issued.year
    of_year = (certificate.c.series == wanted.series, certificate.c.year == year)
    last = db.scalar(select(func.max(certificate.c.sequence)).where(*of_year))
    sequence = (last or 0) + 1
    number = number_text(wanted.series, year, sequence)
    if db.scalar(select(certificate.c.id).where(certificate.c.number == number)) is not None:
        raise InputError(
            f"certificate {number} was issued with another pattern of numbers; give "
            "certificate_number its own prefix",
            key="certificate_number",
            names=(number,),
        )
    files = wanted.make(number, previous)
    values = {
        "number": number,
        "series": wanted.series,
        "year": year,
        "sequence": sequence,
        "calibration_id": calibration_id,
        "issued": wanted.issued.isoformat(),
        "change": wanted.change,
        "previous": wanted.previous,
        "pdf_sha256": hashlib.sha256(files.pdf).hexdigest(),
        "dcc_sha256": hashlib.sha256(files.dcc).hexdigest(),
        "pdf": files.pdf,
        "dcc": files.dcc,
    }
    insert_row(db, certificate, values, who)
    return find_certificate(db, number)


def find_certificate(db: Connection, number: str) -> CertificateEntry:
    """Return the certificate with this number.

    Raises
    ------
    InputError
        If there is no such certificate.
    """
    found = db.execute(select(certificate).where(certificate.c.number == number)).one_or_none()
    if found is None:
        numbers = db.scalars(select(certificate.c.number).order_by(certificate.c.id)).all()
        last = f"; the last one is {numbers[-1]}" if numbers else ""
        raise InputError(
            f"there is no certificate {number!r} in the register{last}; check the number",
            names=(number,),
        )
    return CertificateEntry(
        calibration=found.calibration_id,
        files=CertificateFiles(bytes(found.pdf), bytes(found.dcc)),
        by=found.entered_by,
        at=found.entered_at,
        **attributes(found, "number issued change previous pdf_sha256 dcc_sha256"),
    )


def list_certificates(db: Connection) -> tuple[CertificateSummary, ...]:
    """Return all certificates without their files, in the order of issue."""
    query = (
        select(
            certificate.c.number,
            certificate.c.issued,
            sensor.c.name.label("sensor"),
            certificate.c.calibration_id.label("calibration"),
            certificate.c.change,
            certificate.c.previous,
            certificate.c.entered_by.label("by"),
        )
        .join(calibration, calibration.c.id == certificate.c.calibration_id)
        .join(sensor, sensor.c.id == calibration.c.sensor_id)
        .order_by(certificate.c.id)
    )
    return tuple(CertificateSummary(*row) for row in db.execute(query))


def successors(db: Connection, number: str) -> tuple[tuple[str, str], ...]:
    """Return number and kind of change of each certificate that changes the given certificate."""
    query = select(certificate.c.number, certificate.c.change).order_by(certificate.c.id)
    rows = db.execute(query.where(certificate.c.previous == number))
    return tuple((row.number, row.change) for row in rows)
