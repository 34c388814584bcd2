"""What a simulated turntable writes: the numbers of its holds, and a readback of its own file."""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil, floor

import numpy as np

from inercal.benches.contract import SimulatedMotion
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.rest_timing import settling_time
from inercal.benches.turntable.settings import HOLD_COLUMN, TurntableData
from inercal.benches.turntable.simulation import path_profile, sample_readback
from inercal.data import Source
from inercal.data.recording_loader import readback_columns, readback_units
from inercal.plan import Position, TableStep, table_steps
from inercal.recording import Recording
from inercal.units import si_factor

_MARGIN_SECONDS = 0.5  # s


def add_hold_numbers(
    bench: Turntable, steps: Sequence[TableStep], done: SimulatedMotion
) -> SimulatedMotion:
    """Return a simulation with the number of the hold of each sample, as a bench host writes it."""
    number = np.full(done.time.size, -1.0)
    for k, step in enumerate(one for one in steps if isinstance(one, Position)):
        time = done.time[done.labels == step.label]
        aside = settling_time(bench)
        number[(done.time >= time[0] + aside) & (done.time <= time[-1] - aside)] = k
    return replace(done, readback={**done.readback, HOLD_COLUMN: number})


def readback_files(
    run: Source[TurntableData], done: SimulatedMotion, rng: np.random.Generator
) -> dict[str, Recording]:
    """Return the readback by the table's clock, as its file has it, if it has its own.

    The clock is ahead by the bench's latency, and gains as its clock does. The file begins before
    the recording and ends after it, as by hand.
    """
    bench, data, rate = run.bench, run.data, run.rate_hz
    if data.table_file is None:
        return {}
    assert rate is not None
    q = {name: values[0] for name, values in done.bench_errors.items()}
    first, last = ((t + q["latency"]) / (1 - q["clock"]) for t in (0.0, float(done.time[-1])))
    ticks = range(
        floor((first - _MARGIN_SECONDS) * rate), ceil((last + _MARGIN_SECONDS) * rate) + 1
    )
    stamps = np.array(ticks) / rate
    angles = sample_readback(bench, path_profile(bench, table_steps(run.steps)), stamps, q, rng)
    sizes = np.array([readback_units(run)[name] for name in bench.names])
    table = Recording(
        time=stamps / si_factor(data.table_time_unit, "s"),
        data=angles / sizes,
        channels=tuple(readback_columns(run)[name] for name in bench.names),
        units=(data.table_unit,) * len(sizes),
        time_name=str(data.table_time),
    )
    return {data.table_file: table}
