"""Read the state of a check standard from the `inercal control` file that a run file names.

Schema "inercal/control/1": `sensor`, `reference` (`days`, `until`), `points` (`first`, `last`,
`in_control`, `signals`), `episodes`, limits and statistics of the charts.

A run is doubtful if the last point before it, or the first point after it, is out of control. The
bench may then have changed at any time since the last point in control.
"""

from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, Field

from inercal.basics.documents import read_document
from inercal.basics.errors import InputError
from inercal.calibration.grade import Verdict

SCHEMA = "inercal/control/1"
CHECK_STANDARD = "check standard"
"""Key in `Calibration.conditions`, and kind of the finding."""
_MOST_NAMED = 3  # largest number of coefficients named for a chart


def _utc(text: str) -> str:
    time = datetime.fromisoformat(text)
    return time.astimezone(UTC).isoformat() if time.tzinfo else text


Time = Annotated[str, AfterValidator(_utc)]
"""ISO 8601, in UTC."""


class CheckedDay(BaseModel, defer_build=True):
    """A day on which the check standard was measured."""

    first: Time
    last: Time
    in_control: bool
    signals: dict[str, tuple[str, ...]] = {}

    @property
    def day(self) -> date:
        """The date of the last session."""
        return datetime.fromisoformat(self.last).date()

    @property
    def words(self) -> str:
        """Text with the charts that give a signal, and their coefficients."""
        parts: list[str] = []
        for kind, names in self.signals.items():
            named = ", ".join(names[:_MOST_NAMED])
            more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
            parts.append(f"{kind} of {named}{more}" if names else kind)
        return "; ".join(parts)


class _Sensor(BaseModel, defer_build=True):
    name: str


class _Reference(BaseModel, defer_build=True):
    days: int
    until: Time


class _File(BaseModel, defer_build=True):
    schema_: Literal["inercal/control/1"] = Field(alias="schema")
    sensor: _Sensor
    reference: _Reference
    points: tuple[CheckedDay, ...]


@dataclass(frozen=True)
class CheckState:
    """The state of the check standard at the time of a run.

    Parameters
    ----------
    text : str
        Description of the state, for the conditions of the calibration.
    warnings : tuple of str
        Reasons why the run is doubtful; empty if it is not doubtful.
    """

    text: str
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class CheckStandard:
    """A check standard with its sensor, the end of its reference period, and its ordered points."""

    source: str
    sensor: str
    reference_end: str
    points: tuple[CheckedDay, ...]

    def state(self, measured: date | None, longest: float | None) -> CheckState:
        """Return the state of the check standard at the time of a run.

        Parameters
        ----------
        measured : date or None
            Last day of the run. If None, the newest point is used.
        longest : float or None
            Longest permitted time between the last point and the day of the run, s.

        Raises
        ------
        InputError
            If `longest` is given without the day of the run.
        """
        if longest is not None and measured is None:
            raise InputError(
                "the age of the check standard can only be checked if the date of the run is "
                "known: state [job] measured"
            )
        before = [one for one in self.points if measured is None or one.day <= measured]
        after = [one for one in self.points if measured is not None and one.day > measured]
        if not before:
            text = f"{self.sensor}: not checked between its reference period and the run"
            return CheckState(text, (f"{text}; measure it, and run inercal control again",))
        last = before[-1]
        word = "in control" if last.in_control else "out of control"
        text = f"{self.sensor}: {word} on {last.day}"
        warnings: list[str] = []
        for one in (last, *after[:1]):
            if not one.in_control:
                warnings.append(
                    f"check standard {self.sensor} was out of control on {one.day} ({one.words}): "
                    f"the bench is doubtful since {self._last_in_control(one)}; find the cause, "
                    "and measure again"
                )
        if measured is not None and longest is not None:
            age = (measured - last.day).days
            if age * 86_400.0 > longest:
                warnings.append(
                    f"check standard {self.sensor} was last measured on {last.day}, {age} days "
                    "before the run, which is longer than check_standard_age: measure it before "
                    "each run"
                )
        return CheckState(text, tuple(warnings))

    def _last_in_control(self, point: CheckedDay) -> str:
        earlier = self.points[: self.points.index(point)]
        found = [one.last for one in earlier if one.in_control]
        return (found[-1] if found else self.reference_end).partition("T")[0]


def load_check_standard(path: Path) -> CheckStandard:
    """Read the check standard from a file written by `inercal control`.

    Raises
    ------
    InputError
        If the file does not exist, or contains something else.
    """
    found = read_document(path, _File, "inercal control")
    return CheckStandard(path.name, found.sensor.name, found.reference.until, found.points)


def is_doubtful(verdict: Verdict | None) -> bool:
    """Return whether a calibration is doubtful because of the check standard."""
    return verdict is not None and CHECK_STANDARD in verdict.warned
