"""Coverage of the uncertainty that `predict` states for corrected values, over many devices.

Each device is made by a generator that knows nothing of inercal, and calibrated. At points inside
the validity, half of them with one axis at its edge, the same generator gives the reading without
noise. The calibration corrects it, and the result is compared with the true motion and with U.

`python -m tests.evidence.prediction` works out all methods and writes docs/evidence/prediction.json
and the page beside it, or with `--only` some of them; `--devices` with another number of devices
for each seed prints it only.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from warnings import catch_warnings, simplefilter
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from tests.accuracy import ramps, soaks
from tests.evidence import sensor_models, temperature_ramps, temperature_soaks
from tests.evidence.stored_counts import FOLDER
from tests.evidence.stored_runs import store_runs
from tests.evidence.violation_cells import BASE, Cell, device_files
from tests.magnetometer import generator, motion
from tests.magnetometer.motion_calibrations import calibrated_motion
from tests.methods import systematic_cases, systematic_table

from inercal.basics.errors import InercalError
from inercal.calibration import Calibration, Validity
from inercal.pipeline import calibrate

Array = NDArray[np.float64]
DATA, PAGE = FOLDER / "prediction.json", FOLDER / "prediction.md"
G0, EARTH = 9.80665, 7.292115e-5  # m/s² exact; rad/s, WGS 84
SEEDS, DEVICES = (1, 2, 3), 200
BATCH = 20  # triads in soaks that are estimated together
POINTS = 8  # of each device; half of them have one axis at the edge of the validity
METHODS = (
    "six_position", "ferraris", "multi_position", "multi_position, recorded", "centrifuge_norm",
    "dual_orthogonal", "tumble", "rates_and_poses", "ship_planar", "ship_multi_angle",
    "turntable_discrete", "six_position, soaks", "temperature_ramp", "turntable_kalman",
    "turntable_trajectory", "systematic", "field_and_rates",
)  # fmt: skip
SLOW = METHODS[-4:]  # up to a second for each device
LOWER, UPPER = 0.93, 0.97
BAND = 3.29  # standard deviations: 99.9 %, two-sided
Sense = Callable[[Array, Array, Array, Array], Array]


class Device(NamedTuple):
    """A calibration, and the true device's readings for f, ω (n, 3), T (n,) and m (n, 3)."""

    calibration: Calibration
    sense: Sense


class Covered(NamedTuple):
    """Shares of the errors of a device within U, inside the validity and at its edge."""

    inside: float
    edge: float


def device(method: str, seed: int, k: int) -> Device | None:
    """Return a device, or None if its data are refused."""
    rng = np.random.default_rng([seed, k, crc32(method.encode())])
    if method == "six_position, soaks":
        return _soaked(seed, k)
    if method == "temperature_ramp":
        return _ramped(rng)
    if method == "systematic":
        return _systematic(rng)
    if method == "field_and_rates":
        return _in_motion(rng)
    files, truth = device_files(Cell(method, "", BASE, 0.0, 0.0, 90.0, seed, 1), k)
    with TemporaryDirectory() as folder, catch_warnings():
        simplefilter("ignore")
        for name, content in files.items():
            raw = content.encode() if isinstance(content, str) else content
            (Path(folder) / name).write_bytes(raw)
        try:
            found = calibrate(Path(folder) / "run.toml").calibration
        except InercalError:
            return None
    if method in ("tumble", "dual_orthogonal"):
        return Device(found, lambda f, w, t, m: _on_head(truth, f))
    kinds = {axis.measures for axis in found.sensor.axes}

    def sense(f: Array, w: Array, t: Array, m: Array) -> Array:
        parts = [sensor_models.accelerometers(truth, f)] if "f" in kinds else []
        parts += [sensor_models.gyros(truth, w, f)] if "w" in kinds else []
        return np.concatenate(parts, axis=1)

    return Device(found, sense)


def _on_head(truth: Mapping[str, float], f: Array) -> Array:
    """Return readings of accelerometers in the plane of rotation, as `cases.dividing_head`."""
    y = np.empty((len(f), len({name[0] for name in truth})))
    for k in range(y.shape[1]):
        c = {name[2:]: value for name, value in truth.items() if name[0] == "ab"[k]}
        turn = np.arctan2(f[:, 0], f[:, 1]) + k * np.pi / 2 + c["delta_o"]
        a, p = np.hypot(f[:, 0], f[:, 1]) * (np.sin(turn), np.cos(turn))
        y[:, k] = c["k0"] + (1 + c["k1"]) * a + c["k2"] * a**2 + c["k3"] * a**3 + c["kip"] * a * p
    return y


@lru_cache(maxsize=4)
def _soaked_batch(seed: int, batch: int) -> temperature_soaks.Fits:
    return temperature_soaks.fits(1000 * seed + batch, BATCH)


def _soaked(seed: int, k: int) -> Device:
    """Return a triad from six positions at seven temperatures."""
    made, sensor, estimate = _soaked_batch(seed, k // BATCH)
    p, own = len(sensor.coefficients), k % BATCH
    validity = Validity(
        force=(float(made.mean[own].min()), float(made.mean[own].max())),
        temperature=(float(made.temperature.min()), float(made.temperature.max())),
    )
    found = Calibration(
        sensor, estimate.value[own, :p], estimate.covariance[own, :p, :p], validity=validity
    )

    def sense(f: Array, w: Array, t: Array, m: Array) -> Array:
        powers = [(t - soaks.REFERENCE)[:, None] ** j for j in range(4)]
        y = f + sum(powers[j] * made.bias[j, own] for j in range(4))
        return y + sum(powers[j] * (f @ made.matrix[j, own].T) for j in range(3))

    return Device(found, sense)


def _ramped(rng: np.random.Generator) -> Device:
    """Return a gyro at rest along a ramp; it senses a part of the earth's rate."""
    element = ramps.PROFILES["up and down, 2 × 30 min"]()
    made = ramps.record(rng, element)
    made = replace(made, reading=made.reading + EARTH / np.sqrt(3) * rng.standard_normal())
    sensor, bench = temperature_ramps.gyro(), temperature_ramps.Hand(
        temperature_ramps.Measured(9.81, 1e-4)
    )  # fmt: skip
    seen = temperature_ramps.observed(made)
    estimate = temperature_ramps.ramp(seen, sensor, bench, temperature_ramps.rest())
    p = len(sensor.coefficients)
    validity = Validity(
        rate=(float(made.reading.min()), float(made.reading.max())),
        temperature=(float(made.recorded.min()), float(made.recorded.max())),
    )
    found = Calibration(
        sensor, estimate.value[:p], estimate.stated_covariance[:p, :p], validity=validity
    )

    def sense(f: Array, w: Array, t: Array, m: Array) -> Array:
        return (w[:, 0] + ramps.BIAS[0] + ramps.change(t))[:, None]

    return Device(found, sense)


def _systematic(rng: np.random.Generator) -> Device:
    """Return an IMU of tactical grade from turns between rests."""
    grade, table = systematic_table.GRADES["T"], systematic_table.Table()
    truth, lag = systematic_table.draw_truth(grade, rng)
    made = systematic_table.record(truth, lag, table, rng, grade=grade, drift="flicker")
    sensor = systematic_cases.sensor_of(grade, "flicker")
    estimate = systematic_cases.solved(made, sensor, systematic_cases.table_of(table))
    p = len(sensor.coefficients)
    low, high = made.reading.min(axis=0), made.reading.max(axis=0)
    validity = Validity((low[3:].min(), high[3:].max()), (low[:3].min(), high[:3].max()))
    found = Calibration(sensor, estimate.value[:p], estimate.covariance[:p, :p], validity=validity)
    true = {name: value + made.drift_means.get(name, 0.0) for name, value in truth.items()}

    def sense(f: Array, w: Array, t: Array, m: Array) -> Array:
        still = np.zeros_like(w)
        parts = [systematic_table.sense(true, w, still, f, force=force) for force in (True, False)]
        return np.concatenate(parts, axis=1)

    return Device(found, sense)


def _in_motion(rng: np.random.Generator) -> Device:
    """Return gyros and magnetometers that were turned about all axes."""
    made = motion.motion(rng, generator.device(rng), delay=rng.uniform(-0.02, 0.03))
    one = calibrated_motion(rng, made)
    p = len(one.sensor.coefficients)
    validity = Validity(
        rate=(float(made.rate.min()), float(made.rate.max())),
        field=(float(made.field.min()), float(made.field.max())),
    )
    found = Calibration(
        one.sensor, one.estimate.value[:p], one.estimate.covariance[:p, :p], validity=validity
    )

    def sense(f: Array, w: Array, t: Array, m: Array) -> Array:
        return np.concatenate([w + made.bias, m @ made.device.d.T + made.device.o], axis=1)

    return Device(found, sense)


def points(
    calibration: Calibration, rng: np.random.Generator, *, edge: bool
) -> tuple[Array, Array, Array, Array]:
    """Return f, ω (n, 3), T (n,) and m (n, 3), with readings inside the validity or at its edge."""
    sensor, validity, n = calibration.sensor, calibration.validity, POINTS // 2
    assert validity is not None
    ranges = {"f": validity.force, "w": validity.rate, "m": validity.field}
    limits = np.array([ranges[axis.measures] for axis in sensor.axes])
    reading = rng.uniform(limits[:, 0], limits[:, 1], (n, len(limits)))
    kelvin = np.full(n, sensor.reference_temperature)
    if validity.temperature is not None:
        kelvin = rng.uniform(*validity.temperature, n)
    if edge:
        which, end = rng.integers(len(limits), size=n), rng.integers(2, size=n)
        reading[np.arange(n), which] = limits[which, end]
        if validity.temperature is not None:
            kelvin = np.array(validity.temperature)[end]
    forces = any(axis.measures == "f" for axis in sensor.axes)
    across = forces * rng.uniform(-G0, G0, (n, 3))
    found = calibration.correct(
        sensor.to_output(reading), f=across, w=np.zeros((n, 3)), dw=np.zeros((n, 3)),
        dT=kelvin - sensor.reference_temperature,
    )  # fmt: skip
    return found.f, found.w, kelvin, found.m


def covered(method: str, seed: int, k: int) -> Covered | None:
    """Return the shares of the errors of a device that are within U."""
    found = device(method, seed, k)
    if found is None:
        return None
    calibration, rng = found.calibration, np.random.default_rng([seed, k])
    sensor, shares = calibration.sensor, list[float]()
    for edge in (False, True):
        f, w, kelvin, m = points(calibration, rng, edge=edge)
        stated = calibration.predict(f, w, kelvin, m if sensor.rank("m") else None)
        corrected = calibration.correct(
            sensor.to_output(found.sense(f, w, kelvin, m)), f=f, w=w, dw=np.zeros_like(w),
            dT=kelvin - sensor.reference_temperature,
        )  # fmt: skip
        pairs = (corrected.f, f), (corrected.w, w), (corrected.m, m)
        along = np.concatenate([one - true + np.zeros_like(w) for one, true in pairs], axis=1)
        error = along @ _directions(calibration).T
        shares.append(float((np.abs(error) <= stated.expanded).mean()))
    return Covered(*shares)


def _directions(calibration: Calibration) -> Array:
    """Return the components that a sensor measures, or its input axes, as rows (q, 9)."""
    rows: list[Array] = []
    for block, kind in enumerate("fwm"):
        own = np.array([axis.i for axis in calibration.sensor.axes if axis.measures == kind])
        if own.size:
            padded = np.zeros((len(own), 9))
            padded[:, 3 * block : 3 * block + 3] = own
            rows.append(padded)
    return np.concatenate(rows)


def _task(task: tuple[str, int, int]) -> Covered | None:
    return covered(*task)


def counted(found: list[Covered | None]) -> dict[str, Any]:
    """Return coverages over devices, and the band in which chance leaves that of all points."""
    used = np.array([one for one in found if one is not None])
    both = used.mean(axis=1)
    width = BAND * float(both.std(ddof=1)) / len(both) ** 0.5
    inside, edge = used.mean(axis=0).tolist()
    return {
        "devices": len(used),
        "refused": len(found) - len(used),
        "covered": round(float(both.mean()), 4),
        "inside": round(inside, 4),
        "edge": round(edge, 4),
        "band": [round(0.9545 - width, 4), round(0.9545 + width, 4)],
    }


def within(one: Mapping[str, Any]) -> bool:
    """Return whether a coverage is within 93 to 97 %, or in the band of chance if it is wider."""
    low, high = one["band"]
    return min(LOWER, low) <= one["covered"] <= max(UPPER, high)


def work_out(devices: int, pool: Any, only: Sequence[str] = METHODS) -> dict[str, Any]:
    """Return the stored counts, with those of the methods `only` worked out anew."""
    found: dict[str, Any] = json.loads(DATA.read_text(encoding="utf-8"))
    for method in only:
        tasks = [(method, seed, k) for seed in SEEDS for k in range(devices)]
        found["methods"][method] = counted(pool.map(_task, tasks, chunksize=20))
        print(method, found["methods"][method], flush=True)
    return found


def page(found: dict[str, Any]) -> str:
    """Return the page of the stored counts."""
    lines = [
        "# Predictions: coverage of U, counted",
        "",
        "Written by `python -m tests.evidence.prediction`; do not edit. Each device was",
        "simulated by a generator that is independent of inercal, and then calibrated. At four",
        "points inside the validity and four points with one axis at its edge, the reading of",
        "the true device (without noise) was corrected. The table states how many corrected",
        "values differ from the true motion by at most the U that `inercal predict` states.",
        "About 95 % are expected. With a probability of 99.9 %, the coverage of all points lies",
        "within the band.",
        "",
        "| method | devices | covered | inside | at the edge | band |",
        "|---|---|---|---|---|---|",
    ]
    for name, one in found["methods"].items():
        low, high = one["band"]
        lines.append(
            f"| {name} | {one['devices']} | {one['covered']:.3f} | {one['inside']:.3f} | "
            f"{one['edge']:.3f} | {low:.3f} to {high:.3f} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    store_runs(__doc__, work_out, page, (DATA, PAGE), DEVICES, "--devices", METHODS)
