"""Draft the keys for means from a rate table, with the axis that is up, the rate, and three gyros.

The keys for angles and an autocollimator of a dividing head are here, too.

The rate is the column to which the gyro of the vertical axis is proportional, whatever its name.
"""

from collections.abc import Mapping

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import format_quantity, si_factor
from inercal.benches.stated_axes import axis_letters
from inercal.physics.sensors import output_unit
from inercal.pipeline.drafts.column_names import bracketed_unit, column_unit, named_triads
from inercal.pipeline.drafts.column_roles import ColumnRoles
from inercal.pipeline.drafts.draft_entries import ANYWHERE, UNKNOWN, DraftKey
from inercal.pipeline.drafts.readouts import GuessedReadout, counts_per_degree
from inercal.recordings.data.rest_marks import parse_face
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.mean_tables import SD_SUFFIX
from inercal.recordings.io.rest_norm import LARGEST_BIAS

_PROPORTIONAL = 0.999  # correlation of a rate and the gyro that senses it
_NEAR = 0.12  # relative to a unit's size
_FEWEST_ROWS = 3
_FACES = 6  # at rest, or poses, that the accelerometers need
_ABSENT = ("", "nan")
_UNCERTIFIED = "2 ″"  # deviation of a face of a polygon without certificate
_ERRORS = {
    "rate_scale": "standard deviation of the scale of all rates",
    "rate_asymmetry": "difference of the two senses",
    "rate_stability": "further error of the rate of each row",
    "setting": "table's axis in the case, for each setting",
}
_POSE_ERRORS = {"attitude": "tilt of a pose", "mounting": "mounting of the case on the platform"}


def with_rate_table(table: Table, roles: ColumnRoles) -> ColumnRoles:
    """Return the roles, including `axis` and `table_rate` if the means are from a rate table."""
    triads, reasons, units = dict(roles.triads), dict(roles.reasons), dict(roles.units)
    if "gyro" not in triads:
        numbers = [name for name in table.names if table.columns[name].dtype.kind != "U"]
        found = named_triads(numbers, reasons, units, incomplete=True)
        triads |= {kind: names for kind, names in found.items() if kind == "gyro"}
    letters = axis_letters(triads.get("gyro", ()))
    if not roles.means or not letters or table.rows < max(_FEWEST_ROWS, 2 * len(letters)):
        return roles
    texts = [name for name in table.names if table.columns[name].dtype.kind == "U"]
    used = {name for triad in triads.values() for name in triad}
    by_lower = {name.lower(): name for name in table.names}
    poses = {role: by_lower[role] for role in ("roll", "pitch") if role in by_lower}
    for axis in texts:
        faces = [parse_face(str(cell)) for cell in table.columns[axis].tolist()]
        empty = [str(cell).strip() in _ABSENT for cell in table.columns[axis].tolist()]
        named = np.array([face is not None for face in faces])
        if not named.any() or not (named | (np.array(empty) & bool(poses))).all():
            continue
        named &= np.array([face is not None and face[-1] in letters for face in faces])
        sensed = _along(table, triads["gyro"], faces)[named]
        for name in table.names if named.any() else ():
            if name in {*used, *texts, *poses.values()}:
                continue
            rate = table.numbers(name)[named]
            if _correlation(rate, sensed) > _PROPORTIONAL:
                kept = {"temperature"} & roles.single.keys()
                single = {role: roles.single[role] for role in kept}
                single |= {"axis": axis, "table_rate": name, **poses}
                if "seconds" in by_lower:
                    single["seconds"] = by_lower["seconds"]
                reasons |= {
                    **dict.fromkeys(single, "by its name"),
                    "axis": "its values name the axis that is up",
                    "table_rate": "the gyro of the axis that is up is proportional to it",
                }
                if not _shows_accelerometers(table, faces, name, poses):
                    triads.pop("accelerometer", None)
                return ColumnRoles(triads, single, reasons=reasons, units=units, means=True)
    return roles


def _along(table: Table, gyro: tuple[str, ...], faces: list[str | None]) -> Array:
    """Return the readings of the gyro whose axis is up, with their sign, (n,)."""
    readings, letters = table.stack(gyro), axis_letters(gyro)
    columns = [letters.index(face[-1]) if face and face[-1] in letters else 0 for face in faces]
    signs = [-1.0 if face and face.startswith("-") else 1.0 for face in faces]
    return np.asarray(signs * readings[np.arange(len(faces)), columns], dtype=float)


def _correlation(rate: Array, sensed: Array) -> float:
    if not np.isfinite(rate).all() or np.ptp(rate) == 0 or np.ptp(sensed) == 0:
        return 0.0
    return float(np.corrcoef(rate, sensed)[0, 1])


def _shows_accelerometers(
    table: Table, faces: list[str | None], rate: str, poses: Mapping[str, str]
) -> bool:
    still = table.numbers(rate) == 0
    up = {face for face, rests in zip(faces, still.tolist(), strict=True) if face and rests}
    tilted = sum(face is None for face in faces) if poses else 0
    return len(up) >= _FACES or tilted >= _FACES


def angle_unit_key(key: str, column: str) -> tuple[DraftKey, ...]:
    """Return the key for the unit of angles that the name of a column states."""
    unit = bracketed_unit(column, "°")
    return () if unit in (None, "°") else (DraftKey("data", key, unit, "by its name"),)


def collimation_keys(table: Table, roles: ColumnRoles) -> tuple[DraftKey, ...]:
    """Return how an autocollimator was used, judged by the positions with a reading."""
    reading = np.nan_to_num(table.numbers(roles.single["autocollimator"]))
    if not reading.any():
        return ()
    angle = bracketed_unit(roles.single["angle"], "°") or "°"
    quarters = table.numbers(roles.single["angle"]) * si_factor(angle) / (np.pi / 2)
    pairs = np.allclose(quarters[reading != 0], np.rint(quarters[reading != 0]), atol=1e-3)
    reason = "its readings are at " + ("0°, 90°, 180° and 270°" if pairs else "other angles, too")
    faces = "deviation of a face: state [bench] polygon with its certificate for less uncertainty"
    return (
        DraftKey("bench", "autocollimation", "pairs" if pairs else "every", reason),
        DraftKey("bench", "certificate", _UNCERTIFIED, faces),
    )


def rate_unit(table: Table, roles: ColumnRoles) -> tuple[str, str]:
    """Return the unit of the table's rate, and the reason."""
    name = roles.single["table_rate"]
    if "rpm" in name.lower():
        return "rpm", "by its name"
    if (unit := column_unit(name)) in ("°/s", "rad/s"):
        return unit, "by its name"
    stated = roles.units.get("gyro", "")
    if stated in ("°/s", "rad/s"):
        ratio, _ = _line(table, roles)
        for unit in ("°/s", "rad/s"):
            if abs(ratio * si_factor(stated) / si_factor(unit) - 1) < _NEAR:
                return unit, "the gyros read as much in this unit"
    return "°/s", "assumed; state rad/s or rpm if it is not true"


def _line(table: Table, roles: ColumnRoles) -> tuple[float, float]:
    """Return slope and reading at zero of the gyro of the axis that is up over the table's rate."""
    faces = [parse_face(str(cell)) for cell in table.columns[roles.single["axis"]].tolist()]
    letters = axis_letters(roles.triads["gyro"])
    named = np.array([face is not None and face[-1] in letters for face in faces])
    sensed = _along(table, roles.triads["gyro"], faces)[named]
    rate = table.numbers(roles.single["table_rate"])[named]
    slope, at_zero = np.polyfit(rate, sensed, 1).tolist()
    return slope, at_zero


def gyro_readout(table: Table, roles: ColumnRoles) -> GuessedReadout:
    """Return the readout of the gyros, which is stated, named, or found from the table's rates."""
    stated = roles.units.get("gyro")
    if stated is not None and output_unit(stated) is None:
        return GuessedReadout(stated, "", 0.0, si_factor(stated), "as stated or named")
    rate, _ = rate_unit(table, roles)
    slope, at_zero = _line(table, roles)
    slope /= si_factor(rate)
    for unit in ("°/s", "rad/s"):
        if stated is None and abs(slope * si_factor(unit) - 1) < _NEAR:
            return GuessedReadout(unit, "", 0.0, si_factor(unit), "they read the table's rate")
    counts = slope * si_factor("°/s")
    unit = stated or "LSB"
    near, why = counts_per_degree(counts)
    reason = f"they read {counts:.4g} per °/s of the table{why}"
    offset = float(f"{at_zero:.4g}") if abs(at_zero) > LARGEST_BIAS * abs(slope) else 0.0
    scale, size = f"{near:.6g} {unit}/(°/s)", si_factor("°/s") / near
    return GuessedReadout(unit, scale, offset, size, reason)


def rate_bench_keys(roles: ColumnRoles) -> tuple[DraftKey, ...]:
    """Return the keys of [bench], with typical errors of a rate table beside the questions."""
    from inercal.benches.rate_platform.bench import STATED

    entries = [DraftKey("bench", "kind", "rate_platform", "by the columns")]
    ask = 'latitude, such as "48.1 °"; the gyros sense the rotation of the earth'
    entries.append(DraftKey("bench", "latitude", UNKNOWN, "", ask))
    poses = "roll" in roles.single
    if "accelerometer" in roles.triads:
        reason = "valid anywhere near sea level: state your own for less uncertainty"
        entries.append(DraftKey("bench", "gravity", ANYWHERE, reason))
    for key, meaning in (_ERRORS | _POSE_ERRORS if poses else _ERRORS).items():
        value = STATED[key].example
        reason = f"{meaning}: a typical value that nobody measured; state your own"
        entries.append(DraftKey("bench", key, UNKNOWN, reason, meaning, value))
    return tuple(entries)


def gyro_deviation_keys(
    table: Table, roles: ColumnRoles, readout: GuessedReadout
) -> tuple[DraftKey, ...]:
    """Return the deviation of a mean, from the residuals of smooth curves through the rates.

    The result is empty if columns of the table state the deviations.
    """
    if all(name + SD_SUFFIX in table.names for name in roles.triads["gyro"]):
        return ()
    faces = table.columns[roles.single["axis"]]
    rate = table.numbers(roles.single["table_rate"])
    found: list[float] = []
    for face in np.unique(faces).tolist():
        own = (faces == face) & np.isfinite(rate)
        if parse_face(str(face)) is None or own.sum() < 4:
            continue
        for name in roles.triads["gyro"]:
            y, x = table.numbers(name)[own], rate[own] / (np.abs(rate[own]).max() or 1.0)
            terms = [np.ones_like(x), x, np.abs(x), x**2, x**3][: int(own.sum()) - 2]
            design = np.column_stack(terms)
            left = y - design @ np.linalg.lstsq(design, y)[0]
            found.append(float(np.sqrt((left**2).sum() / (own.sum() - len(terms)))))
    size = float(np.median(found)) * readout.size if found else 0.0
    text = format_quantity(max(size, si_factor("°/h")), 0.0, "°/h", 2)
    reason = "from the residuals of smooth curves: state the measured deviation of your means"
    return (DraftKey("data.sd", "gyro", text, reason),)
