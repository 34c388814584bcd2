"""A run as the page is told of it: what is known of live estimation and of attitude, and when."""

from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace as EndMessage
from typing import Any, cast

import numpy as np
import pytest

from inercal.benches.turntable import require_turntable
from inercal.benches.turntable.attitude import reference_attitude
from inercal.host.bench_run import BenchRun
from inercal.host.drivers.rotary_table import AxisState
from inercal.host.live_estimator import NavigationSolution
from inercal.host.web import page_messages
from inercal.runfile import Run, read

ANGLES = np.array([0.3, -0.2, 0.1])  # rad
OTHERS = np.array([0.2, 0.1, 0.4])
NAVIGATION = NavigationSolution(
    9.0, np.eye(3), 1.0, 2.0, 3.0, np.zeros(3), np.ones(3), is_hold=True
)


@pytest.fixture(scope="module")
def run_file() -> Run:
    return read(Path(str(files("inercal").joinpath("demo.toml"))))


def state(run_file: Run, estimation: str, *, homed: bool = True, **more: Any) -> dict[str, Any]:
    """Return what is told of a run whose table stands at ANGLES, its last samples at OTHERS."""
    axes = tuple(
        AxisState(angle, 0.0, 0.0, in_position=True, moving=False, enabled=True, homed=homed)
        for angle in ANGLES.tolist()
    )
    counts = EndMessage(packets=0, lost=0, failed=0, discarded=0)
    imu = EndMessage(counts=counts)
    assembly = EndMessage(imu=imu, samples=0, samples_without_angle=0)
    account = EndMessage(
        assembly=assembly,
        estimation=estimation,
        navigation=more.get("navigation"),
        temperature=float("nan"),
    )
    run = EndMessage(
        time=10.0,
        state=EndMessage(time=10.0, axes=axes),
        pause_reason="",
        trouble="",
        speed=1.0,
        sequencer=EndMessage(phase="work", number=0, task=None, remaining_time=lambda _: 60.0),
        mounting_request=None,
        recorder=account,
    )
    return page_messages.state_message(cast(BenchRun, run), run_file, more.get("angles"))


def by(run_file: Run, angles: "np.ndarray[Any, np.dtype[np.float64]]") -> list[float | None]:
    return page_messages.rounded_numbers(
        reference_attitude(require_turntable(run_file), angles[None])[0].ravel()
    )


@pytest.mark.parametrize("estimation", ["none", "waits", "on", "ended"])
def test_how_live_estimation_stands_is_told(run_file: Run, estimation: str):
    assert state(run_file, estimation)["live"] == estimation


def test_attitude_is_told_by_the_table_before_there_are_samples(run_file: Run):
    told = state(run_file, "waits")["attitude"]
    assert told.pop("table") == by(run_file, ANGLES)
    assert set(told) == {"navigation", "roll", "pitch", "heading", "apart", "velocity"}
    assert set(told.values()) == {None}


def test_a_table_that_has_no_zero_yet_has_no_attitude(run_file: Run):
    assert state(run_file, "waits", homed=False)["attitude"] is None


def test_beside_navigation_stands_the_table_at_the_same_sample(run_file: Run):
    told = state(run_file, "on", navigation=NAVIGATION, angles=OTHERS)["attitude"]
    assert told["table"] == by(run_file, OTHERS)
    assert told["navigation"] == np.eye(3).ravel().tolist()
    assert (told["roll"], told["pitch"], told["heading"]) == (1.0, 2.0, 3.0)


def test_navigation_is_not_told_on_once_its_coefficients_are_gone(run_file: Run):
    told = state(run_file, "ended", navigation=NAVIGATION, angles=OTHERS)["attitude"]
    assert told["table"] == by(run_file, ANGLES)
    assert told["navigation"] is told["heading"] is None


@pytest.mark.parametrize(
    ("ratio", "count", "level"),
    [
        (1.0, 18_000, "good"),
        (1.03, 18_000, "good"),  # 2.8 standard deviations, √(2 / 18000) each
        (1.06, 18_000, "care"),
        (0.94, 18_000, "care"),
        (1.5, 6, "good"),
        (4.1, 6, "bad"),
    ],
)
def test_the_innovations_are_judged_by_their_number_in_the_words_of_the_verdict(
    ratio: float, count: int, level: str
):
    told = page_messages.nis_fields(ratio, count)
    words = {"good": "consistent", "care": "usable with reservations", "bad": "not to be relied on"}
    assert told == {"ratio": ratio, "level": level, "words": words[level]}
