"""Many sensors of one type from their means, in one call, against a loop over `calibrate`.

Six positions of a triad (12 coefficients, 13 nuisances) and Ferraris' nine sections of an IMU (33
coefficients, 44 nuisances). SciPy's fastest method (lm) solves the problem of the six positions of
`benchmarks.fits` at its default tolerances; the tilts are so small here that the second order,
which inercal corrects for, does not show. Memory is that beyond table and result.
"""

import time
import tracemalloc
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

import inercal
from benchmarks import Duration, Row, best, fits
from inercal.physics.plan import Turn, ferraris_plan
from inercal.pipeline.batch import BatchCalibration

Array = NDArray[np.float64]
SIZES = (100, 1_000, 10_000, 100_000)
IMUS, CALLS, PEER_FITS = 2_000, 5, 200
TO_REACH = 50.0
MEMORY = 150.0  # MB
GROWTH = 1.2  # of the time of ten times as many sensors over ten times the time
G, SD = 9.80665, 1e-4  # m/s²; of a mean, g
LABELS = ["x_p", "y_p", "z_p", "x_a", "y_a", "z_a"]  # as of `fits.UP`
SIX: dict[str, Any] = {
    "method": "six_position",
    "sensor": {"accelerometer": {"unit": "g"}},
    "bench": {"gravity": f"{G} m/s² ± 0.1 mm/s²", "tilt": "1 ″"},
    "label": "position",
    "sd": {"accelerometer": "100 µg"},
}
FERRARIS: dict[str, Any] = {
    "method": "ferraris",
    "sensor": {"accelerometer": {"unit": "g"}, "gyro": {"unit": "rad/s"}},
    "bench": {"gravity": f"{G} m/s² ± 0.1 mm/s²", "latitude": "48 °", "tilt": "0.05 °"},
    "label": "section",
    "seconds": "seconds",
    "sd": {"accelerometer": "100 µg", "gyro": "20 °/h"},
}


def six_means(count: int) -> dict[str, Any]:
    """Return tables of sensors with errors of 1 %."""
    rng = np.random.default_rng(0)
    matrix = np.eye(3) + 0.01 * rng.standard_normal((count, 3, 3))
    y = fits.UP @ np.swapaxes(matrix, -1, -2) + 0.01 * rng.standard_normal((count, 1, 3))
    y += SD * rng.standard_normal(y.shape)
    return {"position": LABELS, **_columns("acc", y)}


def imu_means(count: int) -> dict[str, Any]:
    """Return tables of IMUs with errors of 1 % in Ferraris' nine sections."""
    rng, steps = np.random.default_rng(1), ferraris_plan()
    up = np.array([step.axis if isinstance(step, Turn) else step.up for step in steps])
    rates = np.array([step.angle / step.seconds if isinstance(step, Turn) else 0 for step in steps])
    table: dict[str, Any] = {
        "section": [step.label for step in steps],
        "seconds": np.array([step.seconds for step in steps]),
    }
    for name, motion, sd in (("acc", up, SD), ("gyr", rates[:, None] * up, 1e-4)):
        matrix = np.eye(3) + 0.01 * rng.standard_normal((count, 3, 3))
        y = motion @ np.swapaxes(matrix, -1, -2) + 0.001 * rng.standard_normal((count, 1, 3))
        table |= _columns(name, y + sd * rng.standard_normal(y.shape))
    return table


def _columns(name: str, y: Array) -> dict[str, Array]:
    return {f"{name}_{a}": np.ascontiguousarray(y[..., k]) for k, a in enumerate("xyz")}


def one_of(table: dict[str, Any], k: int) -> dict[str, Any]:
    """Return the table of one sensor."""
    return {name: one if np.ndim(one) == 1 else one[k] for name, one in table.items()}


def loop(table: dict[str, Any], keys: dict[str, Any], found: BatchCalibration) -> float:
    """Return the processor time of a call of `calibrate`, s, which must agree with the batch."""

    def work() -> list[tuple[Array, Array]]:
        outcomes = (inercal.calibrate(one_of(table, k), kind="means", **keys) for k in range(CALLS))
        return [(one.calibration.values, one.calibration.covariance) for one in outcomes]

    for k, (values, covariance) in enumerate(work()):
        sd = np.sqrt(np.diag(covariance))
        assert np.abs((found.values[k] - values) / sd).max() < 1e-5
        scaled = (found.covariance[k] - covariance) / np.outer(sd, sd)
        assert np.abs(scaled).max() < 1e-5
    return best(work, 2) / CALLS


def scipy_lm(table: dict[str, Any], found: BatchCalibration) -> float:
    """Return the processor time of a fit by SciPy, s, which must agree with the batch."""
    y = G * np.stack([table[f"acc_{a}"][:PEER_FITS] for a in "xyz"], axis=-1)
    names = [f"{a}.{c}" for c in ("k0", "k1") for a in ("ax", "ay", "az")]
    own = found.values[:PEER_FITS, [found.names.index(name) for name in names]]
    peer, covariance = fits.peer(y.reshape(PEER_FITS, 18), "lm", SD * G, np.append(*_TILTS))
    at = [0, 1, 2, 3, 7, 11]  # biases, and the diagonal of the matrix
    assert np.abs((own - peer[:, at]) / np.sqrt(covariance[:, at, at])).max() < 1e-3
    begin = time.process_time()
    fits.peer(y.reshape(PEER_FITS, 18), "lm", SD * G, np.append(*_TILTS))
    return (time.process_time() - begin) / PEER_FITS


_TILTS = np.full(12, np.pi / 648_000), 1e-4  # rad and m/s², as of `SIX`


def measured(table: dict[str, Any], keys: dict[str, Any]) -> tuple[Duration, BatchCalibration]:
    """Return the time of a call whose kernels are loaded, and its result."""
    begin, used = time.perf_counter(), time.process_time()
    found = inercal.calibrate_batch(table, **keys)
    wall, processor = time.perf_counter() - begin, time.process_time() - used
    assert found.converged.all()
    return Duration(processor, wall, processor), found


def rows() -> Iterator[Row]:
    """Yield batch against loop, memory, and how time grows with the number of sensors."""
    table = six_means(SIZES[-1])
    inercal.calibrate_batch(six_means(50), **SIX)
    took: list[Duration] = []
    for size in SIZES[:-1]:
        some = {n: one if np.ndim(one) == 1 else one[:size] for n, one in table.items()}
        took.append(min(measured(some, SIX)[0] for _ in range(3)))
    last, found = measured(table, SIX)
    took.append(last)
    name = f"six positions, {SIZES[-1]} sensors as means"
    each = loop(table, SIX, found)
    yield Row(name, last, each * SIZES[-1], "loop over calibrate", to_reach=TO_REACH)
    yield Row(name, last, scipy_lm(table, found) * SIZES[-1], "scipy lm")
    grown = max(b / a / 10 for a, b in pairwise(took))
    per_sensor = ", ".join(f"{t / n * 1e6:.0f}" for t, n in zip(took, SIZES, strict=True))
    yield Row(f"growth, 100 to 100000 sensors ({per_sensor} µs each)", grown, GROWTH, "limit", "")
    yield Row(f"{name}, memory", memory(table, found), MEMORY, "limit", "MB")
    imus = imu_means(IMUS)
    inercal.calibrate_batch({n: one[:50] for n, one in imus.items()}, **FERRARIS)
    took_imus, found = measured(imus, FERRARIS)
    each = loop(imus, FERRARIS, found)
    name = f"six positions and three turns, {IMUS} IMUs as means"
    yield Row(name, took_imus, each * IMUS, "loop over calibrate")


def memory(table: dict[str, Any], found: BatchCalibration) -> float:
    """Return the memory that a call needs beyond its table and its result, MB."""
    result = sum(
        one.nbytes for one in (found.values, found.covariance, found.chi2, found.converged)
    )
    tracemalloc.start()
    try:
        inercal.calibrate_batch(table, **SIX)
        return (tracemalloc.get_traced_memory()[1] - result) / 1e6
    finally:
        tracemalloc.stop()
