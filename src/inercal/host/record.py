"""From the log of a run to the recording that its run file names.

Columns are those of [data]; beside them, in the group `bench`, stands what the table said itself,
poll by poll.
"""

import os
from collections.abc import Mapping
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.benches.turntable import data_of, turntable_of
from inercal.data.load import readback_columns
from inercal.errors import InputError, brought_by
from inercal.host.assembly import Assembly, Block
from inercal.host.log import TABLE, digest, frames
from inercal.host.packets import Layout
from inercal.host.states import polls
from inercal.io.atomic import atomic_write
from inercal.runfile import Run
from inercal.units import to_si

_FRAMES = 4096  # worked through at once
_SUFFIXES = (".h5", ".hdf5")
_NEEDED = {"time": '"time"', "rate": '"200 Hz"', "label": '"step"', "hold": '"hold"'}
GROUP = "bench"


def require_recordable(run: Run, layout: Layout | None = None) -> None:
    """Refuse a run file whose [data] does not say what a run on the bench is written to.

    Parameters
    ----------
    run : Run
    layout : Layout, optional
        Of the IMU's packets, where it is known.

    Raises
    ------
    InputError
        Naming the key and what is possible.
    """
    data, where = data_of(run), f"{run.path}: [data]"
    if Path(data.file).suffix.lower() not in _SUFFIXES:
        raise InputError(
            f"{where} file: {data.file!r}: a run on the bench is written to {_SUFFIXES[0]}"
        )
    for key, example in _NEEDED.items():
        if getattr(data, key) is None:
            raise InputError(f"{where} {key} is missing, such as {key} = {example}")
    if data.time_unit != "s":
        raise InputError(f'{where} time_unit: {data.time_unit!r}: a run on the bench takes "s"')
    for key in ("gyro_file", "table_file"):
        if getattr(data, key) is not None:
            raise InputError(f"{where} {key}: a run on the bench is one file; leave it out")
    names = [*data.accelerometer, *data.gyro, *(data.table or ()), data.time, data.label, data.hold]
    names += [data.temperature] if data.temperature is not None else []
    for name in names:
        if not isinstance(name, str) or not name or set(name) & set("./()#") or name == GROUP:
            raise InputError(f"{where}: column {name!r} cannot be written; name it by letters")
        if name.startswith("-"):
            raise InputError(
                f"{where}: {name!r}: a run on the bench reverses nothing as it is written; put the "
                "sign to the description of the packets or to the table's counts"
            )
    if data.temperature is not None and layout is not None and "temperature" not in layout.roles:
        raise InputError(f"{where} temperature: packets of {layout.name!r} have none; leave it out")


def write(
    run: Run,
    layout: Layout,
    log: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    about: Mapping[str, str] | None = None,
    poll: float = 0.02,
    log_sha256: str | None = None,
) -> Path:
    """Write the recording of a run, whole or not at all; return its path.

    Parameters
    ----------
    run : Run
    layout : Layout
        Of the IMU's packets.
    log : path
    folder : path
        Where [data] `file` is written.
    about : mapping of str to str, optional
        More to be kept as attributes of the group: addresses, versions.
    poll : float
        s between polls of the table.
    log_sha256 : str, optional
        Digest of the log, where it is known; else the log is read for it.

    Raises
    ------
    InputError
        A run file that says too little, a log that is damaged or holds no sample of a section, a
        path that cannot be written, or no h5py.
    """
    require_recordable(run, layout)
    with brought_by("io", "a recording is written by h5py", ("h5py",)):
        h5py: Any = import_module("h5py")
    assembly = Assembly(run, layout, poll)
    blocks: list[Block] = []
    said: list[bytes] = []
    heard: list[float] = []

    def take() -> None:
        if (block := assembly.take()) is not None:
            if block.begins:
                blocks.clear()
            blocks.append(block)

    for k, frame in enumerate(frames(log), start=1):
        assembly.feed(frame)
        if frame.kind == TABLE:
            said.append(frame.payload)
            heard.append(frame.time)
        if k % _FRAMES == 0:
            take()
    take()
    if not blocks or not said:
        raise InputError(f"{log} holds no sample of a section: nothing to record")
    columns = _columns(run, assembly, blocks)
    tally, path = assembly.tally, Path(folder) / run.data.file
    told: dict[str, Any] = {
        "packets": layout.name,
        "protection": layout.protection,
        "log sha256": log_sha256 or digest(log),
        "samples": tally.samples,
        "samples without angle": tally.no_angle,
        "polls left out": tally.polls_left_out,
        **{f"bytes: {name}": n for name, n in asdict(tally.bytes).items()},
        **{f"packets left out: {name}": n for name, n in asdict(tally.left_out).items()},
        **(about or {}),
    }
    table = polls(said)
    with atomic_write(path) as temporary, h5py.File(temporary, "w") as file:
        for name, column in columns.items():
            if column.dtype.kind == "U":
                coded = np.char.encode(column, "utf-8")
                kind = h5py.string_dtype("utf-8", max(coded.dtype.itemsize, 1))
                file.create_dataset(name, data=coded.astype(kind), dtype=kind)
            else:
                file.create_dataset(name, data=column)
        group = file.create_group(GROUP)
        group.attrs.update(told)
        group["heard"] = np.array(heard)
        for name in ("time", "span", "angle", "rate", "following_error"):
            group[name] = getattr(table, name)
    return path


def _columns(run: Run, assembly: Assembly, blocks: list[Block]) -> dict[str, NDArray[Any]]:
    """Return the columns by their names in [data]."""
    data, bench = data_of(run), turntable_of(run)
    output = np.concatenate([one.output for one in blocks])
    said = np.concatenate([one.said for one in blocks])
    table = np.concatenate([one.table for one in blocks])
    given = {"f": iter(data.accelerometer), "w": iter(data.gyro)}
    names = [next(given[axis.measures]) for axis in run.sensor.axes]
    of_table = [readback_columns(run)[name] for name in bench.names]
    columns: dict[str, NDArray[Any]] = {
        str(data.time): np.concatenate([one.time for one in blocks]),
        **{str(name): output[:, k] for k, name in enumerate(names)},
        **{name: said[:, k] for k, name in enumerate(of_table)},
        str(data.label): assembly.labels(table),
        str(data.hold): np.concatenate([one.hold for one in blocks]),
    }
    if data.temperature is not None:
        kelvin = _filled(np.concatenate([one.temperature for one in blocks]))
        zero, one = to_si(np.array([0.0, 1.0]), data.temperature_unit, "K")
        columns[str(data.temperature)] = (kelvin - zero) / (one - zero)
    return columns


def _filled(values: Array) -> Array:
    """Return values with what was there last where there is none; at the start with the first."""
    there = np.isfinite(values)
    if not there.any():
        raise InputError("no packet holds a temperature; leave [data] temperature out")
    at = np.maximum.accumulate(np.where(there, np.arange(values.size), -1))
    return values[np.where(at < 0, int(np.argmax(there)), at)]
