"""The dividing head as the accelerometers saw it: by how much it stood beyond its angles."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from math import degrees, pi

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from inercal.benches import DividingHead
from inercal.benches.dividing_head.head_angles import angles
from inercal.benches.dividing_head.passes import pass_names, passes
from inercal.calibration.verdict import COVERAGE
from inercal.pipeline import Outcome
from inercal.plan import Index
from inercal.report import drawing
from inercal.report.drawing import AXES, FAINT, PAPER, SHAPES, svg
from inercal.sensors import G0

Array = NDArray[np.float64]
_ARCSEC = pi / 648_000


def steps_of(outcome: Outcome) -> list[Index]:
    """Return the positions of the head."""
    return [step for step in outcome.steps if isinstance(step, Index)]


def beyond(outcome: Outcome, bench: DividingHead) -> tuple[Array, Array]:
    """Return the found angles beyond the stated ones and their deviations, (r,) each, rad.

    About their mean, which cannot be told from the mounting angles. Empty where the estimator
    finds no angles.
    """
    steps, estimate = steps_of(outcome), outcome.estimate
    weights = {n: w for n, w in angles(bench, steps).weights.items() if n in estimate.names}
    if not weights:
        return np.zeros(0), np.zeros(0)
    rows = np.stack(list(weights.values()), axis=-1)
    rows = rows - rows.mean(axis=0)
    found = estimate.select(tuple(weights))
    variance = np.einsum("rk,kl,rl->r", rows, found.covariance, rows)
    return rows @ found.value, np.sqrt(variance)


@drawing.style
def head(outcome: Outcome, bench: DividingHead) -> Markup | None:
    """Return the found angles against the head's, pass by pass; None where none were found."""
    error, sd = beyond(outcome, bench)
    if not error.size:
        return None
    steps = steps_of(outcome)
    which = np.array(passes(steps))
    turned = np.array([degrees(step.angle) % 360 for step in steps])
    figure, ((axes,),) = drawing.panels(2.0, [0.45])
    axes.axhline(0, color=FAINT, lw=0.8, zorder=0)
    names = pass_names(steps)
    for k, name in enumerate(names):
        own = which == k
        shift = 3.0 * (k - (len(names) - 1) / 2)
        axes.errorbar(turned[own] + shift, error[own] / _ARCSEC,
                      yerr=COVERAGE * sd[own] / _ARCSEC, fmt=SHAPES[k % 3], ms=4.5,
                      mfc=AXES[k % 3], mec=PAPER, mew=0.4, ecolor=AXES[k % 3], elinewidth=0.8,
                      label=name)  # fmt: skip
    axes.set_xlim(-12, 372)
    axes.set_xticks(range(0, 361, 30))
    axes.set_xlabel("angle of the head, °")
    axes.set_ylabel("beyond it, ″")
    drawing.key(axes)
    return svg(figure, "head", "Angles of the head beyond those stated, with ±2 uncertainties")


def in_words(step: Index, outcome: Outcome, row: int) -> str:
    """Return what a position was and what was read there: "head at 30°, forward; a 0.5 g"."""
    text = step.in_words()
    if step.level:
        text += f"; level {step.level / _ARCSEC:+.2f}″"
    if step.reading:
        text += f"; autocollimator {step.reading / _ARCSEC:+.2f}″"
    observed = outcome.observations
    readings = [
        f"{channel} {value / G0:.7f} g"
        for channel, value in zip(observed.channels, observed.mean[row].tolist(), strict=True)
    ]
    return f"{text}; {', '.join(readings)}"
