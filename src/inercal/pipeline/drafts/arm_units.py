"""Find or check the units of an arm's rate and radius from the norms of the readings.

On an arm the readings have the norm s √(g² + (r ω²)²). In the right units of r and ω, the size s of
an output unit is the same at all rates, whatever it is.
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.benches.arm_units import LENGTHS, RATES
from inercal.physics.sensors import G0
from inercal.pipeline.drafts.column_names import column_unit
from inercal.pipeline.drafts.column_roles import STATED, ColumnRoles
from inercal.recordings.io.column_table import Table

_NAMED = {"omega_over_pi": "0.5 rev/s"}
_CLEAR = 0.3  # ratio of the scatter of norms in two units that decides
_AGREES = 0.12  # scatter of the norms of a plain MEMS sensor in the right unit


def arm_rate_unit(
    table: Table, roles: ColumnRoles, force: Array, radius: float | None
) -> tuple[str, str]:
    """Return the unit of an arm's rate, with a reason.

    If neither the user nor the column's name states it, it is rpm unless the norms of the readings
    agree far better in another unit.
    """
    name = roles.single["arm_rate"]
    if (unit := roles.units.get("arm_rate")) is not None:
        return unit, STATED
    known = "rpm" if "rpm" in name.lower() else _NAMED.get(name.strip().lower())
    if (unit := column_unit(name) or known) is not None:
        return unit, "by its name"
    if radius is None:
        return "rpm", ""
    rate = table.numbers(name)
    spread = {unit: norm_spread(force, rate * si_factor(unit, "rad/s"), radius) for unit in RATES}
    best = min(spread, key=lambda unit: spread[unit])
    return (
        (best, "by the norms of the readings")
        if spread[best] < _CLEAR * spread["rpm"]
        else ("rpm", "")
    )


def norm_spread(force: Array, rate: Array, radius: float) -> float:
    """Return how much the readings, (n, 3), scatter about norms on an arm, relative to the norm.

    The scatter is independent of the readings' unit.
    """
    norm = np.maximum(np.linalg.norm(force, axis=-1), np.finfo(float).tiny)
    return float(np.std(np.log(norm / np.hypot(G0, rate**2 * radius))))


def require_radius_unit(force: Array, rate: Array, radius: float) -> None:
    """Refuse a radius, m, if the norms of the readings agree far better in another unit.

    Raises
    ------
    InputError
        The message names the radius that agrees.
    """
    spread = {factor: norm_spread(force, rate, radius * factor) for factor in (1.0, *LENGTHS)}
    best = min(spread, key=lambda factor: spread[factor])
    if spread[best] < min(_CLEAR * spread[1.0], _AGREES):
        raise InputError(
            f"[bench] radius: {radius:.4g} m does not agree with the norms of the readings, but "
            f"{radius * best:.4g} m does: check whether the radius is in m or {LENGTHS[best]}",
            key="[bench] radius",
            names=(LENGTHS[best],),
        )
