"""Studies that recompute source papers: tables, figures and claims, judged by the numbers.

A study is a module with a function `run(trials, seed, say, executor)`. To add a study, add a line
to `STUDIES`.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from math import isfinite
from pathlib import Path
from typing import Any

from inercal.basics.atomic_files import make_folder, write_text
from inercal.basics.errors import InputError, require_extra
from inercal.basics.parallel import Executor, SerialExecutor
from inercal.studies.claim import Claim, ClaimResult, judge_claim
from inercal.studies.study import MessageCallback, Study

STUDIES: Mapping[str, str] = {
    "centrifuge": "inercal.studies.centrifuge",
    "dual-orthogonal": "inercal.studies.dual_orthogonal",
    "one-sensor": "inercal.studies.one_sensor",
    "ship-model": "inercal.studies.ship_model",
    "turntable": "inercal.studies.turntable",
}
"""Names of the studies, and the modules that run them."""
TRIALS = 4000
_MIN_TRIALS = 20


def _discard_message(_: str) -> None:
    """Ignore progress messages."""


def reproduce(
    name: str,
    trials: int = TRIALS,
    seed: int = 0,
    say: MessageCallback = _discard_message,
    executor: Executor | None = None,
) -> Study:
    """Recompute a source paper, and return the study.

    Parameters
    ----------
    name : str
        Name of a study, a key of `STUDIES`.
    trials : int
        Number of Monte Carlo trials; slower estimators use fewer.
    seed : int
    say : callable
        Function that receives progress messages.
    executor : Executor, optional
        Executor for the computation; by default it runs in this process. The result does not depend
        on it.

    Raises
    ------
    InputError
        No study has this name, or there are fewer than 20 trials.
    """
    name = name.replace("_", "-")
    if name not in STUDIES:
        raise InputError(
            f"no study {name!r}; the studies are {', '.join(STUDIES)}. A bundle is a file whose "
            "name ends in .zip",
            key="name",
            names=(name,),
        )
    if trials < _MIN_TRIALS:
        raise InputError(
            f"{trials} trials are too few for a verdict; give {_MIN_TRIALS} or more", key="--trials"
        )
    if seed < 0:
        raise InputError(f"seed is {seed}; give a whole number, 0 or more", key="--seed")
    run: Callable[..., Study] = import_module(STUDIES[name]).run
    return run(trials, seed, say, executor or SerialExecutor())


def results_as_list(study: Study) -> list[dict[str, Any]]:
    """Return the findings as `inercal reproduce --json` prints them, with null if not finite.

    "printed" is also null if the source prints no number; "expected" is then the number implied by
    its words or by a printed formula.
    """
    return [
        {
            "claim": finding.claim.title,
            "printed": finding.claim.printed,
            "expected": finding.claim.expected,
            "computed": finding.computed if isfinite(finding.computed) else None,
            "uncertainty": finding.uncertainty if isfinite(finding.uncertainty) else None,
            "verdict": finding.verdict,
        }
        for finding in study.findings
    ]


def write_study(study: Study, folder: str | Path) -> Path:
    """Write the study as one HTML page, NAME.study.html, and return its path.

    The file is written completely or not at all.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing, or the file cannot be written.
    """
    packages = ("matplotlib", "jinja2", "markupsafe")
    with require_extra("report", "the page of a study needs matplotlib and jinja2", packages):
        from inercal.studies.study_page import render_study
    folder = Path(folder)
    make_folder(folder)
    return write_text(folder / f"{study.name}.study.html", render_study(study))


__all__ = [
    "STUDIES",
    "Claim",
    "ClaimResult",
    "Study",
    "judge_claim",
    "reproduce",
    "results_as_list",
    "write_study",
]
