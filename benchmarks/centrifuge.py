"""Many calibrations on a centrifuge: the norms of 60 dwells, nine coefficients a trial.

The design and the sensor are the paper's (see `inercal.methods.centrifuge_norm`), the bench exact:
n = √((ω²R)² + g²) in 20 attitudes at three rates, against ‖f̂‖ with f̂ the root of
y = k0 + (1 + k1) f + k2 f² on each axis. The peer is a loop over SciPy with the analytic Jacobian,
by its default method (trf) and its fastest (lm), at its default tolerances and from the same start;
it takes all rows of a trial at once and the root by its closed formula. Both whiten by the noise
that belongs to the coefficients of the step.

With k3 and non-orthogonality there are 15 coefficients, in attitudes all round; a limit is given.
Of nine coefficients the limit is centrifuge.cpp, where a compiler is.
"""

import ctypes
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

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
from benchmarks._compiled import library
from inercal.benches import Centrifuge
from inercal.methods.centrifuge_norm import ml
from inercal.plan import Spin
from inercal.recording import Observations
from inercal.sensors import Sensor, triad
from inercal.units import Measured

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


def peer(y: Array, rates: Array, method: Literal["trf", "lm"]) -> tuple[Array, Array]:
    """Return values and covariances of all trials, one after another."""
    norm = np.sqrt((BENCH.radius.value * rates**2) ** 2 + PAPER_G**2)

    def fit(one: Array) -> tuple[Array, Array]:
        last: list[Array] = []  # SciPy asks for the residual and then for the Jacobian, at one x

        def residual(x: Array) -> Array:
            k0, k1, k2 = x.reshape(3, 3).T
            u = one - k0
            root = np.sqrt((1 + k1) ** 2 + 4 * k2 * u)  # the slope ∂y/∂f, too
            f = 2 * u / (1 + k1 + root)
            length = np.sqrt((f * f).sum(axis=1))
            along = f / (length[:, None] * root)  # ∂‖f̂‖/∂y
            sd = SD * np.sqrt((along * along).sum(axis=1))
            last[:] = [x.copy(), f, along / sd[:, None]]
            return (length - norm) / sd

        def derivative(x: Array) -> Array:
            if not np.array_equal(last[0], x):
                residual(x)
            _, f, along = last
            columns = np.empty((*f.shape, 3))
            np.negative(along, out=columns[..., 0])
            np.multiply(columns[..., 0], f, out=columns[..., 1])
            np.multiply(columns[..., 1], f, out=columns[..., 2])
            return columns.reshape(len(f), 9)

        found = scipy_least_squares(
            residual,
            np.zeros(9),
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
    places = [one.ctypes.data_as(ctypes.c_void_p) for one in (*inputs, values, covariances)]
    sizes = (ctypes.c_long(len(y)), ctypes.c_long(len(norm)), ctypes.c_double(SD))
    assert code.fit_norms(*places[:2], *sizes, *places[2:]) == 0
    return values, covariances


def rows() -> list[Row | Skipped]:
    """Compare the answers, then the times; the peer's time is of fewer trials, scaled up."""
    y, rates = draw(TRIALS, printed_attitudes())
    few = y[:PEER_TRIALS]
    value, covariance = ours(y, rates)
    sd = np.sqrt(np.diagonal(covariance[:PEER_TRIALS], axis1=-2, axis2=-1))
    methods: dict[str, Callable[[], tuple[Array, Array]]] = {
        "scipy trf": lambda: peer(few, rates, "trf"),
        "scipy lm": lambda: peer(few, rates, "lm"),
    }
    for work in methods.values():
        other, other_covariance = work()
        assert np.abs((value[:PEER_TRIALS] - other) / sd).max() < 1e-4
        scale = sd[:, :, None] * sd[:, None, :]
        assert np.abs((covariance[:PEER_TRIALS] - other_covariance) / scale).max() < 1e-4
    times = {name: best(work, 3) * TRIALS / PEER_TRIALS for name, work in methods.items()}
    label, own = f"centrifuge, 9 coefficients, {TRIALS} trials", best(lambda: ours(y, rates))
    wanted = {"scipy trf": 75.0, "scipy lm": 75.0}
    compared: list[Row | Skipped] = [
        Row(label, own, times[name], name, to_reach=wanted[name]) for name in times
    ]
    if (exact := compiled(y, rates)) is None:
        compared.append(Skipped(f"{label}, C++", "no compiler"))
    else:
        assert np.abs((value - exact[0]) / np.sqrt(np.diagonal(covariance, 0, -2, -1))).max() < 1e-4
        limit = best(lambda: compiled(y, rates))
        compared.append(Row(label, own, limit, "C++, scalar", to_reach=1 / 4.5))
    y, rates = draw(TRIALS, full_circle())
    more = best(lambda: ours(y, rates, SENSOR_15))
    return [
        *compared,
        Row(f"{label}, after warm-up", own, LIMIT, "limit"),
        Row(f"centrifuge, 15 coefficients, {TRIALS} trials", more, LIMIT_15, "limit"),
    ]
