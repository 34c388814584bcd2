"""Read [method.filter] of a run file, which sets up the filters of the method turntable_kalman."""

from collections.abc import Mapping
from math import isclose
from typing import TYPE_CHECKING, Any, NamedTuple

from inercal.basics.keys import CoefficientName
from inercal.methods import Method
from inercal.physics.section_settings import Section, key_error, positive_value, si_value
from inercal.physics.sensors import Sensor
from inercal.runfile.schema import FilterSection, RunSchema

if TYPE_CHECKING:
    from inercal.methods.turntable_kalman.filter_config import FilterConfig

FILTER_KEY = "[method.filter]"
FILTER_METHOD = "turntable_kalman"
_ROUNDING = 1e-12  # relative rounding error of unit conversion


class _Range(NamedTuple):
    """The smallest and largest values of a key, as text, and a unit of the same dimension."""

    like: str
    least: str
    largest: str


_RANGES: Mapping[str, _Range] = {
    # The lower limit of R covers the error of assuming that rates change linearly between samples.
    "readback_sd": _Range("°", "0.1 ″", "1 °"),
    "velocity_sd": _Range("m/s", "0.1 µm/s", "1 m/s"),
    # Φ is a first-order approximation over one epoch; a hold of one second must have several
    # epochs.
    "epoch": _Range("s", "0.02 s", "0.5 s"),
}
# The filters are linear in the coefficients.
_INITIAL_RANGES: Mapping[str, _Range] = {
    "gyro_bias": _Range("rad/s", "0.001 °/h", "10 °/s"),
    "gyro_scale": _Range("1", "0.1 ppm", "20 %"),
    "gyro_misalignment": _Range("°", "0.1 ″", "10 °"),
    "accelerometer_bias": _Range("m/s²", "0.1 µg", "300 mg"),
    "accelerometer_scale": _Range("1", "0.1 ppm", "20 %"),
    "accelerometer_misalignment": _Range("°", "0.1 ″", "10 °"),
    "attitude": _Range("°", "0.1 ″", "1 °"),
}

FILTER_RANGES = {**_RANGES, **{f"initial.{name}": one for name, one in _INITIAL_RANGES.items()}}


def with_filter_keys(
    schema: RunSchema,
    chosen: Method[Any, Any],
    estimator: str,
    sensor: Sensor,
    rate_hz: float | None,
) -> "tuple[Method[Any, Any], FilterConfig | None]":
    """Return the method and the filter configuration stated in the run file.

    Parameters
    ----------
    schema : RunSchema
    chosen : Method
    estimator : str
        Name of one of the method's estimators.
    sensor : Sensor
        The sensor with the coefficients to estimate.
    rate_hz : float or None
        Sampling rate stated in the run file.

    Returns
    -------
    method : Method
        A modified method if the run file has [method.filter].
    config : FilterConfig or None
        None if the run file has no such section.

    Raises
    ------
    InputError
        The method has no filter, or a value is out of range or has no effect.
    """
    section = schema.method.filter
    if section is None:
        return chosen, None
    if chosen.name != FILTER_METHOD:
        raise key_error(
            FILTER_KEY,
            f"only {FILTER_METHOD} uses these keys; {chosen.name} has no filter, so remove the "
            "section",
        )
    from inercal.methods.turntable_kalman import method_with

    config = _filter_config(schema, section, estimator, sensor, rate_hz)
    return method_with(config, estimator), config


def _filter_config(
    schema: RunSchema, section: FilterSection, estimator: str, sensor: Sensor, rate_hz: float | None
) -> "FilterConfig":
    from inercal.methods.turntable_kalman import filter_config

    config = filter_config.FILTER_CONFIGS[estimator]
    changes: dict[str, Any] = {}
    if section.bias_drift is not None:
        _require_unstable_biases(schema)
        changes["bias_drift"] = section.bias_drift
    if section.table_states is not None:
        changes["table_states"] = section.table_states
    found = _stated_values(section, FILTER_KEY, _RANGES)
    if (sd := found.get("readback_sd")) is not None:
        changes["attitude_sd"] = (sd, sd)
    if (sd := found.get("velocity_sd")) is not None:
        changes["velocity_sd"] = _unrounded(sd, config.velocity_sd)
    if (epoch := found.get("epoch")) is not None:
        epoch = _unrounded(epoch, config.epoch)
        if rate_hz is not None:
            filter_config.require_whole_epoch(epoch, 1 / rate_hz)
        changes["epoch"] = epoch
    if section.initial is not None:
        initial = _stated_values(section.initial, "[method.filter.initial]", _INITIAL_RANGES)
        for name in initial.keys() & filter_config.INITIAL_TERMS.keys():
            kind, terms = filter_config.INITIAL_TERMS[name]
            _require_estimated(name, (kind, terms), sensor)
            initial[name] = _unrounded(initial[name], config.expected_sizes(kind)[terms[0]])
        changes["initial"] = initial
    return config._replace(source_values=config.source_values - found.keys(), **changes)


def _stated_values(section: Section, place: str, ranges: Mapping[str, _Range]) -> dict[str, float]:
    """Return the quantities that a section states, in SI units."""
    return {
        name: _value(f"{place} {name}", text, limits)
        for name, limits in ranges.items()
        if (text := getattr(section, name)) is not None
    }


def _value(key: str, text: str, limits: _Range) -> float:
    """Return a quantity in SI units after checking its limits."""
    value = positive_value(text, limits.like, key)
    least, largest = (si_value(limit, limits.like, key) for limit in limits[1:])
    if not least * (1 - 1e-9) <= value <= largest * (1 + 1e-9):
        raise key_error(key, f"{text!r} is outside {limits.least} to {limits.largest}")
    return value


def _unrounded(value: float, default: float) -> float:
    """Return the exact default if the stated value only differs from it by rounding."""
    return default if isclose(value, default, rel_tol=_ROUNDING) else value


def _require_unstable_biases(schema: RunSchema) -> None:
    """Raise an error if `bias_drift` is set but no bias instability or random walk is stated."""
    noise = [one for one in (schema.sensor.accelerometer, schema.sensor.gyro) if one is not None]
    if not any(one.bias_instability or one.random_walk for one in noise):
        raise key_error(
            f"{FILTER_KEY} bias_drift",
            "bias_drift needs a bias_instability or a random_walk in [sensor]; state one, or "
            "remove bias_drift",
        )


def _require_estimated(name: str, terms: tuple[str, tuple[str, ...]], sensor: Sensor) -> None:
    """Raise an error if a standard deviation is stated for coefficients that are not estimated."""
    kind, wanted = terms
    estimated = sensor.select_axes("f" if kind == "f" else "w").coefficients
    if not any(CoefficientName(one).term in wanted for one in estimated):
        raise key_error(
            f"[method.filter.initial] {name}",
            f"the run does not estimate {' or '.join(wanted)}; remove it",
        )
