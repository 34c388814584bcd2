"""The calibrations and certificates of a register that used a qualification of a bench.

A calibration used it where an error that it shares is of the determination, or where its
provenance names the determination: a qualified scatter is no shared error.
"""

from typing import NamedTuple

from inercal.calibration import Calibration
from inercal.laboratory.store.register import Register


class QualificationUse(NamedTuple):
    """A calibration that used a qualification, with its certificates.

    Parameters
    ----------
    calibration : int
        Its number in the register.
    sensor, measured : str
    parameters : tuple of str
        The shared errors of the determination; empty where it shares none.
    certificates : tuple of str
        Their numbers.
    """

    calibration: int
    sensor: str
    measured: str
    parameters: tuple[str, ...]
    certificates: tuple[str, ...]


def qualification_uses(register: Register, determination: str) -> tuple[QualificationUse, ...]:
    """Return the calibrations that used a determination, as they were measured.

    Parameters
    ----------
    register : Register
    determination : str
        Identity of the qualification.

    Raises
    ------
    InputError
        A calibration in the register is damaged.
    """
    certificates = register.certificates()
    found: list[QualificationUse] = []
    for entry in register.calibrations():
        if determination not in entry.content:
            continue
        used = _used(entry.calibration, determination)
        if used is None:
            continue
        numbers = tuple(one.number for one in certificates if one.calibration == entry.id)
        found.append(QualificationUse(entry.id, entry.sensor, entry.measured, used, numbers))
    return tuple(found)


def _used(calibration: Calibration, determination: str) -> tuple[str, ...] | None:
    shared = tuple(
        one.name for one in calibration.shared or () if one.determination == determination
    )
    named = determination in calibration.provenance.values()
    return shared if shared or named else None
