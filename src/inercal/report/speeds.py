"""What each axis reads beyond what it felt on a rate table, by speed: as it came, and corrected."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from math import pi

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from inercal.benches import RateTable
from inercal.benches.rate_table import felt
from inercal.pipeline import Outcome
from inercal.plan import Spin
from inercal.report import drawing
from inercal.report.drawing import AXES, FAINT, MUTED, PAPER, SHAPES, svg
from inercal.sensors import G0

Array = NDArray[np.float64]
_MG = 1e-3 * G0


def deviations(outcome: Outcome, bench: RateTable) -> tuple[Array, Array, Array]:
    """Return the rates, (r,) r/min, and what readings are off as they came and corrected, (r, 3).

    In m/s², against what was felt nominally: the errors of mountings are in both.
    """
    spins = [step for step in outcome.steps if isinstance(step, Spin)]
    made = felt(bench, spins, {}).f
    mean, corrected = outcome.observations.mean, outcome.felt().f
    rates = np.array([abs(step.rate) for step in spins]) * 30 / pi
    return rates, mean - made, corrected - made


@drawing.style
def speeds(outcome: Outcome, bench: RateTable) -> Markup:
    """Return the deviations of each axis against the rate, as in the source's Figs. 3 to 9."""
    rates, before, after = deviations(outcome, bench)
    figure, rows = drawing.panels(1.9, [0.45], 3)
    reach = 1.15 * float(np.abs(np.concatenate([before, after])).max()) / _MG
    for k, axes in enumerate(rows[0]):
        axes.axhline(0, color=FAINT, lw=0.8, zorder=0)
        axes.plot(rates, before[:, k] / _MG, "o", ms=4.5, mfc="none", mec=MUTED, mew=0.8, ls="none",
                  label="as read")  # fmt: skip
        axes.plot(rates, after[:, k] / _MG, SHAPES[k % 3], ms=4.5, mfc=AXES[k % 3], mec=PAPER,
                  mew=0.4, ls="none", label="corrected")  # fmt: skip
        axes.set_ylim(-reach, reach)
        axes.set_title(outcome.observations.channels[k])
        axes.set_xlabel("r/min")
        drawing.key(axes)
    rows[0][0].set_ylabel("beyond what was felt, mg")
    return svg(figure, "speeds", "Deviations of each axis by speed, as read and corrected")
