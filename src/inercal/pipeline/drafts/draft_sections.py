"""Draft the keys of each run-file section from the columns of a recording.

The norms of the readings show the units of an arm's rate and radius. On an arm the readings have
the norm s √(g² + (r ω²)²). If the units of r and ω are right, the size s of an output unit is the
same at all rates.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS, format_count, format_quantity, si_factor
from inercal.benches.arm import LENGTHS, RATES
from inercal.physics.sensors import G0
from inercal.pipeline.drafts.column_names import column_unit, run_file_column
from inercal.pipeline.drafts.column_roles import STATED, ColumnRoles
from inercal.pipeline.drafts.draft_entries import ANYWHERE, UNKNOWN, DraftKey
from inercal.pipeline.drafts.method_trials import RAMP
from inercal.pipeline.drafts.quiet_sections import QuietMeans, find_quiet_sections, rest_means
from inercal.pipeline.drafts.rate_tables import angle_unit_key, collimation_keys, rate_unit
from inercal.pipeline.drafts.readouts import (
    GuessedReadout,
    far_off,
    guess_accelerometer,
    guess_from_norms,
    guess_from_turned_axis,
    guess_gyro,
    guess_resting_gyro,
    white_noise,
)
from inercal.recordings.data import unit_size
from inercal.recordings.io.column_table import Table, shorten
from inercal.recordings.io.mean_tables import SD_SUFFIX
from inercal.recordings.io.repeated_values import railed_ranges
from inercal.recordings.samples import mean_step
from inercal.recordings.temperature import COUNTS, first_impossible, named_unit, seems_kelvin

_NAMED = {"omega_over_pi": "0.5 rev/s"}
_CLEAR = 0.3  # ratio of the scatter of norms in two units that decides
_AGREES = 0.12  # scatter of the norms of a plain MEMS sensor in the right unit


def arm_rate_unit(
    table: Table, roles: ColumnRoles, force: Array, radius: float | None
) -> tuple[str, str]:
    """Return the unit of an arm's rate, with a reason.

    If neither the user nor the name of the column states a unit, rpm is assumed, unless the norms
    of the readings agree far better with another unit.
    """
    name = roles.single["arm_rate"]
    if (unit := roles.units.get("arm_rate")) is not None:
        return unit, STATED
    known = "rpm" if "rpm" in name.lower() else _NAMED.get(name.strip().lower())
    if (unit := column_unit(name) or known) is not None:
        return unit, "by its name"
    if radius is None:
        return "rpm", ""
    rate = table.numbers(name)
    spread = {unit: norm_spread(force, rate * si_factor(unit, "rad/s"), radius) for unit in RATES}
    best = min(spread, key=lambda unit: spread[unit])
    clear = spread[best] < _CLEAR * spread["rpm"]
    return (best, "by the norms of the readings") if clear else ("rpm", "")


def norm_spread(force: Array, rate: Array, radius: float) -> float:
    """Return how much the readings, (n, 3), scatter about norms on an arm, relative to the norm.

    The scatter is independent of the readings' unit.
    """
    norm = np.maximum(np.linalg.norm(force, axis=-1), np.finfo(float).tiny)
    return float(np.std(np.log(norm / np.hypot(G0, rate**2 * radius))))


def require_radius_unit(force: Array, rate: Array, radius: float) -> None:
    """Refuse a radius, m, if the norms of the readings agree far better in another unit.

    Raises
    ------
    InputError
        The message names the radius that agrees.
    """
    spread = {factor: norm_spread(force, rate, radius * factor) for factor in (1.0, *LENGTHS)}
    best = min(spread, key=lambda factor: spread[factor])
    if spread[best] < min(_CLEAR * spread[1.0], _AGREES):
        raise InputError(
            f"[bench] radius: {radius:.4g} m does not agree with the norms of the readings, but "
            f"{radius * best:.4g} m does: check whether the radius is in m or {LENGTHS[best]}",
            key="[bench] radius",
            names=(LENGTHS[best],),
        )


_WINDOW = 0.5  # s, window in which a rest must be quiet
_WINDOW_SAMPLES = 50  # the same window if the rate is not known
_MOST_LISTED = 12  # columns in a line


def find_rest_means(
    table: Table, roles: ColumnRoles, readings: Mapping[str, Array], time: Array | None
) -> tuple[QuietMeans, tuple[tuple[int, int], ...]]:
    """Return the rests and, if a column marks sections, the marked sections with motion."""
    data = np.hstack([readings[kind] for kind in readings])
    if "accelerometer" not in readings:  # gyros at rest
        return QuietMeans(np.array([[0, len(data)]]), data[:1, :0], data.mean(axis=0)[None]), ()
    if roles.marks == "labels":
        spans = np.array(roles.parts)
        if 0.0 in roles.rates:
            spans = spans[np.equal(roles.rates, 0.0)]
        return rest_means(spans, readings["accelerometer"], readings.get("gyro")), ()
    spans = np.array(roles.parts if roles.marks not in ("", "found") else ())
    if "label" in roles.single and "time" in roles.single:
        labels = table.columns[roles.single["label"]]
        change = np.flatnonzero(labels[1:] != labels[:-1]) + 1
        edges = np.concatenate([[0], change, [len(labels)]])
        spans = np.column_stack([edges[:-1], edges[1:]])
    if len(spans):
        spans = spans[spans[:, 1] - spans[:, 0] >= 8]
        scatter = np.array([data[a:b].std(axis=0).max() for a, b in spans])
        still = scatter <= 5 * np.quantile(scatter, 0.3) if len(spans) else np.zeros(0, bool)
        if still.sum() >= 2:
            rests = rest_means(spans[still], readings["accelerometer"], readings.get("gyro"))
            return rests, tuple((int(a), int(b)) for a, b in spans[~still])
    window = _WINDOW_SAMPLES
    if time is not None and time.size > 1:
        window = max(4, int(_WINDOW / np.median(np.diff(time))))
    spans = find_quiet_sections(data, window)
    if not len(spans):
        spans = np.array([[0, len(data)]])
    return rest_means(spans, readings["accelerometer"], readings.get("gyro")), ()


def guess_readouts(
    table: Table,
    readings: Mapping[str, Array],
    roles: ColumnRoles,
    rests: QuietMeans | None,
    turns: Sequence[tuple[int, int]],
    time: Array | None,
    radius: float | None,
) -> tuple[dict[str, GuessedReadout], float | None]:
    """Guess the readout of each triad and, if possible, the radius of an arm in m."""
    if "accelerometer" not in readings:
        return {"gyro": guess_resting_gyro(roles.units.get("gyro"))}, None
    force, stated = readings["accelerometer"], roles.units.get("accelerometer")
    if "arm_rate" in roles.single:
        name = roles.single["arm_rate"]
        rate = table.numbers(name) * unit_size(roles.units["arm_rate"], "rad/s", "arm_rate_unit")
        if radius is not None:
            require_radius_unit(force, rate, radius)
        readout, radius = guess_from_norms(force, rate, radius, stated)
    elif "angle" in roles.single:
        readout = guess_from_turned_axis(force, stated)
    else:
        readout = guess_accelerometer(force if rests is None else rests.force, stated)
    found = {"accelerometer": readout}
    if "gyro" in readings and rests is not None:
        dt = None if time is None else float(np.median(np.diff(time)))
        found["gyro"] = guess_gyro(
            rests, readings["gyro"], readout, dt, roles.units.get("gyro"), turns
        )
    return found, radius


def readout_keys(kind: str, readout: GuessedReadout) -> tuple[DraftKey, ...]:
    """Return the keys of [sensor.accelerometer] or [sensor.gyro]: unit, scale and offset."""
    section = f"sensor.{kind}"
    unit = DraftKey(section, "unit", readout.unit, readout.reason)
    if not readout.certain and (kind == "gyro" or readout.unit == UNKNOWN):
        example = "rad/s" if kind == "gyro" else "m/s²"
        ask = f"the unit of the {kind}s, such as {example} ({readout.reason})"
        typical = "" if readout.unit == UNKNOWN else readout.unit
        unit = replace(unit, value=UNKNOWN, ask=ask, typical=typical)
    entries = [unit]
    if readout.scale:
        example = "131 LSB/(°/s)" if kind == "gyro" else "2048 LSB/g"
        ask = f"the nominal scale of the {kind}s, such as {example}"
        reason = f"nominal; see the data sheet; {readout.reason}"
        assumed = kind == "accelerometer"
        entries.append(DraftKey(section, "scale", readout.scale, reason, ask, assumed=assumed))
    if readout.offset:
        entries.append(DraftKey(section, "offset", readout.offset, "reading at zero"))
    return tuple(entries)


def noise_keys(
    readings: Mapping[str, Array],
    readouts: Mapping[str, GuessedReadout],
    rests: QuietMeans | None,
    time: Array | None,
) -> dict[str, tuple[DraftKey, ...]]:
    """Return the keys for the noise densities, which filters need."""
    if rests is None or time is None:
        return {}
    dt = float(np.median(np.diff(time)))
    units = {"accelerometer": "µg/√Hz", "gyro": "°/√h"}
    reason = "from the scatter within rests"
    found: dict[str, tuple[DraftKey, ...]] = {}
    for kind, readout in readouts.items():
        density = white_noise(readings[kind], rests, readout.size, dt)
        text = format_quantity(density, 0.0, units[kind], 3)
        found[kind] = (DraftKey(f"sensor.{kind}", "white", text, reason),)
    return found


def bench_keys(bench: str, method: str, radius: float | None) -> tuple[DraftKey, ...]:
    """Return the keys of [bench]; `radius` is the radius of an arm in m, if it is known."""
    entries = [] if bench == "hand" else [DraftKey("bench", "kind", bench, "by the columns")]
    if method == RAMP:
        return (DraftKey("bench", "kind", bench, "a sensor at rest, whose temperature changes"),)
    if bench == "turntable":
        return (*entries, DraftKey("bench", "latitude", UNKNOWN, "", 'latitude, such as "48.1 °"'))
    reason = "valid anywhere near sea level: state latitude and height instead for less uncertainty"
    entries.append(DraftKey("bench", "gravity", ANYWHERE, reason))
    if bench in ("centrifuge", "rate_table"):
        text = UNKNOWN if radius is None else format_quantity(radius, 0.02 * radius, "m")
        reason = "estimated from the norms and the rates: replace it with your measured value"
        ask = 'the radius of the arm with its uncertainty, such as "1 m ± 0.1 mm"'
        entries.append(DraftKey("bench", "radius", text, reason, ask))
    return tuple(entries)


def data_keys(
    logs: Sequence[Path],
    path: Path,
    table: Table,
    roles: ColumnRoles,
    bench: str,
    values: Mapping[str, object],
) -> tuple[DraftKey, ...]:
    """Return the keys of [data] except the clock: files, and the columns that the bench uses.

    `values` contains the values that the user states, by key.
    """

    def file(log: Path) -> str:
        return Path(os.path.relpath(log.resolve(), path.parent.resolve())).as_posix()

    entries = [DraftKey("data", "file", file(logs[0]))]
    if roles.means:
        entries.append(DraftKey("data", "kind", "means", "there are few rows and no time column"))
    if len(logs) > 1:
        entries.append(DraftKey("data", "gyro_file", file(logs[1])))
    for kind, columns in roles.triads.items():
        entries.append(
            DraftKey("data", kind, [run_file_column(c) for c in columns], roles.reasons[kind])
        )
    if not roles.triads.get("accelerometer"):
        entries.append(DraftKey("data", "accelerometer", [], "gyros only"))
    if roles.table_file:
        entries.append(DraftKey("data", "table_file", file(Path(roles.table_file))))
    if roles.table:
        entries.append(DraftKey("data", "table", list(roles.table), "by their names"))
        entries += angle_unit_key("table_unit", roles.table[0])
    if roles.attitude and roles.means:
        entries += angle_unit_key("attitude_unit", roles.attitude[0])
        entries.append(DraftKey("data", "attitude", list(roles.attitude), "by their names"))
    wanted = {
        "centrifuge": ("arm_rate", "label", "temperature"),
        "rate_platform": ("axis", "table_rate", "roll", "pitch", "seconds", "temperature"),
        "rate_table": ("arm_rate", "mounting", "temperature"),
        "dividing_head": ("angle", "autocollimator", "level", "label", "temperature"),
        "turntable": ("table_time", "label", "hold", "temperature"),
        "hand": ("label", "gyro_time", "temperature"),
    }[bench]
    for role in wanted:
        if role in roles.single:
            name = roles.single[role]
            entries.append(DraftKey("data", role, run_file_column(name), roles.reasons[role]))
            if role in ("angle", "autocollimator", "level", "roll"):
                entries += angle_unit_key(f"{role}_unit".replace("roll", "angle"), name)
            if role == "autocollimator":
                entries += collimation_keys(table, roles)
            if role == "table_rate":
                entries.append(DraftKey("data", "table_rate_unit", *rate_unit(table, roles)))
            if role == "arm_rate" and (unit := roles.units["arm_rate"]) != "rpm":
                reason = roles.reasons["arm_rate_unit"]
                entries.append(DraftKey("data", "arm_rate_unit", unit, reason))
            if role == "temperature":
                entries += _thermometer_keys(table, name, values)
    if roles.marks in ("labels", "found"):
        reason = "each file is a section" if roles.marks == "labels" else ""
        entries.append(DraftKey("data", "marks", roles.marks, reason))
    elif roles.marks:
        entries.append(DraftKey("data", "marks", file(Path(roles.marks)), roles.reasons["marks"]))
    if bench == "hand" and not roles.means and "label" in roles.single:
        entries.append(DraftKey("data", "marks", "labels", "the column names the sections"))
    return tuple(entries)


def _thermometer_keys(
    table: Table, name: str, values: Mapping[str, object]
) -> tuple[DraftKey, ...]:
    """Return the known keys for a temperature column whose readings cannot be in °C."""
    if "data.temperature_unit" not in values and (stated := named_unit(name)) != "°C":
        return (DraftKey("data", "temperature_unit", stated, "by its name"),)
    read = table.numbers(name)
    kelvin = seems_kelvin(read)
    if first_impossible(read + ZERO_CELSIUS) is None and not kelvin:
        return ()
    low, high = float(np.nanmin(read)), float(np.nanmax(read))
    reads = f"{name} reads {low:.6g} to {high:.6g}"
    if values.get("data.temperature_unit") in COUNTS:
        unit = values["data.temperature_unit"]
        scale = f'the scale of {name}, such as "340 {unit}/K"; {reads}'
        zero = f'the temperature at which {name} reads 0, such as "36.53 °C"'
        return (
            DraftKey("data", "temperature_unit", unit),
            DraftKey("data", "temperature_scale", UNKNOWN, "", scale),
            DraftKey("data", "temperature_zero", UNKNOWN, "", zero),
        )
    if kelvin:
        return (DraftKey("data", "temperature_unit", "K", reads),)
    ask = f"the unit of the thermometer, LSB for raw counts ({reads}, which cannot be °C)"
    return (DraftKey("data", "temperature_unit", UNKNOWN, "", ask),)


def unused_columns(table: Table, entries: Sequence[DraftKey]) -> tuple[str, ...]:
    """Return a line that lists the columns without use in the run file; () if there are none."""
    used: set[str] = set()
    for entry in entries:
        if entry.section == "data":
            value = entry.value
            given = cast(list[object], value) if isinstance(value, list) else [value]
            used |= {str(name).removeprefix("-") for name in given}
    left = [name for name in table.names if name.removesuffix(SD_SUFFIX) not in used]
    if not left:
        return ()
    more = f", … ({len(left)} in all)" if len(left) > _MOST_LISTED else ""
    return (f"not used: {', '.join(map(shorten, left[:_MOST_LISTED]))}{more}",)


def _railed_samples(x: Array, every: Sequence[Array]) -> int:
    """Return how many of a channel's n samples are at the end of its range."""
    others = [one for one in every if not np.array_equal(one, x)]
    return int(np.diff(railed_ranges(x, others)).sum())


def facts(
    logs: Sequence[Path],
    table: Table,
    roles: ColumnRoles,
    rests: QuietMeans | None,
    time: Array | None,
    readings: Mapping[str, Array],
) -> tuple[str, ...]:
    """Return lines with facts about a recording: size, rate, rests and ranges."""
    facts = [
        f"{' and '.join(log.name for log in logs)}: {table.rows} rows of "
        f"{format_count(len(table.names), 'column')}"
    ]
    if time is not None and time.size > 1:
        facts.append(f"{time[-1] - time[0]:.1f} s at {1 / mean_step(time):.5g} Hz")
    if rests is not None:
        spans = rests.spans
        samples = int((spans[:, 1] - spans[:, 0]).sum())
        count = format_count(len(spans), "section")
        turning = format_count(int(np.count_nonzero(roles.rates)), "section")
        facts += [f"{turning} at the rates that their names state"] * bool(roles.rates)
        if 0.0 in roles.rates or not roles.rates:
            facts.append(f"{count} at rest, {samples} of {table.rows} samples")
    every = list(np.hstack(list(readings.values())).T)
    for kind, data in readings.items():
        facts.append(f"{kind}s read {data.min():.6g} to {data.max():.6g}")
        if kind == "accelerometer" and data.shape[1] == len("xyz"):
            facts += far_off(data if rests is None else rests.force, roles.triads[kind])
        clipped = [0] if roles.means else [_railed_samples(x, every) for x in data.T]
        if any(clipped):
            facts.append(f"{kind}s are at the end of their range in {max(clipped)} samples")
    return tuple(facts)
