"""Temperatures against those that a calibration was made at."""

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.calibration.validity import Validity
from inercal.physics.sensors import Sensor
from inercal.recordings.temperature import first_impossible, impossible_text

TEMPERATURE_MARGIN = 1.0  # K beyond the temperatures of a calibration that still count as inside


def require_inside(
    sensor: Sensor,
    validity: Validity | None,
    kelvin: Array,
    remedy: str,
    *,
    key: str = "temperature",
) -> None:
    """Refuse temperatures, (..., n) K, beyond those of the calibration's data.

    Parameters
    ----------
    sensor : Sensor
    validity : Validity or None
        Of the calibration.
    kelvin : array
    remedy : str
        What is possible, for the message.
    key : str, optional
        What the error is about.

    Raises
    ------
    InputError
        The message states both ranges.
    """
    outside = temperatures_outside(sensor, validity, kelvin)
    if outside.any():
        assert validity is not None
        assert validity.temperature is not None
        low, high = (t - ZERO_CELSIUS for t in validity.temperature)
        beyond = float(kelvin[outside][0]) - ZERO_CELSIUS
        raise InputError(
            f"{beyond:.2f} °C is beyond the temperatures of the calibration, {low:.2f} to "
            f"{high:.2f} °C: a polynomial is unknown there; {remedy}",
            key=key,
        )


def require_usable(
    sensor: Sensor, validity: Validity | None, dT: Array | float, *, extrapolate: bool
) -> None:
    """Refuse temperatures at which readings cannot be corrected.

    Parameters
    ----------
    sensor : Sensor
    validity : Validity or None
        Of the calibration.
    dT : array or float
        Temperature minus the reference, K.
    extrapolate : bool
        Whether temperatures beyond those of the calibration are accepted, but never below 0 K.

    Raises
    ------
    InputError
        A temperature that is not possible, or beyond those of the calibration.
    """
    kelvin = np.atleast_1d(sensor.reference_temperature + np.asarray(dT, dtype=float))
    if not extrapolate:
        remedy = "give temperatures within, or ask for it by extrapolate=True"
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
    """Return which temperatures, (..., n) K, are beyond those of a calibration's data.

    A kelvin beyond them still counts as inside. None are outside where the model does not depend on
    temperature, or where the file of the calibration states no range.
    """
    limits = None if validity is None else validity.temperature
    if limits is None or not sensor.uses("dT", "dTdt"):
        return np.zeros(kelvin.shape, dtype=np.bool_)
    low, high = limits
    return (kelvin < low - TEMPERATURE_MARGIN) | (kelvin > high + TEMPERATURE_MARGIN)
