"""Evaluate coefficients as functions of temperature, k(T) = Σ_j c_j ΔT^j, with their uncertainty.

A curve combines the terms of an axis whose basis functions differ only in the power of ΔT. For the
bias, these are `k0`, `k0_dT`, `k0_dT2` and `k0_dT3`.
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName
from inercal.calibration import Calibration
from inercal.calibration.validity import require_inside
from inercal.physics.sensors.coefficient_tables import TABLES


class TemperatureCurve(NamedTuple):
    """A coefficient of an axis at n temperatures.

    Parameters
    ----------
    name : str
        Full name, such as "ax.k0".
    meaning, unit : str
        Meaning and unit from the table of coefficients.
    si : float
        Size of the unit in SI units.
    value, std : (n,) arrays
        Values and standard uncertainties (k = 1), SI.
    complete : bool
        Whether the term of order 0 was estimated. If not, the values are changes relative to the
        reference temperature.
    """

    name: str
    meaning: str
    unit: str
    si: float
    value: Array
    std: Array
    complete: bool


def temperature_curves(calibration: Calibration, kelvin: Array) -> tuple[TemperatureCurve, ...]:
    """Return the temperature-dependent coefficients at some temperatures, (n,), in K.

    Raises
    ------
    InputError
        If a temperature is more than a kelvin outside the range of the calibration's data.
    """
    require_inside(calibration.sensor, calibration.validity, kelvin, "give one in this range")
    sensor = calibration.sensor
    dT = kelvin - sensor.reference_temperature
    found: list[TemperatureCurve] = []
    for axis in sensor.axes:
        own = [n for n in sensor.coefficients if CoefficientName(n).axis == axis.name]
        terms = {n: sensor.coefficient(n) for n in own}
        warm = [one.without_temperature for one in terms.values() if one.temperature_order]
        for base in dict.fromkeys(warm):
            line = next(
                one
                for one in TABLES[axis.measures]
                if one.without_temperature == base and not one.temperature_order
            )
            by = np.zeros((kelvin.size, len(sensor.coefficients)))
            for name, one in terms.items():
                if one.without_temperature == base:
                    by[:, sensor.coefficients.index(name)] = dT**one.temperature_order
            variance = np.einsum("ni,ij,nj->n", by, calibration.covariance, by)
            found.append(
                TemperatureCurve(
                    f"{axis.name}.{line.name}",
                    line.meaning,
                    line.unit,
                    line.si,
                    by @ calibration.values,
                    np.sqrt(np.maximum(variance, 0.0)),
                    f"{axis.name}.{line.name}" in own,
                )
            )
    return tuple(found)
