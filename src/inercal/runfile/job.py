"""Read [job] of a run file, which states the customer, the dates, the staff and the instruments.

None of these keys affects a coefficient. They are stored as texts in the calibration. If the
calibration of an instrument was due before the date of the measurement, a warning is issued.

The laboratory file, lab.toml, has the entries that all jobs share. A run file with [job] uses only
the names and the instruments; a certificate uses all keys.
"""

from datetime import UTC, date, datetime, timedelta
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from inercal.basics.errors import InputError
from inercal.basics.small_files import read_toml
from inercal.physics.section_settings import DESCRIPTION, Section, optional
from inercal.recordings import Finding
from inercal.runfile.validation_errors import schema_error

Action = Literal["refuse", "mark"]


class InstrumentSection(Section):
    """Keys of [[instrument]] in the laboratory file."""

    name: str = Field(examples=["dividing head 2"])
    serial_number: str | None = None
    certificate: str | None = Field(None, examples=["PTB 4711/25"])
    calibrated_by: str | None = Field(None, examples=["PTB"])
    due: date | None = Field(None, examples=[date(2027, 3, 1)])

    def is_overdue(self, day: date | None) -> bool:
        """Return whether the instrument was due for calibration before a measurement ended."""
        return self.due is not None and day is not None and self.due < day


class PersonSection(Section):
    """Keys of [[person]] in the laboratory file: staff other than the approving person."""

    name: str = Field(examples=["A. Lovelace"])
    role: str | None = Field(None, examples=["performed the calibration"])


class CapabilitySection(Section):
    """Keys of [capability], which state the calibration and measurement capability (CMC).

    `uncertainty` contains the smallest U (k = 2) that the laboratory states, under the same names
    as in [specification.limits]. Coefficients that are not listed are outside the capability. A
    range consists of two quantities.
    """

    uncertainty: dict[str, str] = Field({}, examples=[{"bias": "20 µg"}])
    force: tuple[str, str] | None = Field(None, examples=[("-1.1 g", "1.1 g")])
    rate: tuple[str, str] | None = Field(None, examples=[("-200 °/s", "200 °/s")])
    temperature: tuple[str, str] | None = Field(None, examples=[("18 °C", "28 °C")])


class PolicySection(Section):
    """Keys of [policy]: when a certificate is refused, and the mark on each of its pages."""

    unreliable: Action = "refuse"
    simulated: Action = "mark"
    outside_capability: Action = "mark"
    overdue: Action = "refuse"
    check_standard: Action = "refuse"


class LaboratoryFile(Section):
    """All sections of the laboratory file."""

    laboratory: str = Field(examples=["Inertial Laboratory"])
    address: str | None = None
    country: str | None = Field(None, pattern="^[A-Z]{2}$", examples=["DE"])
    email: str | None = None
    accreditation: str | None = Field(None, examples=["D-K-15000-01-00"])
    approved_by: str | None = Field(None, examples=["C. F. Gauss"])
    approver_role: str | None = Field(None, examples=["head of the laboratory"])
    procedure: str | None = Field(None, examples=["QA-17, after IEEE Std 1293-2018"])
    traceability: str | None = None
    statements: tuple[str, ...] = ()
    certificate_number: str | None = Field(None, examples=["IL-{year}-{sequence:4}"])
    instrument: tuple[InstrumentSection, ...] = ()
    person: tuple[PersonSection, ...] = ()
    capability: CapabilitySection | None = None
    policy: PolicySection = PolicySection()


def read_laboratory(path: Path) -> LaboratoryFile:
    """Read the laboratory file.

    Raises
    ------
    InputError
        The file cannot be read, has an unknown key, or has a value that is not possible.
    """
    content = read_toml(path, "file of the laboratory")
    try:
        return LaboratoryFile.model_validate(content)
    except ValidationError as error:
        raise schema_error(error, content, LaboratoryFile).located(path) from None


_DATES = ("received", "measured", "measured_until")  # in their order
_LABORATORY_TEXTS = {"laboratory", "address", "accreditation", "approved_by"}


_told = partial(optional, json_schema_extra=DESCRIPTION)


class JobSection(Section):
    """Keys of [job]: the order for this calibration."""

    lab: str | None = _told("lab.toml", about="file of the laboratory")
    number: str | None = _told("2026-117")
    customer: str | None = _told("Basin No. 3")
    customer_address: str | None = _told("Wharf 2, Kiel")
    customer_email: str | None = _told("test@basin.example")
    item: str | None = _told("accelerometer triad")
    maker: str | None = _told("Q-Flex")
    model: str | None = _told("QA 2000")
    serial_number: str | None = _told("0417")
    condition: str | None = _told("new, connector sealed")
    operating_hours: float | None = _told(1250.0, ge=0, allow_inf_nan=False)
    received: date | None = _told(date(2026, 11, 20))
    measured: date | None = _told(date(2026, 11, 25))
    measured_until: date | None = _told(date(2026, 11, 26))
    place: str | None = _told("at the customer's, Kiel")
    procedure: str | None = _told("QA-17")
    operator: str | None = _told("A. Lovelace")
    ambient_temperature: str | None = _told("22.3 °C ± 0.5 °C")
    ambient_humidity: str | None = _told("45 %")
    ambient_pressure: str | None = _told("1013 hPa ± 2 hPa")
    degrees_of_freedom: float | None = _told(8.0, gt=0)
    deviations: str | None = _told("position 3 was omitted")
    external: str | None = _told("temperature tests by Laboratory B")
    opinions: str | None = _told("the bias agrees with that of a new sensor")
    notes: str | None = _told("after repair of the cable")

    @property
    def last_day(self) -> date | None:
        """Return the last day of the measurement."""
        return self.measured_until or self.measured


def require_possible_dates(job: JobSection) -> None:
    """Raise an error if dates of a job contradict each other or are in the future.

    Raises
    ------
    InputError
    """
    stated = zip(_DATES, (job.received, job.measured, job.measured_until), strict=True)
    known = [(f"[job] {name}", day) for name, day in stated if day is not None]
    for (earlier, first), (later, second) in pairwise(known):
        if second < first:
            message = f"{later} {second} is before {earlier} {first}; correct one of them"
            raise InputError(message, key=later)
    if known and known[-1][1] > (datetime.now(UTC) + timedelta(days=1)).date():
        key, day = known[-1]
        raise InputError(f"{key} {day} is in the future; correct it", key=key)


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
        The laboratory file cannot be read or has unknown keys, or a date is not possible.
    """
    if job is None:
        return {}, ()
    require_possible_dates(job)
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
