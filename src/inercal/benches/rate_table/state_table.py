"""The states of a recording on a rate table, as the table of means that they make.

r/min against three axes, one row a state in the order of time. With kind = "means" and its name in
[data] file the same run file calibrates from it, the rows weighed by their own deviations. What
the table does not hold are correlations of the noise between axes, and drift between rows.
"""

from collections.abc import Sequence
from math import pi

import numpy as np

from inercal.benches.rate_table.settings import RateTableData
from inercal.benches.report_data import Columns, ReportInput
from inercal.data import Source
from inercal.data.recording_loader import readback_columns, readback_units, unsigned_column
from inercal.io.mean_tables import SD_SUFFIX
from inercal.plan import Spin

TURNS, SECONDS = "turns", "seconds"


def output_tables(run: Source[RateTableData], shown: ReportInput) -> dict[str, Columns]:
    """Return the table of the states of a recording, "states"; none of means."""
    return {} if shown.recording is None else {"states": state_columns(run, shown)}


def state_columns(run: Source[RateTableData], outcome: ReportInput) -> Columns:
    """Return the columns of the table, by name.

    Mounting, rate and axes have the names and the units of the run's [data]; behind them come the
    standard deviations of the means, whole turns and seconds.

    Parameters
    ----------
    run : Run
        On a rate table.
    outcome : ReportInput
        Of a recording.
    """
    recording, seen = outcome.recording, outcome.observations
    assert recording is not None
    assert recording.labels is not None
    order: list[int] = np.argsort([mark.start for mark in outcome.marks], kind="stable").tolist()
    rates = [step.rate for step in outcome.steps if isinstance(step, Spin)]
    sensor = outcome.calibration.sensor
    mean = sensor.to_output(seen.mean)
    scale = np.array([abs(axis.readout.scale) for axis in sensor.axes])
    sd = np.sqrt(np.diagonal(seen.covariance, axis1=-2, axis2=-1)) * scale
    data, size = run.data, readback_units(run)["arm_rate"]
    turns = [round(abs(w) * t / (2 * pi)) for w, t in zip(rates, seen.duration, strict=True)]
    mounting = [str(recording.labels[mark.start]).strip() for mark in outcome.marks]
    axes = [unsigned_column(column) for column in data.accelerometer]
    found: dict[str, Sequence[str] | Sequence[float] | Sequence[int]] = {
        str(data.mounting): [mounting[k] for k in order],
        readback_columns(run)["arm_rate"]: _round_values([rates[k] / size for k in order]),
    }
    found |= {name: _round_values(mean[order, k].tolist()) for k, name in enumerate(axes)}
    found |= {name + SD_SUFFIX: _round_values(sd[order, k].tolist()) for k, name in enumerate(axes)}
    seconds = _round_values(seen.duration[order].tolist())
    return found | {TURNS: [turns[k] for k in order], SECONDS: seconds}


def _round_values(values: Sequence[float]) -> list[float]:
    """Return numbers of twelve digits: far below the deviations, and no "45.99999999999999"."""
    return [float(f"{value:.12g}") for value in values]
