"""[environment] of a run file: the temperatures around the bench, to SI."""

from collections.abc import Sequence
from typing import Any, Literal

from inercal.environment import ChamberProfile, Environment
from inercal.errors import InputError
from inercal.methods import Method
from inercal.runfile.schema import EnvironmentSection, RunSchema
from inercal.section_settings import key_error, measured_constant, si_value
from inercal.sensors import Sensor

_WORDS = {"f": "accelerometers", "w": "gyros"}
TemperatureOrder = Literal["auto"] | tuple[int, int, int] | None
MAX_ORDERS = (3, 2, 1)  # of bias, scale factor and misalignment
# Terms of each order from 1, by kind of axis: bias, scale factor, misalignment.
_TERMS = {
    "f": (("k0_dT", "k0_dT2", "k0_dT3"), ("k1_dT", "k1_dT2"), (("delta_o_dT", "delta_p_dT"),)),
    "w": (
        ("bias_dT", "bias_dT2", "bias_dT3"),
        ("scale_dT", "scale_dT2"),
        (("delta_o_dT", "delta_p_dT"),),
    ),
}


def order_terms(kind: str, orders: Sequence[int]) -> tuple[str, ...]:
    """Return the short names of the terms of temperature of three orders.

    Parameters
    ----------
    kind : "f" or "w"
    orders : sequence of 3 int
        Of bias, scale factor and misalignment.
    """
    names: list[str] = []
    for terms, order in zip(_TERMS[kind], orders, strict=True):
        for term in terms[:order]:
            names += [term] if isinstance(term, str) else term
    return tuple(names)


def terms_of_order(
    section_order: TemperatureOrder, sensor: Sensor, possible: Sequence[str]
) -> list[str]:
    """Return the full names of the terms that [method] temperature_order states.

    Parameters
    ----------
    section_order : "auto", sequence of 3 int, or None
        "auto" gives the terms of the highest orders, among which a test chooses.
    sensor : Sensor
    possible : sequence of str
        Coefficients that the method can estimate.

    Raises
    ------
    InputError
        Orders beyond the highest, or an order that the method estimates of no axis.
    """
    if section_order is None:
        return []
    key = "[method] temperature_order"
    automatic = section_order == "auto"
    orders = MAX_ORDERS if isinstance(section_order, str) else section_order
    if any(not 0 <= n <= most for n, most in zip(orders, MAX_ORDERS, strict=True)):
        raise key_error(key, f"{list(orders)}: give orders from 0 to {list(MAX_ORDERS)}, or 'auto'")
    named = [
        f"{axis.name}.{term}"
        for axis in sensor.axes
        for term in order_terms(axis.measures, orders)
        if f"{axis.name}.{term}" in possible
    ]
    if not automatic:
        for place, word in enumerate(("bias", "scale factor", "misalignment")):
            alone = [orders[k] if k == place else 0 for k in range(3)]
            wanted = [
                f"{axis.name}.{term}"
                for axis in sensor.axes
                for term in order_terms(axis.measures, alone)
            ]
            if wanted and not set(wanted) & set(possible):
                raise key_error(
                    key,
                    f"the method estimates no {word} against temperature; give order 0 there",
                    None,
                    tuple(wanted),
                )
    if not named:
        raise key_error(key, "the method estimates no coefficients of temperature; remove the key")
    return named


def stated_environment(
    schema: RunSchema, sensor: Sensor, chosen: Method[Any, Any], estimates_lag: bool
) -> Environment | None:
    """Return the environment that a run file states; None without the section.

    Parameters
    ----------
    schema : RunSchema
    sensor : Sensor
        With the coefficients to estimate.
    chosen : Method
    estimates_lag : bool
        Whether the method follows a ramp.

    Raises
    ------
    InputError
        A key that changes no result, or a value that is not possible.
    """
    section = schema.environment
    ordered = schema.method.temperature_order is not None
    if (ordered or section is not None) and schema.data.temperature is None:
        raise key_error(
            "[data] temperature",
            "is missing: coefficients of temperature need the sensor's temperature; name its "
            "column",
        )
    if section is None:
        return None
    _require_used(section, schema, sensor, chosen, estimates_lag)
    lag = None
    if section.lag is not None:
        lag = measured_constant(section.lag, "s", "[environment] lag", last_digit=False)
        if lag.value < 0:
            raise key_error("[environment] lag", f"{section.lag!r} is negative; give 0 or more")
    profile = ChamberProfile(
        tuple(si_value(t, "°C", "[environment] temperatures") for t in section.temperatures),
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
    )


def _positive(section: EnvironmentSection, name: str, like: str) -> float:
    text = getattr(section, name)
    if text is None:
        return 0.0
    value = si_value(text, like, f"[environment] {name}")
    if value < 0:
        raise key_error(f"[environment] {name}", f"{text!r} is negative; give 0 or more")
    return value


def _require_used(
    section: EnvironmentSection,
    schema: RunSchema,
    sensor: Sensor,
    chosen: Method[Any, Any],
    estimates_lag: bool,
) -> None:
    """Refuse the section, or keys of it, that change no result."""
    if not sensor.uses("dT", "dTdt"):
        raise InputError(
            "[environment]: the run estimates no coefficients of temperature, and nothing depends "
            'on the section; state [method] temperature_order = "auto", or remove [environment]',
            key="[environment]",
        )
    ramp = section.kind == "ramp"
    if estimates_lag and not ramp:
        raise key_error(
            "[environment] kind", f'method {chosen.name} follows a ramp; write kind = "ramp"'
        )
    kinds = {axis.measures for axis in sensor.axes}
    unused: dict[str, str] = {}
    for kind, key in (("f", "accelerometer_repeatability"), ("w", "gyro_repeatability")):
        if ramp:
            unused[key] = "a ramp has no soaks from which a bias comes back"
        elif kind not in kinds:
            unused[key] = f"the method calibrates no {_WORDS[kind]}"
    if not estimates_lag:
        unused["warm_up"] = "only method temperature_ramp estimates a warm-up"
    if schema.data.kind == "means":
        unused["lag"] = "means hold no course of the temperature; correct their temperatures"
    for key, reason in unused.items():
        if getattr(section, key) is not None:
            raise key_error(f"[environment] {key}", f"{reason}; remove {key}")
