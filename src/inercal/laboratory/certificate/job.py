"""Read the job data of a certificate from [job] in the run file and in an additional file."""

from collections.abc import Mapping
from pathlib import Path

from pydantic import ValidationError

from inercal.basics.errors import InputError
from inercal.basics.small_files import read_toml
from inercal.physics.section_settings import Section
from inercal.runfile.job import JobSection, LaboratoryFile, require_possible_dates
from inercal.runfile.validation_errors import schema_error

_OF_JOB = ("customer", "customer_address", "serial_number", "condition", "measured")
_OF_LABORATORY = ("address", "country", "approved_by", "procedure", "traceability")


class _OrderFile(Section):
    """An additional job file, which has one section."""

    job: JobSection


def read_job(texts: Mapping[str, str], path: Path | None = None) -> JobSection:
    """Return the job data of a calibration.

    Parameters
    ----------
    texts : mapping of str to str
        `Calibration.job`.
    path : Path, optional
        A TOML file with a section [job], whose keys replace or complete the keys in the
        calibration.

    Raises
    ------
    InputError
        If the file cannot be read, or has an unknown section or key or an invalid date.
    """
    # The other texts in a calibration come from the laboratory file.
    stated: dict[str, object] = {
        key: text
        for name, text in texts.items()
        if (key := name.replace(" ", "_")) in JobSection.model_fields
    }
    if path is not None:
        added = _validate(read_toml(path, "job file"), path)
        stated |= added.model_dump(exclude_unset=True)
    return _validate({"job": stated}, "the calibration")


def _validate(content: Mapping[str, object], where: Path | str) -> JobSection:
    try:
        return _OrderFile.model_validate(content).job
    except ValidationError as error:
        raise schema_error(error, content, _OrderFile).located(where) from None


def require_complete(job: JobSection, laboratory: LaboratoryFile) -> None:
    """Raise an error if an item that ISO/IEC 17025:2017, 7.8.2 or 7.8.4 requires is missing.

    Raises
    ------
    InputError
        If items are missing. The message names all missing items.
    """
    of_job = [f"[job] {key}" for key in _OF_JOB if getattr(job, key) is None]
    procedure = job.procedure or laboratory.procedure
    of_laboratory = [
        f"{key} in the laboratory's file"
        for key in _OF_LABORATORY
        if getattr(laboratory, key) is None and not (key == "procedure" and procedure)
    ]
    if missing := (*of_job, *of_laboratory):
        places = ["[job] keys in the run file or in a file given by --job"] if of_job else []
        places += ["the laboratory's keys in the file given by --lab"] if of_laboratory else []
        raise InputError(
            f"the certificate still needs {', '.join(missing)}; state {', '.join(places)}",
            key=missing[0],
            names=missing,
        )
    require_possible_dates(job)
