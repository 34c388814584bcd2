"""What the columns of a recording hold, by their names, else by their values."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from inercal.arrays import Array
from inercal.io.column_table import Table
from inercal.io.time_stamps import is_iso_time

_AXES = ("x", "y", "z")
_AXIS_ENDS = {"x": 0, "y": 1, "z": 2, "0": 0, "1": 1, "2": 2}
_STEMS = {
    "accelerometer": re.compile(
        r"(n?a|f|acc|accl?|accel\w*|accelerometer\w*|linear_?accel\w*|specific_?force)"
    ),
    "gyro": re.compile(r"(g|w|om|omega|gyr|gyro\w*|angular_?(velocity|rate)|angular)"),
}
_NAMES = {
    "time": re.compile(
        r"t|time\w*|stamp|timestamp\w*|date\w*|seconds?|sample\w*|n_samples|counter"
    ),
    "temperature": re.compile(r"(imu_?|chip_?|sensor_?)?temp\w*|t_?c(elsius)?"),
    "arm_rate": re.compile(r"rpm|arm_?rate|rate|speed_?rpm|omega_over_pi|table_?rate"),
    "axis": re.compile(r"axis|up"),
    "angle": re.compile(r"angle|head|head_?angle"),
    "autocollimator": re.compile(r"autocollimator|collimator"),
    "level": re.compile(r"level"),
    "mounting": re.compile(r"mounting|fixture"),
    "hold": re.compile(r"hold"),
    "label": re.compile(r"label|part|section|position|pos|pose|step|face|phase"),
}
_TABLE = ("outer", "middle", "inner")
_ATTITUDE = ("psi", "theta")
_UNITS = (  # in a column's name, as text or in brackets: the unit, of which kind
    (re.compile(r"m_?/?s_?(\^?2|²|2)\b|m_s2|mps2"), "m/s²"),
    (re.compile(r"\[(mg)\]|\(mg\)|_mg\b"), "mg"),
    (re.compile(r"\[g\]|\(g\)|_g\b"), "g"),
    (re.compile(r"rad_?/?s\b|_rad\b|rads\b"), "rad/s"),
    (re.compile(r"(deg|°)_?/?s\b|dps\b|_deg\b"), "°/s"),
    (re.compile(r"lsb|counts?|raw"), "LSB"),
)
_TIME_UNITS = (
    (re.compile(r"\[?\bns\b|_ns\b|nanosec"), "ns"),
    (re.compile(r"\bus\b|_us\b|µs|microsec|usec"), "µs"),
    (re.compile(r"\bms\b|_ms\b|millisec|msec"), "ms"),
    (re.compile(r"\[s\]|\(s\)|_s\b|\bsec"), "s"),
)
_LOGS = ("ulog", "dataflash", "rosbag")  # formats of samples in SI units
_SI = {"accelerometer": "m/s²", "gyro": "rad/s"}
_FEWEST_SAMPLES = 500  # of a recording; fewer rows are means
_EVEN_STEPS = 0.5  # of the median step: largest 90 % deviation of steps of a clock


@dataclass(frozen=True)
class ColumnRoles:
    """Which columns hold what.

    Parameters
    ----------
    triads : mapping of "accelerometer" or "gyro" to tuple of str
        Columns by axis.
    single : mapping of str to str
        Column by role: "time", "label", "temperature", "arm_rate", "angle", ….
    table, attitude : tuple of str
        Columns of a turntable's angles, outermost first, and of ψ and θ on a centrifuge.
    reasons : mapping of str to str
        By role, how it was recognised.
    units : mapping of str to str
        By role, the unit that the column's name states.
    means : bool
        Whether the rows are means, not samples.
    """

    triads: Mapping[str, tuple[str, ...]]
    single: Mapping[str, str]
    table: tuple[str, ...] = ()
    attitude: tuple[str, ...] = ()
    reasons: Mapping[str, str] = field(default_factory=dict[str, str])
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    means: bool = False


def recognise_columns(table: Table, reader: str = "text") -> ColumnRoles:
    """Return the roles of a table's columns; some formats state units, and hold samples alone."""
    numbers = [name for name in table.names if table.columns[name].dtype.kind != "U"]
    texts = [name for name in table.names if table.columns[name].dtype.kind == "U"]
    rows = next(iter(table.columns.values())).size
    triads: dict[str, tuple[str, ...]] = {}
    single, reasons, units = dict[str, str](), dict[str, str](), dict[str, str]()
    if table.header:
        triads = _named_triads(numbers, reasons, units)
        used = {name for columns in triads.values() for name in columns}
        single = _named_columns([n for n in table.names if n not in used], table, reasons, units)
    else:
        triads, single = _unnamed_columns(table, numbers, reasons)
    if "label" not in single and texts and texts[0] not in single.values():
        single["label"], reasons["label"] = texts[0], "the column of text"
    if reader in _LOGS:
        units = {kind: unit for kind, unit in _SI.items() if kind in triads}
    by_lower = {name.lower(): name for name in table.names}
    angles = tuple(by_lower[name] for name in _TABLE if name in by_lower)
    attitude = tuple(by_lower[name] for name in _ATTITUDE if name in by_lower)
    if "accelerometer" not in triads and single.keys() & {"angle", "arm_rate"}:
        used = {*single.values(), *angles, *attitude}
        free = tuple(name for name in numbers if name not in used)
        triads["accelerometer"] = free[:2]
        reasons["accelerometer"] = "the columns that are left"
    return ColumnRoles(
        triads,
        single,
        angles,
        attitude if len(attitude) == len(_ATTITUDE) else (),
        reasons,
        units,
        reader not in _LOGS
        and rows < _FEWEST_SAMPLES
        and not _has_a_clock(table, single.get("time")),
    )


def column_unit(name: str) -> str | None:
    """Return the unit that a column's name states."""
    return next((unit for pattern, unit in _UNITS if pattern.search(name.lower())), None)


def time_unit(name: str) -> str | None:
    """Return the unit of time that a column's name states."""
    return next((unit for pattern, unit in _TIME_UNITS if pattern.search(name.lower())), None)


def _words(name: str) -> str:
    """Return a name in lower case, words by "_", without units in brackets."""
    name = re.sub(r"\(.*?\)|\[[^\]]*[^\d\]][^\]]*\]", "", name)  # "[0]" stays
    name = re.sub(r"([a-z])([A-Z])", r"\1_\2", name)
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def _named_triads(
    names: Sequence[str], reasons: dict[str, str], units: dict[str, str]
) -> dict[str, tuple[str, ...]]:
    """Return accelerometers and gyros by names that differ in their axis alone."""
    groups: dict[str, dict[int, str]] = {}
    for name in names:
        stem, axis = _stem_and_axis(_words(name))
        if axis is not None:
            groups.setdefault(stem, {}).setdefault(axis, name)
    triads: dict[str, tuple[str, ...]] = {}
    for kind, pattern in _STEMS.items():
        for stem, found in groups.items():
            base = re.sub(r"_(m_s2|mg|g|rad(_s)?|deg(_s)?|dps|raw|lsb)$", "", stem)
            last = base.rpartition("_")[2] if not pattern.fullmatch(base) else base
            if len(found) == len(_AXES) and (pattern.fullmatch(base) or pattern.fullmatch(last)):
                if kind in triads:
                    reasons[kind] += f"; {', '.join(found.values())} are left out"
                    continue
                triads[kind] = tuple(found[k] for k in range(len(_AXES)))
                reasons[kind] = "by their names"
                if unit := column_unit(found[0]):
                    units[kind] = unit
    return triads


def _stem_and_axis(words: str) -> tuple[str, int | None]:
    """Return a name without its axis, and the axis: ("acc", 0) of "acc_x", "accx" and "ax"."""
    head, _, last = words.rpartition("_")
    if head and last in _AXIS_ENDS:
        return head, _AXIS_ENDS[last]
    if head and re.fullmatch(r"m_s2|g|mg|rad|deg|dps|raw|lsb", last):
        inner, _, axis = head.rpartition("_")
        if axis in _AXIS_ENDS:
            return inner, _AXIS_ENDS[axis]
    if len(words) > 1 and words[-1] in _AXES:
        return words[:-1], _AXIS_ENDS[words[-1]]
    if len(words) > 1 and words[0] in _AXES and "_" in words:
        return words[2:], _AXIS_ENDS[words[0]]
    return words, None


def _named_columns(
    names: Sequence[str], table: Table, reasons: dict[str, str], units: dict[str, str]
) -> dict[str, str]:
    """Return the column of each further role by its name, and a clock by its values."""
    single: dict[str, str] = {}
    for name in names:
        words = _words(name.rpartition(".")[2])  # a log's columns are "topic.field"
        for role, pattern in _NAMES.items():
            if role not in single and pattern.fullmatch(words):
                if role == "time" and not _grows(table, name):
                    continue
                single[role], reasons[role] = name, "by its name"
                break
    if "time" in single and (unit := time_unit(single["time"])):
        units["time"] = unit
    return single


def _grows(table: Table, name: str) -> bool:
    """Return whether a column may be a clock: dates, or numbers that never go back far."""
    column = table.columns[name]
    if column.dtype.kind == "U":
        return column.size > 0 and is_iso_time(str(column[0]))
    steps = np.diff(column.astype(np.float64))
    return steps.size > 0 and bool(np.median(steps) > 0)


def _has_a_clock(table: Table, name: str | None) -> bool:
    """Return whether a column of times has steps of one length, as of samples."""
    if name is None:
        return False
    column = table.columns[name]
    if column.dtype.kind == "U":
        return True
    steps = np.diff(column.astype(np.float64))
    if steps.size < 2 * len(_AXES):
        return False
    typical = float(np.median(steps))
    return typical > 0 and float(np.quantile(np.abs(steps / typical - 1), 0.9)) < _EVEN_STEPS


def _unnamed_columns(
    table: Table, names: Sequence[str], reasons: dict[str, str]
) -> tuple[dict[str, tuple[str, ...]], dict[str, str]]:
    """Return triads and the clock of a table without header, by what their values do."""
    single: dict[str, str] = {}
    rest = list(names)
    if rest and _grows(table, rest[0]) and _has_a_clock(table, rest[0]):
        single["time"] = rest.pop(0)
        reasons["time"] = "it grows by steps of one length"
    triples = [tuple(rest[k : k + 3]) for k in range(0, len(rest) - len(rest) % 3, 3)][:2]
    found = [(columns, _varies_between_rests(table, columns)) for columns in triples]
    if len(found) == 1:
        kind = "accelerometer" if found[0][1] else "gyro"
        reasons[kind] = _value_reason(found[0][1])
        return {kind: found[0][0]}, single
    triads: dict[str, tuple[str, ...]] = {}
    for kind, wanted in (("accelerometer", True), ("gyro", False)):
        match = [columns for columns, varies in found if varies == wanted]
        if match:
            triads[kind], reasons[kind] = match[0], _value_reason(wanted)
    return triads, single


def _value_reason(varies: bool) -> str:
    return (
        "their readings at rest differ from attitude to attitude"
        if varies
        else "their readings at rest are the same in all attitudes"
    )


def _varies_between_rests(table: Table, columns: Sequence[str]) -> bool:
    """Return whether the readings of quiet blocks differ by far more than within a block."""
    data: Array = np.stack([table.numbers(name) for name in columns], axis=-1)
    block = max(20, len(data) // 1000)
    blocks = data[: len(data) // block * block].reshape(-1, block, len(columns))
    if len(blocks) < 4:
        return True
    scatter = blocks.std(axis=1).sum(axis=-1)
    quiet = blocks[scatter <= np.quantile(scatter, 0.3)].mean(axis=1)
    spread = np.ptp(np.quantile(quiet, (0.05, 0.95), axis=0), axis=0).max()
    moving = np.ptp(np.quantile(data, (0.001, 0.999), axis=0), axis=0).max()
    return bool(spread > 0.25 * moving)
