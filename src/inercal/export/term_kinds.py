"""The kind of each coefficient for export targets, derived from its basis function.

| kind | basis function |
|---|---|
| bias | 1 |
| scale | along the input axis, once |
| misalignment | across the input axis, once |
| g | of a gyro: specific force, once |
| bias_temperature | powers of temperature only |
| polynomial | other products of force, rate, their signs and temperature |
| angular_acceleration | with a component of the angular acceleration |
| temperature_rate | with the rate of the temperature |
"""

from collections.abc import Collection, Mapping
from itertools import product
from typing import Literal

from inercal.basics.keys import CoefficientName
from inercal.physics.quantities import KINDS, Measures
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_tables import ErrorTerm

TermKind = Literal[
    "bias",
    "scale",
    "misalignment",
    "g",
    "bias_temperature",
    "polynomial",
    "angular_acceleration",
    "temperature_rate",
]
LINEAR: frozenset[TermKind] = frozenset({"bias", "scale", "misalignment", "g"})
UNDETERMINED: tuple[TermKind, ...] = ("bias", "scale")  # without them, a reading has no meaning
# Derivatives are not part of any sensor reading, so no target supports them.
DERIVATIVES: dict[TermKind, str] = {
    "angular_acceleration": "angular acceleration",
    "temperature_rate": "temperature rate",
}
WORDS: dict[TermKind, str] = {
    "bias": "bias",
    "scale": "scale factor",
    "misalignment": "misalignment",
    "g": "g-sensitivity",
    "bias_temperature": "bias over temperature",
    "polynomial": "nonlinear or temperature terms",
    "angular_acceleration": "terms with angular acceleration",
    "temperature_rate": "terms with temperature rate",
}


def term_kind(measures: Measures, term: ErrorTerm) -> TermKind:
    """Return the kind of a term of an accelerometer ("f") or a gyro ("w")."""
    products = [product.components for product in term.basis.products]
    used = {name for product in products for name in product}
    if used & {"ai", "ap", "ao"}:
        return "angular_acceleration"
    if "dTdt" in used:
        return "temperature_rate"
    if not used:
        return "bias"
    if used == {"dT"}:
        return "bias_temperature"
    if any(len(product) != 1 for product in products) or used & {"si", "swi", "dT"}:
        return "polynomial"
    if used == {f"{measures}i"}:
        return "scale"
    if used <= {f"{measures}p", f"{measures}o"}:
        return "misalignment"
    return "g" if measures == "w" and used <= {"fi", "fp", "fo"} else "polynomial"


def undetermined(
    sensor: Sensor, holds: Mapping[str, Collection[str]] | None = None
) -> dict[tuple[Measures, TermKind], str]:
    """Say which biases and scale factors the calibration of a sensor does not determine.

    `holds` restricts this to the terms that a target states.
    """
    stated = {
        (CoefficientName(full).axis, kind)
        for full, (_, kind, _) in zip(sensor.coefficients, kinds_of(sensor), strict=True)
    }
    found: dict[tuple[Measures, TermKind], str] = {}
    for measures, kind in product(KINDS, UNDETERMINED):
        axes = [axis.name for axis in sensor.axes if axis.measures == measures]
        without = ", ".join(name for name in axes if (name, kind) not in stated)
        if without and (holds is None or kind in holds.get(measures, ())):
            found[measures, kind] = (
                f"the calibration does not determine the {WORDS[kind]} of {without}: its nominal "
                "value is assumed, and its error is not included in U"
            )
    return found


def kinds_of(sensor: Sensor) -> tuple[tuple[Measures, TermKind, int], ...]:
    """Return the quantity, kind and power of temperature for each coefficient."""
    found: list[tuple[Measures, TermKind, int]] = []
    for full in sensor.coefficients:
        sort, term = sensor.measures[CoefficientName(full).axis], sensor.coefficient(full)
        found.append((sort, term_kind(sort, term), term.basis.degree("dT")))
    return tuple(found)
