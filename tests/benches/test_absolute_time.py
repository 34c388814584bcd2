"""Times since 1970 give what the same times from zero give: every method, and `noise`.

Stamps of whole ms, µs and ns are exact from either origin. Stamps in s since 1970 are rounded to
0.24 µs by float64: against the rounded stamps less the first nothing may differ, and against the
exact ones little.
"""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.base_seeds import evidence, slow
from tests.benches.generated_runs import simulate_run, write_run
from tests.noise.generator import MEMS, draw
from tests.reports import report_file

from inercal.basics.arrays import Array
from inercal.methods import METHODS
from inercal.noise import analyse_noise
from inercal.pipeline import calibrate, load_recording
from inercal.pipeline.drafts import draft_run_file
from inercal.recordings.io.frames import recording_from_frame
from inercal.recordings.io.table_recording import Columns
from inercal.runfile import read

START = 1_700_000_000_123_000_000  # ns since 1970
UNITS = {"ms": 10**6, "us": 10**3, "ns": 1}
SAME, NEAR = 1e-9, 1e-2  # u
RARE = (
    "turntable_trajectory", "systematic", "dual_orthogonal", "tumble", "ship_planar",
)  # fmt: skip
# A method of each way from samples to observations.
FAST = (
    "six_position", "ferraris", "multi_position", "centrifuge_norm", "temperature_ramp",
)  # fmt: skip

Stamps = NDArray[np.int64] | Array


class Found(NamedTuple):
    value: Array
    u: Array


def stamped(ns: NDArray[np.int64]) -> dict[str, tuple[str, Stamps]]:
    """Return columns of times and their units by what they are; `ns` begins at zero."""
    made: dict[str, tuple[str, Stamps]] = {}
    for unit, size in UNITS.items():
        made[f"{unit} from zero"] = unit, ns // size
        made[f"{unit} since 1970"] = unit, (ns + START) // size
    rounded = (ns + START) / 1e9
    made["s from zero"] = "s", ns / 1e9
    made["s since 1970"] = "s", rounded
    made["rounded"] = "s", rounded - rounded[0]
    return made


def check_every_clock(ns: NDArray[np.int64], find: Callable[[str, Stamps], Found]) -> None:
    by_clock = {name: find(*one) for name, one in stamped(ns).items()}

    def apart(one: str, two: str) -> float:
        """Return the largest difference of values over u, or of u over itself."""
        a, b = by_clock[one], by_clock[two]
        known = a.u > 0
        assert known.any()
        away = np.abs(b.value - a.value)[known] / a.u[known]
        return float(max(away.max(), np.abs(b.u[known] / a.u[known] - 1).max()))

    for unit in UNITS:
        assert apart(f"{unit} from zero", f"{unit} since 1970") <= SAME
    assert apart("rounded", "s since 1970") <= SAME
    assert apart("s from zero", "ns from zero") <= SAME
    assert apart("s from zero", "s since 1970") <= NEAR


@pytest.mark.slow
@pytest.mark.parametrize(
    "method",
    [evidence(name) if name in RARE else name if name in FAST else slow(name) for name in METHODS],
)
def test_a_calibration_does_not_depend_on_where_the_clock_begins(method: str, tmp_path: Path):
    path = write_run(method, tmp_path)
    file = simulate_run(path, 3).file("made.npz")
    columns, text = dict(np.load(file)), path.read_text(encoding="utf-8")
    ns = np.rint(columns["time"] * 1e9).astype(np.int64)
    assert (ns % 10**6 == 0).all()
    known: dict[bytes, Found] = {}

    def find(unit: str, stamps: Stamps) -> Found:
        np.savez(file, allow_pickle=False, **(columns | {"time": stamps}))
        path.write_text(text.replace('time = "time"', f'time = "time"\ntime_unit = "{unit}"'))
        # Of times that are equal to the last bit one calibration is enough.
        read_times = load_recording(read(path)).time.tobytes()
        if read_times not in known:
            found = calibrate(path).calibration
            known[read_times] = Found(found.values, np.sqrt(np.diag(found.covariance)))
        return known[read_times]

    check_every_clock(ns - ns[0], find)


@pytest.mark.slow
def test_a_noise_analysis_does_not_depend_on_where_the_clock_begins():
    n, rate = 1 << 14, 100
    data = np.stack([draw(MEMS, seed)[0][:n] for seed in range(3)], axis=1)
    ns = np.arange(n, dtype=np.int64) * (10**9 // rate)
    known: dict[bytes, Found] = {}

    def find(unit: str, stamps: Stamps) -> Found:
        frame = {"t": stamps, **dict(zip("xyz", data.T, strict=True))}
        axes = tuple((f"g{axis}", axis, "rad/s") for axis in "xyz")
        recording = recording_from_frame(frame, Columns(axes, time="t", time_unit=unit))
        if recording.time.tobytes() not in known:
            found = [
                one
                for channel in analyse_noise(recording, terms="NBK", kinds=("oadev",)).channels
                for one in channel.coefficients
            ]
            known[recording.time.tobytes()] = Found(
                np.array([one.value for one in found]), np.array([one.u for one in found])
            )
        return known[recording.time.tobytes()]

    check_every_clock(ns, find)


@pytest.mark.slow
def test_the_reported_log_gives_what_its_twin_from_zero_gives(tmp_path: Path):
    found: list[Found] = []
    for name in ("01_epoch_seconds", "01_same_from_zero"):
        log = tmp_path / f"{name}.csv"
        shutil.copy(report_file(log.name), log)
        run = log.with_suffix(".toml")
        run.write_text(draft_run_file([log], run).text, encoding="utf-8")
        outcome = calibrate(run)
        assert outcome.verdict.grade == "consistent"
        assert outcome.calibration.method == "multi_position"
        found.append(
            Found(outcome.calibration.values, np.sqrt(np.diag(outcome.calibration.covariance)))
        )
    assert (np.abs(found[0].value - found[1].value) <= NEAR * found[1].u).all()
