"""Many calibrations on a centrifuge: the norms of 60 dwells, nine coefficients a trial.

The design and the sensor are the paper's (see `inercal.methods.centrifuge_norm`), the bench exact:
n = √((ω²R)² + g²) in 20 attitudes at three rates, against ‖f̂‖ with f̂ the root of
y = k0 + (1 + k1) f + k2 f² on each axis. The peer is a loop over SciPy with the analytic Jacobian,
by its default method (trf) and its fastest (lm), at its default tolerances and from the same start;
it takes all rows of a trial at once and the root by its closed formula. Both whiten by the noise
that belongs to the coefficients of the step.

With k3 and non-orthogonality there are 15 coefficients, in attitudes all round; the root is then
Newton's. Of nine coefficients the limit is centrifuge.cpp, where a compiler is.
"""

import ctypes
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares as scipy_least_squares
from tests.accuracy.centrifuge import (
    PAPER_G,
    RATES,
    Triad,
    full_circle,
    printed_attitudes,
    sensed_motion,
)

from benchmarks import Row, Skipped, best
from benchmarks._compiled import library, pointer
from inercal.basics.units import Measured
from inercal.benches import Centrifuge
from inercal.methods.centrifuge_norm import ml
from inercal.physics.plan import Spin
from inercal.physics.sensors import Sensor, triad
from inercal.recordings import Observations

Array = NDArray[np.float64]
TRIALS, PEER_TRIALS = 4000, 200
LIMIT = 2.0  # s
LIMIT_15 = 40e-6 * TRIALS  # s
NOMINAL = 1.25  # output units per PAPER_G
SD = 1e-5 / NOMINAL * PAPER_G  # m/s²
SENSOR = replace(triad().with_coefficients("k0", "k1", "k2"), form="tilted")
SENSOR_15 = replace(
    triad().with_coefficients("k0", "k1", "k2", "k3", "nonorthogonality"), form="tilted"
)
# Where `SENSOR_15.coefficients` has k0 to k3 of each axis, and the angles delta_p of y, delta_o and
# delta_p of z: the axes that they tilt, towards what other one, and with what sign.
_OF_AXES = np.array([[0, 1, 2, 3], [4, 5, 7, 8], [9, 10, 13, 14]])
_OF_ANGLES, _TILTED, _SIGNS = np.array([6, 11, 12]), ((1, 0), (2, 0), (2, 1)), np.array([-1, 1, -1])
BENCH = Centrifuge(Measured(PAPER_G, 0.0), Measured(1.0, 0.0), Measured(0.0, 0.0))


def draw(trials: int, attitudes: list[tuple[float, float]]) -> tuple[Array, Array]:
    """Return readings (trials, 60, 3), m/s², and the rates of the rows, rad/s."""
    f, rates = sensed_motion(attitudes, RATES)
    reading = Triad().output(f) / NOMINAL * PAPER_G
    return reading + SD * np.random.default_rng(0).standard_normal((trials, *f.shape)), rates


def ours(y: Array, rates: Array, sensor: Sensor = SENSOR) -> tuple[Array, Array]:
    """Return values and covariances of all trials, together."""
    rows = len(rates)
    labels = tuple(f"{k}" for k in range(rows))
    observations = Observations(
        labels,
        y,
        np.broadcast_to(SD**2 * np.eye(3), (rows, 3, 3)),
        np.ones(rows),
        np.ones(rows, dtype=np.int64),
        np.arange(rows, dtype=float),
        sensor.channels,
    )
    spins = [Spin(label, rate) for label, rate in zip(labels, rates.tolist(), strict=True)]
    estimate = ml(observations, sensor, BENCH, spins)
    assert estimate.converged.all()
    return estimate.value, estimate.covariance


class Model(NamedTuple):
    """For SciPy, of one trial at some coefficients: the modelled norms and their derivatives."""

    length: Array  # (r,)
    by_reading: Array  # (r, 3)
    by_coefficient: Array  # (r, p)


def model_9(one: Array, x: Array) -> Model:
    """Return the norms by three coefficients of each axis, axis by axis."""
    k0, k1, k2 = x.reshape(3, 3).T
    u = one - k0
    root = np.sqrt((1 + k1) ** 2 + 4 * k2 * u)  # the slope ∂y/∂f, too
    f = 2 * u / (1 + k1 + root)
    length = np.sqrt((f * f).sum(axis=1))
    along = f / (length[:, None] * root)  # ∂‖f̂‖/∂y
    columns = np.empty((*f.shape, 3))
    np.negative(along, out=columns[..., 0])
    np.multiply(columns[..., 0], f, out=columns[..., 1])
    np.multiply(columns[..., 1], f, out=columns[..., 2])
    return Model(length, along, columns.reshape(len(f), 9))


def model_15(one: Array, x: Array) -> Model:
    """Return the norms by four coefficients of each axis, and the tangents of three angles.

    The order is that of `SENSOR_15.coefficients`; an input axis is tilted towards the others.
    """
    k0, k1, k2, k3 = x[_OF_AXES].T
    u = one - k0
    f = u / (1 + k1)
    for _ in range(3):
        f -= (((k3 * f + k2) * f + 1 + k1) * f - u) / ((3 * k3 * f + 2 * k2) * f + 1 + k1)
    slope = (3 * k3 * f + 2 * k2) * f + 1 + k1
    rows = np.eye(3)
    rows[1, 0], rows[2, 0], rows[2, 1] = x[_OF_ANGLES] * _SIGNS
    lengths = np.sqrt((rows * rows).sum(axis=1))
    axes = rows / lengths[:, None]
    back = np.linalg.inv(axes)
    force = f @ back.T
    length = np.sqrt((force * force).sum(axis=1))
    along = (force / length[:, None]) @ back  # ∂‖f̂‖ by what each axis measures
    by_reading = along / slope
    columns = np.empty((len(f), 15))
    power = -by_reading
    for k in range(4):
        columns[:, _OF_AXES[:, k]] = power
        power = power * f
    for angle, sign, (axis, other) in zip(_OF_ANGLES, _SIGNS, _TILTED, strict=True):
        turned = (force[:, other] - axes[axis, other] * f[:, axis]) / lengths[axis]
        columns[:, angle] = -sign * along[:, axis] * turned
    return Model(length, by_reading, columns)


def peer(
    y: Array,
    rates: Array,
    method: Literal["trf", "lm"],
    model: Callable[[Array, Array], Model] = model_9,
    count: int = 9,
) -> tuple[Array, Array]:
    """Return values and covariances of all trials, one after another."""
    norm = np.sqrt((BENCH.radius.value * rates**2) ** 2 + PAPER_G**2)

    def fit(one: Array) -> tuple[Array, Array]:
        last: list[Array] = []  # SciPy asks for the residual and then for the Jacobian, at one x

        def residual(x: Array) -> Array:
            length, by_reading, columns = model(one, x)
            sd = SD * np.sqrt((by_reading * by_reading).sum(axis=1))
            last[:] = [x.copy(), columns / sd[:, None]]
            return (length - norm) / sd

        def derivative(x: Array) -> Array:
            if not np.array_equal(last[0], x):
                residual(x)
            return last[1]

        found = scipy_least_squares(
            residual,
            np.zeros(count),
            derivative,  # pyright: ignore[reportArgumentType]  SciPy has no stubs
            method=method,
            x_scale="jac",
        )
        return found.x, np.linalg.inv(found.jac.T @ found.jac)

    pairs = [fit(one) for one in y]
    return np.array([v for v, _ in pairs]), np.array([c for _, c in pairs])


def compiled(y: Array, rates: Array) -> tuple[Array, Array] | None:
    """Return values and covariances of all trials by C++; None where no compiler is."""
    code = library(Path(__file__).with_name("centrifuge.cpp"))
    if code is None:
        return None
    norm = np.sqrt((BENCH.radius.value * rates**2) ** 2 + PAPER_G**2)
    values, covariances = np.empty((len(y), 9)), np.empty((len(y), 9, 9))
    inputs = (np.ascontiguousarray(y), np.ascontiguousarray(norm))
    places = [pointer(one) for one in (*inputs, values, covariances)]
    sizes = (ctypes.c_long(len(y)), ctypes.c_long(len(norm)), ctypes.c_double(SD))
    assert code.fit_norms(*places[:2], *sizes, *places[2:]) == 0
    return values, covariances


def rows() -> list[Row | Skipped]:
    """Compare the answers, then the times; the peer's time is of fewer trials, scaled up."""
    y, rates = draw(TRIALS, printed_attitudes())
    label, own = f"centrifuge, 9 coefficients, {TRIALS} trials", best(lambda: ours(y, rates))
    compared: list[Row | Skipped] = [
        Row(label, own, other, name, to_reach=75.0)
        for name, other in peer_times(y, rates, SENSOR, model_9)
    ]
    if (exact := compiled(y, rates)) is None:
        compared.append(Skipped(f"{label}, C++", "no compiler"))
    else:
        value, covariance = ours(y, rates)
        assert np.abs((value - exact[0]) / np.sqrt(np.diagonal(covariance, 0, -2, -1))).max() < 1e-4
        limit = best(lambda: compiled(y, rates))
        compared.append(Row(label, own, limit, "C++, scalar", to_reach=1 / 4.5))
    compared.append(Row(f"{label}, after warm-up", own, LIMIT, "limit"))
    y, rates = draw(TRIALS, full_circle())
    label, own = (
        f"centrifuge, 15 coefficients, {TRIALS} trials",
        best(lambda: ours(y, rates, SENSOR_15)),
    )
    return [
        *compared,
        *(
            Row(label, own, other, name, to_reach=60.0)
            for name, other in peer_times(y, rates, SENSOR_15, model_15)
        ),
        Row(label, own, LIMIT_15, "limit"),
    ]


def peer_times(
    y: Array, rates: Array, sensor: Sensor, model: Callable[[Array, Array], Model]
) -> Iterator[tuple[str, float]]:
    """Yield SciPy's methods with the time of each for all trials, once its answers agree."""
    few = y[:PEER_TRIALS]
    value, covariance = (one[:PEER_TRIALS] for one in ours(y, rates, sensor))
    sd = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    scale = sd[:, :, None] * sd[:, None, :]
    methods: tuple[Literal["trf", "lm"], ...] = ("trf", "lm")
    for method in methods:
        work = partial(peer, few, rates, method, model, value.shape[1])
        other, other_covariance = work()
        assert np.abs((value - other) / sd).max() < 1e-4
        assert np.abs((covariance - other_covariance) / scale).max() < 1e-4
        yield f"scipy {method}", best(work, 3) * TRIALS / PEER_TRIALS
