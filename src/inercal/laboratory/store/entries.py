"""Define the entries in a register, and the facts that a run reports to it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from inercal.calibration import Calibration
from inercal.calibration.files import parse
from inercal.physics.sensors import Sensor


@dataclass(frozen=True)
class SensorEntry:
    """A sensor in the register.

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
        Author and time of the entry, ISO 8601, UTC.
    """

    id: int
    name: str
    axes: tuple[str, ...]
    calibrations: int
    last: str | None
    by: str
    at: str


class FileEntry(NamedTuple):
    """A file in the folder of a run, with name, size in bytes and SHA-256."""

    name: str
    size: int
    sha256: str


@dataclass(frozen=True)
class RunEntry:
    """A run in the register.

    Parameters
    ----------
    id : int
    key : str
        Text that identifies the run; it does not depend on the folder.
    sensor : str
    kind, bench : str
        Kind of bench, and its name if the run file states a name.
    begun : str
        Start of the run, ISO 8601, UTC.
    state : str
        State of the run; see `inercal.host.journal.JournalHeader`.
    table, imu : str
        Addresses of the table and the IMU.
    folder : str
    files : tuple of FileEntry
    by, at : str
        Author and time of the entry, ISO 8601, UTC.
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
    """A calibration in the register.

    Parameters
    ----------
    id : int
    sensor : str
    kind, bench : str
        Kind of bench and its name; each is empty if unknown.
    run : int or None
        The run whose recording was calibrated.
    measured : str
        Time of measurement, ISO 8601, UTC.
    measured_from : "stated", "run" or "created"
        Source of the time of measurement: the user, the start of the run, or the calibration file.
    method, estimator : str
    grade : str
        Grade of the verdict, "consistent", "reservations" or "unreliable"; empty if unknown.
    sha256 : str
        SHA-256 hash of the calibration's content, which its file states.
    by, at : str
        Author and time of the entry, ISO 8601, UTC.
    content : str
        The whole calibration file as JSON.
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
        """The calibration, after its hash was verified again.

        Raises
        ------
        InputError
            If the text in the register differs from the text that was entered.
        """
        return parse(self.content, f"calibration #{self.id}")


@dataclass(frozen=True)
class RunFacts:
    """The facts that a run reports to the register.

    Parameters
    ----------
    key : str
        Text that identifies the run; it does not depend on the time of entry or on the folder.
    sensor : Sensor
    kind, bench : str
        Kind of bench, and its name; the name is empty if the bench has none.
    begun : str
        Start of the run, ISO 8601.
    state : str
        State of the run; see `inercal.host.journal.JournalHeader`.
    table, imu : str
        Addresses of the table and the IMU.
    folder : str
    files : mapping of str to (int, str)
        Size and SHA-256 of each file, by name.
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
