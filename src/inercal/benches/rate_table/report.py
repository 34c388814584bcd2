"""Report for a rate table: errors of each axis by speed, and the states found in a recording.

The table of states has the rate in r/min and the readings of three axes, with one row per state in
the order of time. With kind = "means" and the table's name in [data] file, the same run file
calibrates from it. Rows are then weighted by their own standard deviations. The table contains
neither correlations of the noise between axes nor drift between rows.
"""

from collections.abc import Sequence
from math import pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.rate_table.bench import sensed_motion
from inercal.benches.rate_table.settings import RateTableData
from inercal.benches.report_data import Columns, Panel, Plot, ReportInput, Series
from inercal.physics.plan import Spin
from inercal.physics.sensors import G0
from inercal.recordings.data import RunBase
from inercal.recordings.data.recording_loader import (
    readback_columns,
    readback_units,
    unsigned_column,
)
from inercal.recordings.io.mean_tables import SD_SUFFIX

_MG = 1e-3 * G0


def plots(shown: ReportInput) -> tuple[Plot, ...]:
    """Plot the deviations from the nominal motion by rate, as in Figs. 3 to 9 of the source."""
    spins = [step for step in shown.steps if isinstance(step, Spin)]
    nominal = sensed_motion(shown.bench, spins, {}).f
    before, after = shown.observations.mean - nominal, shown.sensed_motion().f - nominal
    rates = np.array([abs(step.rate) for step in spins]) * 30 / pi
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
            "Deviations of each axis by speed, before and after correction",
            "Readings of each axis minus the nominal motion in the state, before and after "
            "correction. An error that all speeds of a mounting share comes from its angles.",
            "reading − nominal, mg",
            panels,
        ),
    )


def output_tables(run: RunBase[RateTableData], outcome: ReportInput) -> dict[str, Columns]:
    """Return the table "states" of a recording; a table of means has none.

    The columns for mounting, rate and axes have the names and units in the run's [data]. The
    standard deviations of the means, the whole turns and the seconds follow.
    """
    recording, seen = outcome.recording, outcome.observations
    if recording is None:
        return {}
    assert recording.labels is not None
    order: list[int] = np.argsort([mark.start for mark in outcome.marks], kind="stable").tolist()
    rates = [step.rate for step in outcome.steps if isinstance(step, Spin)]
    sensor = outcome.sensor
    mean = sensor.to_output(seen.mean)
    scale = np.array([abs(axis.readout.scale) for axis in sensor.axes])
    sd = np.sqrt(np.diagonal(seen.covariance, axis1=-2, axis2=-1)) * scale
    data, size = run.data, readback_units(run)["arm_rate"]
    turns = [round(abs(w) * t / (2 * pi)) for w, t in zip(rates, seen.duration, strict=True)]
    mounting = [str(recording.labels[mark.start]).strip() for mark in outcome.marks]
    axes = [unsigned_column(column) for column in data.accelerometer]
    columns: dict[str, Sequence[str] | Sequence[float] | Sequence[int]] = {
        str(data.mounting): [mounting[k] for k in order],
        readback_columns(run)["arm_rate"]: _rounded(np.array(rates)[order] / size),
    }
    for suffix, values in (("", mean), (SD_SUFFIX, sd)):
        columns |= {a + suffix: _rounded(values[order, k]) for k, a in enumerate(axes)}
    columns["turns"] = [turns[k] for k in order]
    columns["seconds"] = _rounded(seen.duration[order])
    return {"states": columns}


def _rounded(values: Array) -> list[float]:
    """Round numbers to twelve digits, which avoids "45.99999999999999"."""
    return [float(f"{value:.12g}") for value in values]
