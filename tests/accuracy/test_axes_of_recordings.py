"""Exchanged, reversed and left-handed axes and wrong units, on sessions made without inercal."""

from dataclasses import replace
from functools import cache
from itertools import permutations, product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy import handheld
from tests.accuracy.ferraris import (
    CHANNELS,
    DEGREE,
    POSITIONS,
    TURNS,
    FerrarisSession,
    Imu,
    mems,
)
from tests.accuracy.test_generated_recordings import calibrated, session
from tests.base_seeds import SEEDS, chosen, evidence, sampled
from tests.refusals import refused

import inercal
from inercal.basics.errors import InputError
from inercal.benches.hand import axes_check
from inercal.benches.hand.axes_check import NO_TURNS
from inercal.physics.sensors import Axis, Sensor
from inercal.pipeline import Outcome
from inercal.pipeline.drafts import draft_run_file
from inercal.recordings import Mark, Recording
from inercal.recordings.segments.gravity_turns import TurnVerdict, judge_turns, read_gravity_turns

Array = NDArray[np.float64]
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
SENSOR = Sensor(
    "imu",
    tuple(
        Axis(f"{'a' if kind == 'f' else 'g'}{name}", kind, i, p)
        for kind in ("f", "w")
        for name, i, p in (("x", X, Y), ("y", Y, Z), ("z", Z, X))
    ),
)
SIGNED = [
    np.array([[s * (k == place) for k in range(3)] for s, place in zip(signs, order, strict=True)])
    for signs in product((1, -1), repeat=3)
    for order in permutations(range(3))
]
EXCHANGED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]])
# The accelerometers' and the gyros' columns, and the change that is named.
MISTAKES = {
    "az": (np.diag([1, 1, -1]), np.eye(3), ("az is reversed",)),
    "gz": (np.eye(3), np.diag([1, 1, -1]), ("gz is reversed",)),
    "gyros exchanged": (np.eye(3), EXCHANGED, ("gx and gy are exchanged",)),
    "accelerometers exchanged": (EXCHANGED, np.eye(3), ("ax and ay are exchanged",)),
    "°/s": (np.eye(3), np.eye(3) / DEGREE, ("the gyros' unit is °/s",)),
    "rad/s": (np.eye(3), np.eye(3) * DEGREE, ("the gyros' unit is rad/s",)),
    "m°/s": (np.eye(3), 1e-3 * np.eye(3), ("the gyros' readings are multiplied by about 1000",)),
}


def changed(data: Array, force: Array, rate: Array) -> Array:
    """Return samples (..., 6) with other columns of each triad."""
    return np.concatenate([data[..., :3] @ force.T, data[..., 3:] @ rate.T], axis=-1)


def held(seed: int, **changes: float) -> tuple[Array, Array, tuple[Mark, ...]]:
    """Return time, readings and rests of a hand-held session of a plain sensor."""
    time, data, rests = recorded(seed, **changes)
    return time, data.copy(), rests


@cache
def recorded(seed: int, **changes: float) -> tuple[Array, Array, tuple[Mark, ...]]:
    rng = np.random.default_rng(seed)
    device = plain(rng)
    made = handheld.record(device, handheld.Session(tremor_deg=0.05, **changes), rng)  # type: ignore[arg-type]
    rests = tuple(Mark(f"rest {k}", a + 20, b - 20) for k, (a, b) in enumerate(made.rests))
    return made.time, made.data[0], rests


@cache
def with_moves() -> FerrarisSession:
    return session(54, hold_seconds=5.0)[1]


def plain(rng: np.random.Generator) -> Imu:
    """Return a sensor with gyro biases of 2 °/s and scale errors of 1 %."""
    return replace(mems(rng), b_g=2 * DEGREE * rng.choice([-1.0, 1.0], 3))


def judged(time: Array, data: Array, rests: tuple[Mark, ...]) -> TurnVerdict:
    recording = Recording(time, data, CHANNELS, ("m/s²",) * 3 + ("rad/s",) * 3)
    return judge_turns(read_gravity_turns(recording, SENSOR, rests))


def placed(made: FerrarisSession, rate_hz: float) -> tuple[Mark, ...]:
    """Return what is at rest of a session with moves: positions and either side of turns."""
    marks = [Mark(name, *made.marks[name]) for name in POSITIONS]
    for name in TURNS:
        a, b = made.marks[name]
        near, far = round(0.1 * rate_hz), round(0.9 * rate_hz)
        marks += [Mark(f"to {name}", a - far, a - near), Mark(f"of {name}", b + near, b + far)]
    return tuple(one for one in marks if one.stop <= made.time.size)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "sessions"), sampled(4, 10))
@pytest.mark.parametrize(
    "changes",
    [{}, {"rate_hz": 50.0, "move_seconds": 0.6}, {"positions": 40, "drift_g": 0.1 * DEGREE}],
    ids=["plain", "fast at 50 Hz", "drift"],
)
def test_ordinary_sessions_by_hand_agree(seed: int, sessions: int, changes: dict[str, float]):
    for trial in range(sessions):
        found = judged(*held(1000 * seed + trial, **changes))
        assert found.agree is True, found
        assert found.unique
        assert found.misfit < 5 * DEGREE


@pytest.mark.parametrize(("seed", "sessions"), sampled(2, 5))
@pytest.mark.parametrize("rate_hz", [50.0, 100.0])
def test_ordinary_ferraris_sessions_agree(seed: int, sessions: int, rate_hz: float):
    for trial in range(sessions):
        _, made = session(1000 * seed + trial, rate_hz=rate_hz, hold_seconds=4.0)
        found = judged(made.time, made.data[0], placed(made, rate_hz))
        assert found.agree is True, found
        assert found.misfit < 5 * DEGREE


# Ten of 48, with all six orders of the axes and all eight sets of signs.
@pytest.mark.slow
@pytest.mark.parametrize("every", [5, evidence(1)])
def test_each_signed_permutation_of_gyros_disagrees_and_is_found(every: int):
    time, data, rests = held(3)
    for matrix in SIGNED[::every]:
        found = judged(time, changed(data, np.eye(3), matrix), rests)
        assert found.agree is bool(np.array_equal(matrix, np.eye(3))), matrix
        assert found.unique, matrix


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("mistake", MISTAKES)
def test_each_mistake_is_named(seed: int, mistake: str):
    force, rate, changes = MISTAKES[mistake]
    time, data, rests = held(seed)
    found = judged(time, changed(data, force, rate), rests)
    assert (found.agree, found.unique, found.changes) == (False, True, changes)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.3, 0.5, 2.0])
def test_a_scale_that_no_usable_gyro_has_is_found(scale: float):
    time, data, rests = held(1)
    found = judged(time, changed(data, np.eye(3), scale * np.eye(3)), rests)
    assert (found.agree, found.unique, found.clear) == (False, True, True)
    (change,) = found.changes
    assert float(change.split()[-1]) == pytest.approx(1 / scale, rel=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.75, 1.3])
def test_a_scale_that_can_be_calibrated_is_not_refused(scale: float):
    time, data, rests = held(1)
    assert judged(time, changed(data, np.eye(3), scale * np.eye(3)), rests).agree is not False


@pytest.mark.parametrize("both", [EXCHANGED, np.diag([1, -1, 1])], ids=["exchanged", "reversed"])
def test_left_handed_axes_are_found(both: Array):
    time, data, rests = held(4)
    found = judged(time, changed(data, both, both), rests)
    assert (found.agree, found.unique) == (False, True)
    assert found.changes == judged(time, changed(data, np.eye(3), -np.eye(3)), rests).changes


@pytest.mark.slow
def test_gyros_that_read_none_of_the_moves_say_nothing():
    time, data, rests = held(5)
    data[:, 3:] = data[rests[0].start : rests[0].stop, 3:].mean(axis=0)
    assert judged(time, data, rests).agree is None


@pytest.mark.slow
@pytest.mark.parametrize(
    "mistake",
    chosen([*MISTAKES, "left-handed"], ["gz", "accelerometers exchanged", "left-handed"]),
)
def test_found_sections_with_a_mistake_are_refused(tmp_path: Path, mistake: str):
    made = with_moves()
    force, rate, changes = MISTAKES.get(mistake, (EXCHANGED, EXCHANGED, None))
    wrong = replace(made, data=changed(made.data, force, rate))
    with refused(key="[data] accelerometer") as refusal:
        calibrated(tmp_path, wrong, marks="found")
    if changes:
        assert refusal.value.names == changes


@pytest.mark.parametrize(("axis", "factor"), [("ax", 2.0), ("az", 0.25)])
def test_a_range_that_was_switched_is_named_with_its_axis(axis: str, factor: float):
    time, data, rests = held(1)
    half = rests[len(rests) // 2].start

    def text() -> str:
        recording = Recording(time, data, CHANNELS, ("m/s²",) * 3 + ("rad/s",) * 3)
        return axes_check.changed_scale(recording, SENSOR, rests)

    assert text() == ""
    data[half:, CHANNELS.index(axis)] *= factor
    assert f"{axis} reads {factor:g} times as much from {time[half]:.6g} s on" in text()


def test_a_wrong_rate_is_named_only_if_it_gives_the_times():
    change = ("the gyros' readings are multiplied by about 0.5",)
    stated, by_column = (axes_check.mistake_advice(change, rate) for rate in ("100 Hz", None))
    assert '[data] rate = "100 Hz" is wrong' in stated
    assert "rate" not in by_column


def test_found_sections_without_a_mistake_are_consistent(tmp_path: Path):
    outcome = calibrated(tmp_path, with_moves(), marks="found")
    assert outcome.verdict.grade == "consistent"
    assert not [one for one in outcome.findings if one.what in {"axes", "up"}]


@pytest.mark.slow
def test_turns_that_contradict_the_axes_are_not_to_be_relied_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    changes = ("gy and gz are exchanged and gx is reversed", "gy and gz are exchanged")
    odd = TurnVerdict(5, agree=False, unique=False, misfit=0.03, changes=changes, clear=True)
    monkeypatch.setattr(axes_check, "judge_turns", lambda *_, **__: odd)
    outcome = calibrated(tmp_path, with_moves(), marks="found")
    assert outcome.verdict.grade == "unreliable"
    (cause,) = [one for one in outcome.verdict.lines if one.startswith("Most likely cause")]
    assert "gy" in cause
    assert "gx" not in cause
    notes = {axes_check.positions_note(odd._replace(agree=one)) for one in (True, False, None)}
    assert len(notes) == 3
    assert not [one for one in notes if "no turns" in one]


@pytest.mark.parametrize("mistake", ["gz", "gyros exchanged", None])
def test_labelled_sections_are_compared_with_the_moves_between_them(mistake: str | None):
    made = with_moves()
    force, rate, changes = MISTAKES.get(mistake or "", (np.eye(3), np.eye(3), ()))
    data = changed(made.data[0], force, rate)
    face = np.where(np.isin(made.labels(), list(TURNS)), "", made.labels())
    columns = {"t": made.time, "face": face, **dict(zip("abcuvw", data.T, strict=True))}

    def calibrate(kept: Array) -> Outcome:
        return inercal.calibrate(
            {name: column[kept] for name, column in columns.items()},
            method="six_position",
            sensor={"accelerometer": {"unit": "m/s²"}, "gyro": {"unit": "rad/s"}},
            bench={"gravity": "9.81 m/s² ± 1 mm/s²", "tilt": "1 °", "latitude": "0 °"},
            time="t",
            label="face",
            marks="labels",
            accelerometer=["a", "b", "c"],
            gyro=["u", "v", "w"],
        )

    # Without the moves, nothing shows the mistake, and a note says so.
    assert NO_TURNS in calibrate(face != "").observations.notes
    if mistake is None:
        assert NO_TURNS not in calibrate(np.ones(face.size, dtype=bool)).observations.notes
        return
    with refused(names=changes):
        calibrate(np.ones(face.size, dtype=bool))


def test_turns_with_the_axis_down_are_warned_of(tmp_path: Path):
    downs = {name: -axis for name, axis in TURNS.items()}
    made = session(55, turns=downs)[1]
    outcome = calibrated(tmp_path, made, marks="found", turn="-360")
    warned = [one.message.split()[1] for one in outcome.findings if one.what == "up"]
    assert sorted(warned) == sorted(TURNS)


def write(path: Path, time: Array, data: Array, names: str = "u,F1,F2,F3,R1,R2,R3") -> None:
    table = np.column_stack([time, data])
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=names, comments="")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mistake", "column"), [("gz", "R3 is reversed"), evidence("az", "F3 is reversed")]
)
def test_a_draft_says_why_columns_are_no_gyros(tmp_path: Path, mistake: str, column: str):
    time, data, _ = held(6, rate_hz=50.0, positions=16)
    force, rate, _ = MISTAKES[mistake]
    write(tmp_path / "log.csv", time, changed(data, force, rate))
    draft = draft_run_file([tmp_path / "log.csv"], tmp_path / "run.toml")
    assert "gyro" not in draft.roles.triads
    assert any(column in one for one in draft.facts)


@pytest.mark.slow
def test_a_draft_says_that_a_gyro_is_missing(tmp_path: Path):
    time, data, _ = held(6)
    write(tmp_path / "log.csv", time, data[:, :5], "u,F1,F2,F3,R1,R2")
    draft = draft_run_file([tmp_path / "log.csv"], tmp_path / "run.toml")
    assert any("R1 and R2" in one and "missing" in one for one in draft.facts)


@pytest.mark.slow
def test_a_draft_names_rows_without_numbers(tmp_path: Path):
    time, data, _ = held(6, rate_hz=50.0, positions=16)
    data[1498:1501, 1] = np.nan
    log = tmp_path / "log.csv"
    write(log, time, data)
    with refused(InputError, line=1500, names=("F2",), key="data.nonfinite"):
        draft_run_file([log], tmp_path / "run.toml")
    draft = draft_run_file([log], tmp_path / "run.toml", {"data.nonfinite": "drop"})
    assert draft.roles.triads["accelerometer"] == ("F1", "F2", "F3")
    assert draft.method is not None
