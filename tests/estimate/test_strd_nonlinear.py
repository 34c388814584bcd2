"""NIST Statistical Reference Datasets, nonlinear regression: certified to eleven digits.

https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml. Derivatives by complex step, exact to
rounding (Squire and Trapp 1998).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.estimation import Problem, least_squares

Array = NDArray[np.float64]


class Dataset(NamedTuple):
    model: Callable[[Array, Array], Array]
    start: list[float]  # NIST's start 2
    certified: list[float]
    sd: list[float]
    y: list[float]
    x: list[float]


def parts(b: Array) -> list[Array]:
    return [b[..., i, None] for i in range(b.shape[-1])]


def saturation(b: Array, x: Array) -> Array:
    b1, b2 = parts(b)
    return b1 * (1 - np.exp(-b2 * x))


def cubic_ratio(b: Array, x: Array) -> Array:
    b1, b2, b3, b4, b5, b6, b7 = parts(b)
    return (b1 + x * (b2 + x * (b3 + x * b4))) / (1 + x * (b5 + x * (b6 + x * b7)))


def quadratic_ratio(b: Array, x: Array) -> Array:
    b1, b2, b3, b4 = parts(b)
    return b1 * (x**2 + x * b2) / (x**2 + x * b3 + b4)


def exponential_of_ratio(b: Array, x: Array) -> Array:
    b1, b2, b3 = parts(b)
    return b1 * np.exp(b2 / (x + b3))


def two_exponentials(b: Array, x: Array) -> Array:
    b1, b2, b3, b4, b5 = parts(b)
    return b1 + b2 * np.exp(-x * b4) + b3 * np.exp(-x * b5)


def growth(b: Array, x: Array) -> Array:
    b1, b2, b3, b4 = parts(b)
    return b1 / (1 + np.exp(b2 - b3 * x)) ** (1 / b4)


# fmt: off
DATASETS = {
    "Misra1a": Dataset(
        saturation, [250, 5e-4], [2.3894212918e2, 5.5015643181e-4], [2.7070075241, 7.2668688436e-6],
        [10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47,
         81.78],
        [77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1,
         760.0],
    ),
    "BoxBOD": Dataset(
        saturation, [100, 0.75], [2.1380940889e2, 5.4723748542e-1],
        [1.2354515176e1, 1.0455993237e-1],
        [109, 149, 149, 191, 213, 224], [1, 2, 3, 5, 7, 10],
    ),
    "Thurber": Dataset(
        cubic_ratio, [1300, 1500, 500, 75, 1, 0.4, 0.05],
        [1.2881396800e3, 1.4910792535e3, 5.8323836877e2, 7.5416644291e1, 9.6629502864e-1,
         3.9797285797e-1, 4.9727297349e-2],
        [4.6647963344, 3.9571156086e1, 2.8698696102e1, 5.5675370270, 3.1333340687e-2,
         1.4984928198e-2, 6.5842344623e-3],
        [80.574, 84.248, 87.264, 87.195, 89.076, 89.608, 89.868, 90.101, 92.405, 95.854, 100.696,
         101.060, 401.672, 390.724, 567.534, 635.316, 733.054, 759.087, 894.206, 990.785, 1090.109,
         1080.914, 1122.643, 1178.351, 1260.531, 1273.514, 1288.339, 1327.543, 1353.863, 1414.509,
         1425.208, 1421.384, 1442.962, 1464.350, 1468.705, 1447.894, 1457.628],
        [-3.067, -2.981, -2.921, -2.912, -2.840, -2.797, -2.702, -2.699, -2.633, -2.481, -2.363,
         -2.322, -1.501, -1.460, -1.274, -1.212, -1.100, -1.046, -0.915, -0.714, -0.566, -0.545,
         -0.400, -0.309, -0.109, -0.103, 0.010, 0.119, 0.377, 0.790, 0.963, 1.006, 1.115, 1.572,
         1.841, 2.047, 2.200],
    ),
    "MGH09": Dataset(
        quadratic_ratio, [0.25, 0.39, 0.415, 0.39],
        [1.9280693458e-1, 1.9128232873e-1, 1.2305650693e-1, 1.3606233068e-1],
        [1.1435312227e-2, 1.9633220911e-1, 8.0842031232e-2, 9.0025542308e-2],
        [0.1957, 0.1947, 0.1735, 0.16, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246],
        [4, 2, 1, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625],
    ),
    "MGH10": Dataset(
        exponential_of_ratio, [0.02, 4000, 250],
        [5.6096364710e-3, 6.1813463463e3, 3.4522363462e2],
        [1.5687892471e-4, 2.3309021107e1, 7.8486103508e-1],
        [34780, 28610, 23650, 19630, 16370, 13720, 11540, 9744, 8261, 7030, 6005, 5147, 4427, 3820,
         3307, 2872],
        list(np.arange(50.0, 130.0, 5.0)),
    ),
    "MGH17": Dataset(
        two_exponentials, [0.5, 1.5, -1, 0.01, 0.02],
        [3.7541005211e-1, 1.9358469127, -1.4646871366, 1.2867534640e-2, 2.2122699662e-2],
        [2.0723153551e-3, 2.2031669222e-1, 2.2175707739e-1, 4.4861358114e-4, 8.9471996575e-4],
        [0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818, 0.784, 0.751, 0.718, 0.685,
         0.658, 0.628, 0.603, 0.580, 0.558, 0.538, 0.522, 0.506, 0.490, 0.478, 0.467, 0.457, 0.448,
         0.438, 0.431, 0.424, 0.420, 0.414, 0.411, 0.406],
        list(np.arange(0.0, 330.0, 10.0)),
    ),
    "Rat43": Dataset(
        growth, [700, 5, 0.75, 1.3],
        [6.9964151270e2, 5.2771253025, 7.5962938329e-1, 1.2792483859],
        [1.6302297817e1, 2.0828735829, 1.9566123451e-1, 6.8761936385e-1],
        [16.08, 33.83, 65.80, 97.20, 191.55, 326.20, 386.87, 520.53, 590.03, 651.92, 724.93, 699.56,
         689.96, 637.56, 717.41],
        list(np.arange(1.0, 16.0)),
    ),
}
# fmt: on


def problem(data: Dataset, trials: int | None = None) -> Problem:
    x, y, p = np.array(data.x), np.array(data.y), len(data.start)

    def linearise(b: Array) -> tuple[Array, Array]:
        shifted = [data.model(b + 1e-100j * np.eye(p)[i], x) for i in range(p)]
        return y - data.model(b, x), np.stack([s.imag / 1e-100 for s in shifted], axis=-1)

    start = np.array(data.start, dtype=float)
    return Problem(
        names=tuple(f"b{i + 1}" for i in range(p)),
        start=start if trials is None else np.tile(start, (trials, 1)),
        linearise=linearise,
        noise=np.ones(len(y)),
        scale=np.abs(start),
    )


@pytest.mark.parametrize("trials", [None, 20], ids=["alone", "together"])
@pytest.mark.parametrize("name", DATASETS)
def test_certified_values_to_seven_digits(name: str, trials: int | None):
    data = DATASETS[name]
    estimate = least_squares(problem(data, trials))
    assert np.all(estimate.converged)
    np.testing.assert_allclose(
        np.atleast_2d(estimate.value), np.broadcast_to(data.certified, (trials or 1, len(data.sd))),
        rtol=1e-7 if name != "MGH09" else 2e-7,
    )  # fmt: skip
    # NIST scales by the residuals; here the noise was stated as one.
    sd = np.sqrt(np.diagonal(estimate.covariance, axis1=-2, axis2=-1)) * np.sqrt(
        np.asarray(estimate.chi2)[..., None] / estimate.dof
    )
    np.testing.assert_allclose(
        np.atleast_2d(sd), np.broadcast_to(data.sd, (trials or 1, len(data.sd))), rtol=1e-6
    )
