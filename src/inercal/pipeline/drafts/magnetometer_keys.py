"""Recognise the magnetometers of a recording, and draft their keys of the run file.

At rest, their readings lie on a sphere, like those of accelerometers, but motion does not move them
off it. The angle between the field and gravity is the same at all rests. This determines the axes
except for a common sign of all three, which follows from the hemisphere.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import si_factor
from inercal.physics.magnetism import TURNS_OF_CUBE, axis_names, unit_of_earth_field
from inercal.physics.section_settings import measured_constant
from inercal.physics.sensors import output_unit
from inercal.pipeline.drafts.column_names import (
    is_other_quantity,
    plain_name,
    role_of_name,
    run_file_column,
)
from inercal.pipeline.drafts.column_roles import ColumnRoles
from inercal.pipeline.drafts.draft_entries import UNKNOWN, DraftKey
from inercal.pipeline.drafts.quiet_sections import QuietMeans
from inercal.pipeline.drafts.readouts import norm_misfit, off_sphere
from inercal.recordings.io.column_table import Table
from inercal.recordings.segments.gravity_turns import sphere

NO_FIELD = "no magnetometers"
"""Key for the reason why magnetometers are not used."""

_NAME = re.compile(
    r"((?:\w*_)?(?:m|b|mag[a-z_]*?|compass[a-z_]*?))_?([xyz012])(_([un]_?t|gauss|m_?g|m_?gauss))?"
)
_UNITS = (  # units in a column's name
    (re.compile(r"(?i:[uµμ]t\b|micro_?tesla)"), "µT"),
    (re.compile(r"(?i:\bnt\b|_nt\b|nano_?tesla)"), "nT"),
    (re.compile(r"(?i:m_?gauss|milli_?gauss|\bmg\b|_mg\b)"), "mG"),
    (re.compile(r"(?i:gauss|[(\[]ga?[)\]]|_ga\b)"), "gauss"),
    (re.compile(r"[(\[]T[)\]]"), "T"),
)
_SECTION = "sensor.magnetometer"
_FEWEST = 8  # rests
_ON_SPHERE = 0.15  # scatter of the norm, relative: soft iron of usual sensors
_SAME_ANGLE = 0.15  # scatter of the cosine between field and gravity
_CLEARER = 2.0  # ratio of that scatter for the second best axes
_TYPICAL = 50e-6  # T
_NEAR = 0.15  # relative difference between a unit and the stated field: scale and soft iron
_LIKE_COUNTS = ("mG", "nT")  # units in which the readings of usual chips fit by chance
_ERROR = 5e-3  # of the field, for means without a stated scatter


def magnetometer_keys(
    table: Table, roles: ColumnRoles, rests: QuietMeans | None, values: Mapping[str, Any]
) -> tuple[DraftKey, ...]:
    """Return the keys for the magnetometers of a recording or a table; () if there are none.

    `values` contains the values that the user states, by key.
    """
    stated, triad = values.get("data.magnetometer"), roles.triads.get("accelerometer", ())
    if stated == [] or NO_FIELD in roles.reasons or len(triad) != len("xyz"):
        return ()
    used = {*roles.single.values(), *(name for each in roles.triads.values() for name in each)}
    free = [n for n in table.names if n not in used and table.columns[n].dtype.kind != "U"]
    columns, reason = named_magnetometer(free) if table.header else (), "by their names"
    if stated is None and not columns:
        columns, reason = _by_values(table, free, triad, rests), "their readings lie on a sphere"
    given = list(columns) if stated is None else [str(c).removeprefix("-") for c in stated]
    names = [table.names[int(n) - 1] if n.isdecimal() and n not in free else n for n in given]
    if len(names) != len("xyz") or not set(names) <= set(table.names):
        return ()
    field, force = (_means(table, each, rests) for each in (names, triad))
    centre, radius = sphere(field)
    unit = roles.units.get("magnetometer") or (named_unit(names[0]) if table.header else None)
    if radius is None and (unit is None or output_unit(unit) is not None):
        return ()
    found = [DraftKey("data", "magnetometer", [run_file_column(n) for n in names], reason)]
    rest = np.mod(table.stack(names), 1)
    counts = roles.means or not rest[np.isfinite(rest)].any()
    readout, size = _readout(unit, radius or 1.0, values.get("bench.field"), counts=counts)
    found += readout
    if centre is not None and len(field) >= _FEWEST:
        axes = _fit_axes(field - centre, force, values.get("bench.hemisphere"))
        if axes not in (None, ["x", "y", "z"]):
            why = "with these axes the angle between field and gravity is constant"
            found.append(DraftKey(_SECTION, "axis", axes, why))
    if roles.means:
        text = f"{1e6 * size * _ERROR * (radius or _TYPICAL / size):.2g} µT"
        found.append(DraftKey("data.sd", "magnetometer", text, "a guess: state your own value"))
    return tuple(found)


def _readout(
    unit: str | None, radius: float, field: str | None, *, counts: bool
) -> tuple[list[DraftKey], float]:
    """Return the keys for unit and scale, and the size of an output unit in T.

    Readings that may be counts, because they are whole numbers or means, may fit a unit by chance:
    only the user or a stated field can tell.
    """
    strength = _TYPICAL
    if field is not None:
        strength = measured_constant(field, like="T", key="[bench] field", last_digit=False).value
    size, why = strength / radius, f"the field reads {radius:.4g}"
    reads = unit_of_earth_field(radius)
    counts = counts and reads in _LIKE_COUNTS
    if reads is None or (counts and field is not None and abs(si_factor(reads) / size - 1) > _NEAR):
        reads = "LSB"
    reason = "stated, or in the columns' names" if unit else why
    key = DraftKey(_SECTION, "unit", unit or reads, reason)
    if unit is None and field is None and (counts or reads == "LSB"):
        ask = f"the unit of the magnetometers, such as µT, or LSB for counts ({why})"
        key = replace(key, value=UNKNOWN, ask=ask, typical=reads)
    if output_unit(unit or reads) is None:
        return [key], si_factor(unit or reads)
    text = f"{1e-6 / size:.4g} {unit or reads}/µT"
    scale = DraftKey(_SECTION, "scale", text, f"{why}, which is taken as {1e6 * strength:.4g} µT")
    if field is None:
        ask = "the nominal scale of the magnetometers, such as 30 LSB/µT"
        scale = replace(scale, value=UNKNOWN, ask=ask, typical=text)
    return [key, scale], size


def named_magnetometer(names: Sequence[str]) -> tuple[str, ...]:
    """Return the first three columns that are named like the axes of a magnetometer.

    >>> named_magnetometer(["compass0", "mag_x", "mag_y", "mag_z"]), named_magnetometer(["max"])
    (('mag_x', 'mag_y', 'mag_z'), ())
    """
    groups: dict[str, dict[str, str]] = {}
    for name in names:
        if found := _NAME.fullmatch(plain_name(name)):
            groups.setdefault(found[1], {}).setdefault(found[2], name)
    whole = (one for one in groups.values() if len(one) == len("xyz"))
    return next((tuple(one[axis] for axis in sorted(one)) for one in whole), ())


def named_unit(name: str) -> str | None:
    """Return the unit of magnetic flux density that a column's name states, if any.

    >>> named_unit("mag_x (mG)"), named_unit("MagX_uT"), named_unit("mx")
    ('mG', 'µT', None)
    """
    return next((unit for pattern, unit in _UNITS if pattern.search(name)), None)


def _by_values(
    table: Table, free: list[str], triad: tuple[str, ...], rests: QuietMeans | None
) -> tuple[str, ...]:
    """Return the neighbouring columns whose readings behave like those of a magnetometer."""
    numbered = {name: k for k, name in enumerate(table.names)}
    known = [n for n in free if role_of_name(n) is None and not is_other_quantity(n)]
    for k in range(len(known) - 2 if rests is not None else 0):
        names = tuple(known[k : k + 3])
        data = table.stack(names)
        if numbered[names[2]] - numbered[names[0]] != 2 or not np.isfinite(data).all():
            continue
        field = _means(table, names, rests)
        centre, _ = sphere(field)
        if len(field) < _FEWEST or centre is None:
            continue
        on_sphere = max(norm_misfit(field), off_sphere(field, data)) < _ON_SPHERE
        if on_sphere and _fit_axes(field - centre, _means(table, triad, rests), None):
            return names
    return ()


def _means(table: Table, names: Sequence[str], rests: QuietMeans | None) -> Array:
    """Return the readings at rest, (k, 3); rests without a reading are left out."""
    data = table.stack(names)
    if rests is None:
        return data
    return np.array([np.nanmean(data[a:b], axis=0) for a, b in rests.spans.tolist()])


def _fit_axes(field: Array, force: Array, hemisphere: object) -> list[str] | None:
    """Find the directions of the axes for which field and gravity enclose a constant angle.

    Without a hemisphere, the axes are taken as right-handed. None if several axes fit, or none.
    """
    unit = [x / np.linalg.norm(x, axis=1, keepdims=True) for x in (field, force)]
    cosine = np.einsum("ki,tij,kj->tk", unit[0], TURNS_OF_CUBE, unit[1])
    scatter = cosine.std(axis=1)
    best, second = np.argsort(scatter, kind="stable")[:2]
    reverse = hemisphere is not None and (cosine[best].mean() < 0) != (hemisphere == "north")
    found = scatter[best] < min(_SAME_ANGLE, scatter[second] / _CLEARER)
    return axis_names(-TURNS_OF_CUBE[best] if reverse else TURNS_OF_CUBE[best]) if found else None
