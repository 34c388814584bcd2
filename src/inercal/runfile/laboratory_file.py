"""Reader for the laboratory file, lab.toml, with the entries that all jobs share.

A run file with [job] uses only the names and the instruments; a certificate uses all keys.
"""

from datetime import date
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from inercal.basics.small_files import read_toml
from inercal.physics.section_settings import Section
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
    """Keys of [capability]: the calibration and measurement capability (CMC).

    `uncertainty` contains the smallest U (k = 2) that the laboratory states, under the same names
    as in [specification.limits]. A coefficient that is not named is outside the capability. A range
    consists of two quantities.
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
