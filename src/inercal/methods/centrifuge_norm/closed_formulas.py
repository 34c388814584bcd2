"""Estimate in closed form: a linear regression of the squared norm gives the coefficients.

If an axis follows the model N = S (f + D f²) + b, and u = (N − b)/S, the sensed force is

    f = 2u / (1 + √(1 + 4Du)),   f² = u² − 2Du³ + 5D²u⁴ − 14D³u⁵ + …

Up to the fourth power, Σ f² = n² is therefore linear in thirteen numbers: C₀, and C₁ … C₄ for each
of three axes. With K = Db/S and q = √(1 − 4K) the Taylor coefficients at N = 0 are exactly::

    C₁ = (q − 1)/(DSq)    C₂ = 1/(S²q³)    C₃ = −2D/(S³q⁵)    C₄ = 5D²/(S⁴q⁷)

`series` inverts C₁, C₂, C₃ and is regular at D = 0; `paper` computes D from C₄, as its source does.
The omitted higher powers cause errors of the other coefficients: for D = 5e-5/g at 36 g, the error
of D is 2e-9/g.

Source: Wang Shiming, Li Mengzhen, Navigation Positioning and Timing 8(6), 2021, equations 13 to 22,
with its misprints corrected: (14) C₄ = 5D²S⁻⁴ without N⁴; (19) the other branch of K; (21) the sign
of D, which is that of −C₃; (22) is inverted. `series` is our own.

`paper_form` gives a calibration in the form of that source, N = S (f + D f²) + b, with f in
g₀ = 9.8 m/s². N is the output of an axis. With its readout, N = offset + scale (k0 +
(1 + k1) f + k2 f²), f in m/s², the coefficients of the source (their equation 6, without
misalignments) are::

    S = g₀ scale (1 + k1)     b = offset + scale k0     D = g₀ k2 / (1 + k1)
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.basics.keys import CoefficientName
from inercal.calibration import Calibration, ConvertedCoefficients
from inercal.calibration.shared_errors import transform_shared
from inercal.estimation.uncertainty import value_and_jacobian
from inercal.physics.sensors import G0, Sensor

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


SeriesInverse = Callable[[Array, Array, Array, Array], tuple[Array, Array, Array]]
TERMS = ("k0", "k1", "k2")
_COMPLEX_STEP = 1e-30  # no difference is formed, so no digits are lost


def regression_matrix(y: Array) -> Array:
    """Return the regressor, (..., r, 13): 1, then powers one to four of three axes; y is in g."""
    one = np.ones((*y.shape[:-1], 1))
    return np.concatenate([one, y, y**2, y**3, y**4], axis=-1)


def series(c1: Array, c2: Array, c3: Array, c4: Array) -> tuple[Array, Array, Array]:
    """Return S, b (g) and D (1/g) for each axis from C₁, C₂, C₃."""
    q = 1 - c1 * c3 / (2 * c2**2)
    scale = (c2 * q**3) ** -0.5
    return scale, -(1 + q) * q * scale**2 * c1 / 4, -c3 * scale**3 * q**5 / 2


def paper(c1: Array, c2: Array, c3: Array, c4: Array) -> tuple[Array, Array, Array]:
    """Return S, b (g) and D (1/g) for each axis as the source does; NaN without a real root."""
    m = c4 / c3 * c1 / c2  # (17)
    six = 6 * m - 5
    with np.errstate(invalid="ignore"):
        k = (-six - np.sqrt(12 * m**2 - 40 * m + 25)) / (2 * six)  # (19)
        bent = 1 + 6 * k + 6 * k**2
        scale = np.sqrt(bent / c2)  # (20)
        bias = -c1 * bent / (2 * c2 * (1 + k) * (1 + 2 * k))  # (22)
        return scale, bias, -np.sign(np.real(c3)) * np.sqrt(c4 * scale**4 / 5)  # (21)


def coefficients(
    sensor: Sensor, y: Array, norm: Array, invert: SeriesInverse, *, weighted: bool = False
) -> Array:
    """Return k0, k1, k2 for each axis in the sensor's order, (..., 9) SI.

    Parameters
    ----------
    sensor : Sensor
        Three accelerometers.
    y : (..., r, 3) array
        Readings, m/s².
    norm : (r,) array
        Norm of the sensed motion, m/s².
    invert : callable
        `series` or `paper`.
    weighted : bool
        Whether to weight each row by 1/n. If all readings have the noise σ, the squared norm has
        the noise 2nσ.
    """
    rows, target = regression_matrix(y / G0), (norm / G0) ** 2
    if weighted:
        rows, target = rows * (G0 / norm)[:, None], target * (G0 / norm)
    size = np.linalg.norm(rows, axis=-2, keepdims=True)
    q, r = np.linalg.qr(rows / size)
    right = q.mT @ target[:, None]
    c = np.linalg.solve(r, right)[..., 0] / size[..., 0, :]
    scale, bias, bend = invert(*(c[..., k : k + 3] for k in (1, 4, 7, 10)))
    return _in_order(sensor, np.stack([bias * G0, scale - 1, scale * bend / G0], axis=-2))


def _in_order(sensor: Sensor, by_term: Array) -> Array:
    """Put k0, k1 and k2, stored axis by axis, (..., 3, 3), in the sensor's order, (..., 9)."""
    names = [CoefficientName(name).parts for name in sensor.coefficients]
    rows = [TERMS.index(short) for _, short in names]
    return by_term[..., rows, [sensor.channels.index(axis) for axis, _ in names]]


@dataclass(frozen=True, eq=False)
class Linearised:
    """Derivatives of the closed formulas with respect to the readings, row by row.

    Parameters
    ----------
    coefficients : (9, 3r) array
        Derivatives of k0, k1, k2 in the sensor's order, SI.
    fourth : (3,) array
        The fourth-power coefficients C₄ for each axis, 1/g².
    by_fourth : (3, 3r) array
        Derivatives of C₄.
    """

    coefficients: Array
    fourth: Array
    by_fourth: Array


def linearise(
    sensor: Sensor, y: Array, norm: Array, invert: SeriesInverse, *, weighted: bool = False
) -> Linearised:
    """Return the exact derivatives of `coefficients` for one recording; the arguments are the same.

    Each row of the regressor depends only on its own readings. With the residuals ε of C = A⁺ t,
    ∂C/∂y = (AᵀA)⁻¹ (∂A/∂y)ᵀ ε − A⁺ (∂A/∂y) C. The inversion is differentiated by a complex step
    (Squire and Trapp 1998, SIAM Review 40, 110–112), because after a real step of finite size there
    might be no real root.
    """
    y, norm = y / G0, norm / G0
    weight = 1 / norm if weighted else np.ones_like(norm)
    rows, target = regression_matrix(y) * weight[:, None], norm**2 * weight
    size = np.linalg.norm(rows, axis=0)
    q, r = np.linalg.qr(rows / size)
    inverse = np.linalg.solve(r, q.T) / size[:, None]
    c = inverse @ target
    left = target - rows @ c
    power = np.arange(1.0, 5.0)
    by = np.empty((len(c), *y.shape))
    for axis in range(3):
        own = np.arange(1 + axis, 13, 3)  # the four powers of this axis
        slope = power * y[:, axis, None] ** (power - 1) * weight[:, None]
        by[:, :, axis] = inverse @ inverse[own].T @ (slope * left[:, None]).T
        by[:, :, axis] -= inverse * (slope @ c[own])
    by_powers = by[1:].reshape(4, 3, -1)
    powers = c[1:].reshape(4, 3)
    result = np.zeros((3, 3, by_powers.shape[-1]))  # by term and axis
    for k in range(4):
        moved = powers.astype(complex)
        moved[k] += 1j * _COMPLEX_STEP
        scale, bias, bend = invert(*moved)
        terms = np.stack([bias * G0, scale - 1, scale * bend / G0])
        result += (terms.imag / _COMPLEX_STEP)[:, :, None] * by_powers[k]
    in_order = _in_order(sensor, np.moveaxis(result, -1, 0)).T
    return Linearised(in_order / G0, powers[3], by_powers[3] / G0)


def regression_singular_values(sensor: Sensor, y: Array, name: str) -> Array:
    """Return the singular values of the regressor with scaled columns, (13,).

    Raises
    ------
    InputError
        The sensor is not three accelerometers with bias, scale factor and k2 each.
    NotObserved
        The regressor does not have full rank; the message names the powers that it cannot separate.
    """
    wanted = {f"{axis.name}.{short}" for axis in sensor.axes for short in TERMS}
    if len(sensor.axes) != 3 or set(sensor.coefficients) != wanted:
        raise InputError(
            f"estimator {name} estimates only k0, k1 and k2 of three accelerometers; choose "
            "these, or use estimator ml",
            key="[method]",
            names=tuple(sorted(wanted ^ set(sensor.coefficients))),
        )
    rows = regression_matrix(y / G0)
    scaled = rows / np.linalg.norm(rows, axis=0)
    if len(scaled) < scaled.shape[1]:
        raise NotObserved(
            f"estimator {name}: {len(scaled)} dwells are too few for {scaled.shape[1]} terms; add "
            "attitudes, at two rates or more",
            key="steps",
        )
    _, singular, vectors = np.linalg.svd(scaled)
    if singular[-1] < 1e-10 * singular[0]:
        powers = ["1", *(f"{axis}{k}" for k in ("", "²", "³", "⁴") for axis in sensor.channels)]
        vector = vectors[-1]
        large = np.flatnonzero(np.abs(vector) > 0.3 * np.abs(vector).max()).tolist()
        words = ", ".join(powers[k] for k in large)
        raise NotObserved(
            f"estimator {name}: these dwells cannot distinguish {words} (rank "
            f"{int(np.sum(singular > 1e-10 * singular[0]))} of {scaled.shape[1]}); add a rate, "
            "or attitudes all around the circle",
            (words,),
        )
    return singular
