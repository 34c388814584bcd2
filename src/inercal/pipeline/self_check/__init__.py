"""Run each method on stored data, and compare its results with stored answers (self-check).

A laboratory must validate software before using it, and after each change of program, libraries or
machine (ISO/IEC 17025:2017, 7.11.2). Some cases use a stored table of means. The other cases use a
recording that is simulated from a stored run file and seed, so its true coefficients are known.
`answers.json` contains the stored results of all cases. `python -m tools.self_check_answers` writes
this file.
"""

import json
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from importlib.resources import as_file, files
from pathlib import Path
from shutil import copytree
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.special import chdtrc  # pyright: ignore[reportMissingTypeStubs]

from inercal.basics.arrays import Array
from inercal.basics.errors import InercalError, InputError
from inercal.calibration import Calibration
from inercal.calibration.comparison import largest_change
from inercal.pipeline import calibrate, simulate_files
from inercal.recordings.io.write import write_recordings
from inercal.runfile import read

CASES = {
    "six_position": "six_position",
    "ferraris": "ferraris",
    "multi_position": "multi_position",
    "field_and_rates": "field_and_rates",
    "centrifuge_norm": "centrifuge_norm",
    "tumble": "tumble",
    "dual_orthogonal": "dual_orthogonal",
    "rates_and_poses": "rates_and_poses",
    "ship_planar": "ship_planar",
    "ship_multi_angle": "ship_multi_angle",
    "turntable_kalman": "turntable",
    "turntable_discrete": "turntable",
    "turntable_trajectory": "turntable",
    "systematic": "systematic",
    "temperature_ramp": "temperature_ramp",
}
"""The run file with data for each method; its [method] is replaced by the method's name."""
TOLERANCE = 0.01
"""Largest permitted difference of a value or u from the stored one, in units of the stored u."""
LEAST_PROBABILITY = 1e-4
"""A simulated case fails if the probability of the χ² of its errors is below this limit."""
_SEED = 0
_LIBRARIES = ("numpy", "scipy", "numba", "pydantic")
_HEADS = (
    "method",
    "coefficients",
    "difference",
    "probability",
    "verdict",
    "time",
    "result",
)  # of the report


@dataclass(frozen=True)
class CaseResult:
    """The result of one case.

    Parameters
    ----------
    method : str
    coefficients : int
    deviation : float
        Largest difference of a value or its u from the stored answer, in units of the stored u; NaN
        if there is no result.
    probability : float or None
        Probability of a χ² at least as large, where χ² is computed from the errors relative to the
        true values; None for stored tables.
    grade : str
        Grade of the verdict.
    seconds : float
    reason : str
        Reason why the case failed; empty if it passed.
    """

    method: str
    coefficients: int
    deviation: float
    probability: float | None
    grade: str
    seconds: float
    reason: str

    @property
    def passed(self) -> bool:
        """Whether the case passed."""
        return not self.reason


@dataclass(frozen=True)
class SelfCheck:
    """The results of all cases, with date, versions and machine."""

    begun: str
    versions: Mapping[str, str]
    machine: Mapping[str, str]
    stored_with: Mapping[str, str]
    results: tuple[CaseResult, ...]

    @property
    def passed(self) -> bool:
        """Whether all cases passed."""
        return all(one.passed for one in self.results)

    def as_object(self) -> dict[str, Any]:
        """Return all results as a JSON object."""
        results = [asdict(one) | {"passed": one.passed} for one in self.results]
        return {**asdict(self), "tolerance": TOLERANCE, "passed": self.passed, "results": results}


def self_check(
    methods: tuple[str, ...] = (), progress: Callable[[str], None] | None = None
) -> SelfCheck:
    """Run the cases of the given methods, or of all methods.

    Parameters
    ----------
    methods : tuple of str
        Names of the methods; empty means all methods.
    progress : callable or None
        Function called with the name of each method before its case starts.

    Raises
    ------
    InputError
        If a method has no case.
    """
    for name in methods:
        if name not in CASES:
            raise InputError(
                f"--method {name}: no case has this method; choose from {', '.join(CASES)}",
                key="--method",
                names=(name,),
            )
    answers = stored_answers()
    begun = datetime.now(UTC).isoformat(timespec="seconds")
    results: list[CaseResult] = []
    with TemporaryDirectory() as name:
        folder = copy_cases(Path(name) / "cases")
        for method in methods or CASES:
            if progress is not None:
                progress(method)
            results.append(_check(method, folder, answers["cases"][method]))
    return SelfCheck(begun, versions(), machine(), answers["versions"], tuple(results))


def versions() -> dict[str, str]:
    """Return the versions of inercal and of the numerical libraries."""
    return {name: version(name) for name in ("inercal", *_LIBRARIES)}


def machine() -> dict[str, str]:
    """Return a description of the machine: system, processor and Python."""
    return {
        "system": f"{platform.system()} {platform.release()}",
        "processor": platform.machine(),
        "python": platform.python_version(),
    }


def stored_answers() -> dict[str, Any]:
    """Return the stored answers: versions, and the values and u of each case."""
    text = files("inercal.pipeline.self_check").joinpath("answers.json").read_text(encoding="utf-8")
    return json.loads(text)


def copy_cases(folder: Path) -> Path:
    """Copy the stored run files and tables to a new folder, and return it."""
    with as_file(files("inercal.pipeline.self_check").joinpath("cases")) as stored:
        return Path(copytree(stored, folder))


def compute(method: str, folder: Path) -> tuple[Calibration, str, Array | None]:
    """Run a case; return the calibration, the grade and, for a simulation, the true values."""
    path = folder / f"{CASES[method]}.toml"
    text = path.read_text(encoding="utf-8")
    own = folder / f"{method}.toml"
    own.write_text(text.replace('name = "turntable_kalman"', f'name = "{method}"'), "utf-8")
    run = read(own)
    if run.truth and not run.file(run.data.file).exists():
        made = simulate_files(run, _SEED)
        write_recordings({run.file(name): one for name, one in made.items()})
    outcome = calibrate(run)
    calibration = outcome.calibration
    names = calibration.sensor.coefficients
    truth = np.array([run.truth.get(name, 0.0) for name in names]) if run.truth else None
    return calibration, outcome.verdict.grade, truth


def _check(method: str, folder: Path, answer: Mapping[str, Any]) -> CaseResult:
    begin = time.perf_counter()
    try:
        calibration, grade, truth = compute(method, folder)
    except InercalError as error:
        seconds = time.perf_counter() - begin
        return CaseResult(method, 0, np.nan, None, "", seconds, f"no result: {error}")
    names = calibration.sensor.coefficients
    stored = (np.array(answer[key]) for key in ("values", "u"))
    deviation = largest_change(calibration, answer["names"], *stored)
    probability = None if truth is None else _probability(calibration, truth)
    reasons = list(_reasons(grade, deviation, probability, answer))
    seconds = time.perf_counter() - begin
    return CaseResult(
        method, len(names), deviation, probability, grade, seconds, "; ".join(reasons)
    )


def _probability(calibration: Calibration, truth: Array) -> float:
    error = calibration.values - truth
    chi2 = float(error @ np.linalg.solve(calibration.covariance, error))
    return float(chdtrc(error.size, chi2))


def _reasons(
    grade: str, deviation: float, probability: float | None, answer: Mapping[str, Any]
) -> Iterator[str]:
    if not deviation <= TOLERANCE:
        yield f"differs from the stored answer by {deviation:.2g} u; the limit is {TOLERANCE} u"
    if grade != answer["grade"]:
        yield f"the verdict is {grade!r}, but the stored one is {answer['grade']!r}"
    if probability is not None and not probability >= LEAST_PROBABILITY:
        yield f"disagrees with the true values of the simulation (p = {probability:.1g})"


def report_text(check: SelfCheck) -> str:
    """Return the report as text: date, versions, machine, a line for each method, and failures."""
    rows = [_HEADS, *(_cells(one) for one in check.results)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(_HEADS))]
    table = [
        "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows
    ]
    failed = [f"{one.method}: {one.reason}" for one in check.results if one.reason]
    passed = len(check.results) - len(failed)
    return "\n".join(
        [
            "Self-check of inercal: known answers",
            "",
            f"begun         {check.begun}",
            f"versions      {_words(check.versions)}",
            f"machine       {_words(check.machine)}",
            f"answers with  {_words(check.stored_with)}",
            f"tolerance     {TOLERANCE} u from the stored answers, of values and of u",
            "",
            *table,
            "",
            *failed,
            f"{passed} of {len(check.results)} methods passed",
            "",
        ]
    )


def _cells(one: CaseResult) -> tuple[str, ...]:
    probability = "" if one.probability is None else f"{one.probability:.3f}"
    difference = "" if one.coefficients == 0 else f"{one.deviation:.1e} u"
    verdict, count = one.grade, str(one.coefficients)
    result = "passed" if one.passed else "FAILED"
    return one.method, count, difference, probability, verdict, f"{one.seconds:.1f} s", result


def _words(facts: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {value}" for name, value in facts.items())
