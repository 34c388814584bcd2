"""Sensor noise: coverage of its coefficients, false terms, models chosen, disturbances found.

Recordings of tests/noise/generator.py, which knows nothing of inercal, of two grades: MEMS
(0.15 °/√h, 5 °/h, 0.2 °/h/√s, 4.55 h) and tactical (0.05 °/√h, 0.3 °/h, 0.006 °/h/√s, 18.2 h).

`python -m tests.evidence.sensor_noise` works out all of it and writes docs/evidence/noise.json and
the page beside it; `--runs` with another number prints it only.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import betaincinv
from tests.evidence.stored_counts import FOLDER
from tests.evidence.stored_runs import store_runs
from tests.noise.generator import DEG_H, MEMS, TACTICAL, draw

from inercal.noise.coefficients import estimate_coefficients
from inercal.noise.deviations import deviations
from inercal.noise.disturbances import find_disturbances, take_out_lines
from inercal.noise.selection import Selection, select_terms
from inercal.noise.spectrum import Bins, make_bins, piece_spectra

GRADES = {"MEMS": MEMS, "tactical": TACTICAL}
SEEDS, RUNS = (1, 2, 3), 300
FEWER = 0.2  # of the runs, of models and disturbances
CLEAN = {"fresh": range(40_000_000, 40_000_150), "tuned": range(30_000_000, 30_000_150)}
"""Seeds of undisturbed recordings of six channels; limits and levels were set on the latter."""
MODELS = {
    "N": replace(MEMS, flicker=0.0, walk=0.0),
    "NB": replace(MEMS, walk=0.0),
    "NK": replace(MEMS, flicker=0.0),
    "NBK": MEMS,
    "NG": replace(MEMS, flicker=0.0, walk=0.0, markov=4.0, markov_time=300.0),
}
START = 4040.0  # s, of disturbances
DATA, PAGE = FOLDER / "noise.json", FOLDER / "noise.md"
LINE_HZ = 0.7371


def spectrum_bins(y: np.ndarray, dt: float) -> tuple[Bins, int]:
    spectrum, lines = take_out_lines(piece_spectra(y, dt)[0])
    return make_bins((spectrum,), dt), len(lines)


def cover(task: tuple[str, int, int]) -> list[float]:
    """Return N, B, K over their truth, whether each is covered, and whether K is zero."""
    grade, seed, run = task
    truth = GRADES[grade]
    y = draw(truth, 100_000 * seed + run)[0]
    bins, _ = spectrum_bins(y, truth.dt)
    selection = select_terms(bins, ("NBK",))
    oadev = deviations(y, truth.dt)
    found, _ = estimate_coefficients(selection, bins, oadev, "gyro", "likelihood", y.size)
    true = np.array([truth.white, truth.flicker, truth.walk]) * truth.unit
    inside = [abs(one.value - t) <= 2 * one.u for one, t in zip(found, true, strict=True)]
    inside[2] = found[2].low <= true[2] <= found[2].high
    ratios = [one.value / t for one, t in zip(found, true, strict=True)]
    return [*ratios, *map(float, inside), float(found[2].is_limit)]


def choose(task: tuple[str, int]) -> tuple[str, str, int]:
    """Return the chosen terms, the significant ones, and the number of lines."""
    name, run = task
    truth = MODELS[name]
    # Seeds of its own for each truth: the white noise would be the same otherwise.
    y = draw(truth, 1_000_000 * (1 + list(MODELS).index(name)) + run)[0]
    bins, lines = spectrum_bins(y, truth.dt)
    found: Selection = select_terms(bins)
    sure = [one for one, test in found.significance.items() if test.is_significant]
    return "".join(found.fit.symbols), "".join(sure), lines


def _step(y: np.ndarray, size: float, rng: np.random.Generator) -> None:
    y[round(START / MEMS.dt) :] += size * DEG_H


def _knock(y: np.ndarray, size: float, rng: np.random.Generator) -> None:
    k = round(START / MEMS.dt)
    y[k : k + round(5 / MEMS.dt)] += size * DEG_H


def _burst(y: np.ndarray, size: float, rng: np.random.Generator) -> None:
    k, n = round(START / MEMS.dt), round(10 / MEMS.dt)
    sd = MEMS.white * DEG_H / np.sqrt(MEMS.dt)
    y[k : k + n] += np.sqrt(size**2 - 1) * sd * rng.standard_normal(n)


def _line(y: np.ndarray, size: float, rng: np.random.Generator) -> None:
    t = np.arange(y.size) * MEMS.dt
    y += size * y.std() * np.sin(2 * np.pi * (LINE_HZ * t + rng.random()))


ADDED: dict[str, tuple[Callable[[np.ndarray, float, np.random.Generator], None], list[float]]] = {
    "step, °/h": (_step, [20, 25, 30, 40]),
    "knock of 5 s, °/h": (_knock, [40, 60, 100]),
    "burst of 10 s, times": (_burst, [1.5, 2.0, 3.0]),
    "line, amplitude over sd": (_line, [0.03, 0.05, 0.1]),
}


def disturb(task: tuple[str, float, int]) -> tuple[bool, float]:
    """Return whether a disturbance is found within 5 s or 1 %, and the error of its time, s."""
    what, size, run = task
    y = draw(MEMS, 20_000_000 + run)[0]
    ADDED[what][0](y, size, np.random.default_rng(run))
    if what.startswith("line"):
        _, lines = take_out_lines(piece_spectra(y, MEMS.dt)[0])
        return any(abs(one.frequency / LINE_HZ - 1) < 0.01 for one in lines), 0.0
    errors = [abs(one.time - START) for one in find_disturbances(y, MEMS.dt)]
    best = min(errors, default=np.inf)
    return best <= 5, float(best)


def clean(seed: int) -> bool:
    """Return whether any of six undisturbed channels raises an alarm: disturbance or line."""
    for y in draw(MEMS, seed, 6):
        _, lines = take_out_lines(piece_spectra(y, MEMS.dt)[0])
        if lines or find_disturbances(y, MEMS.dt):
            return True
    return False


def work_out(runs: int, pool: Any) -> dict[str, object]:
    """Return all counts."""
    fewer = max(1, round(FEWER * runs))
    found: dict[str, object] = {"runs": runs, "fewer": fewer, "seeds": list(SEEDS)}
    coverage: dict[str, object] = {}
    for grade in GRADES:
        tasks = [(grade, seed, run) for seed in SEEDS for run in range(runs)]
        rows = np.array(pool.map(cover, tasks, chunksize=10))
        limited = rows[:, 6] == 1
        coverage[grade] = {
            "median": np.round(np.median(rows[:, :3], axis=0), 4).tolist(),
            "rms": np.round(np.sqrt(np.mean((rows[:, :3] - 1) ** 2, axis=0)), 4).tolist(),
            "covered": np.round(rows[:, 3:6].mean(axis=0), 4).tolist(),
            "by_seed": np.round(rows[:, 3:6].reshape(len(SEEDS), runs, 3).mean(1), 4).tolist(),
            "zero": float(np.round(limited.mean(), 4)),
        }
        print(grade, coverage[grade], flush=True)
    found["coverage"] = coverage
    models: dict[str, object] = {}
    for name in MODELS:
        answers = pool.map(choose, [(name, run) for run in range(fewer)], chunksize=5)
        chosen = Counter(one[0] for one in answers)
        models[name] = {
            "chosen": dict(chosen.most_common()),
            "right": chosen[name] / fewer,
            "false_by_aic": float(np.mean([bool(set(a) - set(name)) for a, _, _ in answers])),
            "false_significant": float(np.mean([bool(set(b) - set(name)) for _, b, _ in answers])),
            "lines": sum(one[2] for one in answers),
        }
        print(name, models[name], flush=True)
    found["models"] = models
    count_disturbances(found, fewer, pool)
    return found


def count_disturbances(found: dict[str, object], fewer: int, pool: Any) -> None:
    """Add the disturbances that are found, and the alarms of clean recordings."""
    sizes: dict[str, object] = {}
    for what, (_, levels) in ADDED.items():
        for size in levels:
            answers = pool.map(disturb, [(what, size, run) for run in range(fewer)], chunksize=10)
            hits = [one for one in answers if one[0]]
            late = float(np.round(max((one[1] for one in hits), default=0.0), 2))
            share = float(np.round(len(hits) / fewer, 4))
            sizes[f"{what} {size:g}"] = {"found": share, "largest_time_error": late}
            print(what, size, sizes[f"{what} {size:g}"], flush=True)
    found["disturbances"] = sizes
    found["clean"] = {
        name: {"seeds": [seeds[0], seeds[-1]], "alarms": sum(pool.map(clean, seeds, chunksize=5))}
        for name, seeds in CLEAN.items()
    }
    print("clean", found["clean"], flush=True)


def page(found: dict[str, Any]) -> str:
    """Return the page of the stored counts."""
    lines = [
        "# Noise of a sensor at rest: coverage, models, disturbances, counted",
        "",
        "Written by `python -m tests.evidence.sensor_noise`; do not edit. Recordings were made by",
        "`tests/noise/generator.py`, which is independent of inercal. The coverage was counted in",
        f"{found['runs']} recordings for each of three seeds. The other lines contain",
        f"{found['fewer']} recordings each.",
        "",
        "## Coefficients by likelihood",
        "",
        "N and B count as covered if the true value is within ±2u. K counts as covered if the",
        "true value is within its profile-likelihood interval or, if the estimate of K is zero,",
        "below its upper limit.",
        "",
        "| grade | | N | B | K |",
        "|---|---|---|---|---|",
    ]
    for grade, one in found["coverage"].items():
        for key, words in (("median", "median over truth"), ("rms", "relative rms"),
                           ("covered", "covered")):  # fmt: skip
            lines.append(
                f"| {grade} | {words} | " + " | ".join(f"{x:.4g}" for x in one[key]) + " |"
            )
        lines.append(f"| {grade} | K zero | | | {one['zero']:.3g} |")
    lines += ["", "## Models", "",
              "The model is chosen by Akaike's criterion. A term is false if the true noise",
              "lacks it.", "",
              "| truth | chosen rightly | false term by AIC | false term called significant |",
              "|---|---|---|---|"]  # fmt: skip
    for name, one in found["models"].items():
        lines.append(
            f"| {name} | {one['right']:.3f} | {one['false_by_aic']:.3f} | "
            f"{one['false_significant']:.3f} |"
        )
    total = np.mean([one["false_significant"] for one in found["models"].values()])
    lines += [f"| all | | | {total:.4f} |", "", "## Disturbances, MEMS grade", "",
              "| what | found | largest error of its time, s |", "|---|---|---|"]  # fmt: skip
    for what, one in found["disturbances"].items():
        lines.append(f"| {what} | {one['found']:.3f} | {one['largest_time_error']:g} |")
    lines += ["", "## Alarms in undisturbed recordings, MEMS grade, six channels", "",
              "An alarm is a disturbance or a line in any channel. The limits and levels were",
              "tuned with the seeds in the last line, so only the fresh seeds are a test.", "",
              "| seeds | recordings | with an alarm | share | 95 % upper limit |",
              "|---|---|---|---|---|"]  # fmt: skip
    for name, one in found["clean"].items():
        first, last = one["seeds"]
        runs, alarms = last - first + 1, one["alarms"]
        limit = betaincinv(alarms + 1, runs - alarms, 0.95)
        lines.append(
            f"| {name}, {first} to {last} | {runs} | {alarms} | {alarms / runs:.4f} | {limit:.4f} |"
        )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    store_runs(__doc__, work_out, page, (DATA, PAGE), RUNS)
