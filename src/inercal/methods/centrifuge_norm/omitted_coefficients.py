"""Coefficients that were not chosen and would explain why the rows of a table scatter.

Where rows scatter more than stated, those that agree best with one another are fitted alone, and
the score tests of that fit rank what was left out. The first two that are significant are tried: a
coefficient counts where the rows scatter far less with it, or far fewer stand out. A second one may
follow the first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inercal.benches.centrifuge.bench import Centrifuge
from inercal.errors import NotObserved
from inercal.estimate import Gaussian, least_squares
from inercal.estimate.scores import SCORE_TEST_SHARE, SIGNIFICANCE_LEVEL
from inercal.methods.centrifuge_norm.problems import norm_problem
from inercal.methods.centrifuge_norm.screening import Agreement, row_agreement
from inercal.plan import Spin
from inercal.recording import Observations
from inercal.sensors import Sensor

CANDIDATE_GROUPS = ("k3", "koq", "nonorthogonality")  # that norms show, as [method] also takes them
_INLIER_LIMIT = 4.0  # deviations of most rows; farther ones are left out of the score tests
_EXPECTED_SCATTER = 1.5  # scatter over what is stated that needs no explanation
# Of scatter, or of outlying rows, that is left where a coefficient explains it
_EXPLAINED_RATIO = 0.5
_TRIED_PER_STEP = 2  # coefficients with the best scores
_MAX_OMITTED = 2  # coefficients that are left out at a time


@dataclass(frozen=True)
class OmittedCoefficients:
    """Coefficients that explain the scatter of the rows.

    Parameters
    ----------
    words : tuple of str
        As [method] also takes them; empty where none explains it.
    sensor : Sensor
        With them.
    before, after : float
        Scatter of most rows over what is stated, without and with them.
    outlier_counts : tuple of two int
        Rows that stand out from the others, without and with them.
    agreement : Agreement
        Of the rows, with them.
    """

    words: tuple[str, ...]
    sensor: Sensor
    before: float
    after: float
    outlier_counts: tuple[int, int]
    agreement: Agreement

    def describe(self) -> str:
        """Return the key to set, and what it explains."""
        names = ", ".join(f'"{word}"' for word in self.words)
        return (
            f"[method] also = [{names}] explains the residuals: without it most rows scatter "
            f"{self.before:.3g} times as much as stated and {self.outlier_counts[0]} stand out, "
            f"with it {self.after:.3g} times and {self.outlier_counts[1]}"
        )


def find_omitted_coefficients(
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian] = (),
) -> OmittedCoefficients:
    """Return the coefficients that explain why the rows scatter; arguments as of `screen_rows`.

    Raises
    ------
    NotObserved
        Coefficients of the sensor that these dwells leave open.
    """
    here = before = row_agreement(norm_problem(observations, sensor, bench, steps, priors))
    words: tuple[str, ...] = ()
    while len(words) < _MAX_OMITTED and (here.noise > _EXPECTED_SCATTER or here.outlier_rows.size):
        for word in _ranked_groups(observations, sensor, bench, steps, priors, here)[
            :_TRIED_PER_STEP
        ]:
            larger = _with_coefficients(sensor, word)
            try:
                there = row_agreement(norm_problem(observations, larger, bench, steps, priors))
            except NotObserved:
                continue
            if _explains_scatter(here, there):
                here, sensor, words = there, larger, (*words, word)
                break
        else:
            break
    outlying = (before.outlier_rows.size, here.outlier_rows.size)
    return OmittedCoefficients(words, sensor, before.noise, here.noise, outlying, here)


def _explains_scatter(before: Agreement, after: Agreement) -> bool:
    quieter = after.noise < _EXPLAINED_RATIO * before.noise and not after.inconsistent
    fewer = (
        after.outlier_rows.size < _EXPLAINED_RATIO * before.outlier_rows.size
        and after.noise <= before.noise
    )
    return quieter or fewer


def _ranked_groups(
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian],
    found: Agreement,
) -> list[str]:
    """Return the words that the sensor lacks, those first whose score test explains most."""
    size = np.abs(found.fit.whitened)
    keep: list[int] = np.flatnonzero(size <= _INLIER_LIMIT * found.noise).tolist()
    some = observations.rows(keep)
    try:
        fit = least_squares(norm_problem(some, sensor, bench, [steps[k] for k in keep], priors))
    except NotObserved:
        return []
    scores = [
        score
        for score in fit.score_tests.scores
        if score.name in CANDIDATE_GROUPS
        and fit.score_tests.adjusted(score) < SCORE_TEST_SHARE * SIGNIFICANCE_LEVEL
    ]
    return [score.name for score in sorted(scores, key=lambda score: -score.chi2)]


def _with_coefficients(sensor: Sensor, word: str) -> Sensor:
    chosen = sensor.with_coefficients(*sensor.coefficients, word)
    # The tilted form takes nonlinear terms and misalignments together.
    return replace(chosen, form="tilted") if word == "nonorthogonality" else chosen
