"""Writes the recording of a run from the log; the run file names the recording.

[data] names the columns. The group `bench` contains the table's readings, poll by poll, and the
quality of the interpolated angles. For a table without readback, it contains neither. For a run in
a chamber, it also contains the chamber's temperatures.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.atomic_files import atomic_write
from inercal.basics.errors import InputError, require_extra, require_installed
from inercal.benches.turntable.reading import host_readback
from inercal.host.assembly import SampleAssembler, SampleBlock
from inercal.host.assembly.table_polls import POLL_INTERVAL
from inercal.host.drivers.rotary_table import unpack_states
from inercal.host.packets import PacketLayout
from inercal.host.run_log import CHAMBER, EVENT, IMU, TABLE, file_sha256, read_frames
from inercal.host.tasks import has_soaks
from inercal.physics.section_settings import key_error
from inercal.recordings import AngleQuality
from inercal.recordings.data.recording_loader import readback_columns
from inercal.recordings.io.simulation_mark import SIMULATION_KEY
from inercal.runfile import Run

_FRAMES_PER_PIECE = 4096  # frames processed at once
_NEEDS_H5PY = "writing a recording needs h5py"
_SUFFIXES = (".h5", ".hdf5")
_SINGLE_KEYS = ("time", "label", "mounting", "hold", "arm_rate", "temperature")
_CHAMBER_COLUMNS = ("chamber_time", "chamber_temperature", "chamber_target")  # s, K, K
_AXIS_KEYS = ("accelerometer", "gyro", "table")  # each names a column for each axis


def require_recordable(run: Run, layout: PacketLayout | None = None) -> None:
    """Raise an error if [data] does not state where and how to record a bench run.

    Parameters
    ----------
    run : Run
    layout : PacketLayout, optional
        Layout of the IMU's packets, if known.

    Raises
    ------
    InputError
        [data] is incomplete or unsuitable; the message names the key and the possible values.
    """
    require_installed("io", _NEEDS_H5PY, ("h5py",))
    control, data = run.motion_control, run.data

    def refusal(key: str, text: str, *names: str) -> InputError:
        return key_error(f"[data] {key}", text, run.path, names)

    if Path(data.file).suffix.lower() not in _SUFFIXES:
        raise refusal(
            "file", f"a run on the bench is written as {_SUFFIXES[0]}; change {data.file!r} to it"
        )
    for key, example in control.required_keys.items():
        if key == "hold" and run.method.without_angles:
            continue  # such a method finds the rests in the gyro readings
        if getattr(data, key) is None:
            raise refusal(key, f"the key is missing; add it, such as {key} = {example}")
    if data.time_unit != "s":
        raise refusal(
            "time_unit", f'a run on the bench is written in "s"; replace {data.time_unit!r}'
        )
    for key in ("gyro_file", "gyro_time", "table_file"):
        if getattr(data, key, None) is not None:
            raise refusal(key, "a run on the bench is written to one file; remove this key")
    group = host_readback.BENCH_GROUP
    columns = [(key, name) for key in _AXIS_KEYS for name in getattr(data, key, None) or ()]
    columns += [(key, getattr(data, key)) for key in _SINGLE_KEYS if getattr(data, key, None)]
    for key, name in columns:
        if not isinstance(name, str) or not name or set(name) & set("./()#") or name == group:
            raise refusal(
                key,
                f"column {name!r} cannot be written; give a name without . / ( ) #, other than "
                f"{group!r}",
                str(name),
            )
        if name.startswith("-"):
            raise refusal(
                key,
                f"a run on the bench does not write {name!r} reversed; reverse the sign in the "
                "description of the packets or in the table's counts",
                name,
            )
    # A chamber also measures a temperature.
    has_temperature = layout is None or "temperature" in layout.roles or has_soaks(run)
    if data.temperature is not None and layout is not None and not has_temperature:
        raise refusal(
            "temperature",
            f"the packets of {layout.name!r} have no temperature; remove this key",
            layout.name,
        )


def write_recording(
    run: Run,
    layout: PacketLayout,
    log: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    about: Mapping[str, str] | None = None,
    poll: float = POLL_INTERVAL,
    log_sha256: str | None = None,
    simulation: str = "",
    imu_kind: int = IMU,
) -> Path:
    """Write the recording of a run, completely or not at all, and return its path.

    Parameters
    ----------
    run : Run
    layout : PacketLayout
        Layout of the IMU's packets.
    log : path
    folder : path
        Folder in which the file named in [data] is written.
    about : mapping of str to str, optional
        Additional attributes of the group, such as addresses and versions.
    poll : float
        Time between two polls of the table, s.
    log_sha256 : str, optional
        SHA-256 hash of the log, if known; if not, it is computed.
    simulation : str
        The mark of a simulated bench (`inercal.recordings.io.simulation_mark`); empty for a real
        bench.
    imu_kind : int
        Kind of the frames of the recorded IMU in the log.

    Raises
    ------
    InputError
        The run file does not state enough, the log is damaged or contains no sample of any section,
        the path is not writable, or h5py is missing.
    """
    require_recordable(run, layout)
    with require_extra("io", _NEEDS_H5PY, ("h5py",)):
        h5py: Any = import_module("h5py")
    assembly = SampleAssembler(run, layout, poll, imu_kind)
    blocks: list[SampleBlock] = []
    said: list[bytes] = []
    heard: list[float] = []
    chamber: list[tuple[float, float, float]] = []

    def take() -> None:
        if (block := assembly.take()) is not None:
            if block.starts_recording:
                blocks.clear()
            blocks.append(block)

    for k, frame in enumerate(read_frames(log), start=1):
        assembly.feed(frame)
        if frame.kind == TABLE:
            said.append(frame.payload)
            heard.append(frame.time)
        elif frame.kind == EVENT and (event := json.loads(frame.payload)).get("what") == CHAMBER:
            chamber.append((frame.time, event["temperature"], event["target"]))
        if k % _FRAMES_PER_PIECE == 0:
            take()
    take()
    if not blocks or not said:
        raise InputError(
            f"{log} contains no sample from a section, so there is no recording to write; "
            "repeat the run",
            file=Path(log),
        )
    of_chamber = np.array(chamber).reshape(-1, 3)
    of_chamber[:, 0] -= assembly.recording_start or 0.0
    columns = _recording_columns(run, assembly, blocks, of_chamber)
    path = Path(folder) / run.data.file
    told: dict[str, Any] = {
        "packets": layout.name,
        "protection": layout.protection,
        "log sha256": log_sha256 or file_sha256(log),
        "samples": assembly.samples,
        host_readback.POLLS: assembly.table.count,
        "polls left out": assembly.table.drops,
        host_readback.IMPLAUSIBLE_POLLS: assembly.table.implausible,
        **{f"bytes: {name}": n for name, n in asdict(assembly.imu.counts).items()},
        **{f"packets left out: {name}": n for name, n in asdict(assembly.imu.drops).items()},
        host_readback.INTERRUPTIONS: host_readback.write_interruptions(_interruptions(assembly)),
        **(about or {}),
    }
    reads_angles = bool(readback_columns(run))
    if reads_angles:
        told |= {
            "samples without angle": assembly.samples_without_angle,
            host_readback.UNUSABLE_ANGLES: assembly.samples_with_unusable_angle,
        }
    table = unpack_states(said)
    with atomic_write(path) as temporary, h5py.File(temporary, "w") as file:
        for name, column in columns.items():
            if column.dtype.kind == "U":
                coded = np.char.encode(column, "utf-8")
                kind = h5py.string_dtype("utf-8", max(coded.dtype.itemsize, 1))
                file.create_dataset(name, data=coded.astype(kind), dtype=kind)
            else:
                file.create_dataset(name, data=column)
        if simulation:
            file.attrs[SIMULATION_KEY] = simulation
        group = file.create_group(host_readback.BENCH_GROUP)
        group.attrs.update(told)
        if chamber:
            for name, column in zip(_CHAMBER_COLUMNS, of_chamber.T, strict=True):
                group[name] = column
        if reads_angles:
            group["heard"] = np.array(heard)
            for name in ("time", "span", "angle", "rate", "following_error"):
                group[name] = getattr(table, name)
            for name in AngleQuality._fields:
                group[name] = np.concatenate([getattr(one.quality, name) for one in blocks])
    return path


def _interruptions(assembly: SampleAssembler) -> list[host_readback.Interruption]:
    """Return the interruptions of a recording, in s after its first sample."""
    begin = assembly.recording_start or 0.0
    return [
        host_readback.Interruption(one.start - begin, one.stop - begin, "; ".join(one.causes))
        for one in assembly.interruptions.spans
        if one.start > begin
    ]


def _recording_columns(
    run: Run, assembly: SampleAssembler, blocks: list[SampleBlock], chamber: Array
) -> dict[str, NDArray[Any]]:
    """Return the columns by the names in [data].

    If the packets contain no temperature, it is the temperature in the rows of `chamber`, (c, 3).
    """
    data, control = run.data, run.motion_control
    output = np.concatenate([one.output for one in blocks])
    said = np.concatenate([one.angle_output for one in blocks])
    table = np.concatenate([one.table for one in blocks])
    given = {"f": iter(data.accelerometer), "w": iter(data.gyro)}
    names = [next(given[axis.measures]) for axis in run.sensor.axes]
    recorded = readback_columns(run)
    of_table = [recorded[name] for name in control.readback(run.bench) if name in recorded]
    columns: dict[str, NDArray[Any]] = {
        str(data.time): np.concatenate([one.time for one in blocks]),
        **{str(name): output[:, k] for k, name in enumerate(names)},
        **{name: said[:, k] for k, name in enumerate(of_table)},
        str(data.row): assembly.sections.labels(table),
    }
    if (hold := getattr(data, "hold", None)) is not None:
        columns[str(hold)] = np.concatenate([one.hold for one in blocks])
    if data.temperature is not None:
        kelvin = np.concatenate([one.temperature for one in blocks])
        if chamber.size and not np.isfinite(kelvin).any():
            kelvin = np.interp(columns[str(data.time)], chamber[:, 0], chamber[:, 1])
        kelvin = _fill_missing(kelvin)
        columns[str(data.temperature)] = data.thermometer.values(kelvin)
    return columns


def _fill_missing(values: Array) -> Array:
    """Fill each gap with the last value before the gap; at the start, use the first value."""
    there = np.isfinite(values)
    if not there.any():
        raise InputError(
            "the packets of the run contain no temperature; remove [data] temperature",
            key="[data] temperature",
        )
    at = np.maximum.accumulate(np.where(there, np.arange(values.size), -1))
    return values[np.where(at < 0, int(np.argmax(there)), at)]
