"""Run lengths of the control charts, over simulated runs and laboratories.

`python -m tests.evidence.control` works out all rows and writes docs/evidence/control.md; `--runs`
with another number prints the rows only.
"""

import argparse
from collections.abc import Callable
from functools import partial
from math import sqrt
from multiprocessing import Pool, cpu_count
from typing import Any

import numpy as np
from tests.check_standard.history import checked_sessions
from tests.evidence import stored_counts
from tests.repeatability.laboratory import MICRO, NAMES, Laboratory

from inercal.estimation.uncertainty.control_charts import chart_limit, cusum_limit, wider_limit
from inercal.laboratory.check_standard import control_charts

SEEDS, RUNS = (1, 2, 3), 9_000
LABORATORIES = 20  # one of so many runs
PAGE = stored_counts.FOLDER / "control.md"
SHIFTS = (0.0, 0.5, 1.0, 2.0)
LENGTH = 370.4
CUSUM, ALLOWANCE = "CUSUM, k = 0.5", 0.5
CHARTS = {
    "Shewhart": (1, 1.0),
    "EWMA, λ = 0.2": (1, 0.2),
    CUSUM: (1, 0.0),
    "T², p = 12": (12, 1.0),
    "MEWMA, λ = 0.1, p = 12": (12, 0.1),
    "MEWMA, λ = 0.1, p = 24": (24, 0.1),
}
REFERENCES = (10, 20, 40)
DAYS = 100  # after the reference
STEPS = (0.0, 1.0, 2.0, 4.0)  # of ax.k0, in standard deviations
_OF_BIAS = sqrt(9.3**2 + 60**2) * MICRO
_PAGE = """\
# Control charts: run lengths

Written by `make evidence`; do not edit. Runs and laboratories were simulated without inercal. The
run length is the number of points until a chart signals.

## Known covariance

The limits are for an in-control run length of 370.4, and were computed with inercal's integral
equation. The table states the mean run length after a shift, from {runs} runs (base seeds {seeds}),
with the standard deviation of this mean. The shift is in standard deviations; for all coefficients
together it is √(δᵀV⁻¹δ).

| chart | limit | {shifts} |
|---|--:|--:|--:|--:|--:|
{known}

With `--lasting CUSUM`, a CUSUM chart replaces the EWMA chart.

## A reference of m sessions, one coefficient

The table compares the limit 3 S of the handbooks with the limit t S √(1 + 1/m) of inercal. For each
limit, it states the in-control run length that nine of ten laboratories exceed, and the median
({labs} laboratories).

| m | 3 S: one in ten below | median | t S √(1 + 1/m): one in ten below | median |
|--:|--:|--:|--:|--:|
{single}

## Sessions of one day

There are four sessions a day, and half of their variance is common to all four. The table states
the mean in-control run length of an EWMA chart (λ = 0.2, L = 2.860) in points.

| charted | run length |
|---|--:|
{days}

## Laboratories

Each laboratory measures a triad. From session to session, the bias scatters by 60 and the scale
factor by 30 (1e-6 SI). The triad is mounted again each day, with a scatter of 40. The uncertainties
of a session itself are 9.3, 14 and 18 (bias, scale factor, misalignment). `inercal control` draws
all 26 charts for an in-control run length of 370 days. Each row contains {reported} laboratories
and {length} days after the reference. From the first of these days on, ax.k0 is too large by the
stated step, in standard deviations. If the run length is 370, 24 % of laboratories in control
signal within 100 days.

| reference, days | step | laboratories that signal, % | days that signal, % | median run length |
|--:|--:|--:|--:|--:|
{laboratories}

Commit {commit}; {machine}.
"""


def run_lengths(size: int, weight: float, limit: float, shift: float, seed: int, runs: int) -> Any:
    """Return the run lengths of a chart after a shift, (runs,)."""
    rng = np.random.default_rng([seed, size, round(10 * weight), round(10 * shift)])
    w, length, alive = np.zeros((runs, size)), np.zeros(runs), np.arange(runs)
    bound = limit * weight / (2 - weight)
    while alive.size:
        z = rng.standard_normal((alive.size, size))
        z[:, 0] += shift
        w[alive] = (1 - weight) * w[alive] + weight * z
        length[alive] += 1
        alive = alive[np.sum(w[alive] ** 2, axis=1) < bound]
    return length


def cusum_lengths(limit: float, shift: float, seed: int, runs: int) -> Any:
    """Return the run lengths of a two-sided CUSUM after a shift, (runs,)."""
    rng = np.random.default_rng([seed, 99, round(10 * shift)])
    sums, length, alive = np.zeros((runs, 2)), np.zeros(runs), np.arange(runs)
    while alive.size:
        z = shift + rng.standard_normal(alive.size)
        both = sums[alive] + np.stack([z, -z], axis=1) - ALLOWANCE
        sums[alive] = np.maximum(both, 0.0)
        length[alive] += 1
        alive = alive[np.max(sums[alive], axis=1) <= limit]
    return length


def lengths_of(name: str, shift: float, seed: int, runs: int) -> Any:
    """Return the run lengths of a chart by its name, (runs,)."""
    if name == CUSUM:
        return cusum_lengths(cusum_limit(LENGTH), shift, seed, runs)
    size, weight = CHARTS[name]
    return run_lengths(size, weight, chart_limit(LENGTH, weight, size), shift, seed, runs)


def known_row(name: str, runs: int, share: Callable[..., list[Any]]) -> str:
    """Return a line of the table of known covariances."""
    size, weight = CHARTS[name]
    cells: list[str] = []
    for shift in SHIFTS:
        one = partial(_of_seed, name, shift, runs // len(SEEDS))
        found = np.concatenate(share(one, SEEDS))
        cells.append(f"{found.mean():.1f} ± {found.std() / sqrt(found.size):.1f}")
    if name == CUSUM:
        return f"| {name} | {cusum_limit(LENGTH):.3f} | {' | '.join(cells)} |"
    limit = chart_limit(LENGTH, weight, size)
    shown = sqrt(limit) if size == 1 else limit
    return f"| {name} | {shown:.3f} | {' | '.join(cells)} |"


def _of_seed(name: str, shift: float, runs: int, seed: int) -> Any:
    return lengths_of(name, shift, seed, runs)


def single_row(m: int, laboratories: int) -> str:
    """Return a line of the table of estimated standard deviations."""
    from scipy.stats import norm

    rng = np.random.default_rng([m, 7])
    mean = rng.standard_normal(laboratories) / sqrt(m)
    s = np.sqrt(rng.chisquare(m - 1, laboratories) / (m - 1))
    cells: list[str] = []
    ours = sqrt(wider_limit(9.0, 1, m - 1) * (1 + 1 / m))
    for factor in (3.0, ours):
        rate = norm.sf(factor * s - mean) + norm.cdf(-factor * s - mean)
        length = 1 / rate
        for one in np.quantile(length, (0.1, 0.5)):
            cells.append(f"{one:.0f}" if one < 1e6 else "above 1 000 000")
    return f"| {m} | {' | '.join(cells)} |"


def day_rows(runs: int) -> list[str]:
    """Return the lines of the table of sessions of one day."""
    rng = np.random.default_rng(4)
    bound = 2.860 * sqrt(0.2 / 1.8)
    found: list[str] = []
    for name, means in (("each session", False), ("means of days", True)):
        w, length, alive, t = np.zeros(runs), np.zeros(runs), np.arange(runs), 0
        common = np.zeros(runs)
        while alive.size:
            if means:
                z = rng.standard_normal(alive.size)
            else:
                if t % 4 == 0:
                    common = sqrt(0.5) * rng.standard_normal(runs)
                z = common[alive] + sqrt(0.5) * rng.standard_normal(alive.size)
            t += 1
            w[alive] = 0.8 * w[alive] + 0.2 * z
            length[alive] += 1
            alive = alive[np.abs(w[alive]) < bound]
        found.append(f"| {name} | {length.mean():.0f} ± {length.std() / sqrt(runs):.0f} |")
    return found


def laboratory_points(
    reference: int, step: float, seed_and_count: tuple[int, int]
) -> list[list[bool]]:
    """Return which days signal, of a number of laboratories."""
    seed, count = seed_and_count
    rng = np.random.default_rng([seed, reference, round(step)])
    shift = np.where(np.array(NAMES) == "ax.k0", step * _OF_BIAS, 0.0)
    found: list[list[bool]] = []
    for _ in range(count):
        sessions = checked_sessions(
            Laboratory(), reference + DAYS, rng, shift=shift, shifted=(reference, 10**9)
        )
        charts = control_charts(sessions, reference=reference)
        found.append([not one.in_control for one in charts.points])
    return found


def laboratory_row(reference: int, step: float, count: int, share: Callable[..., list[Any]]) -> str:
    """Return a line of the table of laboratories."""
    pieces = [(seed, count // len(SEEDS)) for seed in SEEDS]
    parts = share(partial(laboratory_points, reference, step), pieces)
    signals = np.array([one for part in parts for one in part])
    some = signals.any(axis=1)
    first = np.where(some, signals.argmax(axis=1) + 1, DAYS + 1)
    middle = float(np.median(first))
    length = f"{middle:.0f}" if middle <= DAYS else f"above {DAYS}"
    return (
        f"| {reference} | {step:g} | {100 * some.mean():.1f} | {100 * signals.mean():.2f} | "
        f"{length} |"
    )


def main() -> None:
    """Work out the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=RUNS)
    runs: int = parser.parse_args().runs
    count = max(runs // LABORATORIES, len(SEEDS))
    parts: dict[str, list[str]] = {"known": [], "laboratories": []}
    with Pool(cpu_count()) as pool:
        for name in CHARTS:
            parts["known"].append(known_row(name, runs, pool.map))
            print(parts["known"][-1], flush=True)
        for reference in REFERENCES:
            for step in STEPS:
                line = laboratory_row(reference, step, count, pool.map)
                parts["laboratories"].append(line)
                print(line, flush=True)
    parts["single"] = [single_row(m, 100_000) for m in (5, 10, 20, 40)]
    parts["days"] = day_rows(runs)
    print("\n".join([*parts["single"], *parts["days"]]))
    if runs == RUNS:
        PAGE.write_text(
            _PAGE.format(
                **{name: "\n".join(lines) for name, lines in parts.items()},
                runs=f"{runs:,}".replace(",", " "),
                seeds=", ".join(map(str, SEEDS)),
                shifts=" | ".join(f"{one:g}" for one in SHIFTS),
                labs="100 000",
                reported=count // len(SEEDS) * len(SEEDS),
                length=DAYS,
                commit=stored_counts.current_commit(),
                machine=stored_counts.describe_machine(),
            ),
            encoding="utf-8",
        )


if __name__ == "__main__":
    main()
