"""Find coefficients that were not selected but would explain the scatter between a table's rows.

If rows scatter more than stated, only the rows that agree best with each other are fitted. The
score tests of that fit rank the omitted coefficients, and the first two significant ones are tried.
A coefficient is named if, when it is added, the rows scatter far less or far fewer rows are
outliers. Then the search looks for a second coefficient.
"""

from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.errors import NotObserved
from inercal.basics.run_file_advice import Change
from inercal.benches.centrifuge.bench import Centrifuge
from inercal.estimation import least_squares
from inercal.estimation.scores import SCORE_TEST_SHARE, SIGNIFICANCE_LEVEL
from inercal.methods import Priors
from inercal.methods.centrifuge_norm.problems import norm_problem
from inercal.methods.centrifuge_norm.screening import START_ITERATIONS, Agreement, row_agreement
from inercal.physics.plan import Spins
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations

CANDIDATE_GROUPS = ("k3", "koq", "nonorthogonality")  # observable from norms; as in [method] also
_INLIER_LIMIT = 4.0  # standard deviations; rows beyond this limit are left out of the score tests
_EXPECTED_SCATTER = 1.5  # times the stated scatter; less than this needs no explanation
# Fraction of the scatter, or of the outliers, that may remain if a coefficient explains it
_EXPLAINED_RATIO = 0.5
_TRIED_PER_STEP = 2  # number of coefficients with the best scores that are tried
_MAX_OMITTED = 2  # coefficients that may be omitted at the same time


@dataclass(frozen=True)
class OmittedCoefficients:
    """Coefficients that explain the scatter of the rows.

    Parameters
    ----------
    words : tuple of str
        Names as in [method] also; empty if no coefficient explains the scatter.
    sensor : Sensor
        The sensor with these coefficients added.
    before, agreement : Agreement
        Agreement between the rows, without and with the coefficients.
    """

    words: tuple[str, ...]
    sensor: Sensor
    before: Agreement
    agreement: Agreement

    @property
    def changes(self) -> tuple[Change, ...]:
        """The run-file keys that make the method estimate these coefficients."""
        form = (Change("sensor", "form", self.sensor.form),)
        return (
            Change("method", "also", self.words),
            *(form if "nonorthogonality" in self.words else ()),
        )

    def describe(self) -> str:
        """Return a sentence that describes what the coefficients explain."""
        before, after = self.before, self.agreement
        return (
            f"{', '.join(self.words)} explains the residuals: without it most rows scatter "
            f"{before.noise:.3g} times as much as stated and {before.outlier_rows.size} rows are "
            f"outliers; with it {after.noise:.3g} times and {after.outlier_rows.size}"
        )


def find_omitted_coefficients(
    observations: Observations, sensor: Sensor, bench: Centrifuge, steps: Spins, priors: Priors = ()
) -> OmittedCoefficients:
    """Return the coefficients that explain the scatter; the arguments are as for `screen_rows`.

    Raises
    ------
    NotObserved
        These dwells do not determine all coefficients of the sensor.
    """
    here = before = row_agreement(norm_problem(observations, sensor, bench, steps, priors))
    words: tuple[str, ...] = ()
    while len(words) < _MAX_OMITTED and (here.noise > _EXPECTED_SCATTER or here.outlier_rows.size):
        ranked = _ranked_groups(observations, sensor, bench, steps, priors, here)
        for word in ranked[:_TRIED_PER_STEP]:
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
    return OmittedCoefficients(words, sensor, before, here)


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
    steps: Spins,
    priors: Priors,
    agreement: Agreement,
) -> list[str]:
    """Return the groups of coefficients that were not selected, the most significant first."""
    size = np.abs(agreement.fit.whitened)
    keep: list[int] = np.flatnonzero(size <= _INLIER_LIMIT * agreement.noise).tolist()
    some = observations.rows(keep)
    try:
        # The start is near the minimum, because the retained rows dominated the fit to all rows.
        problem = replace(
            norm_problem(some, sensor, bench, [steps[k] for k in keep], priors),
            start=agreement.fit.value,
        )
        fit = least_squares(problem, max_iterations=START_ITERATIONS)
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
    # Nonlinear terms together with misalignments are only possible in the tilted form.
    return replace(chosen, form="tilted") if word == "nonorthogonality" else chosen
