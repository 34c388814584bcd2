"""A run file drafted from a recording: columns, units, rate, sections, and the methods that fit.

Every choice is a line of the run file with its reason; what only the user knows is asked for.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from inercal.arrays import Array
from inercal.drafts.column_roles import ColumnRoles, recognise_columns
from inercal.drafts.draft_entries import UNKNOWN, DraftKey, run_file_text
from inercal.drafts.method_trials import Candidate, MethodTrial, candidate_methods, try_methods
from inercal.drafts.readouts import (
    GuessedReadout,
    QuietMeans,
    find_quiet_sections,
    guess_accelerometer,
    guess_from_norms,
    guess_from_turned_axis,
    guess_gyro,
    rest_means,
    white_noise,
)
from inercal.errors import InputError
from inercal.io.column_table import Table
from inercal.io.read import detect_reader, read_table
from inercal.section_settings import measured_constant, si_value
from inercal.units import si_factor

_ANYWHERE = "9.80 m/s² ± 0.02 m/s²"
_WINDOW = 0.5  # s, in which a rest is quiet
_WINDOW_SAMPLES = 50  # the same where the rate is not known
_TIME_UNITS = ("s", "ms", "µs", "ns")
_RATES = (1.0, 20e3)  # Hz, of IMUs
_RATE_UNITS = {"rpm": "rpm", "omega_over_pi": "0.5 rev/s"}
_WORST = "unreliable"
_MOST_TEXTS = 4  # columns
_SCATTER_ROUNDS, _SCATTER_AGREES = 6, 0.2
_ARM_DEVIATION = 1e-2
_MEAN_DEVIATION = 1e-4  # of gravity: of means whose scatter nobody stated


@dataclass(frozen=True, eq=False)
class Draft:
    """A drafted run file.

    Parameters
    ----------
    path : Path
        Where it is to be written.
    entries : tuple of DraftKey
        Its keys, [method] included where a method fits.
    trials : tuple of MethodTrial
        The methods that may fit, and what became of them.
    facts : tuple of str
        What was seen, in a line each.
    roles : ColumnRoles
    rests : QuietMeans or None
        Of a recording.
    time : (n,) array or None
        s, of a recording.
    readings : mapping of str to (n, k) array
        Of each triad, in output units.
    """

    path: Path
    entries: tuple[DraftKey, ...]
    trials: tuple[MethodTrial, ...]
    facts: tuple[str, ...]
    roles: ColumnRoles
    rests: QuietMeans | None
    time: Array | None
    readings: Mapping[str, Array]

    @property
    def questions(self) -> tuple[DraftKey, ...]:
        """The keys that only the user knows, without a unit that follows from another answer."""
        found = [entry for entry in self.entries if entry.value == UNKNOWN]
        rate = [entry for entry in found if entry.key == "rate"]
        return tuple(rate or found)

    @property
    def method(self) -> MethodTrial | None:
        """The method that is proposed; None where none fits."""
        works = [trial for trial in self.trials if trial.outcome is not None]
        works.sort(key=lambda one: one.outcome is not None and one.outcome.verdict.grade == _WORST)
        return next(iter(works or (self.trials if self.questions else ())), None)

    @property
    def text(self) -> str:
        """The run file."""
        head = (
            "Drafted by inercal init. Every line gives its reason; change what is wrong.",
            "",
            *self.facts,
            "Methods that these data support, and what became of them when tried:",
            *(f"  {trial.text}" for trial in self.trials),
            "",
            f"  inercal calibrate {self.path.name}",
        )
        return run_file_text(self.entries, head)


def draft_run_file(
    logs: Sequence[Path], path: Path, told: Mapping[str, str] | None = None
) -> Draft:
    """Return the run file that fits a recording, or two: accelerometers, then gyros.

    Parameters
    ----------
    logs : sequence of Path
        One or two files, of any format that is read.
    path : Path
        Of the run file.
    told : mapping of str to str, optional
        Values that the user states, by key: "data.rate", "bench.gravity".

    Raises
    ------
    InputError
        A file cannot be read, has no columns of a sensor, or no method fits its columns.
    """
    told = dict(told or {})
    table = _read(logs[0])
    roles = recognise_columns(table, detect_reader(logs[0]).name)
    gyro_table = _second_table(logs, table, roles)
    if gyro_table is not None:
        second = recognise_columns(gyro_table)
        roles = replace(
            roles,
            triads={**roles.triads, "gyro": second.triads["gyro"]},
            reasons={**second.reasons, **roles.reasons},
            units={**second.units, **roles.units},
        )
    if "accelerometer" not in roles.triads:
        known = ", ".join(roles.triads) or "no triad"
        raise InputError(
            f"{logs[0]}: no accelerometers found among the columns {', '.join(table.names[:12])} "
            f"({known}); no method calibrates without them: give the file of the accelerometers "
            "first",
            file=logs[0],
            names=table.names[:12],
        )
    candidates = candidate_methods(roles)
    if not candidates:
        raise InputError(
            f"{logs[0]}: no method fits {len(roles.triads['accelerometer'])} accelerometer columns "
            f"with {', '.join(roles.single) or 'nothing'} beside them; see inercal show {logs[0]}",
            file=logs[0],
        )
    readings = {
        kind: np.stack(
            [
                (gyro_table if kind == "gyro" and gyro_table else table).numbers(name)
                for name in columns
            ],
            axis=-1,
        )
        for kind, columns in roles.triads.items()
    }
    time, clock = _clock(table, roles, told)
    bench = candidates[0][0]
    rests, turns = (None, ()) if roles.means else _rests(table, roles, readings, time)
    radius = None
    if "bench.radius" in told:
        radius = measured_constant(
            told["bench.radius"], "m", "[bench] radius", last_digit=False
        ).value
    readouts, radius = _readouts(table, readings, roles, rests, turns, time, radius)
    noise = _noise_entries(readings, readouts, rests, time) if bench == "turntable" else {}
    entries = (
        DraftKey("sensor", "name", logs[0].stem, "change it to the sensor's serial number"),
        *(
            entry
            for kind, readout in readouts.items()
            for entry in (*_readout_entries(kind, readout), *noise.get(kind, ()))
        ),
        *_bench_entries(bench, radius),
        *_data_entries(logs, path, roles, bench),
        *_with_suggestion(clock, readouts.get("gyro")),
        *((_deviation_entry(_mean_deviation(roles), "a guess"),) if roles.means else ()),
    )
    entries = _with_told(entries, told)
    trials = try_methods(entries, candidates, path.parent)
    if roles.means and "data.sd.accelerometer" not in told:
        entries, trials = _with_scatter(
            entries, trials, candidates, path.parent, _mean_deviation(roles)
        )
    found = Draft(
        path,
        entries,
        trials,
        _facts(logs, table, roles, rests, time, readings),
        roles,
        rests,
        time,
        readings,
    )
    if found.method is None:
        reasons = "; ".join(trial.text for trial in trials)
        raise InputError(
            f"{logs[0]}: no method fits these data: {reasons}", file=logs[0], names=("method",)
        )
    keys = [DraftKey("method", "name", found.method.name, "the first of the above that fits")]
    keys += [DraftKey("method", key, value) for key, value in found.method.keys.items()]
    return replace(found, entries=(*entries, *keys))


def _read(log: Path) -> Table:
    """Return a table, with the columns as text that begin with numbers or nothing and are text."""
    text: list[str] = []
    while True:
        try:
            return read_table(log, text=text)
        except InputError as error:
            column = error.names[0] if error.names else ""
            if not column or column in text or error.line is None or len(text) == _MOST_TEXTS:
                raise
            text.append(column)


def _second_table(logs: Sequence[Path], table: Table, roles: ColumnRoles) -> Table | None:
    if len(logs) == 1:
        return None
    if len(logs) > 2:
        raise InputError(
            f"{len(logs)} files: give one recording, or the file of the accelerometers and that of "
            "the gyros",
            names=tuple(map(str, logs)),
        )
    second = _read(logs[1])
    rows, others = (next(iter(one.columns.values())).size for one in (table, second))
    if "gyro" not in recognise_columns(second).triads or "gyro" in roles.triads or rows != others:
        raise InputError(
            f"{logs[1]} is not the gyros' file of {logs[0]}: {others} rows to {rows}, and no gyros "
            "that the first file lacks; draft a run file of each",
            file=logs[1],
        )
    return second


def _clock(
    table: Table, roles: ColumnRoles, told: Mapping[str, str]
) -> tuple[Array | None, tuple[DraftKey, ...]]:
    """Return the times, s, where they are known, and the keys of the clock."""
    if roles.means:
        return None, ()
    name = roles.single.get("time")
    ask = 'the rate of the samples, such as "100 Hz"'
    count = next(iter(table.columns.values())).size
    rate = told.get("data.rate")
    hertz = None if rate is None else si_value(rate, "Hz", "[data] rate")
    by_rate = None if hertz is None else np.arange(count) / hertz
    stated = DraftKey("data", "rate", rate or UNKNOWN, "as told" if rate else "", ask)
    if name is None:
        return by_rate, (stated,)
    entry = DraftKey("data", "time", _column(name), roles.reasons.get("time", ""))
    column = table.columns[name]
    if column.dtype.kind == "U":
        seconds = (column.astype("M8[ns]") - column[:1].astype("M8[ns]")) / np.timedelta64(1, "s")
        return np.asarray(seconds, dtype=np.float64), (entry,)
    stamps = column.astype(np.float64)
    step = float(np.median(np.diff(stamps)))
    if step == 1.0 and np.all(stamps == np.rint(stamps)):
        counter = DraftKey("data", "time_unit", "sample", "its steps are 1: it counts samples")
        return by_rate, (entry, counter, stated)
    unit = roles.units.get("time") or next(
        (one for one in _TIME_UNITS if _RATES[0] <= 1 / (step * si_factor(one)) <= _RATES[1]), "s"
    )
    seconds = stamps * si_factor(unit)
    reason = f"its steps are {step:.6g} {unit}, {1 / (step * si_factor(unit)):.5g} Hz"
    units = () if unit == "s" else (DraftKey("data", "time_unit", unit, reason),)
    return seconds, (replace(entry, reason=reason) if not units else entry, *units)


def _with_suggestion(
    clock: tuple[DraftKey, ...], gyro: GuessedReadout | None
) -> tuple[DraftKey, ...]:
    """Return the keys of the clock, with the rate that turns suggest in the question for it."""
    if gyro is None or not gyro.rate_hz:
        return clock
    text = f"; the turns between rests suggest about {gyro.rate_hz:.3g} Hz"
    return tuple(replace(one, ask=one.ask + text) if one.value == UNKNOWN else one for one in clock)


def _rests(
    table: Table, roles: ColumnRoles, readings: Mapping[str, Array], time: Array | None
) -> tuple[QuietMeans, tuple[tuple[int, int], ...]]:
    """Return the rests, and the marked sections that move, where a column marks sections."""
    data = np.hstack([readings[kind] for kind in readings])
    if "label" in roles.single and "time" in roles.single:
        labels = table.columns[roles.single["label"]]
        change = np.flatnonzero(labels[1:] != labels[:-1]) + 1
        edges = np.concatenate([[0], change, [len(labels)]])
        spans = np.column_stack([edges[:-1], edges[1:]])
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


def _readouts(
    table: Table,
    readings: Mapping[str, Array],
    roles: ColumnRoles,
    rests: QuietMeans | None,
    turns: Sequence[tuple[int, int]],
    time: Array | None,
    radius: float | None,
) -> tuple[dict[str, GuessedReadout], float | None]:
    """Return the readout of each triad, and the radius of an arm, m, where it is known."""
    force, stated = readings["accelerometer"], roles.units.get("accelerometer")
    if "arm_rate" in roles.single:
        name = roles.single["arm_rate"]
        rate = table.numbers(name) * _rate_size(name)
        readout, radius = guess_from_norms(force, rate, radius)
    elif "angle" in roles.single:
        readout = guess_from_turned_axis(force)
    else:
        readout = guess_accelerometer(force if rests is None else rests.force, stated)
    found = {"accelerometer": readout}
    if "gyro" in readings and rests is not None:
        dt = None if time is None else float(np.median(np.diff(time)))
        found["gyro"] = guess_gyro(
            rests, readings["gyro"], readout, dt, roles.units.get("gyro"), turns
        )
    return found, radius


def _readout_entries(kind: str, readout: GuessedReadout) -> tuple[DraftKey, ...]:
    section = f"sensor.{kind}"
    unit = DraftKey(section, "unit", readout.unit, readout.reason)
    if not readout.certain and kind == "gyro":
        unit = replace(unit, value=UNKNOWN, ask=f"the unit of the {kind}s, such as rad/s")
    entries = [unit]
    if readout.scale:
        entries.append(DraftKey(section, "scale", readout.scale, "nominal; see the data sheet"))
    if readout.offset:
        entries.append(DraftKey(section, "offset", readout.offset, "reading at zero"))
    return tuple(entries)


def _noise_entries(
    readings: Mapping[str, Array],
    readouts: Mapping[str, GuessedReadout],
    rests: QuietMeans | None,
    time: Array | None,
) -> dict[str, tuple[DraftKey, ...]]:
    """Return the noise densities, which filters need."""
    if rests is None or time is None:
        return {}
    dt = float(np.median(np.diff(time)))
    units = {"accelerometer": "µg/√Hz", "gyro": "°/√h"}
    reason = "from the scatter within rests"
    found: dict[str, tuple[DraftKey, ...]] = {}
    for kind, readout in readouts.items():
        density = white_noise(readings[kind], rests, readout.size, dt)
        text = f"{density / si_factor(units[kind]):.3g} {units[kind]}"
        found[kind] = (DraftKey(f"sensor.{kind}", "white", text, reason),)
    return found


def _bench_entries(bench: str, radius: float | None) -> tuple[DraftKey, ...]:
    entries = [] if bench == "hand" else [DraftKey("bench", "kind", bench, "by the columns")]
    if bench == "turntable":
        return (*entries, DraftKey("bench", "latitude", UNKNOWN, "", 'latitude, such as "48.1 °"'))
    reason = "anywhere near sea level: state latitude and height instead for less uncertainty"
    entries.append(DraftKey("bench", "gravity", _ANYWHERE, reason))
    if bench in ("centrifuge", "rate_table"):
        text = UNKNOWN if radius is None else f"{radius:.4g} m ± {0.02 * radius:.1g} m"
        reason = "from the norms and the rates: state what was measured"
        ask = 'the radius of the arm with its uncertainty, such as "1 m ± 0.1 mm"'
        entries.append(DraftKey("bench", "radius", text, reason, ask))
    return tuple(entries)


def _rate_unit(name: str) -> str:
    return _RATE_UNITS.get(name.strip().lower(), "rpm")


def _rate_size(name: str) -> float:
    from inercal.data import unit_size

    return unit_size(_rate_unit(name), "rad/s", "arm_rate_unit")


def _column(name: str) -> str | int:
    """Return a column as a run file names it: its number where it has no name."""
    return int(name) if name.isdecimal() else name


def _data_entries(
    logs: Sequence[Path], path: Path, roles: ColumnRoles, bench: str
) -> tuple[DraftKey, ...]:
    def file(log: Path) -> str:
        return Path(os.path.relpath(log.resolve(), path.parent.resolve())).as_posix()

    entries = [DraftKey("data", "file", file(logs[0]))]
    if roles.means:
        entries.append(DraftKey("data", "kind", "means", "few rows without a clock"))
    if len(logs) > 1:
        entries.append(DraftKey("data", "gyro_file", file(logs[1])))
    for kind, columns in roles.triads.items():
        entries.append(DraftKey("data", kind, [_column(c) for c in columns], roles.reasons[kind]))
    if roles.table:
        entries.append(DraftKey("data", "table", list(roles.table), "by their names"))
    if roles.attitude and roles.means:
        entries.append(DraftKey("data", "attitude", list(roles.attitude), "by their names"))
    wanted = {
        "centrifuge": ("arm_rate", "label", "temperature"),
        "rate_table": ("arm_rate", "mounting", "temperature"),
        "dividing_head": ("angle", "autocollimator", "level", "label", "temperature"),
        "turntable": ("label", "hold", "temperature"),
        "hand": ("label", "temperature"),
    }[bench]
    for role in wanted:
        if role in roles.single:
            name = roles.single[role]
            entries.append(DraftKey("data", role, _column(name), roles.reasons[role]))
            if role == "arm_rate" and _rate_unit(name) != "rpm":
                entries.append(DraftKey("data", "arm_rate_unit", _rate_unit(name), "by its name"))
    if bench == "hand" and not roles.means and "label" in roles.single:
        entries.append(DraftKey("data", "marks", "labels", "the column names the sections"))
    return tuple(entries)


def _mean_deviation(roles: ColumnRoles) -> float:
    """Return the deviation of means to begin with, of gravity: on an arm norms vary more."""
    return _ARM_DEVIATION if "arm_rate" in roles.single else _MEAN_DEVIATION


def _deviation_entry(deviation: float, reason: str) -> DraftKey:
    return DraftKey("data.sd", "accelerometer", f"{1e6 * deviation:.2g} µg", reason)


def _with_scatter(
    entries: tuple[DraftKey, ...],
    trials: tuple[MethodTrial, ...],
    candidates: Sequence[Candidate],
    folder: Path,
    deviation: float,
) -> tuple[tuple[DraftKey, ...], tuple[MethodTrial, ...]]:
    """Return entries and trials with the deviation of means by which χ² agrees with its dof."""
    reason = (
        "by which the fit has the χ² that it should have, so that the fit cannot be judged: state "
        "the scatter of your means instead"
    )
    given, before = (entries, trials), np.inf
    for _ in range(_SCATTER_ROUNDS):
        fits = [one.outcome.estimate for one in trials if one.outcome is not None]
        if not fits or not fits[0].dof:
            break
        ratio = float(np.sqrt(max(fits[0].chi2 / fits[0].dof, 1e-12)))
        if abs(ratio - 1) < _SCATTER_AGREES:
            return entries, trials
        if abs(np.log(ratio)) > 0.7 * before:
            break  # the bench's errors explain the residuals whatever the scatter
        before = abs(np.log(ratio))
        deviation *= ratio
        entries = (*entries[:-1], _deviation_entry(deviation, reason))
        trials = try_methods(entries, candidates, folder)
    return given


def _with_told(entries: tuple[DraftKey, ...], told: Mapping[str, str]) -> tuple[DraftKey, ...]:
    """Return the entries with the values that the user told, which may be new keys."""
    known = {f"{entry.section}.{entry.key}": entry for entry in entries}
    for key, value in told.items():
        section, _, name = key.rpartition(".")
        if not section:
            raise InputError(f"{key} has no section: name it as data.rate", key=key)
        known[key] = replace(
            known.get(key, DraftKey(section, name, value)), value=value, reason="as told"
        )
    if "bench.latitude" in told:
        known.pop("bench.gravity", None)
    return tuple(known.values())


def _facts(
    logs: Sequence[Path],
    table: Table,
    roles: ColumnRoles,
    rests: QuietMeans | None,
    time: Array | None,
    readings: Mapping[str, Array],
) -> tuple[str, ...]:
    rows = next(iter(table.columns.values())).size
    facts = [f"{' and '.join(log.name for log in logs)}: {rows} rows of {len(table.names)} columns"]
    if time is not None and time.size > 1:
        step = float(np.median(np.diff(time)))
        facts.append(f"{time[-1] - time[0]:.1f} s at {1 / step:.5g} Hz")
    if rests is not None:
        spans = rests.spans
        samples = int((spans[:, 1] - spans[:, 0]).sum())
        unit = "samples"
        facts.append(f"{len(spans)} sections at rest, {samples} of {rows} {unit}")
    for kind, data in readings.items():
        facts.append(f"{kind}s read {data.min():.6g} to {data.max():.6g}")
        clipped = [int(np.sum(column == column.max())) for column in data.T]
        if not roles.means and max(clipped) > max(10, rows // 1000):
            facts.append(
                f"{kind}s stay at their largest reading in {max(clipped)} samples: clipped?"
            )
    return tuple(facts)


__all__ = ["Draft", "DraftKey", "MethodTrial", "draft_run_file"]
