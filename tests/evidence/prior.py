"""Priors of a type over many populations: coverage of a new sensor, NEES of the nine parameters.

Each population is drawn anew by `tests.type_prior.populations` or `tests.accuracy.dividing_head`,
which know nothing of inercal. N sensors of it are calibrated, and `type_prior`, which the verb
`prior` calls, makes the prior. Either this is compared with another sensor of the population, or
two others are calibrated at right angles with it, by `dual_orthogonal`.

`python -m tests.evidence.prior` works out all of it and writes docs/evidence/prior.json and the
page beside it; `--populations` with another number prints it only.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.evidence.stored_counts import FOLDER
from tests.evidence.stored_runs import store_runs
from tests.type_prior.cases import ESTIMATORS, TERMS, new_sensors, patent_nees

Array = NDArray[np.float64]
DATA, PAGE = FOLDER / "prior.json", FOLDER / "prior.md"
SENSORS, POPULATIONS = (3, 5, 10, 30), 1000
BATCH = 25  # populations of one task
SEED = 12
BAND = 3.29  # standard deviations: 99.9 %, two-sided


def cover(task: tuple[int, int]) -> Array:
    """Return whether U of each term contains a new sensor, and whether any is named, (batch, 4)."""
    n, batch = task
    inside, alarms = new_sensors(np.random.default_rng([SEED, n, batch]), n, BATCH, len(TERMS))
    return np.column_stack([inside, alarms])


def calibrate_pairs(task: tuple[str, int, int]) -> Array:
    """Return the NEES of the nine parameters, (batch,)."""
    estimator, n, batch = task
    with TemporaryDirectory() as folder:
        return patent_nees(estimator, 10_000 * n + batch, BATCH, n, Path(folder))[0]


def counted_sensors(rows: Array) -> dict[str, Any]:
    """Return the coverage of each term and the share of populations with a named sensor."""
    share = np.round(rows.mean(axis=0), 4).tolist()
    return {"covered": dict(zip(TERMS, share, strict=False)), "alarms": share[-1]}


def counted_pairs(nees: Array) -> dict[str, float]:
    """Return the mean NEES and its sampling band."""
    band = BAND * float(nees.std(ddof=1)) / len(nees) ** 0.5
    return {"nees": round(float(nees.mean()), 4), "band": round(band, 4)}


def work_out(populations: int, pool: Any) -> dict[str, Any]:
    """Return all counts."""
    batches = range(-(-populations // BATCH))
    found: dict[str, Any] = {"populations": BATCH * len(batches), "sensors": {}, "pairs": {}}
    for n in SENSORS:
        rows = np.concatenate(pool.map(cover, [(n, k) for k in batches], chunksize=1))
        found["sensors"][str(n)] = counted_sensors(rows)
        print(n, found["sensors"][str(n)], flush=True)
    for estimator in ESTIMATORS:
        found["pairs"][estimator] = {}
        for n in SENSORS:
            tasks = [(estimator, n, k) for k in batches]
            rows = np.concatenate(pool.map(calibrate_pairs, tasks, chunksize=1))
            found["pairs"][estimator][str(n)] = counted_pairs(rows)
            print(estimator, n, found["pairs"][estimator][str(n)], flush=True)
    return found


def page(found: dict[str, Any]) -> str:
    """Return the page of the stored counts."""
    lines = [
        "# Priors of a type: coverage and consistency, counted",
        "",
        "Written by `python -m tests.evidence.prior`; do not edit. The sensors and their readings",
        "were simulated by generators that are independent of inercal. Each line contains",
        f"{found['populations']} populations.",
        "",
        "## A new sensor",
        "",
        "N sensors were calibrated, and `inercal prior` made the prior. The table states how often",
        "U contained the coefficient of another sensor of the same population; 95.45 % are",
        "expected. The uncertainties of the calibrations were 0.2 times (K₂), 0.25 times (K_ip)",
        "and 1 times (K₃) the scatter of the sensors. The calibrations also shared an error of",
        "the bench of half that size. For three sensors and K₃, U is larger than necessary: with",
        "such calibrations and an error that all files share, the coverage is about 97 %. The",
        "last column states how often a sensor was named as outlying, although all sensors belong",
        "to one population; 1 % are expected.",
        "",
        "| N | K₂ | K_ip | K₃ | named as outlying |",
        "|---|---|---|---|---|",
    ]
    for n, one in found["sensors"].items():
        shares = " | ".join(f"{one['covered'][term]:.3f}" for term in TERMS)
        lines.append(f"| {n} | {shares} | {one['alarms']:.3f} |")
    lines += [
        "",
        "## Nine parameters of a pair",
        "",
        "The prior of K_ip was made from tumble tests of N accelerometers on the same kind of",
        "dividing head. Then two other accelerometers were calibrated at right angles with this",
        "prior, and with K₃ of each known to 0.5 µg/g³. NEES is the mean of (error)ᵀ covariance⁻¹",
        "(error) / 9; 1 is expected. The nine parameters are K₀, k₁ + K₃, K₂ and K_ip of both",
        "accelerometers, and the angle between the accelerometers. With a probability of 99.9 %,",
        "the mean differs from 1 by at most the number behind ±.",
        "",
        "| estimator | N | NEES |",
        "|---|---|---|",
    ]
    for estimator, rows in found["pairs"].items():
        for n, one in rows.items():
            lines.append(f"| {estimator} | {n} | {one['nees']:.3f} ± {one['band']:.3f} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    store_runs(__doc__, work_out, page, (DATA, PAGE), POPULATIONS, "--populations")
