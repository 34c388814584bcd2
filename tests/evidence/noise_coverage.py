"""Slow noise and drift within recordings: what is called consistent errs as it says.

A first-order Gauss–Markov process of 1 mg, with a memory shorter or longer than what one would
average over, or a drift of the accelerometers' biases over the run, is added to recordings of
`tests.evidence.cases.hand_recordings`; each axis drifts by half the size to all of it, either
way, linearly or as exp(−t/τ) with τ a tenth to all of the run. The truth of a bias is its mean over
the run: how far that is from the mean of other runs no recording shows. An error counts if it
exceeds 2u in a session that is called consistent; the share is of all coefficients of all sessions.

`python -m tests.evidence.noise_coverage` works out all cases and writes
docs/evidence/coverage.json and the page beside it; `--sessions` with another number prints them
only.
"""

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from multiprocessing import Pool, cpu_count
from zlib import crc32

import numpy as np
from scipy.stats import binom
from tests.evidence import graded_calibration, stored_counts
from tests.evidence.violation_cells import find_case
from tests.evidence.violation_table import format_number
from tests.evidence.visibility_model import G0

METHODS = ("six_position, recorded", "multi_position, recorded")
MG = 1e-3 * G0
SESSIONS = {"six_position, recorded": 100, "multi_position, recorded": 40}
SEED = 1
MAX_SHARE = 0.07  # of coefficients
_BEYOND = 0.0455  # of a normal distribution, beyond 2 standard deviations
DATA, PAGE = stored_counts.FOLDER / "coverage.json", stored_counts.FOLDER / "coverage.md"
_PAGE = """\
# Slow noise and drift: what is called consistent errs as it says, counted

Written by `make evidence`; do not edit. Generators that are independent of inercal
(`tests/evidence/noise_coverage.py`) made recordings of six rests of 10 s in 70 s, and of 24 rests
of 3 s in 110 s. The recordings contain correlated noise, or a drift of the accelerometer biases. A
drift is linear, or exponential with a time constant between a tenth of the run and the whole run.
The truth of a bias is its mean over the run; how far that is from the mean of other runs no
recording shows. Counted are coefficients that err by more than 2u in sessions that are called
consistent, as a share of all coefficients of all sessions: at most {most:.0%} are allowed, or the
upper end of the 99.9 % band of the draws; 4.6 % are what a normal distribution has. Seed {seed}.

| method | what is added | sessions | called consistent | beyond 2u | NEES of those |
|---|---|---|---|---|---|
{rows}

Commit {commit}; {machine}.
"""


@dataclass(frozen=True)
class AddedDisturbance:
    """What is added to recordings: noise with a memory, s, or a drift over the run, m/s²."""

    words: str
    memory: float = 0.0
    size: float = 0.0
    shape: str = ""


# s, by the size in mg
MEMORIES = {1.0: (0.05, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0), 0.2: (1.0, 10.0, 30.0, 100.0)}
DRIFTS = (0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)  # mg
DISTURBANCES = (
    AddedDisturbance("nothing"),
    *(
        AddedDisturbance(f"noise of {size:g} mg with a memory of {memory:g} s", memory, size * MG)
        for size, memories in MEMORIES.items()
        for memory in memories
    ),
    *(
        AddedDisturbance(f"{shape} drift of {size:g} mg", 0.0, size * MG, shape)
        for shape in ("linear", "exponential")
        for size in DRIFTS
    ),
)


@dataclass(frozen=True)
class CoverageCount:
    """Sessions of one case.

    Parameters
    ----------
    method, added : str
    coefficients : int
        Of each session.
    nees : float
        Mean over the sessions called consistent.
    each : sequence of int
        Coefficients off by more than 2u in each session; −1 where it is not called consistent.
    """

    method: str
    added: str
    coefficients: int
    nees: float
    each: Sequence[int]

    @property
    def consistent(self) -> int:
        """Sessions that are called consistent."""
        return sum(count >= 0 for count in self.each)

    @property
    def allowed_share(self) -> float:
        """The largest share allowed, with the sampling band of a normal distribution."""
        draws = self.coefficients * len(self.each)
        return max(MAX_SHARE, float(binom.ppf(0.9995, draws, _BEYOND)) / draws)

    @property
    def share(self) -> float:
        """Coefficients that err by more than 2u in these, over those of all sessions."""
        beyond = sum(count for count in self.each if count > 0)
        return beyond / (self.coefficients * len(self.each))


def calibrate_session(
    method: str, added: AddedDisturbance, k: int, seed: int = SEED
) -> graded_calibration.GradedCalibration:
    """Return what inercal says of one session."""
    here = find_case(method)
    rng = np.random.default_rng([seed, k, crc32(f"{method} {added.words}".encode())])
    values = here.draw(rng)
    truth = {name: values[name] for name in here.coefficients}
    if added.memory:
        values |= {"slow": added.size, "memory": added.memory, "of_run": 1.0}
    for axis in "xyz" if added.shape else "":
        size = added.size * rng.uniform(0.5, 1.0) * rng.choice([-1.0, 1.0])
        values[f"a{axis}.drift"] = float(size)
    if added.shape == "exponential":
        values["settling"] = float(np.exp(rng.uniform(np.log(0.1), 0.0)))
    files = dict(here.files(values, rng, None))
    # Where white noise is stated, a warning says that there is more of it: here none is.
    lines = str(files["run.toml"]).splitlines()
    files["run.toml"] = "\n".join(row for row in lines if not row.startswith("white"))
    return graded_calibration.calibrate_files(files, truth)


def _run_job(job: tuple[str, AddedDisturbance, int, int]) -> graded_calibration.GradedCalibration:
    return calibrate_session(*job)


def count_sessions(
    method: str, added: AddedDisturbance, answers: Sequence[graded_calibration.GradedCalibration]
) -> CoverageCount:
    """Return the counts of some sessions."""
    each = [
        sum(abs(error) > 2 for error in one.errors.values()) if one.grade == "consistent" else -1
        for one in answers
    ]
    good = [one.nees for one in answers if one.grade == "consistent"]
    nees = round(float(np.mean(good)), 4) if good else 0.0
    return CoverageCount(method, added.words, len(find_case(method).coefficients), nees, each)


def read_coverage() -> list[CoverageCount]:
    """Return the stored counts."""
    return [CoverageCount(**row) for row in json.loads(DATA.read_text(encoding="utf-8"))["cases"]]


def table_line(one: CoverageCount) -> str:
    """Return one row of the table."""
    return (
        f"| {one.method} | {one.added} | {len(one.each)} | {one.consistent} "
        f"| {one.share:.3f} | {format_number(one.nees if one.consistent else math.nan)} |"
    )


def write_coverage(done: list[CoverageCount]) -> None:
    """Write the data and the page."""
    run: Mapping[str, str | int] = {
        "commit": stored_counts.current_commit(),
        "machine": stored_counts.describe_machine(),
        "seed": SEED,
    }
    cases = ",\n".join("  " + json.dumps(asdict(one), ensure_ascii=False) for one in done)
    head = json.dumps(run, ensure_ascii=False)
    stored_counts.FOLDER.mkdir(exist_ok=True)
    text = f'{{\n "run": {head},\n "cases": [\n{cases}\n]}}\n'
    DATA.write_text(text, encoding="utf-8")
    rows = "\n".join(map(table_line, done))
    page = _PAGE.format(
        most=MAX_SHARE, seed=SEED, rows=rows, commit=run["commit"], machine=run["machine"]
    )
    PAGE.write_text(page, encoding="utf-8")


def main(arguments: list[str]) -> None:
    """Work out all cases and write or print them."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.evidence.noise_coverage", description=__doc__
    )
    parser.add_argument("--methods", nargs="*", default=list(METHODS), choices=METHODS)
    parser.add_argument("--added", default="", help="text that what is added holds")
    parser.add_argument("--sessions", type=int, help="of each case, in place of the stored number")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--processes", type=int, default=cpu_count())
    chosen = parser.parse_args(arguments)
    done: list[CoverageCount] = []
    with Pool(chosen.processes) as pool:
        for method in chosen.methods:
            for added in (one for one in DISTURBANCES if chosen.added in one.words):
                count = chosen.sessions or SESSIONS[method]
                jobs = [(method, added, k, chosen.seed) for k in range(count)]
                done.append(count_sessions(method, added, pool.map(_run_job, jobs, chunksize=5)))
                print(table_line(done[-1]), flush=True)
    whole = list(METHODS), "", None, SEED
    if (chosen.methods, chosen.added, chosen.sessions, chosen.seed) == whole:
        write_coverage(done)


if __name__ == "__main__":
    main(sys.argv[1:])
