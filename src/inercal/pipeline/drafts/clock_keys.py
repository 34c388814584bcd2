"""Draft the keys of the clock: the column of times and its unit, or the sampling rate."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.physics.section_settings import positive_value
from inercal.pipeline.drafts.column_names import role_of_name, run_file_column, time_unit
from inercal.pipeline.drafts.column_roles import STATED, ColumnRoles
from inercal.pipeline.drafts.draft_entries import UNKNOWN, DraftKey
from inercal.pipeline.drafts.readouts import GuessedReadout
from inercal.recordings import Recording
from inercal.recordings.data.recording_loader import require_same_rate
from inercal.recordings.io.audit import burst_findings
from inercal.recordings.io.column_table import Table
from inercal.recordings.io.row_checks import shared_stamps_text
from inercal.recordings.io.time_stamps import (
    SAME_RATE,
    is_iso_time,
    mean_rate,
    times_from_iso,
    times_from_origin,
)
from inercal.recordings.io.wrapped_numbers import unwrap_stamps, wrap_modulus
from inercal.recordings.samples import mean_step

_TIME_UNITS = ("s", "ms", "µs", "ns")
_RATES = (1.0, 20e3)  # Hz, plausible sampling rates of IMUs
RATE_QUESTION = 'the sampling rate, such as "100 Hz"'
_YEAR_2001 = 1e9  # s since 1970
_ROUNDED_STEPS = 1e-3  # the mean of rounded steps may differ from their median, relative


def clock_keys(
    table: Table, roles: ColumnRoles, stated: Mapping[str, str]
) -> tuple[Array | None, tuple[DraftKey, ...]]:
    """Return the times in s, if they are known, and the keys for the clock."""
    if roles.means:
        return None, ()
    name = roles.single.get("time")
    rate = stated.get("data.rate")
    hertz = None if rate is None else positive_value(rate, "Hz", "[data] rate")
    by_rate = None if hertz is None else np.arange(table.rows) / hertz
    rate_key = DraftKey("data", "rate", rate or UNKNOWN, "as stated" if rate else "", RATE_QUESTION)
    if name is None:
        if why := _standing_stamps(table):
            rate_key = replace(rate_key, ask=f"{RATE_QUESTION}; {why}")
        return by_rate, (rate_key,)
    entry = DraftKey("data", "time", run_file_column(name), roles.reasons.get("time", ""))
    column = table.columns[name]
    if column.dtype.kind == "U":
        seconds, _ = times_from_iso(column.tolist(), name, table)
        step = _require_steps(table, name, seconds, "s")
        require_same_rate(hertz or 1 / step, name, 1 / step, Path(table.source))
        return seconds, (entry,)
    stamps = column.astype(np.float64)
    wrap: tuple[DraftKey, ...] = ()
    if (modulus := wrap_modulus(stamps)) is not None:
        reason = f"{name} falls by nearly this number when it restarts"
        wrap = (DraftKey("data", "counter_modulus", modulus, reason),)
        stamps = unwrap_stamps(stamps, modulus).astype(np.float64)
    step = _require_steps(table, name, stamps, roles.units.get("time"))
    if step == 1.0 and np.all(stamps == np.rint(stamps)):
        counter = DraftKey("data", "time_unit", "sample", "its steps are 1, so it counts samples")
        return by_rate, (entry, counter, *wrap, rate_key)
    known = stated.get("data.time_unit", roles.units.get("time"))
    if known == "sample":
        return by_rate, (entry, replace(entry, key="time_unit", value=known), *wrap, rate_key)
    unit = known or _unit_of_step(step)
    if hertz is not None and known is None:
        tried = ((one, hertz * step * si_factor(one)) for one in (unit, *_TIME_UNITS))
        units = [one for one, ratio in tried if abs(ratio - 1) < SAME_RATE]
        in_bursts = abs(hertz * si_factor(unit) / mean_rate(stamps) - 1) < SAME_RATE
        counts = in_bursts or np.all(stamps == np.rint(stamps))
        if not units and "data.time" not in stated and counts:
            return by_rate, (rate_key,)  # the column counts something else, such as ticks
        unit = next(iter(units), unit)
    mean = mean_step(stamps)
    found = 1 / (mean * si_factor(unit))
    require_same_rate(hertz or found, name, found, Path(table.source))
    seconds, _ = times_from_origin(stamps, si_factor(unit))
    if roles.reasons.get("time") != STATED and (why := _bursts(seconds)):
        return by_rate, (replace(rate_key, ask=f"{RATE_QUESTION}; {name} is no clock: {why}"),)
    rounded = abs(mean / step - 1) > _ROUNDED_STEPS
    typical = f"{mean:.4g} {unit} on average" if rounded else f"{step:.6g} {unit}"
    hz = found if rounded else 1 / (step * si_factor(unit))
    reason = f"its steps are {typical}, {hz:.{4 if rounded else 5}g} Hz"
    units = () if unit == "s" else (DraftKey("data", "time_unit", unit, reason),)
    return seconds, (replace(entry, reason=reason) if not units else entry, *units, *wrap)


def _require_steps(table: Table, name: str, stamps: Array, unit: str | None) -> float:
    """Return the typical step of times, and refuse times that mostly stand still or fall."""
    step = float(np.median(np.diff(stamps))) if stamps.size > 1 else 0.0
    if not step > 0:
        raise InputError(
            f"{table.source}: column {name!r} cannot be the time: "
            f"{_why_no_times(stamps, unit)}; remove [data] time",
            names=(name,),
            key="data.time",
        )
    return step


def _bursts(seconds: Array) -> str:
    """Return why stamps that come in bursts are no times of samples; empty if they are."""
    alone = Recording(seconds, np.zeros((seconds.size, 1)), ("t",), ("s",))
    return "; ".join(finding.message for finding in burst_findings(alone))


def _unit_of_step(step: float) -> str:
    """Return the first unit of time in which a step gives a plausible sampling rate."""
    rates = {one: 1 / (step * si_factor(one)) for one in _TIME_UNITS}
    return next((one for one, hz in rates.items() if _RATES[0] <= hz <= _RATES[1]), "s")


def _why_no_times(stamps: Array, unit: str | None) -> str:
    """Return why stamps that stand still are no times, and the rate that they suggest."""
    mean = float(np.ptp(stamps)) / max(stamps.size - 1, 1)
    unit = unit or (_unit_of_step(mean) if mean > 0 else "s")
    return shared_stamps_text(stamps * si_factor(unit))


def _standing_stamps(table: Table) -> str:
    """Return why a column that looks like a time is not used; empty if there is none.

    Such a column is named like a time, or has numbers that are seconds since 1970.

    Raises
    ------
    InputError
        The times run backwards, so that the rows are in the wrong order.
    """
    for name in table.names:
        if role_of_name(name) != "time" and not _counts_since_1970(table, name):
            continue
        column, unit = table.columns[name], time_unit(name)
        if column.dtype.kind != "U":
            stamps = table.numbers(name)
        elif is_iso_time(str(column[0])):
            stamps, unit = times_from_iso(column.tolist(), name, table)[0], "s"
        else:
            return f"{name} cannot be the time, because {column[0]} is not an ISO 8601 time"
        steps = np.diff(stamps)
        if steps.size and np.all(steps < 0):
            raise InputError(
                f"{table.source}: column {name!r}: the time decreases from row to row, first from "
                f"{stamps[0]:.6g} to {stamps[1]:.6g}; sort the rows by time, or rename the column "
                "if it is no time",
                names=(name,),
                key="data.time",
            )
        if np.all(steps >= 0) and not np.median(np.diff(stamps)) > 0:
            return f"{name} cannot be the time: {_why_no_times(stamps, unit)}"
    return ""


def _counts_since_1970(table: Table, name: str) -> bool:
    """Return whether a column of numbers never falls, and all of them are after 2001 in s."""
    if table.columns[name].dtype.kind == "U":
        return False
    stamps = table.numbers(name)
    return bool(np.all(stamps > _YEAR_2001) and np.all(np.diff(stamps) >= 0) and np.ptp(stamps))


def suggest_rate(clock: tuple[DraftKey, ...], gyro: GuessedReadout | None) -> tuple[DraftKey, ...]:
    """Return the keys for the clock; the question for the rate mentions what the turns suggest."""
    if gyro is None or not gyro.rate_hz:
        return clock
    text = f"; the turns between rests suggest about {gyro.rate_hz:.3g} Hz"
    return tuple(replace(one, ask=one.ask + text) if one.value == UNKNOWN else one for one in clock)
