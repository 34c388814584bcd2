"""A calibration in the form of Wang and Li 2021: N = S (f + D f²) + b, with f in g₀ = 9.8 m/s².

N is the output of an axis. With its readout, N = offset + scale (k0 + (1 + k1) f + k2 f²), f in
m/s², the coefficients of the source (their equation 6, without misalignments) are::

    S = g₀ scale (1 + k1)     b = offset + scale k0     D = g₀ k2 / (1 + k1)
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.calibration import Calibration, ConvertedCoefficients
from inercal.calibration.shared_errors import transform_shared
from inercal.estimation.uncertainty import value_and_jacobian
from inercal.methods.centrifuge_norm.closed_formulas import TERMS

G = 9.8  # m/s², the source's unit of g; the unit of inercal is 9.80665 m/s²


def paper_coefficients(k0: Array, k1: Array, k2: Array, scale: Array | float) -> list[Array]:
    """Return S in output units per g, b in output units and D in 1/g, for a readout without offset.

    k0, k1 and k2 are SI; `scale` is that of the readout in output units per g.
    """
    return [scale * (1 + k1), k0 * scale / G, k2 / (1 + k1) * G]


def paper_form(calibration: Calibration) -> ConvertedCoefficients:
    """Return "D_ax", … "S_ax", … "b_ax", … of each axis in the order of the source's tables.

    Raises
    ------
    InputError
        The calibration is not by centrifuge_norm, or it does not have k0, k1 and k2 of each
        accelerometer and no other coefficient.
    """
    sensor = calibration.sensor
    wanted = [f"{axis}.{term}" for term in TERMS for axis in sensor.channels]
    if calibration.method != "centrifuge_norm" or set(sensor.coefficients) != set(wanted):
        raise InputError(
            "the form of the paper has D, S and b of accelerometers on a centrifuge, so it is only "
            "possible for a calibration by centrifuge_norm with exactly k0, k1 and k2 of each "
            f"axis; this one is by {calibration.method or 'an unknown method'} and has "
            f"{', '.join(sensor.coefficients)}",
            names=tuple(sorted(set(sensor.coefficients) ^ set(wanted))),
        )
    order = [sensor.coefficients.index(name) for name in wanted]
    readouts = [axis.readout for axis in sensor.axes]
    scale = G * np.array([readout.scale for readout in readouts])
    offset = np.array([readout.offset for readout in readouts])

    def convert(c: Array) -> Array:
        k0, k1, k2 = c[order].reshape(len(TERMS), -1)
        s, b, d = paper_coefficients(k0, k1, k2, scale)
        return np.concatenate([d, s, b + offset])

    value, by = value_and_jacobian(convert, calibration.values, calibration.covariance)
    units = [readout.unit for readout in readouts]
    return ConvertedCoefficients(
        tuple(f"{letter}_{axis}" for letter in "DSb" for axis in sensor.channels),
        (*["g/g²" for _ in units], *[f"{unit}/g" for unit in units], *units),
        value,
        by @ calibration.covariance @ by.T,
        transform_shared(calibration.shared, by),
    )
