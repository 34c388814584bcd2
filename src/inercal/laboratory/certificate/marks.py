"""Decide whether a certificate is refused or is marked on every page.

The laboratory states in [policy] when a certificate is refused. No option removes a mark; only
another calibration does.
"""

from datetime import date

from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS, parse_quantity
from inercal.calibration import Calibration
from inercal.calibration.check_standard import CHECK_STANDARD, is_doubtful
from inercal.calibration.simulated import SIMULATED
from inercal.laboratory.certificate.results import ResultSet, names_of
from inercal.runfile.laboratory_file import Action, LaboratoryFile

_RANGES = {"force": "m/s²", "rate": "rad/s", "temperature": "K"}


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
        try:
            low, high = (parse_quantity(text, unit).value for text in stated)
        except InputError as error:
            raise error.located(key, key=key) from None
        if not low < high:
            raise InputError(f"{key}: the first quantity must be below the second", key=key)
        least, largest = known[name]
        if least < low or largest > high:
            offset, shown = (ZERO_CELSIUS, "°C") if unit == "K" else (0.0, unit)
            found.append(f"{name} {least - offset:.4g} to {largest - offset:.4g} {shown}")
    return found
