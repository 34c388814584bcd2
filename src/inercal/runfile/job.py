"""[job] of a run file and the laboratory's own file: who, what, when, and with which instruments.

Nothing here changes a coefficient. A calibration carries it as texts; an instrument whose
certificate was due before the date of the measurement is a warning.
"""

from collections.abc import Mapping
from datetime import date
from pathlib import Path

from pydantic import Field, ValidationError

from inercal.errors import InputError
from inercal.recording import Finding
from inercal.section_settings import DESCRIPTION, Section
from inercal.small_files import read_toml


def _text(*example: str) -> str | None:
    return Field(None, examples=list(example), json_schema_extra=DESCRIPTION)


class JobSection(Section):
    """[job]: the order of this calibration."""

    lab: str | None = Field(
        None,
        description="file of the laboratory",
        examples=["lab.toml"],
        json_schema_extra=DESCRIPTION,
    )
    number: str | None = _text("2026-117")
    customer: str | None = _text("Basin No. 3")
    maker: str | None = _text("Q-Flex")
    model: str | None = _text("QA 2000")
    serial_number: str | None = _text("0417")
    condition: str | None = _text("new, connector sealed")
    received: date | None = Field(
        None, examples=[date(2026, 11, 20)], json_schema_extra=DESCRIPTION
    )
    measured: date | None = Field(
        None, examples=[date(2026, 11, 25)], json_schema_extra=DESCRIPTION
    )
    operator: str | None = _text("A. Lovelace")
    ambient_temperature: str | None = _text("22.3 °C ± 0.5 °C")
    ambient_humidity: str | None = _text("45 %")
    notes: str | None = _text("after repair of the cable")


class InstrumentSection(Section):
    """[[instrument]] of the laboratory's file."""

    name: str = Field(examples=["dividing head 2"])
    serial_number: str | None = None
    certificate: str | None = Field(None, examples=["PTB 4711/25"])
    due: date | None = Field(None, examples=[date(2027, 3, 1)])


class LaboratoryFile(Section):
    """The laboratory's file."""

    laboratory: str = Field(examples=["Inertial Laboratory"])
    address: str | None = None
    accreditation: str | None = Field(None, examples=["D-K-15000-01-00"])
    approved_by: str | None = Field(None, examples=["C. F. Gauss"])
    instrument: tuple[InstrumentSection, ...] = ()


def job_texts(job: JobSection | None, folder: Path) -> tuple[dict[str, str], tuple[Finding, ...]]:
    """Return the texts of a job and its laboratory, by name, and warnings of overdue instruments.

    Parameters
    ----------
    job : JobSection or None
    folder : Path
        Of the run file.

    Raises
    ------
    InputError
        The laboratory's file cannot be read, or has other keys.
    """
    if job is None:
        return {}, ()
    stated = job.model_dump(exclude_none=True, exclude={"lab"})
    texts = {name.replace("_", " "): str(value) for name, value in stated.items()}
    if job.lab is None:
        return texts, ()
    found = _read_laboratory(folder / job.lab)
    own = found.model_dump(exclude_none=True, exclude={"instrument"})
    texts |= {name.replace("_", " "): str(value) for name, value in own.items()}
    warnings: list[Finding] = []
    for one in found.instrument:
        parts = {"serial number": one.serial_number, "certificate": one.certificate, "due": one.due}
        texts[f"instrument {one.name}"] = ", ".join(f"{k} {v}" for k, v in parts.items() if v)
        if one.due is not None and job.measured is not None and one.due < job.measured:
            message = (
                f"instrument {one.name} was due on {one.due}, before the measurement on "
                f"{job.measured}: state a valid certificate in {job.lab}"
            )
            warnings.append(Finding("warning", "instrument", message))
    return texts, tuple(warnings)


def _read_laboratory(path: Path) -> LaboratoryFile:
    content: Mapping[str, object] = read_toml(path, "file of the laboratory")
    try:
        return LaboratoryFile.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        known = ", ".join(LaboratoryFile.model_fields)
        raise InputError(
            f"{path}: {key}: {first['msg'].lower()}; keys are {known}, and name, serial_number, "
            "certificate and due of each [[instrument]]",
            file=path,
            key=key,
        ) from None
