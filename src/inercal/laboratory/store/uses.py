"""Find the calibrations on a bench, those of a type, and those that used a qualification.

A calibration used a qualification if one of its shared errors comes from this determination, or if
its provenance names the determination. The provenance is needed because a qualified scatter is not
a shared error.
"""

from collections.abc import Sequence
from typing import NamedTuple

from inercal.basics.errors import InputError
from inercal.calibration import Calibration
from inercal.laboratory.store.entries import CalibrationEntry
from inercal.laboratory.store.history import latest_per_recording
from inercal.laboratory.store.register import Register
from inercal.physics.sensors.coefficient_selection import select_coefficients

_MOST_NAMED = 8


def calibrations_of_bench(
    entries: Sequence[CalibrationEntry], word: str
) -> tuple[CalibrationEntry, ...]:
    """Return the calibrations on a bench in order, but only the last of each recording.

    Parameters
    ----------
    entries : sequence of CalibrationEntry
        Entries of a register.
    word : str
        Name of the bench, or its kind if it has no name.

    Raises
    ------
    InputError
        If there is no such bench, or benches of several kinds have this name.
    """
    found = [one for one in entries if word == (one.bench or one.kind)]
    kinds = sorted({one.kind for one in found})
    if not found:
        listed = _listed({one.bench or one.kind for one in entries})
        raise InputError(
            f"--bench {word!r}: the register has no calibration on this bench; "
            + (f"it has {listed}" if listed else "it has none that names a bench"),
            key="--bench",
            names=(word,),
        )
    if len(kinds) > 1:
        raise InputError(
            f"--bench {word!r}: benches of {len(kinds)} kinds have this name "
            f"({', '.join(kinds)}); give each its own [bench] name",
            key="--bench",
            names=(word,),
        )
    return tuple(latest_per_recording(found)[0])


def _listed(names: set[str]) -> str:
    """Return the names in quotation marks, or the first of many; the empty name is omitted."""
    known = sorted(names - {""})
    return ", ".join(map(repr, known[:_MOST_NAMED])) + ", …" * (len(known) > _MOST_NAMED)


def calibrations_of_type(
    entries: Sequence[CalibrationEntry], type_name: str, coefficients: Sequence[str] = ()
) -> dict[str, Calibration]:
    """Return the newest calibration of each sensor of a type, by its number in the register.

    Parameters
    ----------
    entries : sequence of CalibrationEntry
        Entries of a register, in the order of measurement.
    type_name : str
        Maker and model in [job], such as "Q-Flex QA 2000".
    coefficients : sequence of str
        Names or groups; a calibration without them is not used.

    Raises
    ------
    InputError
        No such calibration has this maker and model.
    """
    newest: dict[str, CalibrationEntry] = {}
    types: set[str] = set()
    for one in entries:
        job = one.calibration.job
        types.add(found := " ".join(job[key] for key in ("maker", "model") if key in job))
        if found == type_name and _has_all(one.calibration, coefficients):
            newest[one.sensor] = one
    if not newest:
        listed = _listed(types)
        lacking = f" with {', '.join(coefficients)}" if type_name in types else ""
        raise InputError(
            f"--type {type_name!r}: the register has no calibration{lacking} of this maker and "
            "model in [job]; " + (f"it has {listed}" if listed else "no calibration states them"),
            key="--type",
            names=(type_name,),
        )
    return {f"#{one.id}": one.calibration for one in newest.values()}


def _has_all(calibration: Calibration, words: Sequence[str]) -> bool:
    sensor = calibration.sensor
    return all(
        set(select_coefficients(sensor.axes, [word])) & set(sensor.coefficients) for word in words
    )


class QualificationUse(NamedTuple):
    """A calibration that used a qualification, with its certificates.

    Parameters
    ----------
    calibration : int
        Number of the calibration in the register.
    sensor, measured : str
    parameters : tuple of str
        Shared errors that come from the determination; empty if there are none.
    certificates : tuple of str
        Numbers of the certificates.
    """

    calibration: int
    sensor: str
    measured: str
    parameters: tuple[str, ...]
    certificates: tuple[str, ...]


def qualification_uses(register: Register, determination: str) -> tuple[QualificationUse, ...]:
    """Return the calibrations that used a determination, in the order of measurement.

    Parameters
    ----------
    register : Register
    determination : str
        Text that identifies the qualification.

    Raises
    ------
    InputError
        If a calibration in the register is damaged.
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
