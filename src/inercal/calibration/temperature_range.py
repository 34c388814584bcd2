"""Check whether temperatures are in the range in which a calibration was made."""

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.calibration.validity import Validity
from inercal.physics.sensors import Sensor
from inercal.recordings.temperature import first_impossible, impossible_text

TEMPERATURE_MARGIN = 1.0  # K outside the calibration's range that are still accepted


def require_inside(
    sensor: Sensor,
    validity: Validity | None,
    kelvin: Array,
    remedy: str,
    *,
    key: str = "temperature",
) -> None:
    """Raise an error if temperatures, (..., n) K, are outside the range of the data.

    Parameters
    ----------
    sensor : Sensor
    validity : Validity or None
        Validity of the calibration.
    kelvin : array
    remedy : str
        What the user can do; the message contains this text.
    key : str, optional
        The run-file key or option that the error names.

    Raises
    ------
    InputError
        If a temperature is outside the range; the message states both ranges.
    """
    outside = temperatures_outside(sensor, validity, kelvin)
    if outside.any():
        assert validity is not None
        assert validity.temperature is not None
        low, high = (t - ZERO_CELSIUS for t in validity.temperature)
        beyond = float(kelvin[outside][0]) - ZERO_CELSIUS
        raise InputError(
            f"{beyond:.2f} °C is outside the temperatures of the calibration, {low:.2f} to "
            f"{high:.2f} °C, where its polynomials are valid; {remedy}",
            key=key,
        )


def require_usable(
    sensor: Sensor, validity: Validity | None, dT: Array | float, *, extrapolate: bool
) -> None:
    """Raise an error if readings cannot be corrected at some temperature.

    Parameters
    ----------
    sensor : Sensor
    validity : Validity or None
        Validity of the calibration.
    dT : array or float
        Temperature minus the reference temperature, K.
    extrapolate : bool
        Whether temperatures outside the range of the calibration are accepted. Temperatures below 0
        K are never accepted.

    Raises
    ------
    InputError
        If a temperature is impossible, or outside the range of the calibration.
    """
    kelvin = np.atleast_1d(sensor.reference_temperature + np.asarray(dT, dtype=float))
    if not extrapolate:
        remedy = "give temperatures in this range, or pass extrapolate=True"
        require_inside(sensor, validity, kelvin, remedy, key="dT")
    flat = kelvin.reshape(-1)
    known = None if validity is None else validity.temperature
    bad = first_impossible(flat, allowed=extrapolate or known is not None)
    if bad is not None:
        raise InputError(
            f"dT of {float(flat[bad]) - sensor.reference_temperature:.6g} K is "
            f"{impossible_text(float(flat[bad]), 'extrapolate=True')}",
            key="dT",
        )


def temperatures_outside(
    sensor: Sensor, validity: Validity | None, kelvin: Array
) -> NDArray[np.bool_]:
    """Return a mask of the temperatures, (..., n) K, outside the range of a calibration's data.

    The range is extended by one kelvin at both ends. No temperature is outside if the model does
    not depend on temperature or if the calibration file states no range.
    """
    limits = None if validity is None else validity.temperature
    if limits is None or not sensor.uses("dT", "dTdt"):
        return np.zeros(kelvin.shape, dtype=np.bool_)
    low, high = limits
    return (kelvin < low - TEMPERATURE_MARGIN) | (kelvin > high + TEMPERATURE_MARGIN)
