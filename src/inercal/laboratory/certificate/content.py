"""Collect the data of a certificate: every item that ISO/IEC 17025:2017, 7.8.2 and 7.8.4 require.

Each item is stored only once. PDF and DCC are both written from these data. Their texts in English,
German and Chinese are read from the table `texts.toml`.

A certificate may be refused, or marked on every page. The laboratory states in [policy] when a
certificate is refused. No option removes a mark; only another calibration does.
"""

import tomllib
from dataclasses import dataclass
from datetime import date
from functools import lru_cache
from importlib.resources import files
from math import inf
from typing import Any, Literal, get_args

from inercal.basics.errors import InputError, error_location
from inercal.basics.units import ZERO_CELSIUS, parse_quantity
from inercal.calibration import Calibration
from inercal.calibration.calibration import SIMULATED
from inercal.calibration.check_standard import CHECK_STANDARD, is_doubtful
from inercal.calibration.files import calibration_object
from inercal.calibration.specification import Conformity
from inercal.laboratory.certificate.job import require_complete
from inercal.laboratory.certificate.results import (
    ResultSet,
    judge_results,
    make_results,
    names_of,
    stated_capability,
)
from inercal.runfile.job import Action, JobSection, LaboratoryFile

Language = Literal["en", "de", "zh"]
LANGUAGES: tuple[Language, ...] = get_args(Language)


@dataclass(frozen=True)
class Texts:
    """The texts of a certificate in one language."""

    language: Language

    def text(self, key: str, **fields: object) -> str:
        """Return a text with its fields filled in."""
        return str(text_table()["text"][key][self.language]).format(**fields)

    def word(self, section: str, key: str) -> str:
        """Return the translation of a word that inercal uses; an unknown word is not changed."""
        entry = text_table()[section].get(key)
        return key if entry is None else str(entry[self.language])


@lru_cache(maxsize=1)
def text_table() -> dict[str, dict[str, Any]]:
    """Return all texts, by section, key and language."""
    source = files("inercal.laboratory.certificate").joinpath("texts.toml")
    return tomllib.loads(source.read_text(encoding="utf-8"))


_RANGES = {"force": "m/s²", "rate": "rad/s", "temperature": "°C"}


def certificate_marks(
    laboratory: LaboratoryFile, results: tuple[ResultSet, ...], measured: date, *, draft: bool
) -> tuple[str, ...]:
    """Return the marks of a certificate as keys of [mark] in the table of texts.

    Parameters
    ----------
    laboratory : LaboratoryFile
    results : tuple of ResultSet
        All results that the certificate states; the worst result decides.
    measured : date
        Last day of the measurement.
    draft : bool

    Raises
    ------
    InputError
        If the laboratory's policy refuses the certificate. A draft is not refused but marked.
    """
    policy = laboratory.policy
    marks: list[str] = ["draft"] if draft else []

    def add(mark: str, action: Action, reason: str, key: str) -> None:
        if action == "refuse" and not draft:
            raise InputError(
                f"{reason}; the laboratory's [policy] refuses such certificates ({key} = "
                '"refuse")',
                key=f"[policy] {key}",
            )
        if mark not in marks:
            marks.append(mark)

    for one in results:
        calibration = one.calibration
        name = calibration.sensor.name
        if source := calibration.provenance.get(SIMULATED):
            add("simulation", policy.simulated, f"{name} was simulated ({source})", "simulated")
        verdict = calibration.verdict
        if verdict is None:
            add("untested", policy.unreliable, f"{name} has no verdict", "unreliable")
        elif verdict.grade == "unreliable":
            reason = f"the result for {name} is not to be relied on: {'; '.join(verdict.reasons)}"
            add("unreliable", policy.unreliable, reason, "unreliable")
        if is_doubtful(verdict):
            state = calibration.conditions.get(CHECK_STANDARD, "")
            reason = f"the check standard makes the calibration of {name} doubtful ({state})"
            add("check_standard", policy.check_standard, reason, "check_standard")
        if outside := _outside(laboratory, one):
            reason = f"{name} is outside the laboratory's stated capability: {outside}"
            add("outside_capability", policy.outside_capability, reason, "outside_capability")
    for instrument in laboratory.instrument:
        if instrument.is_overdue(measured):
            reason = f"the calibration of instrument {instrument.name} was due on {instrument.due}"
            add("overdue", policy.overdue, reason, "overdue")
    return tuple(marks)


def _outside(laboratory: LaboratoryFile, results: ResultSet) -> str:
    """Describe the results that are outside the stated capability; empty if there are none."""
    if laboratory.capability is None:
        return ""
    parts = list(names_of(results.rows))
    parts += _outside_ranges(laboratory, results.calibration)
    return ", ".join(parts)


def _outside_ranges(laboratory: LaboratoryFile, calibration: Calibration) -> list[str]:
    known = {} if calibration.validity is None else calibration.validity.ranges
    found: list[str] = []
    for name, unit in _RANGES.items():
        stated = getattr(laboratory.capability, name)
        if stated is None or name not in known:
            continue
        key = f"[capability] {name}"
        with error_location(key, key=key):
            low, high = (parse_quantity(text, unit).value for text in stated)
        if not low < high:
            raise InputError(f"{key}: the first quantity must be below the second", key=key)
        least, largest = known[name]
        if least < low or largest > high:
            offset, shown = (ZERO_CELSIUS, "°C") if unit == "°C" else (0.0, unit)
            found.append(f"{name} {least - offset:.4g} to {largest - offset:.4g} {shown}")
    return found


Change = Literal["", "amended", "substituted"]


@dataclass(frozen=True)
class CertificateChange:
    """The change that a certificate makes to an earlier certificate.

    Parameters
    ----------
    kind : "amended" or "substituted"; empty for none
    previous : str
        Number of the earlier certificate.
    previous_sha256 : str
        SHA-256 of the earlier certificate's DCC.
    reason : str
    """

    kind: Change = ""
    previous: str = ""
    previous_sha256: str = ""
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Certificate:
    """The content of a certificate.

    Parameters
    ----------
    number : str
        Number of the certificate; empty for a draft.
    issued : date
    texts : Texts
    laboratory : LaboratoryFile
    job : JobSection
    results : tuple of ResultSet
        One set of results, or two: before and after adjustment.
    conformity : Conformity or None
        Conformity, judged with the last set of results.
    marks : tuple of str
        Marks of the certificate, as keys of [mark] in the table of texts.
    change : CertificateChange
    """

    number: str
    issued: date
    texts: Texts
    laboratory: LaboratoryFile
    job: JobSection
    results: tuple[ResultSet, ...]
    conformity: Conformity | None
    marks: tuple[str, ...]
    change: CertificateChange

    @property
    def calibration(self) -> Calibration:
        """The certified calibration."""
        return self.results[-1].calibration

    @property
    def calibration_sha256(self) -> str:
        """SHA-256 hash that the calibration file states."""
        return str(calibration_object(self.calibration)["sha256"])

    @property
    def first_day(self) -> date:
        """First day of the measurement."""
        assert self.job.measured is not None  # `require_complete`
        return self.job.measured

    @property
    def last_day(self) -> date:
        """Last day of the measurement."""
        return self.job.last_day or self.first_day


@dataclass(frozen=True, eq=False)
class CertificateInput:
    """All data for a certificate, except its number and its change to an earlier certificate."""

    calibration: Calibration
    as_found: Calibration | None
    laboratory: LaboratoryFile
    job: JobSection
    language: Language
    issued: date
    draft: bool = False


def make_certificate(
    given: CertificateInput, number: str, change: CertificateChange
) -> Certificate:
    """Check the data and return the certificate.

    Raises
    ------
    InputError
        If an item that the standard requires is missing, the laboratory's policy refuses the
        calibration, dates contradict each other, a calibration states no uncertainty, or the
        as-found calibration is of another sensor.
    """
    job, laboratory, calibration = given.job, given.laboratory, given.calibration
    require_complete(job, laboratory)
    last = job.last_day
    assert job.measured is not None  # `require_complete`
    assert last is not None
    for name, first, second in (
        ("received is after measured", job.received, job.measured),
        ("issued is before the last day of measured", last, given.issued),
    ):
        if first is not None and second < first:
            received = "" if job.received is None else f"received {job.received}, "
            raise InputError(
                f"[job] measured {job.measured} to {last}, {received}issued {given.issued}: these "
                f"dates contradict each other ({name}); correct them",
                key="[job] measured",
            )
    capability = laboratory.capability
    smallest = (
        None
        if capability is None
        else stated_capability(capability.uncertainty, calibration.sensor)
    )
    dof = job.degrees_of_freedom or inf
    for one in filter(None, (calibration, given.as_found)):
        _require_uncertainty(one)
    results = [
        make_results(calibration, smallest, dof, "afterAdjustment" if given.as_found else "")
    ]
    if given.as_found is not None:
        _require_same_sensor(given.as_found, calibration)
        results.insert(0, make_results(given.as_found, smallest, dof, "beforeAdjustment"))
    marks = certificate_marks(laboratory, tuple(results), last, draft=given.draft)
    return Certificate(
        number,
        given.issued,
        Texts(given.language),
        laboratory,
        job,
        tuple(results),
        judge_results(results[-1]),
        marks,
        change,
    )


def _require_uncertainty(calibration: Calibration) -> None:
    """Raise an error for an imported calibration: a certificate must state U (7.8.4.1 a)."""
    if not calibration.std.any():
        name = calibration.sensor.name
        raise InputError(
            f"the calibration of {name} states no uncertainty (inercal import makes such "
            "files); certify a calibration that inercal estimated",
            names=(name,),
        )


def _require_same_sensor(first: Calibration, second: Calibration) -> None:
    if first.sensor.name != second.sensor.name:
        raise InputError(
            f"--as-found is a calibration of {first.sensor.name}, but the other one is of "
            f"{second.sensor.name}; give two calibrations of the same sensor",
            key="--as-found",
            names=(first.sensor.name, second.sensor.name),
        )
