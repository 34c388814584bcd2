"""What a register holds, entry by entry, and what a run tells it."""

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
        How many there are of it.
    last : str or None
        When it was calibrated last, ISO date.
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
    """A file that a run left: its name in the run's folder, bytes, and SHA-256."""

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
        The same wherever its folder lies.
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
        Kind of bench and its name; empty where they are not known.
    run : int or None
        The run whose recording it is of.
    measured : str
        When, ISO 8601, UTC.
    measured_from : "stated", "run" or "created"
        Whose time that is: the user's, the run's begin, or that of the calibration file.
    method, estimator : str
    grade : str
        Of the verdict, "consistent", "reservations" or "unreliable"; empty where it is unknown.
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
        """The calibration itself, its hash proved again.

        Raises
        ------
        InputError
            The register's text is not what was entered.
        """
        return parse(self.content, f"calibration #{self.id}")


@dataclass(frozen=True)
class RunFacts:
    """What a run tells the register.

    Parameters
    ----------
    key : str
        The same whenever the run is entered, wherever its folder lies then.
    sensor : Sensor
    kind, bench : str
        Kind of bench, and its name, empty where it has none.
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
