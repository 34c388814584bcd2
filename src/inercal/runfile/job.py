"""Reader for [job] in a run file, with the customer, the dates, the staff and the instruments.

None of these keys affects a coefficient. They are stored as texts in the calibration. If the
calibration of an instrument was due before the date of the measurement, a warning is issued.
"""

from datetime import date
from pathlib import Path

from pydantic import Field

from inercal.physics.section_settings import DESCRIPTION, Section
from inercal.recordings import Finding
from inercal.runfile.laboratory_file import read_laboratory

_LABORATORY_TEXTS = {"laboratory", "address", "accreditation", "approved_by"}


def _text(*example: str) -> str | None:
    return Field(None, examples=list(example), json_schema_extra=DESCRIPTION)


class JobSection(Section):
    """Keys of [job]: the order for this calibration."""

    lab: str | None = Field(
        None,
        description="file of the laboratory",
        examples=["lab.toml"],
        json_schema_extra=DESCRIPTION,
    )
    number: str | None = _text("2026-117")
    customer: str | None = _text("Basin No. 3")
    customer_address: str | None = _text("Wharf 2, Kiel")
    customer_email: str | None = _text("test@basin.example")
    item: str | None = _text("accelerometer triad")
    maker: str | None = _text("Q-Flex")
    model: str | None = _text("QA 2000")
    serial_number: str | None = _text("0417")
    condition: str | None = _text("new, connector sealed")
    operating_hours: float | None = Field(
        None, ge=0, allow_inf_nan=False, examples=[1250.0], json_schema_extra=DESCRIPTION
    )
    received: date | None = Field(
        None, examples=[date(2026, 11, 20)], json_schema_extra=DESCRIPTION
    )
    measured: date | None = Field(
        None, examples=[date(2026, 11, 25)], json_schema_extra=DESCRIPTION
    )
    measured_until: date | None = Field(
        None, examples=[date(2026, 11, 26)], json_schema_extra=DESCRIPTION
    )
    place: str | None = _text("at the customer's, Kiel")
    procedure: str | None = _text("QA-17")
    operator: str | None = _text("A. Lovelace")
    ambient_temperature: str | None = _text("22.3 °C ± 0.5 °C")
    ambient_humidity: str | None = _text("45 %")
    ambient_pressure: str | None = _text("1013 hPa ± 2 hPa")
    degrees_of_freedom: float | None = Field(
        None, gt=0, examples=[8.0], json_schema_extra=DESCRIPTION
    )
    deviations: str | None = _text("position 3 was omitted")
    external: str | None = _text("temperature tests by Laboratory B")
    opinions: str | None = _text("the bias agrees with that of a new sensor")
    notes: str | None = _text("after repair of the cable")

    @property
    def last_day(self) -> date | None:
        """Return the last day of the measurement."""
        return self.measured_until or self.measured


def job_texts(job: JobSection | None, folder: Path) -> tuple[dict[str, str], tuple[Finding, ...]]:
    """Return the texts of a job and its laboratory, and warnings about overdue instruments.

    Parameters
    ----------
    job : JobSection or None
    folder : Path
        Folder of the run file.

    Raises
    ------
    InputError
        The laboratory file cannot be read or has unknown keys.
    """
    if job is None:
        return {}, ()
    stated = job.model_dump(exclude_none=True, exclude={"lab"})
    texts = {name.replace("_", " "): str(value) for name, value in stated.items()}
    if job.lab is None:
        return texts, ()
    found = read_laboratory(folder / job.lab)
    own = found.model_dump(exclude_none=True, include=_LABORATORY_TEXTS)
    texts |= {name.replace("_", " "): str(value) for name, value in own.items()}
    warnings: list[Finding] = []
    for one in found.instrument:
        parts = {"serial number": one.serial_number, "certificate": one.certificate, "due": one.due}
        texts[f"instrument {one.name}"] = ", ".join(f"{k} {v}" for k, v in parts.items() if v)
        if one.is_overdue(job.last_day):
            message = (
                f"the calibration of instrument {one.name} was due on {one.due}, before the "
                f"measurement on {job.last_day}: state a valid certificate in {job.lab}"
            )
            warnings.append(Finding("warning", "instrument", message))
    return texts, tuple(warnings)
