"""Check that a method can use the magnetometers of a run file, and what it states about them."""

from typing import Any

from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.methods import METHODS, Method
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Sensor
from inercal.runfile.schema import MethodSection, SensorSection

_SECTION = "[sensor.magnetometer]"


def require_magnetometer_method(section: SensorSection, chosen: Method[Any, Any]) -> None:
    """Raise an error if a run file states magnetometers that its method cannot use.

    Raises
    ------
    InputError
        The message names the methods that can use them.
    """
    if section.magnetometer is None or "m" in chosen.default_coefficients:
        return
    able = [name for name, each in METHODS.items() if "m" in each.default_coefficients]
    raise InputError(
        f"{_SECTION}: method {chosen.name} cannot calibrate magnetometers, but "
        f"{', '.join(able)} can; remove the section, or change [method] name",
        key=_SECTION,
        names=(chosen.name,),
    )


def split_magnetometer(sensor: Sensor) -> tuple[Sensor, Sensor | None]:
    """Return the accelerometers and gyros, and the magnetometers; None if there are none.

    Raises
    ------
    InputError
        The magnetometers are not three along independent directions.
    """
    field = sensor.select_axes("m")
    if not field.axes:
        return sensor, None
    if len(field.axes) != len("xyz") or field.rank("m") < len("xyz"):
        raise key_error(
            f"{_SECTION} axis",
            f"{', '.join(field.channels)} do not measure the whole field; name three columns along "
            "independent directions",
            names=field.channels,
        )
    return sensor.select_axes("f", "w"), field


def require_no_field_priors(section: MethodSection, magnetometer: Sensor | None) -> None:
    """Raise an error for a prior for a magnetometer, which no estimator uses.

    Raises
    ------
    InputError
    """
    channels = () if magnetometer is None else magnetometer.channels
    for name in (*section.prior, *(n for one in section.prior_from.values() for n in one)):
        if CoefficientName(name).axis in channels:
            raise key_error(
                f"[method.prior{'_from' * (name not in section.prior)}] {name}",
                "hard and soft iron change with the mounting, so magnetometers are estimated "
                "without priors; remove the key",
                names=(name,),
            )
