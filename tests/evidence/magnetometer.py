"""Calibrations of magnetometers in the earth's field: NEES, coverage of U, and what is detected.

Each device has soft iron, rotation and offset of its own, and attitudes drawn at random, by a
generator that knows nothing of inercal (`tests.magnetometer.generator`). Means of its readings are
calibrated by the methods themselves (`tests.magnetometer.calibrations`). One row is for samples of
continuous motion (`tests.magnetometer.motion`).

`python -m tests.evidence.magnetometer` works out all of it and writes docs/evidence/
magnetometer.json and the page beside it; `--only` works out some rows again, and `--devices` with
another number of devices for each seed prints the page only.
"""

import json
from collections.abc import Sequence
from textwrap import wrap
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
from tests.evidence.stored_counts import FOLDER
from tests.evidence.stored_runs import store_runs
from tests.magnetometer import generator as sim
from tests.magnetometer import motion as moving
from tests.magnetometer.calibrations import EARTH, TILT, Calibrated, calibrated
from tests.magnetometer.motion_calibrations import MotionCalibrated, calibrated_motion

from inercal.estimation.scores import SCORE_TEST_SHARE, SIGNIFICANCE_LEVEL

DATA, PAGE = FOLDER / "magnetometer.json", FOLDER / "magnetometer.md"
SEEDS, DEVICES, BATCH = (1, 2, 3), 200, 10
BAND = 3.29  # standard deviations: 99.9 %, two-sided
NEES, COVERED, EXPECTED = (0.95, 1.05), (0.94, 0.97), 0.9545
LEVEL = SCORE_TEST_SHARE * SIGNIFICANCE_LEVEL
RESTS, STEP = 24, 1e-7  # size of the disturbance whose η is worked out, T
INHOMOGENEITY = 0.01
DELAYS = (-0.02, 0.03)  # of a magnetometer in motion, s
JUDGED = ("", "step")  # disturbances whose verdicts are counted


class Row(NamedTuple):
    """A row of the page: its words, options of the calibration and what disturbs the field.

    `eta` is the size of the disturbance: η² is the χ² that exact readings would have.
    """

    words: str
    options: dict[str, Any] = {}  # noqa: RUF012 (a default that nobody changes)
    disturbed: str = ""
    eta: float = 0.0
    share: float = 1.0


ROWS = {
    "rests": Row("`multi_position`, strength stated"),
    "free": Row("`multi_position`, strength unknown", {"strength": False}),
    "dip": Row("`multi_position`, strength and dip stated", {"dip": True}),
    "gyros": Row("`multi_position` with gyros, strength stated", {"gyros": True}),
    "six": Row("`six_position`, two azimuths per face", {"method": "six_position"}),
    "motion": Row("`field_and_rates`, strength stated", {"method": "field_and_rates"}),
    "uneven": Row("field differs by 1 % between rests", {}, "random", share=0.25),
    "step": Row("step of the field", {}, "step", 6.0, 0.25),
    "large step": Row("step of the field", {}, "step", 12.0, 0.25),
    "offset": Row("drift of the offset", {}, "offset", 6.0, 0.15),
    "strength": Row("drift of the strength", {}, "strength", 6.0, 0.15),
    "rest": Row("another field at one rest", {}, "rest", 6.0, 0.15),
}


class Device(NamedTuple):
    """What is counted of a device."""

    nees: float
    inside: float  # share of the coefficients whose error is at most U
    consistent: bool  # the verdict, which is not worked out for some rows
    found: bool  # a test of the true kind rejects
    named: bool  # and so does the test of the true time or rest, as the smallest p-value
    inhomogeneity: float


def batch(task: tuple[str, int, int]) -> list[Device]:
    """Return the counts of a batch of devices."""
    row, seed, k = task
    rng = np.random.default_rng([seed, k, crc32(row.encode())])
    return [_device(rng, ROWS[row]) for _ in range(BATCH)]


def tasks(row: str, devices: int) -> list[tuple[str, int, int]]:
    """Return the batches of a row, with this number of devices for each seed."""
    batches = max(1, round(ROWS[row].share * devices / BATCH))
    return [(row, seed, k) for seed in SEEDS for k in range(batches)]


def _device(rng: np.random.Generator, row: Row) -> Device:
    own = sim.device(rng)
    if row.options.get("method") == "field_and_rates":
        delay = rng.uniform(*DELAYS)
        return _counts(
            calibrated_motion(rng, moving.motion(rng, own, delay=delay, earth=EARTH)), row
        )
    six = row.options.get("method") == "six_position"
    attitude = sim.six_faces(rng, 2, TILT) if six else sim.scattered(rng, RESTS)
    stem, change = _disturbance(rng, own, row.disturbed)
    if row.eta:
        exact = calibrated(rng, attitude, own, noise=0.0, **change, **row.options)
        eta = np.sqrt(_group(exact).chi2)
        change = {key: row.eta / eta * value for key, value in change.items()}
    one = calibrated(rng, attitude, own, **change, **row.options)
    return _counts(one, row, stem)


def _counts(one: Calibrated | MotionCalibrated, row: Row, stem: str = "") -> Device:
    error, covariance = one.errors()
    sd = np.sqrt(np.diagonal(covariance))
    z = error / sd
    found = named = False
    if row.eta:
        tests = one.estimate.score_tests
        p = {score.name: tests.adjusted(score) for score in tests.scores}
        kind = stem.partition(" at ")[0] + (" at " if " at " in stem else "")
        found = min(value for name, value in p.items() if name.startswith(kind)) < LEVEL
        named = found and min(p, key=p.__getitem__) == stem
    return Device(
        float(z @ np.linalg.solve(covariance / np.outer(sd, sd), z)) / len(z),
        float(np.mean(np.abs(z) <= 2)),
        row.disturbed in JUDGED and one.judged.grade == "consistent",
        found,
        named,
        _group(one).spread.excess / float(one.estimate.value[one.estimate.names.index("strength")]),
    )


def _group(one: Calibrated | MotionCalibrated) -> Any:
    return next(group for group in one.estimate.groups if group.name == "magnetic field")


def _disturbance(
    rng: np.random.Generator, own: sim.Device, kind: str
) -> tuple[str, dict[str, np.ndarray]]:
    """Return the name of the test that should reject, and a small disturbance of the rests."""
    way = rng.standard_normal(3)
    way *= STEP / np.linalg.norm(way)
    part = (np.arange(RESTS) / (RESTS - 1) - 0.5)[:, None]
    first, single = int(rng.integers(2, RESTS - 1)), int(rng.integers(RESTS))
    order = np.arange(RESTS)[:, None]
    if kind == "step":
        return f"step of the field at rest {first + 1}", {"disturbance": (order >= first) * way}
    if kind == "offset":
        return "drift of the offset", {"drift": part * way}
    if kind == "strength":
        return "drift of the strength", {"disturbance": STEP / own.strength * part * own.field}
    if kind == "rest":
        return f"field at rest {single + 1}", {"disturbance": (order == single) * way}
    if kind == "random":
        size = INHOMOGENEITY * own.strength
        return "", {"disturbance": size * rng.standard_normal((RESTS, 3))}
    return "", {}


def counted(devices: Sequence[Device], row: Row) -> dict[str, Any]:
    """Return means over devices, and the bands in which chance leaves them."""
    n = len(devices)
    whole = {name: np.array([getattr(one, name) for one in devices]) for name in Device._fields}
    result: dict[str, Any] = {"devices": n}
    if row.disturbed in JUDGED:
        result["consistent"] = int(whole["consistent"].sum())
    if row.eta:
        return result | {name: int(whole[name].sum()) for name in ("found", "named")}
    for name, one, middle in (
        ("nees", whole["nees"], 1.0),
        ("covered", whole["inside"], EXPECTED),
    ):
        width = BAND * float(one.std(ddof=1)) / n**0.5
        result[name] = round(float(one.mean()), 4)
        result[f"{name}_band"] = [round(middle - width, 4), round(middle + width, 4)]
    if row.disturbed:
        tau = 100 * whole["inhomogeneity"]
        result["tau_percent"] = round(float(tau.mean()), 4)
        result["tau_range"] = np.round(np.percentile(tau, [10, 90]), 3).tolist()
    return result


def within(one: dict[str, Any]) -> bool:
    """Return whether NEES and coverage are as required, or in the band of chance if it is wider."""
    return all(
        min(low, one[f"{name}_band"][0]) <= one[name] <= max(high, one[f"{name}_band"][1])
        for name, (low, high) in (("nees", NEES), ("covered", COVERED))
    )


def work_out(devices: int, pool: Any, only: Sequence[str]) -> dict[str, Any]:
    """Return all counts; rows that are not chosen stay as stored."""
    stored = json.loads(DATA.read_text(encoding="utf-8"))["rows"] if len(only) < len(ROWS) else {}
    rows: dict[str, Any] = {}
    for name, row in ROWS.items():
        if name not in only:
            rows[name] = stored[name]
            continue
        parts = pool.map(batch, tasks(name, devices), chunksize=1)
        rows[name] = counted([one for part in parts for one in part], row)
        print(name, rows[name], flush=True)
    return {"seeds": list(SEEDS), "rows": rows}


def page(found: dict[str, Any]) -> str:
    """Return the page of the stored counts."""
    rows = found["rows"]
    lines = [
        "# Magnetometers in the earth's field: consistency, coverage of U, and what is detected",
        "",
        *wrap(_DEVICES, 96),
        "",
        *wrap(_COLUMNS, 96),
        "",
        "| calibration | devices | NEES | band | covered | band | false alarms |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, row in ROWS.items():
        if not row.disturbed:
            lines.append(f"| {row.words} | {_consistency(rows[name])} | {_alarms(rows[name])} |")
    lines += ["", *wrap(_uneven(rows["uneven"]), 96), "", *wrap(_SIZES, 96), ""]
    lines += ["| disturbance | η | devices | detected | named | verdict *consistent* |"]
    lines += ["|---|---|---|---|---|---|"]
    for name, row in ROWS.items():
        if row.eta:
            one = rows[name]
            cells = [f"{100 * one[key] / one['devices']:.1f} %" for key in ("found", "named")]
            cells = [row.words, f"{row.eta:.0f}", str(one["devices"]), *cells]
            lines.append(f"| {' | '.join(cells)} | {one.get('consistent', '–')} |")
    return "\n".join(lines) + "\n"


_DEVICES = (
    "Written by `python -m tests.evidence.magnetometer`; do not edit. The devices were simulated "
    "by a generator that is independent of inercal. Each axis has a soft-iron error of 5 %, a "
    "rotation of 3° and an offset of 20 µT. The mean of a rest has a noise of 0.1 µT and "
    "0.005 m/s². The field is 50 µT with a dip of 65°. With "
    f"`multi_position` there are {RESTS} rests in random attitudes, with `six_position` 12 rests "
    "at two azimuths per face, tilted by 0.5°. The accelerometers, and the gyros if there are "
    "any, are unknown too. The standard uncertainty of a stated strength is 0.3 µT and that of a "
    "stated dip 0.5°, and the stated values were drawn accordingly. If no strength is stated, the "
    "coefficients are relative to their mean scale. With `field_and_rates` the unit turns for "
    f"{moving.SECONDS:.0f} s at about 1 rad/s about all axes, and its gyros have unknown biases, "
    f"a noise of 0.3 °/√h and {moving.RATE_HZ:.0f} samples/s. A value of the magnetometer has a "
    f"noise of 0.5 µT and is repeated {moving.EVERY} times. Its delay is between −20 and 30 ms; "
    "the delay and the biases of the gyros are counted with the coefficients."
)
_COLUMNS = (
    "NEES is the mean of (error)ᵀ covariance⁻¹ (error) over the number of coefficients and the "
    "dip; 1 is expected. The column covered states how many of them differ from the true value by "
    "at most U (k = 2); 95.45 % are expected. If χ² exceeds its 95 % bound, which happens by "
    "chance in 5 % of devices, the covariance includes an inhomogeneity of the field. Each band "
    "is the range in which chance leaves the number before it with a probability of 99.9 %. A "
    "false alarm is a verdict other than *consistent*; 1 % is expected for all tests together."
)
_SIZES = (
    "The size of a disturbance is η, and η² is the χ² that exact readings would have. A "
    "disturbance of η = 6 is missed with a probability of 5 %. It is detected if a test of its "
    "kind rejects. It is named if the test with the smallest p-value also has the true time or "
    "rest; neighbouring times often cannot be distinguished, and then the verdict says so."
)


def _uneven(one: dict[str, Any]) -> str:
    low, high = one["tau_range"]
    return (
        "If each component of the field differs by 1 % (1 σ) from rest to rest, an inhomogeneity "
        f"of {one['tau_percent']:.2f} % is found on average, and of {low:.2f} to {high:.2f} % in "
        f"80 % of {one['devices']} devices. U includes it: NEES is {one['nees']:.3f}, and "
        f"{100 * one['covered']:.1f} % are covered."
    )


def _consistency(one: dict[str, Any]) -> str:
    cells = [
        f"{one[name]:.3f} | " + " to ".join(f"{end:.3f}" for end in one[f"{name}_band"])
        for name in ("nees", "covered")
    ]
    return f"{one['devices']} | {' | '.join(cells)}"


def _alarms(one: dict[str, Any]) -> str:
    alarms = one["devices"] - one["consistent"]
    return f"{alarms} ({100 * alarms / one['devices']:.1f} %)"


if __name__ == "__main__":
    store_runs(__doc__, work_out, page, (DATA, PAGE), DEVICES, "--devices", tuple(ROWS))
