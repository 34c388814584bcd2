"""Every key of [bench], [sensor], [environment], [method.filter] changes the result or is refused.

A result is values, their uncertainty and the verdict: of a height that only checks gravity it is
the verdict. The keys are those of the schema and the methods those there are: a new key is in this
test without an edit, and a new method without a case fails it.
"""

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.runfile.key_sweep import (
    EXAMPLES,
    Content,
    Key,
    alternatives,
    example,
    keys,
    planning,
    silent_keys,
    toml,
    with_key,
)

from inercal.basics.errors import InputError
from inercal.methods import METHODS
from inercal.pipeline import apply_data_columns, simulate
from inercal.recordings import Recording
from inercal.recordings.io.write import write_recording
from inercal.runfile import read

Change = tuple[str, str, object]


@dataclass(frozen=True)
class Case:
    """A run file of the examples with changes, and the folder of its tables where it has some."""

    path: str
    changes: tuple[Change, ...] = ()
    method: str = ""

    @property
    def content(self) -> Content:
        """The run file's content."""
        return example(self.path, *self.changes)


def recording(path: str, rate: str, *changes: Change) -> Case:
    """Return a case of a simulated recording of few samples."""
    small: tuple[Change, ...] = (("data", "rate", rate), ("data", "file", "log.npz"))
    return Case(path, (*small, *changes))


def seconds(each: str) -> Change:
    return ("method", "seconds", each)


def of(name: str) -> Change:
    return ("method", "name", name)


NO_GYROS: tuple[Change, ...] = (
    ("sensor", "gyro", None),
    ("sensor", "truth", {"ax.k0": "12 mg", "az.k1": "0.6 %", "ax.delta_o": "10 ′"}),
)
NO_TURNS: tuple[Change, ...] = (
    ("bench", "turn_angle", None),
    ("bench", "turn_tilt", None),
    ("method", "turn", None),
    ("method", "turn_seconds", None),
)
SPINS = ("method", "turns", 4)
TABLE = "turntable/mimu.toml"
QUICK = {
    "six_position": recording(
        "ferraris_simulated/run.toml",
        "25 Hz",
        of("six_position"),
        seconds("4 s"),
        *NO_GYROS,
        *NO_TURNS,
    ),
    "temperature_ramp": recording(
        "temperature/ramp.toml",
        "10 Hz",
        seconds("1800 s"),
        ("environment", "ramp_rate", "4.667 K/min"),
        ("method", "temperature_order", [3, 0, 0]),
        ("sensor", "truth", {"gx.bias": "25 °/s", "gx.bias_dT": "54 °/h/K"}),
    ),
    "six_position of means": Case("six_position/run.toml"),
    "dual_orthogonal of means": Case("dividing_head/lab.toml"),
    "tumble": Case("dividing_head/tumble.toml"),
}
SLOW = {
    "six_position with gyros": recording(
        "ferraris_simulated/run.toml", "25 Hz", of("six_position"), seconds("4 s"), *NO_TURNS
    ),
    "ferraris": recording(
        "ferraris_simulated/run.toml", "25 Hz", seconds("4 s"), ("method", "turn_seconds", "4 s")
    ),
    "six_position over soaks": recording(
        "temperature/soaks.toml",
        "10 Hz",
        ("sensor.accelerometer", "unit", "g"),
        seconds("4 s"),
        ("environment", "temperatures", ["-20 °C", "10 °C", "40 °C"]),
        ("environment", "ramp_rate", "60 K/min"),
        ("environment", "wait", "30 s"),
        ("environment", "case_time", "20 s"),
        ("method", "temperature_order", [2, 1, 1]),
    ),
    "ship_multi_angle of means": Case("rate_table/ship.toml"),
    "multi_position": recording(
        "hand_held/simulated.toml", "50 Hz", ("method", "positions", 14), seconds("2 s")
    ),
    "multi_position with magnetometers": recording(
        "magnetometer/nine_axes.toml",
        "50 Hz",
        ("sensor.accelerometer", "unit", "g"),
        ("method", "positions", 14),
        seconds("2 s"),
    ),
    "field_and_rates": recording(
        "magnetometer/motion.toml", "50 Hz", ("method", "positions", 14), seconds("2 s")
    ),
    "centrifuge_norm": recording("centrifuge/arm_run.toml", "50 Hz", SPINS),
    "dual_orthogonal": recording("dividing_head/pair.toml", "10 Hz", seconds("5 s")),
    "ship_planar": recording(
        "rate_table/ship_recording.toml", "50 Hz", of("ship_planar"), seconds("12 s")
    ),
    "rates_and_poses of means": Case("rate_platform/imu.toml"),
    "rates_and_poses of gyros alone": Case("rate_platform/gyros.toml"),
    "centrifuge_norm of means": Case("centrifuge/lab.toml"),
    "ship_multi_angle": recording("rate_table/ship_recording.toml", "50 Hz", seconds("3 s")),
    "turntable_kalman": recording(TABLE, "50 Hz"),
    "turntable_discrete": recording(TABLE, "50 Hz", of("turntable_discrete")),
    "turntable_trajectory": recording(TABLE, "50 Hz", of("turntable_trajectory")),
    "systematic": recording("systematic/imu.toml", "20 Hz", seconds("12 s")),
}
# Of those that take long, one of each kind of bench.
SAMPLE = (
    "ferraris",
    "multi_position with magnetometers",
    "centrifuge_norm of means",
    "ship_multi_angle of means",
    "turntable_kalman",
)
CASES = [
    *(
        pytest.param(
            case, id=name, marks=[pytest.mark.slow] * (name in ("temperature_ramp", "tumble"))
        )
        for name, case in QUICK.items()
    ),
    *(
        pytest.param(
            case, id=name, marks=pytest.mark.slow if name in SAMPLE else pytest.mark.evidence
        )
        for name, case in SLOW.items()
    ),
]


def prepared(folder: Path, case: Case) -> Content:
    """Write what the run file names: tables of the example, or a simulated recording."""
    content = case.content
    for file in (EXAMPLES / case.path).parent.iterdir():
        if file.suffix in (".csv", ".json"):
            shutil.copy(file, folder)
    path = folder / "run.toml"
    path.write_text(toml(content), encoding="utf-8")
    run = read(path)
    if run.data.kind == "recording":
        write_recording(apply_data_columns(run, simulate(run, 1)), run.file(run.data.file))
    return content


def test_every_method_has_a_case():
    assert {case.content["method"]["name"] for case in (QUICK | SLOW).values()} == set(METHODS)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_every_key_counts_or_is_refused(tmp_path: Path, case: Case):
    assert silent_keys(tmp_path, prepared(tmp_path, case)) == {}


@pytest.mark.slow
def test_every_key_of_planning_changes_what_is_simulated(tmp_path: Path):
    """Limits of a table and the place of the IMU on it enter no result."""
    content = example(TABLE, ("data", "rate", "5 Hz"), ("data", "file", "log.npz"))
    shutil.copy(EXAMPLES / "turntable" / "path.csv", tmp_path)
    path = tmp_path / "run.toml"

    def simulated(text: str) -> Recording | None:
        path.write_text(text, encoding="utf-8")
        try:
            return simulate(path, 1)
        except InputError:
            return None

    def shapes(content: Content, key: Key, values: Iterable[object]) -> bool:
        base = simulated(toml(content))
        assert base is not None
        for value in values:
            made = simulated(toml(with_key(content, key, value)))
            if made is not None and (
                made.data.shape != base.data.shape
                or not (made.data == base.data).all()
                or made.readback.keys() != base.readback.keys()
            ):
                return True
        return False

    # Of a table without readback only systematic takes a recording.
    without_angles = example(
        "systematic/imu.toml", ("data", "rate", "5 Hz"), ("data", "file", "log.npz")
    )
    shaping = list(keys(content, planning))
    assert shaping
    for key, field, stated in shaping:
        of_key = without_angles if key.name == "readback" else content
        assert shapes(of_key, key, alternatives(key, field, stated)), f"{key} shapes nothing"
