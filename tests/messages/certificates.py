"""Families of messages of certificates and of the laboratory's file."""

from collections.abc import Callable
from datetime import date
from pathlib import Path

from inercal.laboratory.certificate.dcc_reading import schema_defects
from inercal.laboratory.certificate.issue import find_font
from inercal.laboratory.certificate.job import read_job, require_complete
from inercal.laboratory.store import Register, restore_register
from inercal.laboratory.store.certificates import require_series
from inercal.runfile.job import JobSection, LaboratoryFile, read_laboratory


def order(folder: Path, text: str) -> JobSection:
    path = folder / "job.toml"
    path.write_text(text, encoding="utf-8")
    return read_job({}, path)


def laboratory(folder: Path, text: str) -> LaboratoryFile:
    path = folder / "lab.toml"
    path.write_text(text, encoding="utf-8")
    return read_laboratory(path)


def unknown_number(folder: Path) -> None:
    with Register(str(folder / "register.db")) as register:
        register.certificate("2026-0001")


def schema(folder: Path) -> None:
    path = folder / "dcc.xsd"
    path.write_text(
        '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" targetNamespace="a">'
        '<xs:import namespace="https://ptb.de/si"/></xs:schema>',
        encoding="utf-8",
    )
    schema_defects(b"<a/>", path)


CASES: dict[str, Callable[[Path], object]] = {
    "items that are missing": lambda _: require_complete(
        JobSection.model_validate({"customer": "A", "measured": date(2026, 1, 1)}),
        LaboratoryFile.model_validate(
            {"laboratory": "B", "address": "C", "country": "DE", "approved_by": "D"}
        ),
    ),
    "file of the order with another section": lambda folder: order(folder, "[jobs]\n"),
    "date that is none": lambda folder: order(folder, '[job]\nmeasured = "soon"\n'),
    "degrees of freedom that are none": lambda folder: order(
        folder, "[job]\ndegrees_of_freedom = -1\n"
    ),
    "country that is none": lambda folder: laboratory(
        folder, 'laboratory = "A"\ncountry = "Germany"\n'
    ),
    "unknown key of an instrument": lambda folder: laboratory(
        folder, 'laboratory = "A"\n[[instrument]]\nname = "B"\nnam = "C"\n'
    ),
    "pattern of numbers": lambda _: require_series("{year}"),
    "certificate that is not there": unknown_number,
    "font that is not there": lambda folder: find_font("en", folder / "a.ttf"),
    "schema without what it imports": schema,
    "file that is no backup": lambda folder: restore_register(folder / "a.db", str(folder / "b")),
}
