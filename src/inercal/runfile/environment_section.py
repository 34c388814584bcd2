"""Read the section [environment] of a run file: the temperatures around the bench."""

from collections.abc import Collection, Sequence
from typing import Any, Literal

import numpy as np

from inercal.basics.keys import CoefficientName
from inercal.basics.units import Measured
from inercal.methods import Method
from inercal.physics.quantities import QUANTITIES
from inercal.physics.section_settings import (
    key_error,
    measured_constant,
    non_negative_value,
    si_value,
)
from inercal.physics.sensors import Sensor
from inercal.recordings.environment import ChamberProfile, Environment, SoakCriteria
from inercal.recordings.temperature import first_impossible, impossible_text
from inercal.runfile.schema import EnvironmentSection, RunSchema

TemperatureOrder = Literal["auto"] | tuple[int, int, int] | None
ORDERED = ("bias", "scale factor", "misalignment")
"""Quantities that have a polynomial order in temperature, in the order used in a run file."""
MAX_ORDERS = (3, 2, 1)
# Temperature terms for each kind of axis and each quantity, by order starting at 1.
_TILTS = (("delta_o_dT", "delta_p_dT"),)
_TERMS = {
    "f": ((("k0_dT",), ("k0_dT2",), ("k0_dT3",)), (("k1_dT",), ("k1_dT2",)), _TILTS),
    "w": ((("bias_dT",), ("bias_dT2",), ("bias_dT3",)), (("scale_dT",), ("scale_dT2",)), _TILTS),
    "m": ((("bias_dT",),), (("scale_dT",),), ()),
}


def order_terms(kind: str, orders: Sequence[int]) -> tuple[str, ...]:
    """Return the short names of the temperature terms up to the given orders.

    Parameters
    ----------
    kind : "f", "w" or "m"
    orders : sequence of 3 int
        Orders of bias, scale factor and misalignment.
    """
    by_quantity = zip(_TERMS[kind], orders, strict=True)
    return tuple(n for terms, order in by_quantity for names in terms[:order] for n in names)


def orders_of_terms(kind: str, terms: Collection[str]) -> tuple[int, int, int]:
    """Return the highest orders in temperature of bias, scale factor and misalignment.

    Parameters
    ----------
    kind : "f", "w" or "m"
    terms : collection of str
        Short names of terms; only temperature terms are considered.
    """
    bias, scale, misalignment = (
        max((n for n, names in enumerate(rows, 1) if set(names) & set(terms)), default=0)
        for rows in _TERMS[kind]
    )
    return bias, scale, misalignment


def terms_of_order(
    section_order: TemperatureOrder, sensor: Sensor, possible: Sequence[str]
) -> list[str]:
    """Return the full names of the terms that [method] temperature_order asks for.

    Parameters
    ----------
    section_order : "auto", sequence of 3 int, or None
        If "auto", all terms up to the highest possible orders are returned, and a test later
        selects some of them.
    sensor : Sensor
    possible : sequence of str
        Coefficients that the method can estimate.

    Raises
    ------
    InputError
        An order exceeds the highest possible order, or the highest order that the method can
        estimate.
    """
    if section_order is None:
        return []
    key = "[method] temperature_order"
    orders = MAX_ORDERS if section_order == "auto" else section_order
    if any(not 0 <= n <= most for n, most in zip(orders, MAX_ORDERS, strict=True)):
        raise key_error(key, f"{list(orders)}: give orders from 0 to {list(MAX_ORDERS)}, or 'auto'")
    if section_order != "auto":
        _require_estimated(key, orders, sensor, possible)
    named = [
        f"{axis.name}.{term}"
        for axis in sensor.axes
        for term in order_terms(axis.measures, orders)
        if f"{axis.name}.{term}" in possible
    ]
    if not named:
        raise key_error(key, "the method estimates no temperature coefficients; remove the key")
    return named


def require_free_order(order: TemperatureOrder, also: Sequence[str], terms: Sequence[str]) -> None:
    """Raise an error if [method] also names terms that an automatic order would leave out.

    Parameters
    ----------
    order : "auto", sequence of 3 int, or None
    also : sequence of str
        Coefficients stated in [method] also.
    terms : sequence of str
        Full names of the terms among which the order chooses.

    Raises
    ------
    InputError
    """
    chosen = {CoefficientName(name).term for name in terms} if order == "auto" else set[str]()
    if fixed := [name for name in also if CoefficientName(name).term in chosen]:
        raise key_error(
            "[method] also",
            f'temperature_order = "auto" decides whether {fixed[0]} is estimated: state the orders '
            "instead, such as temperature_order = [2, 1, 0], or remove the term",
            names=(fixed[0],),
        )


def _require_estimated(
    key: str, orders: Sequence[int], sensor: Sensor, possible: Sequence[str]
) -> None:
    """Raise an error if the method cannot estimate a requested order in temperature.

    If the method does not estimate a quantity for one kind of axes at all, only the others are
    checked. Magnetometers have linear terms only, so beside other axes they are not checked.
    """
    terms = {kind: set[str]() for kind in sensor.measures.values()}
    for name in possible:
        axis, term = CoefficientName(name).parts
        terms[sensor.measures[axis]].add(term)
    highest = {kind: orders_of_terms(kind, own) for kind, own in terms.items()}
    for place, (quantity, order) in enumerate(zip(ORDERED, orders, strict=True)):
        found = {kind: most[place] for kind, most in highest.items()}
        if order and not any(found.values()):
            raise key_error(
                key,
                f"the method does not estimate the temperature dependence of {quantity}; "
                f"give order 0 for it",
            )
        for kind, most in found.items():
            beside = kind == "m" and any(found[other] for other in found if other != kind)
            if 0 < most < order and not beside:
                raise key_error(
                    key,
                    f"the method estimates the {quantity} of {QUANTITIES[kind].sensors} up to "
                    f"order {most}, not "
                    f"{order}; give order {most} for it",
                )


def stated_environment(
    schema: RunSchema, sensor: Sensor, chosen: Method[Any, Any]
) -> Environment | None:
    """Return the environment stated in a run file, or None if the section is missing.

    Parameters
    ----------
    schema : RunSchema
    sensor : Sensor
        The sensor with the coefficients to estimate.
    chosen : Method

    Raises
    ------
    InputError
        A key has no effect on the result, or a value is not possible.
    """
    section = schema.environment
    ordered = schema.method.temperature_order is not None
    if (ordered or section is not None) and schema.data.temperature is None:
        raise key_error(
            "[data] temperature",
            "is missing: temperature coefficients need the sensor's temperature; name its column",
        )
    if section is None:
        return None
    if schema.sensor.magnetometer is not None:
        raise key_error(
            "[environment]",
            "errors that the rows of a soak or a ramp share are not included for magnetometers; "
            "remove [environment], so that recorded temperatures are taken as exact, or remove "
            "[sensor.magnetometer]",
        )
    _require_used(section, schema, sensor, chosen)
    lag = _stated_lag(section, chosen)
    allowed = schema.data.allow_temperature
    profile = ChamberProfile(
        _possible_temperatures("temperatures", section.temperatures, allowed=allowed),
        _positive(section, "ramp_rate", "K/s"),
        _positive(section, "wait", "s"),
        _positive(section, "case_time", "s"),
    )
    return Environment(
        section.kind,
        _positive(section, "temperature_sd", "K"),
        _positive(section, "accelerometer_repeatability", "m/s²"),
        _positive(section, "gyro_repeatability", "rad/s"),
        lag,
        profile,
        _positive(section, "warm_up", "s"),
        _stated_criteria(section, profile, allowed=allowed),
    )


def _possible_temperatures(name: str, texts: Sequence[str], *, allowed: bool) -> tuple[float, ...]:
    """Return the temperatures of a key, K; raise an error for an impossible temperature."""
    key = f"[environment] {name}"
    kelvin = tuple(si_value(t, "°C", key) for t in texts)
    bad = first_impossible(np.array(kelvin), allowed=allowed)
    if bad is not None:
        raise key_error(key, f"{texts[bad]!r} is {impossible_text(kelvin[bad])}")
    return kelvin


_CRITERIA = {
    "tolerance": "K", "drift": "K/s", "steady_time": "s", "longest_wait": "s", "max_rate": "K/s",
}  # fmt: skip


def _stated_criteria(
    section: EnvironmentSection, profile: ChamberProfile, *, allowed: bool
) -> SoakCriteria:
    """Return the criteria for a run in a chamber; raise an error for impossible values."""
    given: dict[str, Any] = {}
    for name, unit in _CRITERIA.items():
        if getattr(section, name) is not None:
            given[name] = _positive(section, name, unit)
            if not given[name]:
                raise key_error(f"[environment] {name}", "it must be greater than 0")
    if section.limits is not None:
        low, high = given["limits"] = _possible_temperatures(
            "limits", section.limits, allowed=allowed
        )
        if not all(low < one < high for one in profile.temperatures) or low >= high:
            raise key_error(
                "[environment] limits",
                f"{section.limits[0]!r} and {section.limits[1]!r} must be the lowest and the "
                "highest permitted temperature, with all temperatures between them",
            )
    return SoakCriteria(**given)


def _stated_lag(section: EnvironmentSection, chosen: Method[Any, Any]) -> Measured | None:
    """Return the lag, and raise an error if its uncertainty cannot be used."""
    if section.lag is None:
        return None
    lag = measured_constant(section.lag, "s", "[environment] lag", last_digit=False)
    weighed = chosen.follows_rest or (chosen.weighs_common_errors and section.kind == "soaks")
    if lag.sd and not weighed:
        raise key_error(
            "[environment] lag",
            f'method {chosen.name} cannot use the uncertainty of the lag with kind = "'
            f'{section.kind}"; state the lag without it',
        )
    return lag


def _positive(section: EnvironmentSection, name: str, like: str) -> float:
    text = getattr(section, name)
    if text is None:
        return 0.0
    return non_negative_value(text, like, f"[environment] {name}", difference=True)


def _require_used(
    section: EnvironmentSection, schema: RunSchema, sensor: Sensor, chosen: Method[Any, Any]
) -> None:
    """Raise an error if the section, or one of its keys, has no effect on the result."""
    if not sensor.uses("dT", "dTdt"):
        raise key_error(
            "[environment]",
            "the run estimates no temperature coefficients, so the section has "
            'no effect; state [method] temperature_order = "auto", or remove [environment]',
        )
    ramp = section.kind == "ramp"
    if chosen.follows_rest and not ramp:
        raise key_error(
            "[environment] kind", f'method {chosen.name} needs a ramp; write kind = "ramp"'
        )
    kinds = {axis.measures for axis in sensor.axes}
    soaks_only = (*_CRITERIA, "limits") if ramp else ()
    unused = dict.fromkeys(soaks_only, "it is for the soaks in a chamber")
    for kind, key in (("f", "accelerometer_repeatability"), ("w", "gyro_repeatability")):
        if ramp:
            unused[key] = "a ramp has no soaks, so a bias cannot change from soak to soak"
        elif kind not in kinds:
            unused[key] = f"the method calibrates no {QUANTITIES[kind].sensors}"
    if not chosen.follows_rest:
        unused["warm_up"] = "only method temperature_ramp estimates a warm-up"
    if schema.data.kind == "means":
        unused["lag"] = "means do not show how the temperature changed; correct the temperatures"
    for key, reason in unused.items():
        if getattr(section, key) is not None:
            raise key_error(f"[environment] {key}", f"{reason}; remove {key}")
