"""Ten whole runs in which digits of the table's positions are wrong.

The positions are those of a controller on a serial port, where nothing protects the digits of a
reply: each decimal digit of each axis is another one with a probability of 1e-3, in one reading of
fifty or so.
"""

from dataclasses import dataclass, field, replace
from functools import partial
from math import tau
from pathlib import Path
from shutil import copy

import numpy as np
import pytest
from scipy.stats import chi2

import inercal
from inercal.benches.turntable.attitude import reference_attitude
from inercal.benches.turntable.bench import Turntable
from inercal.host import bench_run
from inercal.host.addresses import open_table
from inercal.host.assembly.table_polls import POLL_INTERVAL
from inercal.host.demonstration import DemonstrationResult, demo
from inercal.host.drivers.rotary_table import RotaryTable, TableState, unpack_states
from inercal.host.packets import read_layout
from inercal.host.recording_writer import write_recording
from inercal.host.run_log import TABLE, RunLog, read_frames
from inercal.methods.turntable_kalman.filter_config import FILTER_CONFIGS
from inercal.methods.turntable_kalman.gyros import GyroFilter
from inercal.physics.frames import log_so3
from inercal.recordings import Track
from inercal.recordings.io.hdf5 import read_group
from inercal.runfile import read

WRONG = 1e-3  # of the digits
COUNTS = 3_600_000 / tau  # a rad
GATE = 5.0  # standard deviations of an innovation, beyond which nothing wrong may be used


@dataclass
class WrongDigits:
    """A table whose positions have wrong digits on their way to the host; all else is its own."""

    table: RotaryTable
    rng: np.random.Generator
    true_angles: dict[float, tuple[float, ...]] = field(default_factory=dict)  # by time

    def read(self) -> TableState:
        state = self.table.read()
        axes = tuple(replace(axis, angle=self._told(axis.angle)) for axis in state.axes)
        if axes != state.axes:
            self.true_angles[state.time] = tuple(axis.angle for axis in state.axes)
        return replace(state, axes=axes)

    def _told(self, angle: float) -> float:
        digits = list(f"{abs(angle) * COUNTS:09.1f}")
        wrong = [k for k, one in enumerate(digits) if one != "." and self.rng.random() < WRONG]
        for k in wrong:
            digits[k] = str((int(digits[k]) + int(self.rng.integers(1, 10))) % 10)
        return float(np.copysign(float("".join(digits)) / COUNTS, angle)) if wrong else angle

    def __getattr__(self, name: str) -> object:
        return getattr(self.table, name)

    def __enter__(self) -> "WrongDigits":
        self.table.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self.table.__exit__(*error)


def open_wrong_table(
    seed: int, opened: list[WrongDigits], address: str, bench: Turntable, timeout: float
) -> WrongDigits:
    table = open_table(address, bench, timeout)
    opened.append(WrongDigits(table, np.random.default_rng(seed)))
    return opened[-1]


def with_true_angles(folder: Path, to: Path, true: dict[float, tuple[float, ...]]) -> Path:
    """Write the recording of the same run with the angles that the table had, its run file beside.

    Rates, following errors and arrivals are those of the log.
    """
    to.mkdir()
    for name in ("mimu.toml", "path.csv"):
        copy(folder / name, to)
    with RunLog(to / "run.log") as log:
        for frame in read_frames(folder / "run.log"):
            payload = frame.payload
            if frame.kind == TABLE:
                time = float(unpack_states([payload]).time[0])
                for i, angle in enumerate(true.get(time, ())):
                    at = 16 + 25 * i
                    payload = payload[:at] + np.float64(angle).tobytes() + payload[at + 8 :]
            log.append(frame.kind, frame.time, payload)
    run = read(to / "mimu.toml")
    write_recording(run, read_layout("fixed"), to / "run.log", to, poll=POLL_INTERVAL)
    return run.path


def largest_accepted(shown: DemonstrationResult, clean: Track) -> float:
    """Return the largest error of the angles that the gyros' filter used at an epoch.

    In standard deviations of the innovation there.
    """
    outcome = shown.outcome
    track, bench = outcome.observations.track, outcome.bench
    assert track is not None
    assert isinstance(bench, Turntable)
    made = FILTER_CONFIGS["full"].filter("w", outcome.calibration.sensor, bench, track)
    assert isinstance(made, GyroFilter)
    filtered = made.begin(track).follow(track)
    course = filtered.history
    variance = np.concatenate([piece.steps.s for piece in filtered.pieces()])
    at = np.searchsorted(track.time, course.time) - made.lag
    both = np.searchsorted(clean.time, track.time[at])
    assert (clean.time[both] == track.time[at]).all()
    said, true = (reference_attitude(bench, a) for a in (track.angles[at], clean.angles[both]))
    error = log_so3(said @ np.swapaxes(true, -1, -2))
    used = course.nis > 0
    return float(np.sqrt(np.max(np.sum(error[used] ** 2 / variance[used], axis=-1))))


@pytest.mark.parametrize(
    "seeds",
    [
        pytest.param(range(1), marks=pytest.mark.evidence),
        pytest.param(range(10), marks=pytest.mark.evidence),
    ],
)
def test_wrong_digits_are_rejected_or_do_no_harm(
    seeds: range,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    nees, moved, accepted, implausible = list[float](), list[float](), list[float](), list[int]()
    for seed in seeds:
        tables: list[WrongDigits] = []

        monkeypatch.setattr(bench_run, "open_table", partial(open_wrong_table, seed, tables))
        shown = demo(tmp_path / f"{seed}", seed, quick=True)
        folder = tmp_path / f"{seed}"
        true = inercal.calibrate(
            with_true_angles(folder, tmp_path / f"{seed} true", tables[0].true_angles)
        )
        attributes = read_group(folder / "recording.h5", "bench", ()).attributes
        implausible.append(int(str(attributes["polls left out as implausible"])))
        assert implausible[-1] > 10
        assert any(one.what == "implausible" for one in shown.outcome.findings)
        clean = true.observations.track
        assert clean is not None
        found, wanted = shown.outcome.calibration, true.calibration
        u = np.sqrt(np.diagonal(wanted.covariance))
        moved.append(float(np.max(np.abs(found.values - wanted.values) / u)))
        accepted.append(largest_accepted(shown, clean))
        nees.append(shown.nees)
        with capsys.disabled():
            print(
                f"\nseed {seed}: {len(tables[0].true_angles)} readings with wrong digits, "
                f"{implausible[-1]} left out; largest used {accepted[-1]:.2f} sd; coefficients "
                f"moved by {moved[-1]:.3f} u; NEES {nees[-1]:.2f}; {shown.outcome.verdict.word}"
            )
    assert max(accepted) < GATE
    assert max(moved) < 0.2
    dof = 24 * len(seeds)
    least, most = chi2.ppf([0.0005, 0.9995], dof) / dof
    assert least < np.mean(nees) < most
