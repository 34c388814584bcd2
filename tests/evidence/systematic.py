"""Systematic calibration: errors against stated uncertainties, over many simulated devices.

Recordings of tests/methods/systematic_table.py, which knows nothing of inercal: path of nineteen
rests, 17 min at 20 Hz, tilt 2°, axes 0.5° off, angles 0.2° off, the IMU 10 cm from the axes.

`python -m tests.evidence.systematic` works out all of it and writes docs/evidence/systematic.json
and the page beside it; `--runs` with another number prints it only.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from tests.evidence.stored_counts import FOLDER
from tests.evidence.stored_runs import store_runs
from tests.methods import systematic_table as made
from tests.methods.systematic_cases import errors_of, group_of, sensor_of, solved, table_of, unit_of

DATA, PAGE = FOLDER / "systematic.json", FOLDER / "systematic.md"
SEEDS, RUNS, FEWER = (1, 2, 3), 60, 16


class Case(NamedTuple):
    """The grade, the drift of the true noise and that of the stated noise, and the estimator."""

    grade: str
    truth: str
    stated: str
    estimator: str = ""


CASES = (
    Case("N", "markov", "markov"), Case("T", "markov", "markov"),
    Case("N", "flicker", "flicker"), Case("T", "flicker", "flicker"),
    Case("N", "markov", "markov", "kalman"), Case("T", "markov", "markov", "kalman"),
    Case("N", "flicker", "flicker", "kalman"), Case("T", "flicker", "flicker", "kalman"),
)  # fmt: skip
WRONG = (
    Case("N", "markov", "none"), Case("T", "markov", "none"),
    Case("N", "flicker", "markov"), Case("T", "flicker", "markov"),
)  # fmt: skip
PATHS = {
    "19 rests, x up, 10 °/s": made.Table(),
    "19 rests, z up, 10 °/s": made.Table(up="z"),
    "19 rests, x up, 30 °/s": made.Table(rate=np.radians(30), rest=46.5),
}


class Answer(NamedTuple):
    """NEES and χ² by their degrees of freedom; errors over sd, errors and sd in printed units."""

    nees: float
    chi2: float
    ratio: list[float]
    error: list[float]
    sd: list[float]


def names_of(grade: str) -> tuple[str, ...]:
    """Return the names of coefficients and lag."""
    return (*sensor_of(made.GRADES[grade]).coefficients, "lag")


def fit(task: tuple[Case, int, int]) -> Answer:
    """Simulate a device and calibrate it."""
    case, seed, run = task
    grade, sensor = made.GRADES[case.grade], sensor_of(made.GRADES[case.grade], case.stated)
    rng = np.random.default_rng([seed, run, "NT".index(case.grade), len(case.truth)])
    truth, lag = made.draw_truth(grade, rng)
    table = made.Table()
    recorded = made.record(truth, lag, table, rng, grade=grade, drift=case.truth)
    estimate = solved(recorded, sensor, table_of(table), estimator=case.estimator)
    error, covariance = errors_of(estimate, recorded, sensor)
    sd = np.sqrt(np.diag(covariance))
    unit = np.array([unit_of(name) for name in (*sensor.coefficients, "lag")])
    nees = error @ np.linalg.solve(covariance, error) / error.size
    chi2 = float(estimate.chi2) / estimate.dof
    return Answer(
        float(nees), chi2, (error / sd).tolist(), (error / unit).tolist(), (sd / unit).tolist()
    )


def bound(task: tuple[str, str]) -> list[float]:
    """Return the standard deviations of a path without errors of the table, printed units."""
    grade, path = task
    table = replace(PATHS[path], tilt=0.0, skew=0.0, angle_error=0.0, azimuth=0.3)
    noise = made.GRADES[grade]
    sensor = sensor_of(noise)
    # With little noise, the estimate is near the truth; without noise, readings seem to have steps.
    quiet = replace(noise, gyro_white=1e-3 * noise.gyro_white, force_white=1e-3 * noise.force_white)
    recorded = made.record({}, 0.0, table, np.random.default_rng(0), grade=quiet, drift="none")
    estimate = solved(recorded, sensor, table_of(table))
    _, covariance = errors_of(estimate, recorded, sensor)
    unit = np.array([unit_of(name) for name in (*sensor.coefficients, "lag")])
    return (np.sqrt(np.diag(covariance)) / unit).tolist()


def by_group(grade: str, values: Any) -> dict[str, float]:
    """Return the root mean square of each group of coefficients; the last axis is of them."""
    groups: dict[str, list[int]] = {}
    for k, name in enumerate(names_of(grade)):
        groups.setdefault(group_of(name), []).append(k)
    table = np.atleast_2d(values)
    return {
        name: float(f"{np.sqrt(np.mean(table[:, at] ** 2)):.4g}") for name, at in groups.items()
    }


def summary(case: Case, answers: list[Answer], seeds: int) -> dict[str, Any]:
    """Return the counts of a case."""
    ratio = np.array([one.ratio for one in answers])
    nees = np.array([one.nees for one in answers])
    return {
        "devices": len(answers),
        "nees": round(float(nees.mean()), 4),
        "nees_by_seed": np.round(nees.reshape(seeds, -1).mean(axis=1), 4).tolist(),
        "chi2": round(float(np.mean([one.chi2 for one in answers])), 4),
        "covered": round(float((np.abs(ratio) <= 2).mean()), 4),
        "largest_ratio": round(float(np.sqrt((ratio**2).mean(axis=0)).max()), 4),
        "rms": by_group(case.grade, [one.error for one in answers]),
        "sd": by_group(case.grade, [one.sd for one in answers]),
    }


def work_out(runs: int, pool: Any) -> dict[str, Any]:
    """Return all counts."""
    found: dict[str, Any] = {"runs": runs, "seeds": list(SEEDS)}
    for name, cases, seeds, count in (
        ("cases", CASES, SEEDS, runs),
        ("wrong", WRONG, SEEDS[:1], min(runs, FEWER)),
    ):
        found[name] = {}
        for case in cases:
            tasks = [(case, seed, run) for seed in seeds for run in range(count)]
            one = summary(case, pool.map(fit, tasks, chunksize=4), len(seeds))
            found[name][" ".join(case).strip()] = one
            print(name, case, one, flush=True)
    tasks = [(grade, path) for path in PATHS for grade in made.GRADES]
    bounds = dict(zip(tasks, pool.map(bound, tasks), strict=True))
    found["bounds"] = {
        path: {grade: by_group(grade, bounds[grade, path]) for grade in made.GRADES}
        for path in PATHS
    }
    return found


def page(found: dict[str, Any]) -> str:
    """Return the page of the stored counts."""
    groups = list(next(iter(found["cases"].values()))["rms"])
    lines = [
        "# Systematic calibration: errors and stated uncertainties, counted",
        "",
        "Written by `python -m tests.evidence.systematic`; do not edit. Recordings were made by",
        "`tests/methods/systematic_table.py`, which is independent of inercal. Each recording has",
        "nineteen rests and lasts 17 min at 20 Hz. The table is tilted by 2°, its axes are off by",
        "0.5° and its angles by 0.2°, and the IMU is 10 cm from the axes. There are",
        f"{found['runs']} devices for each of three seeds. Grade N has gyros of 0.002 °/√h and",
        "0.003 °/h, and accelerometers of 10 µg/√Hz and 3 µg. Grade T has 0.1 °/√h, 0.5 °/h, 60",
        "µg/√Hz and 15 µg.",
        "",
        "NEES is the normalised estimation error squared, divided by its 31 degrees of freedom.",
        '"Covered" is the share of errors within ±2u. "Largest" is the largest ratio of the rms',
        "error of a coefficient to its u.",
        "",
        "| grade, true drift, stated drift, estimator (batch) | devices | NEES | by seed | χ²/ν | "
        "covered | largest |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, one in [*found["cases"].items(), *found["wrong"].items()]:
        seeds = ", ".join(f"{x:.3f}" for x in one["nees_by_seed"])
        lines.append(
            f"| {name} | {one['devices']} | {one['nees']:.3f} | {seeds} | {one['chi2']:.3f} | "
            f"{one['covered']:.3f} | {one['largest_ratio']:.2f} |"
        )
    lines += [
        "",
        'The drift "markov" is a Gauss–Markov process with a time constant of 300 s. The drift',
        '"flicker" is 1/f noise, and the true bias is its mean over the run. In the last four',
        "lines, the stated drift is wrong, and NEES and χ² show this.",
        "",
        "## Errors by group",
        "",
        "The table states the root mean square of the errors in °/h, ppm, ″, µg, µg/g², mm and",
        "ms. The stated standard uncertainty is in brackets.",
        "",
        "| case | " + " | ".join(groups) + " |",
        "|---|" + "---|" * len(groups),
    ]
    for name, one in found["cases"].items():
        cells = " | ".join(f"{one['rms'][g]:.3g} ({one['sd'][g]:.3g})" for g in groups)
        lines.append(f"| {name} | {cells} |")
    lines += [
        "",
        "## Standard uncertainties by path",
        "",
        "This turntable has no errors. On the path that begins with z up, the turns of one axis",
        "are about the vertical.",
        "",
        "| path | grade | " + " | ".join(groups) + " |",
        "|---|---|" + "---|" * len(groups),
    ]
    for path, grades in found["bounds"].items():
        for grade, sizes in grades.items():
            cells = " | ".join(f"{sizes[g]:.3g}" for g in groups)
            lines.append(f"| {path} | {grade} | {cells} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    store_runs(__doc__, work_out, page, (DATA, PAGE), RUNS)
