"""Logs of text: a form states its columns, units, digits and lines, and `write_text` writes a log.

A column is "source|header". The sources a (accelerometers), w (gyros), m (magnetometer), l
(acceleration without gravity), v (gravity by the phone) and e (roll, pitch, yaw) stand for three
columns: {x}, {X} and {k} in the header become the axis, and "a.zyx" gives their order.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tests.log_corpus.motion import G0, Array, Log

EPOCH = 1_764_400_000.25  # s
SI: Mapping[str, float] = {
    **{"m/s²": 1.0, "g": G0, "mg": 1e-3 * G0, "Gal": 0.01, "rad/s": 1.0},
    **{"°/s": np.pi / 180, "m°/s": 1e-3 * np.pi / 180, "mrad/s": 1e-3},
}


class Written(NamedTuple):
    """The files of a log, and what a draft must find: columns, and units if the data tell them."""

    files: tuple[Path, ...]
    columns: Mapping[str, tuple[object, ...]]
    units: Mapping[str, str]
    scales: Mapping[str, float] = {}  # counts per SI unit
    truth: Mapping[str, float] = {}


@dataclass(frozen=True)
class Form:
    """The form of an exporter's files."""

    columns: tuple[str, ...]
    acc: str = "m/s²"
    gyro: str = "rad/s"
    digits: int = 5
    separator: str = ","
    above: tuple[str, ...] = ()  # lines; "{head}" is the place of the header
    below: Mapping[str, str] = field(default_factory=dict[str, str])  # row of units, by source
    comma: bool = False  # decimal commas
    begin: str = ""
    end: str = ""
    counts: tuple[float, float] | None = None  # LSB/g and LSB/(°/s)
    header: bool = True
    suffix: str = ".csv"
    joined: tuple[str, ...] = ()  # text before each cell, for serial prints
    newline: str = "\n"
    unsigned: bool = False
    spreadsheet: bool = False


def readings(log: Log, form: Form) -> dict[str, Array]:
    """Return force and rate in the units of a form, rounded as it rounds."""
    if form.counts is not None:
        per_g, per_degree = form.counts
        a, w = log.force / G0 * per_g, np.degrees(log.rate) * per_degree
        return {"a": np.rint(a), "w": np.rint(w)}
    return {"a": log.force / SI[form.acc], "w": log.rate / SI[form.gyro]}


def _cells(values: Array, digits: int) -> list[str]:
    return [f"{one:.{digits}f}" for one in values.tolist()]


def _dates(log: Log, text: str) -> list[str]:
    start = datetime.fromtimestamp(EPOCH, UTC)
    found = (start + timedelta(seconds=one) for one in log.time.tolist())
    return [one.strftime(text)[: -3 if text.endswith("%f") else None] for one in found]


def single_columns(log: Log) -> dict[str, Callable[[], list[str]]]:
    """Return the cells of each column that is no triad, by its source."""
    n = np.arange(len(log.time))
    us = np.rint(log.time * 1e6).astype(np.int64)
    epoch_ns = round(EPOCH * 1e9) + us * 1000
    quaternion = np.sqrt(np.maximum(0.25 * (1 + np.trace(log.attitude, axis1=1, axis2=2)), 0))

    def whole(x: Array) -> Callable[[], list[str]]:
        return lambda: [str(one) for one in x.tolist()]

    def real(x: Array, digits: int) -> Callable[[], list[str]]:
        return lambda: _cells(x, digits)

    return {
        "t": real(log.time, 6), "t3": real(log.time, 3), "ms": whole(us // 1000), "us": whole(us),
        "ns": whole(us * 1000), "100us": whole(us // 100), "tms": real(log.time * 1e3, 1),
        "late_t": real(log.time + 512.25, 4),
        "epoch": real(EPOCH + log.time, 6), "epoch_ms": whole(epoch_ns // 10**6),
        "epoch_us": whole(epoch_ns // 1000), "epoch_ns": whole(epoch_ns),
        "week_s": real(219418.0 + log.time, 6),
        "ms_wraps": whole((us // 1000 + 2**32 - 7000) % 2**32),
        "us_wraps": whole((us + 2**32 - 11_000_000) % 2**32), "ms16": whole((us // 1000) % 65536),
        "row": whole(n), "u8": whole((n + 200) % 256), "u16": whole((n + 65000) % 65536),
        "u32": whole((n + 2**32 - 900) % 2**32),
        "iso": lambda: _dates(log, "%Y-%m-%dT%H:%M:%S.%f"),
        "isoz": lambda: [f"{one}Z" for one in _dates(log, "%Y-%m-%dT%H:%M:%S.%f")],
        "date": lambda: _dates(log, "%Y-%m-%d"), "clock": lambda: _dates(log, "%H:%M:%S.%f"),
        "spaced": lambda: _dates(log, "%Y-%m-%d %H:%M:%S.%f"),
        "colons": lambda: _dates(log, "%Y-%m-%d %H:%M:%S:%f"),
        "temp": real(log.celsius, 2), "temp1": real(np.rint(log.celsius * 2) / 2, 1),
        "press": real(1009.8 + 0.02 * np.sin(log.time), 2), "q0": real(quaternion, 5),
        "q": real(0.5 * np.cos(log.time / 3), 5), "zero": whole(0 * n),
        "norm": real(np.linalg.norm(log.force, axis=1) / G0, 4), "unused": lambda: [""] * len(n),
        "check": lambda: [f"*{(k * 37) % 256:02X}" for k in n.tolist()],
        "hex": lambda: [f"{(k * 40503) % 65536:04x}" for k in n.tolist()],
        "label": lambda: [log.labels[k] if k >= 0 else "" for k in log.section.tolist()],
    }  # fmt: skip


def triads(log: Log, form: Form) -> dict[str, Array]:
    """Return the triads of a log in the units of a form, by source."""
    c = log.attitude
    angles = [np.arctan2(c[:, 2, 1], c[:, 2, 2]), -np.arcsin(np.clip(c[:, 2, 0], -1, 1))]
    euler = np.degrees([*angles, np.arctan2(c[:, 1, 0], c[:, 0, 0])]).T
    gravity = G0 * c[:, 2]
    iron = np.array([[1.02, 0.01, -0.02], [0.01, 0.97, 0.02], [-0.02, 0.02, 1.01]])
    magnetic = np.einsum("nji,j->ni", c, [22.0, 1.0, -42.0]) @ iron + [5.0, -9.0, 3.0]
    magnetic = magnetic + np.random.default_rng(len(c)).normal(0, 0.3, magnetic.shape)
    own = readings(log, form)
    return own | {"e": euler, "v": gravity, "l": log.force - gravity, "m": magnetic}


def text_columns(log: Log, form: Form) -> tuple[dict[str, list[str]], list[str]]:
    """Return the cells of each column by its header, and the source of each column."""
    data, single = triads(log, form), single_columns(log)
    digits = {"a": form.digits, "w": form.digits, "m": 2, "e": 2, "v": 4, "l": 4}
    found: dict[str, list[str]] = {}
    sources: list[str] = []
    for column in form.columns:
        source, _, head = column.partition("|")
        kind, _, order = source.partition(".")
        if kind in data:
            for axis in order or "xyz":
                k = "xyz".index(axis)
                name = head.replace("{x}", axis).replace("{X}", axis.upper()).replace("{k}", str(k))
                values = data[kind][:, k] * (-1 if name.startswith("-(") else 1)
                if kind in "aw" and form.counts is not None:
                    values = values % 65536 if form.unsigned else values
                    found[name] = [str(int(one)) for one in values.tolist()]
                else:
                    found[name] = _cells(values, digits[kind])
                sources.append(kind)
        else:
            found[head] = [source[1:]] * len(log.time) if kind[:1] == "=" else single[source]()
            sources.append(source)
    return found, sources


def drafted_columns(form: Form) -> dict[str, tuple[object, ...]]:
    """Return the place, from 1, of the columns that a draft must name for each triad."""
    places: dict[str, dict[str, int]] = {"a": {}, "w": {}}
    place = 0
    for column in form.columns:
        source, _, _ = column.partition("|")
        kind, _, order = source.partition(".")
        for axis in (order or "xyz") if kind in set("awmlve") else " ":
            place += 1
            if kind in places:
                places[kind][axis] = -place if "|-(" in column else place
    roles = {"accelerometer": places["a"], "gyro": places["w"]}
    return {kind: tuple(one[x] for x in "xyz" if x in one) for kind, one in roles.items() if one}


def write_text(log: Log, form: Form, folder: Path, name: str) -> Written:
    """Write a log in a form."""
    cells, sources = text_columns(log, form)
    if form.comma:
        cells = {head: [one.replace(".", ",") for one in column] for head, column in cells.items()}
    head = form.separator.join(cells)
    rows = [list(row) for row in zip(*cells.values(), strict=True)]
    if form.joined:
        rows = [[a + b for a, b in zip(form.joined, row, strict=True)] for row in rows]
    body = [form.begin + form.separator.join(row) + form.end for row in rows]
    units = [form.separator.join(form.below.get(s, "") for s in sources)] if form.below else []
    above = [line.replace("{head}", head) for line in form.above]
    if form.header and not any("{head}" in line for line in form.above):
        above.append(head)
    path = folder / f"{name}{form.suffix}"
    path.write_bytes((form.newline.join([*above, *units, *body]) + form.newline).encode())
    return Written((path,), drafted_columns(form), units_of(form), scales_of(form), log.truth)


def units_of(form: Form) -> dict[str, str]:
    """Return the units that a draft must state."""
    kinds = drafted_columns(form)
    units = {"accelerometer": form.acc, "gyro": form.gyro}
    if form.counts is not None:
        units = {"accelerometer": "LSB", "gyro": "LSB"}
    return {kind: unit for kind, unit in units.items() if kind in kinds}


def scales_of(form: Form) -> dict[str, float]:
    """Return the nominal counts per SI unit; none if the readings have a unit."""
    if form.counts is None:
        return {}
    per_g, per_degree = form.counts
    return {"accelerometer": per_g / G0, "gyro": float(np.degrees(per_degree))}
