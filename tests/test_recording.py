import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from tests.refusals import refused

from inercal.recordings import Finding, Observations, Recording


def recording(**changes: object) -> Recording:
    made = Recording(
        time=np.array([0.0, 0.1, 0.2, 0.5, 0.6]),
        data=np.arange(10.0).reshape(5, 2),
        channels=("x", "y"),
        units=("g", "g"),
        labels=np.array(["a", "a", "b", "b", "b"]),
        temperature=np.full(5, 293.15),
        readback={"angle": np.arange(5.0)},
        source="run.csv",
        first_row=2,
    )
    return dataclasses.replace(made, **changes)  # type: ignore[arg-type]


def observations(**changes: object) -> Observations:
    made = Observations(
        labels=("up", "down"),
        mean=np.zeros((2, 3)),
        covariance=np.broadcast_to(np.eye(3), (2, 3, 3)),
        duration=np.ones(2),
        samples=np.full(2, 100),
        time=np.arange(2.0),
        channels=("x", "y", "z"),
    )
    return dataclasses.replace(made, **changes)  # type: ignore[arg-type]


def test_rate_duration_and_gaps_come_from_the_time_stamps():
    made = recording()
    assert made.rate_hz == pytest.approx(10)
    assert made.duration == 0.6
    assert made.gaps.tolist() == [[2, 3]]


def test_a_slice_keeps_its_lines_and_its_findings():
    inside = Finding("warning", "saturation", "x", "x", 1, 4)
    outside = Finding("warning", "saturation", "x", "x", 0, 1)
    whole = Finding("note", "jitter", "x")
    part = recording(findings=(inside, outside, whole)).slice(2, 5)
    assert part.where(0) == "line 4"
    assert part.data[0].tolist() == [4, 5]
    assert part.labels is not None
    assert part.labels.tolist() == ["b", "b", "b"]
    assert part.readback["angle"].tolist() == [2, 3, 4]
    assert part.findings == (dataclasses.replace(inside, start=0, stop=2), whole)


def test_chosen_samples_are_no_longer_in_step_with_lines():
    assert recording().take(np.array([0, 2])).where(1) == "sample 1"


def test_trials_share_times():
    data = np.zeros((7, 5, 2))
    part = recording(data=data, readback={"angle": np.zeros((7, 5))}).slice(1, 3)
    assert part.data.shape == (7, 2, 2)
    assert part.readback["angle"].shape == (7, 2)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"time": np.zeros(0)}, "time"),
        ({"channels": ("x", "x")}, "channels"),
        ({"units": ("g",)}, "units"),
        ({"data": np.zeros((4, 2))}, "data"),
        ({"labels": np.array(["a"])}, "labels"),
        ({"temperature": np.zeros(3)}, "temperature"),
        ({"readback": {"angle": np.zeros(3)}}, "angle"),
    ],
)
def test_a_recording_whose_arrays_disagree_is_refused(changes: dict[str, object], key: str):
    with refused(key=key, file="run.csv"):
        recording(**changes)


def test_a_constant_time_has_no_rate():
    with refused(key="time", file="run.csv"):
        _ = recording(time=np.zeros(5)).rate_hz


@pytest.mark.parametrize(
    ("changes", "key", "names"),
    [
        ({"mean": np.zeros((2, 2))}, "mean", ()),
        ({"mean": np.array([[0, 0, 0], [0, np.nan, 0]])}, "mean", ["down"]),
        ({"covariance": np.full((2, 3, 3), np.inf)}, "covariance", ["up"]),
        ({"covariance": np.broadcast_to(-np.eye(3), (2, 3, 3))}, "covariance", ["up"]),
        (
            {"covariance": np.broadcast_to(np.eye(3) + np.eye(3, k=1), (2, 3, 3))},
            "covariance",
            ["up"],
        ),
        ({"samples": np.array([100, 0])}, "samples", ["down"]),
        ({"dof": 0.0}, "dof", ()),
    ],
)
def test_impossible_observations_are_refused(
    changes: dict[str, object], key: str, names: Sequence[str]
):
    with refused(key=key, names=names):
        observations(**changes)


def test_observations_may_carry_trials():
    many = observations(mean=np.zeros((9, 2, 3)), covariance=np.zeros((9, 2, 3, 3)))
    assert many.mean.shape == (9, 2, 3)
