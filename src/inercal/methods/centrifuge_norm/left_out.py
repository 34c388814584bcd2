"""Coefficients that were not chosen and would explain why the rows of a table scatter.

Where rows scatter more than stated, those that agree best with one another are fitted alone, and
the score tests of that fit rank what was left out. The first two that are significant are tried: a
coefficient counts where the rows scatter far less with it, or far fewer stand out. A second one may
follow the first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inercal.benches.centrifuge import Centrifuge
from inercal.errors import NotObserved
from inercal.estimate import Gaussian, least_squares
from inercal.estimate.scores import LEVEL, SHARE
from inercal.methods.centrifuge_norm.problems import by_norm
from inercal.methods.centrifuge_norm.screening import Agreement, agreement
from inercal.plan import Spin
from inercal.recording import Observations
from inercal.sensors import Sensor

WORDS = ("k3", "koq", "nonorthogonality")  # that norms show, as [method] also takes them
_CLOSE = 4.0  # deviations of most rows; farther ones are left out of the score tests
_QUIET = 1.5  # scatter over what is stated that needs no explanation
_LESS = 0.5  # of scatter, or of outlying rows, that is left where a coefficient explains it
_TRIED = 2  # coefficients with the best scores
_TOGETHER = 2  # coefficients that are left out at a time


@dataclass(frozen=True)
class LeftOut:
    """Coefficients that explain the scatter of the rows.

    Parameters
    ----------
    words : tuple of str
        As [method] also takes them; empty where none explains it.
    sensor : Sensor
        With them.
    before, after : float
        Scatter of most rows over what is stated, without and with them.
    standing_out : tuple of two int
        Rows that stand out from the others, without and with them.
    agreement : Agreement
        Of the rows, with them.
    """

    words: tuple[str, ...]
    sensor: Sensor
    before: float
    after: float
    standing_out: tuple[int, int]
    agreement: Agreement

    def in_words(self) -> str:
        """Return the key to set, and what it explains."""
        names = ", ".join(f'"{word}"' for word in self.words)
        return (
            f"[method] also = [{names}] explains the residuals: without it most rows scatter "
            f"{self.before:.3g} times as much as stated and {self.standing_out[0]} stand out, with "
            f"it {self.after:.3g} times and {self.standing_out[1]}"
        )


def left_out(
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian] = (),
) -> LeftOut:
    """Return the coefficients that explain why the rows scatter; arguments as of `screen`.

    Raises
    ------
    NotObserved
        Coefficients of the sensor that these dwells leave open.
    """
    here = before = agreement(by_norm(observations, sensor, bench, steps, priors))
    words: tuple[str, ...] = ()
    while len(words) < _TOGETHER and (here.noise > _QUIET or here.outlying.size):
        for word in _ranked(observations, sensor, bench, steps, priors, here)[:_TRIED]:
            larger = _with(sensor, word)
            try:
                there = agreement(by_norm(observations, larger, bench, steps, priors))
            except NotObserved:
                continue
            if _explains(here, there):
                here, sensor, words = there, larger, (*words, word)
                break
        else:
            break
    outlying = (before.outlying.size, here.outlying.size)
    return LeftOut(words, sensor, before.noise, here.noise, outlying, here)


def _explains(before: Agreement, after: Agreement) -> bool:
    quieter = after.noise < _LESS * before.noise and not after.hopeless
    fewer = after.outlying.size < _LESS * before.outlying.size and after.noise <= before.noise
    return quieter or fewer


def _ranked(
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian],
    found: Agreement,
) -> list[str]:
    """Return the words that the sensor lacks, those first whose score test explains most."""
    size = np.abs(found.fit.whitened)
    keep: list[int] = np.flatnonzero(size <= _CLOSE * found.noise).tolist()
    some = observations.rows(keep)
    try:
        fit = least_squares(by_norm(some, sensor, bench, [steps[k] for k in keep], priors))
    except NotObserved:
        return []
    scores = [
        score
        for score in fit.scored.scores
        if score.name in WORDS and fit.scored.adjusted(score) < SHARE * LEVEL
    ]
    return [score.name for score in sorted(scores, key=lambda score: -score.chi2)]


def _with(sensor: Sensor, word: str) -> Sensor:
    chosen = sensor.with_coefficients(*sensor.coefficients, word)
    # The tilted form takes nonlinear terms and misalignments together.
    return replace(chosen, form="tilted") if word == "nonorthogonality" else chosen
