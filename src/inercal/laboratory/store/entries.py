"""The entries of a register, and the facts that a run reports to it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from inercal.calibration import Calibration
from inercal.calibration.files import parse
from inercal.physics.sensors import Sensor


@dataclass(frozen=True)
class SensorEntry:
    """A sensor.

    Parameters
    ----------
    id : int
    name : str
    axes : tuple of str
    calibrations : int
        Number of calibrations of the sensor.
    last : str or None
        Date of the last calibration, ISO 8601.
    by, at : str
        Who entered it, and when, ISO 8601, UTC.
    """

    id: int
    name: str
    axes: tuple[str, ...]
    calibrations: int
    last: str | None
    by: str
    at: str


class FileEntry(NamedTuple):
    """A file in the folder of a run, with its name, size in bytes and SHA-256."""

    name: str
    size: int
    sha256: str


@dataclass(frozen=True)
class RunEntry:
    """A run.

    Parameters
    ----------
    id : int
    key : str
        Identity of the run, independent of where its folder is.
    sensor : str
    kind, bench : str
        Kind of bench, and its name where the run file gives one.
    begun : str
        ISO 8601, UTC.
    state : str
        Of `inercal.host.journal.JournalHeader`.
    table, imu : str
        Addresses.
    folder : str
    files : tuple of FileEntry
    by, at : str
        Who entered it, and when, ISO 8601, UTC.
    """

    id: int
    key: str
    sensor: str
    kind: str
    bench: str
    begun: str
    state: str
    table: str
    imu: str
    folder: str
    files: tuple[FileEntry, ...]
    by: str
    at: str


@dataclass(frozen=True)
class CalibrationEntry:
    """A calibration.

    Parameters
    ----------
    id : int
    sensor : str
    kind, bench : str
        Kind of bench and its name; empty if they are not known.
    run : int or None
        The run whose recording was calibrated.
    measured : str
        Time of measurement, ISO 8601, UTC.
    measured_from : "stated", "run" or "created"
        Source of that time: the user, the begin of the run, or the calibration file.
    method, estimator : str
    grade : str
        Of the verdict, "consistent", "reservations" or "unreliable"; empty if it is unknown.
    sha256 : str
        Of the calibration's content, as its file states it.
    by, at : str
        Who entered it, and when, ISO 8601, UTC.
    content : str
        The whole calibration file, JSON.
    """

    id: int
    sensor: str
    kind: str
    bench: str
    run: int | None
    measured: str
    measured_from: str
    method: str
    estimator: str
    grade: str
    sha256: str
    by: str
    at: str
    content: str = field(repr=False)

    @cached_property
    def calibration(self) -> Calibration:
        """The calibration itself, after verifying its hash again.

        Raises
        ------
        InputError
            The text in the register is not what was entered.
        """
        return parse(self.content, f"calibration #{self.id}")


@dataclass(frozen=True)
class RunFacts:
    """The facts that a run reports to the register.

    Parameters
    ----------
    key : str
        Identity of the run, independent of when it is entered and where its folder is.
    sensor : Sensor
    kind, bench : str
        Kind of bench, and its name, empty if it has none.
    begun : str
        ISO 8601.
    state : str
        Of `inercal.host.journal.JournalHeader`.
    table, imu : str
        Addresses.
    folder : str
    files : mapping of str to (int, str)
        Size and SHA-256 by name.
    """

    key: str
    sensor: Sensor
    kind: str
    bench: str
    begun: str
    state: str
    table: str
    imu: str
    folder: str
    files: Mapping[str, tuple[int, str]]
