"""Verify calibrations before they are entered, and add the columns of the register."""

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from inercal.basics.documents import to_utc
from inercal.calibration import Calibration
from inercal.calibration.comparison import recording_sha256
from inercal.calibration.files import calibration_object, canonical_text, parse, read_text
from inercal.physics.sensors import SI_UNITS


@dataclass(frozen=True, eq=False)
class CalibrationDocument:
    """A verified calibration with its text.

    Parameters
    ----------
    source : str
        Name used in error messages.
    text : str
        The whole calibration file as JSON.
    sha256 : str
        SHA-256 hash that the file states.
    calibration : Calibration
    created : str
        Time of creation, ISO 8601, UTC; empty if the file does not state it.
    recording : str
        SHA-256 of the recording; empty if the file does not state it.
    """

    source: str
    text: str
    sha256: str
    calibration: Calibration
    created: str
    recording: str

    @property
    def units(self) -> list[str]:
        """SI units of the coefficients."""
        sensor = self.calibration.sensor
        return [SI_UNITS[sensor.coefficient(name).unit] for name in sensor.coefficients]


def make_document(source: Calibration | str | Path) -> CalibrationDocument:
    """Convert a calibration, or a calibration file, to a document that can be entered.

    Raises
    ------
    InputError
        If the file is missing or damaged, or has content that a register cannot store.
    """
    if isinstance(source, Calibration):
        name = f"calibration of {source.sensor.name}"
        text = json.dumps(calibration_object(source), ensure_ascii=False)
    else:
        name, text = str(source), read_text(source)
    calibration = parse(text, name)
    content: dict[str, Any] = json.loads(text)
    created = calibration.provenance.get("created", "")
    return CalibrationDocument(
        name,
        canonical_text(content),
        content["sha256"],
        calibration,
        created and to_utc(created),
        recording_sha256(calibration),
    )


def utc_now() -> str:
    """Return the current time in the form that the register stores."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")
