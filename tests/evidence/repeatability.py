"""How often U of the mean and of the next use covers the truth, over simulated laboratories.

`python -m tests.evidence.repeatability` works out all cases and writes
docs/evidence/repeatability.md; `--laboratories` with another number prints the rows only.
"""

import argparse
from collections.abc import Callable
from functools import partial
from multiprocessing import Pool, cpu_count

import numpy as np
from scipy.stats import chi2, f
from tests.evidence import stored_counts
from tests.repeatability.laboratory import KIND, Laboratory, draw
from tests.repeatability.sessions import sessions_of

from inercal.laboratory.repeatability import repeat

SESSIONS, SEEDS, LABORATORIES = (3, 5, 10), (1, 2, 3), 4_000
PAGE = stored_counts.FOLDER / "repeatability.md"
LEVEL = 0.9545
CASES = {
    "turn-on 60 and 30, mounting 40 (the note's)": Laboratory(),
    "noise alone": Laboratory(turn_on=(0, 0, 0), mount=0),
    "ten times the scatter": Laboratory(turn_on=(600, 300, 0), mount=400),
    "ax.k0 scatters 3 times as much": Laboratory(odd=3.0),
}
_KINDS = [kind == KIND for kind in range(3)]
_PAGE = """\
# Repeated sessions: how often the U of the mean and of the next use cover the truth

Written by `make evidence`; do not edit. The laboratories were simulated without inercal
(`tests/repeatability/laboratory.py`). In each session, the bias, scale factor and misalignment of a
triad have uncertainties of 9.3, 14 and 18 from this session, and uncertainties of 0, 10 and 20 that
all sessions have in common (1e-6 SI). There are {count} laboratories with base seeds {seeds}. The
table states the coverage of bias, scale factor and misalignment in percent; 95.45 are expected. The
next use includes a new mounting. The columns "last session" and "independent" ignore the scatter
between sessions. "Last session" uses 2u of the last session, and "independent" uses 2u of the mean
of sessions that are treated as independent. "All at once" is the joint region of all twelve
coefficients in the next use, with the limit of χ² or of F.

| {heads} |
|---|--:|---|---|--:|---|---|--:|--:|
{rows}

Commit {commit}; {machine}.
"""
_HEADS = (
    "what scatters", "sessions", "mean", "next use", "ax.k0, next use", "next use, last session",
    "mean, independent", "all at once, χ²", "all at once, F",
)  # fmt: skip


def judge(laboratory: Laboratory, k: int, seed_and_count: tuple[int, int]) -> np.ndarray:
    """Return the hits in a number of laboratories: of four statements, and of two regions."""
    seed, count = seed_and_count
    rng = np.random.default_rng([seed, k, 30])
    hits = np.zeros((5, 12))
    regions = {0: chi2.ppf(LEVEL, 12), 1: 12 * f.ppf(LEVEL, 12, 9 * (k - 1))}
    for _ in range(count):
        drawn = draw(laboratory, k, rng)
        found = repeat(sessions_of(drawn), mount_owner="sensor")
        off = found.values - drawn.next_use
        u = np.sqrt(np.diag(drawn.covariance))
        hits[0] += np.abs(found.values - drawn.mean) < found.mean.expanded
        hits[1] += np.abs(off) < found.next_use.expanded
        hits[2] += np.abs(drawn.values[-1] - drawn.next_use) < 2 * u
        hits[3] += np.abs(drawn.values.mean(axis=0) - drawn.mean) < 2 * u / np.sqrt(k)
        # Without the factor of Student's t, which the regions have themselves.
        by = 2 * np.hypot(found.next_use.scatter_std, found.next_use.shared_std)
        by = by / found.next_use.expanded
        covariance = found.next_use.covariance * np.outer(by, by)
        distance = off @ np.linalg.solve(covariance, off)
        for region, limit in regions.items():
            hits[4, region] += distance < limit
    return hits


def row(name: str, k: int, laboratories: int, share: Callable[..., list[np.ndarray]]) -> str:
    """Return a line of the table."""
    pieces = [(seed, laboratories // len(SEEDS)) for seed in SEEDS]
    hits = np.sum(share(partial(judge, CASES[name], k), pieces), axis=0)
    parts = 100 * hits / sum(count for _, count in pieces)
    texts = [", ".join(f"{one[kind].mean():.1f}" for kind in _KINDS) for one in parts[:4]]
    mean, next_use, last, independent = texts
    regions = " | ".join(f"{x:.1f}" for x in parts[4, :2])
    cells = (name, k, mean, next_use, f"{parts[1, 0]:.1f}", last, independent, regions)
    return f"| {' | '.join(map(str, cells))} |"


def main() -> None:
    """Work out the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--laboratories", type=int, default=LABORATORIES)
    count: int = parser.parse_args().laboratories
    lines: list[str] = []
    with Pool(cpu_count()) as pool:
        for name in CASES:
            for k in SESSIONS:
                lines.append(row(name, k, count, pool.map))
                print(lines[-1], flush=True)
    if count == LABORATORIES:
        PAGE.write_text(
            _PAGE.format(
                count=f"{count:,}".replace(",", " "),
                seeds=", ".join(map(str, SEEDS)),
                heads=" | ".join(_HEADS),
                rows="\n".join(lines),
                commit=stored_counts.current_commit(),
                machine=stored_counts.describe_machine(),
            ),
            encoding="utf-8",
        )


if __name__ == "__main__":
    main()
