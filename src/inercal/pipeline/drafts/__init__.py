"""Draft a run file from a recording: columns, units, rate, sections and suitable methods.

Every choice becomes a line of the run file together with its reason. The draft asks for values that
only the user knows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, error_location
from inercal.basics.units import format_count
from inercal.physics.section_settings import measured_constant
from inercal.pipeline.drafts import rate_tables
from inercal.pipeline.drafts.clock_keys import clock_keys, suggest_rate
from inercal.pipeline.drafts.column_names import is_reversed
from inercal.pipeline.drafts.column_roles import (
    BY_HAND,
    NO_GYROS,
    NO_LABEL,
    NO_MARKS,
    NO_SENSOR,
    ColumnRoles,
    UnknownAccelerometers,
    require_no_cluster,
    unknown_accelerometers,
    without_accelerometers,
    without_sections,
)
from inercal.pipeline.drafts.draft_entries import (
    UNKNOWN,
    DraftKey,
    as_sections,
    run_file_text,
    with_typical_values,
)
from inercal.pipeline.drafts.draft_sections import (
    arm_rate_unit,
    bench_keys,
    data_keys,
    facts,
    find_rest_means,
    guess_readouts,
    noise_keys,
    readout_keys,
    unused_columns,
)
from inercal.pipeline.drafts.file_parts import recording_name
from inercal.pipeline.drafts.log_files import LogFiles, read_logs
from inercal.pipeline.drafts.magnetometer_keys import NO_FIELD, magnetometer_keys
from inercal.pipeline.drafts.method_trials import (
    GUESS,
    RAMP,
    Candidate,
    MethodTrial,
    candidate_methods,
    deviation_key,
    rests_in_ramp,
    start_deviation,
    try_methods,
    with_scatter,
)
from inercal.pipeline.drafts.quiet_sections import QuietMeans
from inercal.pipeline.drafts.readouts import guess_accelerometer
from inercal.pipeline.drafts.stated_keys import default_bench_keys, stated_units, stated_values
from inercal.recordings.io.column_table import Table

_REASONS = {
    ("also", "auto"): "adds the coefficients that the tests point to; a list, such as "
    '["g"], fixes them',
    ("temperature_order", "auto"): "chosen by tests; U includes errors that the rows of a soak "
    "share only if [environment] states them",
}
_HEATED = 10.0  # K, at which biases of MEMS change by more than their uncertainty
_LEFT_OUT = (NO_GYROS, NO_LABEL, NO_MARKS, NO_SENSOR, NO_FIELD)
_WITH_FIELD = ("multi_position", "six_position")
_WORST = "unreliable"


@dataclass(frozen=True, eq=False)
class Draft:
    """A drafted run file.

    Parameters
    ----------
    logs : tuple of Path
        Files of the recording.
    path : Path
        Path at which the run file is to be written.
    entries : tuple of DraftKey
        Keys of the run file, including [method] if a method fits.
    trials : tuple of MethodTrial
        Methods that may fit, with the result of trying each.
    facts : tuple of str
        Observed facts about the recording, one line each.
    unused : tuple of str
        The fact that lists the columns without a role; empty if all have one.
    roles : ColumnRoles
    rests : QuietMeans or None
        Rests in a recording; None for a table of means.
    time : (n,) array or None
        Times in a recording, s.
    readings : mapping of str to (n, k) array
        Readings of each triad, in output units.
    """

    logs: tuple[Path, ...]
    path: Path
    entries: tuple[DraftKey, ...]
    trials: tuple[MethodTrial, ...]
    facts: tuple[str, ...]
    unused: tuple[str, ...]
    roles: ColumnRoles
    rests: QuietMeans | None
    time: Array | None
    readings: Mapping[str, Array]

    @property
    def questions(self) -> tuple[DraftKey, ...]:
        """The keys that only the user knows, except a unit that follows from another answer."""
        found = [entry for entry in self.entries if entry.value == UNKNOWN]
        rate = [entry for entry in found if entry.key == "rate"]
        return tuple(rate or found)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """A line for each typical value that stands for an answer of the user."""
        assumed = (one for one in self.entries if one.assumed)
        return tuple(f"assumed: {one.name} = {one.value} ({one.reason})" for one in assumed)

    @property
    def method(self) -> MethodTrial | None:
        """The proposed method; None if no method fits."""
        works = [trial for trial in self.trials if trial.outcome is not None]
        works.sort(key=lambda one: one.outcome is not None and one.outcome.verdict.grade == _WORST)
        return next(iter(works or (self.trials if self.questions else ())), None)

    @property
    def text(self) -> str:
        """The text of the run file."""
        head = (
            "Drafted by inercal. Every line gives its reason; change what is wrong.",
            "",
            *self.facts,
            "Methods that these data support, and the result of trying each:",
            *(f"  {trial.text}" for trial in self.trials),
            "",
            f"  inercal calibrate {self.path.name}",
        )
        return run_file_text(self.entries, head)


def require_answers(draft: Draft) -> None:
    """Raise an error that lists the questions of a draft, if there are any.

    Raises
    ------
    InputError
    """
    if not draft.questions:
        return
    log = draft.logs[0]
    asked = "; ".join(f"{one.dotted}: {one.question}" for one in draft.questions)
    typical = ", or take typical values with --yes" * all(one.typical for one in draft.questions)
    raise InputError(
        f"only you know {asked} (state it with --set, as an argument in Python{typical})",
        key=draft.questions[0].name,
        names=tuple(one.dotted for one in draft.questions),
    ).located(log)


def draft_run_file(
    logs: Sequence[Path],
    path: Path,
    stated: Mapping[str, str] | None = None,
    *,
    typical: bool = False,
) -> Draft:
    """Draft the run file for a recording in one file or several.

    Parameters
    ----------
    logs : sequence of Path
        Files in any readable format: one, one with the accelerometers and one with the gyros, or
        several with the same columns; also a folder, or a name with a star.
    path : Path
        Path of the run file.
    stated : mapping of str to str, optional
        Values that the user states, by key, such as "data.rate" or "bench.gravity".
    typical : bool
        Whether typical values replace the questions that have them.

    Raises
    ------
    InputError
        If a file cannot be read or has no sensor columns, or if no method fits its columns.
    """
    stated = dict(stated or {})
    values = stated_values(stated)
    read = read_logs(logs, values)
    roles = replace(read.roles, units={**read.roles.units, **stated_units(values)})
    if "data.arm_rate_unit" in values:
        roles = replace(roles, units={**roles.units, "arm_rate": values["data.arm_rate_unit"]})
    roles = rate_tables.with_rate_table(read.table, roles)
    name, logs = recording_name(logs), read.files

    def draft(roles: ColumnRoles, *, field: bool = False) -> Draft:
        found = replace(read, roles=roles)
        return _draft(found, path, stated, values, name, typical=typical, field=field)

    found = draft(roles)
    labelled = "label" in roles.single and "data.label" not in stated and not roles.means
    guessed = labelled or roles.marks not in ("", "labels", "found")
    if found.method is None and guessed:
        other = draft(without_sections(roles))
        found = other if other.method is not None else found
    magnetic = any(one.section == "sensor.magnetometer" for one in found.entries)
    if found.method is not None and found.method.name in _WITH_FIELD and not magnetic:
        # A method without magnetometers came first, but was refused.
        other = draft(found.roles, field=True)
        found = other if other.method is not None else found
    if found.method is None and magnetic and "data.magnetometer" not in stated:
        why = next(trial.reason for trial in found.trials if trial.name in _WITH_FIELD)
        other = draft(roles.because({NO_FIELD: f"the magnetometers are not used: {why}"}))
        found = other if other.method is not None else found
    if found.method is None:
        _require_possible_keys(found.trials, stated)
        by_reason: dict[str, list[str]] = {}
        for trial in found.trials:
            by_reason.setdefault(trial.reason, []).append(trial.called)
        reasons = "; ".join(f"{', '.join(names)}: {why}" for why, names in by_reason.items())
        if "gyro" in roles.triads and _is_heated(read.table, roles):
            reasons += (
                "; if the sensor rested while its temperature changed, data.accelerometer = [] "
                "drafts temperature_ramp for the gyros"
            )
        raise InputError(
            f"{logs[0]}: no method fits these data: {reasons}", file=logs[0], names=("method",)
        )
    reason = "the first of the above that fits"
    if found.questions:
        reason = "not tried yet: inercal init tries all of the above once it has the answers"
    defaults = default_bench_keys(as_sections(found.entries), found.method.name)
    keys = [*defaults, DraftKey("method", "name", found.method.name, reason)]
    keys += [
        DraftKey("method", key, value, _REASONS.get((key, str(value)), ""))
        for key, value in found.method.keys.items()
        if f"method.{key}" not in values
    ]
    return replace(found, entries=(*found.entries, *keys))


def _draft(
    read: LogFiles,
    path: Path,
    stated: Mapping[str, str],
    values: Mapping[str, Any],
    name: str,
    *,
    typical: bool,
    field: bool,
) -> Draft:
    """Draft all sections but [method], and try the methods."""
    logs, table, gyros, roles = read.files, read.table, read.gyros, read.roles
    values = dict(values)
    candidates = _candidates(logs[0], table, roles)
    if (stated_name := values.pop("method.name", None)) is not None:
        named = tuple(one for one in candidates if one[1] == stated_name)
        candidates = named or ((candidates[0][0], stated_name, {}),)
    readings = {
        kind: np.stack(
            [
                (gyros if kind == "gyro" and gyros else table).numbers(name)
                * (-1 if is_reversed(name) else 1)
                for name in columns
            ],
            axis=-1,
        )
        for kind, columns in roles.triads.items()
        if columns
    }
    time, clock = clock_keys(table, roles, stated)
    bench = candidates[0][0]
    rests, turns = (None, ()) if roles.means else find_rest_means(table, roles, readings, time)
    radius_text = stated.get("bench.radius")
    length = partial(measured_constant, like="m", key="[bench] radius", last_digit=False)
    radius = None if radius_text is None else length(radius_text).value
    at_rates = "table_rate" in roles.single
    if "arm_rate" in roles.single:
        unit, reason = arm_rate_unit(table, roles, readings["accelerometer"], radius)
        roles = roles.because({"arm_rate_unit": reason}, units={**roles.units, "arm_rate": unit})
    with error_location(logs[0]):
        if at_rates:
            readouts = {"gyro": rate_tables.gyro_readout(table, roles)}
            if "accelerometer" in readings:
                unit = roles.units.get("accelerometer")
                readouts["accelerometer"] = guess_accelerometer(readings["accelerometer"], unit)
        else:
            readouts, radius = guess_readouts(table, readings, roles, rests, turns, time, radius)
    guessed = roles.means and "accelerometer" in readings
    ramp = candidates[0][1] == RAMP
    noise = noise_keys(readings, readouts, rests, time) if bench == "turntable" or ramp else {}
    entries = (
        DraftKey("sensor", "name", name, "change it to the sensor's serial number"),
        *(
            entry
            for kind, readout in readouts.items()
            for entry in (*readout_keys(kind, readout), *noise.get(kind, ()))
        ),
        *(
            rate_tables.rate_bench_keys(roles)
            if at_rates or roles.rates
            else bench_keys(bench, candidates[0][1], radius)
        ),
        *data_keys(logs, path, table, roles, bench, values),
        *(
            magnetometer_keys(table, roles, rests, values)
            if field or candidates[0][1] in _WITH_FIELD
            else ()
        ),
        *read.signs,
        *suggest_rate(clock, readouts.get("gyro")),
        *(rate_tables.gyro_deviation_keys(table, roles, readouts["gyro"]) if at_rates else ()),
        *((deviation_key(start_deviation(roles), GUESS),) if guessed else ()),
    )
    entries = _with_stated(entries, _named_columns(values, roles))
    if typical:
        entries = tuple(with_typical_values(entries))
    if guessed and "data.sd.accelerometer" not in stated:
        entries, trials = with_scatter(entries, candidates, path.parent, start_deviation(roles))
    else:
        trials = try_methods(entries, candidates, path.parent)
    seen = facts(logs, table, roles, rests, time, readings)
    why_unused = [roles.reasons[key] for key in _LEFT_OUT if key in roles.reasons]
    unused = unused_columns(table, entries)
    seen = (*seen, *unused, *why_unused)
    return Draft(logs, path, entries, trials, seen, unused, roles, rests, time, readings)


def _require_possible_keys(trials: Sequence[MethodTrial], stated: Mapping[str, str]) -> None:
    """Refuse a stated value if it is the only reason why every method was refused."""
    keys = {trial.key for trial in trials}
    for key in stated:
        section, _, name = key.rpartition(".")
        if keys == {f"[{section}] {name}"}:
            reason = trials[0].reason.removeprefix(trials[0].key).lstrip(": ")
            raise InputError(f"--set {key}: {reason}", key=key, names=(key,))


def _is_heated(table: Table, roles: ColumnRoles) -> bool:
    """Return whether the temperature of a log changes much."""
    thermometer = roles.single.get("temperature")
    read = np.zeros(1) if thermometer is None else table.numbers(thermometer)
    read = read[np.isfinite(read)]
    return read.size > 0 and float(np.ptp(np.quantile(read, (0.1, 0.9)))) > _HEATED


def _candidates(log: Path, table: Table, roles: ColumnRoles) -> tuple[Candidate, ...]:
    """Return the methods that may fit, and refuse columns that suit no method."""
    if "table_rate" in roles.single or roles.rates or rests_in_ramp(roles):
        return candidate_methods(roles)
    if roles.triads.get("accelerometer") == ():
        raise without_accelerometers(log, table, roles)
    if "accelerometer" not in roles.triads:
        raise unknown_accelerometers(log, table, roles)
    require_no_cluster(log, table, roles)
    candidates = candidate_methods(roles, heated=_is_heated(table, roles))
    if not candidates:
        count = format_count(len(roles.triads["accelerometer"]), "accelerometer column")
        raise InputError(
            f"init drafts no run file for {count} together with these other columns: "
            f"{', '.join(roles.single) or 'none'}; {BY_HAND}"
        ).located(log)
    return candidates


def _named_columns(values: Mapping[str, Any], roles: ColumnRoles) -> dict[str, Any]:
    """Return the stated values without the columns that are already in the roles.

    A triad with a reversed axis keeps its signs.
    """

    def stays(key: str, value: Any) -> bool:
        signed = isinstance(value, list) and any(
            str(one).startswith("-") for one in cast(list[object], value)
        )
        section, _, role = key.partition(".")
        return section != "data" or signed or role not in {*roles.triads, *roles.single}

    return {key: value for key, value in values.items() if stays(key, value)}


def _with_stated(entries: tuple[DraftKey, ...], stated: Mapping[str, Any]) -> tuple[DraftKey, ...]:
    """Return the entries with the values that the user states, which may add new keys."""
    known = {entry.dotted: entry for entry in entries}
    for key, value in stated.items():
        section, _, name = key.rpartition(".")
        entry = known.get(key, DraftKey(section, name, value))
        known[key] = replace(entry, value=value, reason="as stated", assumed=False)
    if "bench.latitude" in stated and "bench.gravity" not in stated:
        known.pop("bench.gravity", None)
        weighs_gravity = any(one.section == "sensor.accelerometer" for one in entries)
        if "bench.height" not in stated and weighs_gravity:
            reason = "as stated; without a height, gravity covers 0 to 2000 m: state height too"
            known["bench.latitude"] = replace(known["bench.latitude"], reason=reason)
    return tuple(known.values())


__all__ = [
    "Draft",
    "DraftKey",
    "MethodTrial",
    "UnknownAccelerometers",
    "draft_run_file",
    "recording_name",
    "require_answers",
]
