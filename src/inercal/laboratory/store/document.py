"""Verified calibrations that can be entered, with the additional columns of the register."""

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import numpy as np

from inercal.basics.errors import InputError
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
    file = None if isinstance(source, Calibration) else source
    calibration = parse(text, name)
    content: dict[str, Any] = json.loads(text)
    wrong = _content_defect(calibration, content)
    if wrong:
        raise InputError(
            f"{name} is a broken calibration file: {wrong}; restore the file", file=file
        )
    created = calibration.provenance.get("created", "")
    try:
        created = created and to_utc(created)
    except ValueError:
        raise InputError(
            f"{name}: the time of creation, {created!r}, is not in ISO 8601; calibrate again "
            "or restore the file",
            file=file,
            key="created",
        ) from None
    return CalibrationDocument(
        name,
        canonical_text(content),
        content["sha256"],
        calibration,
        created,
        recording_sha256(calibration),
    )


def _content_defect(calibration: Calibration, content: dict[str, Any]) -> str:
    """Describe a defect in a file whose hash is correct; empty if there is none."""
    for name in ("conditions", "provenance"):
        given: Any = content[name]
        if not isinstance(given, dict) or not all(
            isinstance(text, str) for text in cast(dict[Any, Any], given).values()
        ):
            return f"{name} must contain only texts by name"
    for text in (content["method"], content["estimator"], content["sensor"]["name"]):
        if not isinstance(text, str):
            return f"{text!r} is not a text"
    if not calibration.sensor.name.strip():
        return "its sensor has no name"
    variances = np.diag(calibration.covariance)
    if not (np.isfinite(variances).all() and (variances >= 0).all()):
        return "a variance is negative"
    return ""


def to_utc(text: str) -> str:
    """Convert a time in ISO 8601 to the form in the register: in UTC, to the millisecond.

    A time without a zone is assumed to be UTC, and a date means the beginning of this day.

    Raises
    ------
    ValueError
        If the text is not a time in ISO 8601.

    Examples
    --------
    >>> to_utc("2026-03-01"), to_utc("2026-03-01T10:00:00+02:00")
    ('2026-03-01T00:00:00.000+00:00', '2026-03-01T08:00:00.000+00:00')
    """
    time = datetime.fromisoformat(text)
    try:
        time = time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
    except OverflowError:  # in UTC, before the first year or after the last year
        raise ValueError(f"{text} is out of range") from None
    return time.isoformat(timespec="milliseconds")


def utc_now() -> str:
    """Return the current time in the form that the register stores."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")
