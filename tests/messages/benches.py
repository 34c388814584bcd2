"""Families of messages of plans, of benches and of their sections of a run file."""

from collections.abc import Callable
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.units import Measured
from inercal.benches import DividingHead, RateTable, Turntable
from inercal.benches.dividing_head.bench import position_plan
from inercal.benches.dividing_head.bench import sensed_motion as head_motion
from inercal.benches.rate_table.bench import sensed_motion
from inercal.benches.rate_table.fixture import mounting_attitude
from inercal.benches.turntable.paths import read_path
from inercal.benches.turntable.reading.readback_clock import align_readback
from inercal.benches.turntable.reading.track_checks import check_track
from inercal.benches.turntable.settings import TurntableSection, build
from inercal.benches.turntable.simulation import path_profile
from inercal.physics.earth import normal_gravity
from inercal.physics.plan import Position, Rotation, Spin
from inercal.physics.section_settings import si_value
from inercal.physics.sensors.catalogue import imu
from inercal.recordings import Track

GRAVITY = Measured(9.81, 0.0)
TABLE = Turntable(GRAVITY, radians(38))
HEAD = DividingHead(GRAVITY, collimated="every", polygon=(0.0,) * 8)
AXES = ("outer", "middle", "inner")


def _bench(folder: Path, **keys: Any) -> object:
    section = TurntableSection(kind="turntable", gravity="9.81 m/s²", **keys)
    return build(section, folder)


def _path(folder: Path, rows: str, header: str = "label,kind,outer [°],seconds [s]") -> object:
    path = folder / "path.csv"
    path.write_text(f"{header}\n{rows}\n", encoding="utf-8")
    return read_path(path, AXES[:1])


def _frozen_readback(_: Path) -> object:
    reading = np.zeros((1000, 6))
    reading[500:, 5] = 0.2
    hold = np.full(1000, -1)
    track = Track(np.arange(1000) / 100, reading, np.zeros((1000, 3)), hold)
    return check_track("run.toml", track, imu(), TABLE)


CASES: dict[str, Callable[[Path], object]] = {
    "value of a bench": lambda _: replace(TABLE, gravity=Measured(0.0, 0.0)),
    "standard deviation of a bench": lambda _: RateTable(GRAVITY, Measured(0.25, 0.0), seat=-1.0),
    "axes of a turntable": lambda _: replace(TABLE, axes="zz"),
    "field of a step": lambda _: Rotation("r1", 0, 1.0, -1.0),
    "step beyond a limit": lambda _: path_profile(TABLE, [Rotation("r1", 0, 1.0, 9.0)]),
    "step of other axes": lambda _: path_profile(TABLE, [Position("p1", (0.0,), 1.0)]),
    "unknown attitude": lambda _: sensed_motion(
        RateTable(GRAVITY, Measured(0.25, 0.0)), [Spin("s1", 1.0)], {}
    ),
    "unknown mounting": lambda _: mounting_attitude("XZ"),  # pyright: ignore[reportArgumentType]
    "no face of the polygon": lambda _: head_motion(HEAD, position_plan(12), {}),
    "height": lambda _: normal_gravity(0.0, 9e9),
    "uncertainty without effect": lambda _: si_value("3 m ± 1 m", "m", "[bench] height"),
    "key of the bench": lambda folder: _bench(folder, latitude="38 °", square="2 °"),
    "azimuth": lambda folder: _bench(folder, latitude="38 °", azimuth="0 ° ± 10 °"),
    "column of a path": lambda folder: _path(folder, "p,position,1", "label,kind,outer"),
    "cell of a path": lambda folder: _path(folder, "p,position,1,-3"),
    "readback that is constant": _frozen_readback,
    "clock of the readback": lambda _: align_readback(
        TABLE, np.arange(9.0), np.zeros((9, 3)), np.arange(99.0), np.zeros((99, 3))
    ),
}
