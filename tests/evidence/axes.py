"""Calibrations of one to six axes in any directions: NEES and coverage of U, over many devices.

Each batch of devices has directions of its own, drawn at random, and is made by generators that
know nothing of inercal (`tests.methods.axis_devices`). On a dividing head the directions lie in the
plane of rotation; `dual_orthogonal` takes two at right angles.

`python -m tests.evidence.axes` works out all of it and writes docs/evidence/axes.json and the page
beside it; `--devices` with another number of devices for each seed prints it only.
"""

from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
from tests.evidence.stored_counts import FOLDER
from tests.evidence.stored_runs import store_runs
from tests.methods.axis_calibrations import CALIBRATED, Found, joined

DATA, PAGE = FOLDER / "axes.json", FOLDER / "axes.md"
SEEDS, DEVICES = (1, 2, 3), 1000
BAND = 3.29  # standard deviations: 99.9 %, two-sided
NEES, COVERED, EXPECTED = (0.95, 1.05), (0.94, 0.97), 0.9545


class Row(NamedTuple):
    """What is counted of a method: numbers of axes, devices of a batch, and the share of devices.

    Fewer devices are counted where one takes long.
    """

    axes: tuple[int, ...] = (1, 2, 3, 4, 6)
    batch: int = 200
    share: float = 1.0


ROWS = {
    "six_position": Row(),
    "rates_and_poses": Row(),
    "ferraris": Row(),
    "temperature_ramp": Row(batch=1, share=0.2),
    "noise": Row(batch=1, share=0.07),
    "tumble": Row(),
    "dual_orthogonal": Row((2,)),
}


def batch(task: tuple[str, int, int, int]) -> Found:
    """Return NEES and the share within U of each device of a batch."""
    method, axes, seed, k = task
    rng = np.random.default_rng([seed, k, axes, crc32(method.encode())])
    vectors = rng.standard_normal((axes, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    directions = [(float(x), float(y), float(z)) for x, y, z in vectors]
    return CALIBRATED[method](directions, ROWS[method].batch, int(rng.integers(2**31)))


def tasks(method: str, axes: int, devices: int) -> list[tuple[str, int, int, int]]:
    """Return the batches of a line, with this number of devices for each seed where all count."""
    row = ROWS[method]
    batches = max(1, round(row.share * devices / row.batch))
    return [(method, axes, seed, k) for seed in SEEDS for k in range(batches)]


def counted(found: Found) -> dict[str, Any]:
    """Return means over devices, and the bands in which chance leaves them."""
    n = len(found.nees)
    result: dict[str, Any] = {"devices": n}
    for name, one, middle in (("nees", found.nees, 1.0), ("covered", found.inside, EXPECTED)):
        width = BAND * float(one.std(ddof=1)) / n**0.5
        result[name] = round(float(one.mean()), 4)
        result[f"{name}_band"] = [round(middle - width, 4), round(middle + width, 4)]
    return result


def within(one: dict[str, Any]) -> bool:
    """Return whether NEES and coverage are as required, or in the band of chance if it is wider."""
    return all(
        min(low, one[f"{name}_band"][0]) <= one[name] <= max(high, one[f"{name}_band"][1])
        for name, (low, high) in (("nees", NEES), ("covered", COVERED))
    )


def work_out(devices: int, pool: Any) -> dict[str, Any]:
    """Return all counts."""
    found: dict[str, Any] = {"seeds": list(SEEDS), "methods": {}}
    for method, row in ROWS.items():
        rows: dict[str, Any] = {}
        for axes in row.axes:
            parts = pool.map(batch, tasks(method, axes, devices), chunksize=1)
            rows[str(axes)] = counted(joined(parts))
            print(method, axes, rows[str(axes)], flush=True)
        found["methods"][method] = rows
    return found


def page(found: dict[str, Any]) -> str:
    """Return the page of the stored counts."""
    lines = [
        "# Any number of axes: consistency and coverage of U, counted",
        "",
        "Written by `python -m tests.evidence.axes`; do not edit. The devices were simulated by",
        "generators that are independent of inercal. The directions of the axes were drawn at",
        "random, in `tumble` within the plane of rotation. `dual_orthogonal` accepts two axes at",
        "right angles and refuses more. A device of `ferraris` has as many gyros as",
        "accelerometers. For `noise`, the coefficients are N, B and K of each gyro. If nothing",
        "couples the axes, an axis that is calibrated without the others gives the same result as",
        "in the triad, within 1e-9 u; a test checks this.",
        "",
        "NEES is the mean of (error)ᵀ covariance⁻¹ (error) over the number of coefficients; 1 is",
        "expected. For `noise`, the covariance contains only the stated variances. The column",
        '"covered" states the share of coefficients that differ from the true value by at most U;',
        "95.45 % are expected. U includes the Birge ratio, which enlarges it by chance in 5 % of",
        "devices; the covariance of NEES does not include this ratio. With a probability of",
        "99.9 %, the number before a band lies within this band.",
        "",
        "| method | axes | devices | NEES | band | covered | band |",
        "|---|---|---|---|---|---|---|",
    ]
    for method, rows in found["methods"].items():
        for axes, one in rows.items():
            cells = [
                f"{one[name]:.3f} | " + " to ".join(f"{end:.3f}" for end in one[f"{name}_band"])
                for name in ("nees", "covered")
            ]
            lines.append(f"| {method} | {axes} | {one['devices']} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    store_runs(__doc__, work_out, page, (DATA, PAGE), DEVICES, "--devices")
