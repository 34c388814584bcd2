"""Errors of each axis on a rate table by speed: of the raw and of the corrected readings."""

from math import pi

import numpy as np

from inercal.arrays import Array
from inercal.benches.rate_table.bench import sensed_motion
from inercal.benches.report_data import Panel, Plot, ReportInput, Series
from inercal.plan import Spin
from inercal.sensors import G0

_MG = 1e-3 * G0


def deviations(shown: ReportInput) -> tuple[Array, Array, Array]:
    """Return the rates, (r,) r/min, and what readings are off as they came and corrected, (r, 3).

    In m/s², against the sensed motion nominally: the errors of mountings are in both.
    """
    spins = [step for step in shown.steps if isinstance(step, Spin)]
    result = sensed_motion(shown.bench, spins, {}).f
    mean, corrected = shown.observations.mean, shown.sensed_motion().f
    rates = np.array([abs(step.rate) for step in spins]) * 30 / pi
    return rates, mean - result, corrected - result


def plots(shown: ReportInput) -> tuple[Plot, ...]:
    """Return the deviations of each axis against the rate, as in the source's Figs. 3 to 9."""
    rates, before, after = deviations(shown)
    panels = tuple(
        Panel(
            channel,
            "r/min",
            (
                Series(rates, before[:, k] / _MG, "as read", hollow=True),
                Series(rates, after[:, k] / _MG, "corrected"),
            ),
        )
        for k, channel in enumerate(shown.observations.channels)
    )
    return (
        Plot(
            "speeds",
            "Deviations of each axis by speed, as read and corrected",
            "What each axis reads beyond what its state makes it feel nominally, as read and "
            "corrected. What is left at all speeds of a mounting is how it stood.",
            "beyond the sensed motion, mg",
            panels,
        ),
    )
