"""The note's table of both filters, over many devices of the generator: bounds, NEES, failures."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import product
from math import radians, sqrt
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from tests.accuracy import turntable
from tests.base_seeds import SEEDS, chosen, evidence, sampled
from tests.methods.turntable_cases import (
    ARCSEC,
    FAST,
    TABLE,
    Score,
    bench,
    columns,
    observations,
    score,
    sensor,
    track,
    truth,
)

from inercal.methods.turntable_kalman import METHOD
from inercal.methods.turntable_kalman.accelerometers import REST_VELOCITY_SD, AccelerometerFilter
from inercal.methods.turntable_kalman.gyros import GyroFilter
from inercal.recordings import Track

Array = NDArray[np.float64]
Run = Callable[[turntable.Draw, Track, turntable.Grade], tuple[Array, Array]]
Path = list[turntable.Stand | turntable.Turn]
DEVICES = 100
ALL_SEEDS = (1, 2, 3)
SMOOTHED = 40


class AsInTheNote(AccelerometerFilter):
    """The accelerometers' filter with the note's 3.5″ of each hold."""

    def _hold_variance(self, angles: Array) -> Array:
        return np.full((len(angles), 2), (3.5 * ARCSEC) ** 2)


def gyros(
    *,
    own: bool = False,
    bias_drift: bool = True,
    table: Literal["whole", "lean", "exact"] = "whole",
    readback_sd: float = 4 * ARCSEC,
) -> Run:
    """Return a run of the gyros' filter, over its own part of the recording or the whole."""

    def run(made: turntable.Draw, one: Track, grade: turntable.Grade) -> tuple[Array, Array]:
        ours = GyroFilter.from_track(
            sensor(grade), bench(), one, bias_drift=bias_drift, table=table, readback_sd=readback_sd
        )
        first = int(np.flatnonzero(made.labels == "home")[0]) if own else 0
        piece = one.slice(first, one.time.size)
        state, _ = ours.step(ours.start(piece), piece)
        return state.theta, state.p[3:15, 3:15]

    return run


def accelerometers(
    kind: type[AccelerometerFilter],
    table: str,
    readback_sd: float | None = None,
    velocity_sd: float = 1e-3,
) -> Run:
    def run(made: turntable.Draw, one: Track, grade: turntable.Grade) -> tuple[Array, Array]:
        ours = kind.from_track(
            sensor(grade), bench(), one,
            bias_drift=table != "exact", table=table,  # pyright: ignore[reportArgumentType]
            readback_sd=readback_sd, velocity_sd=velocity_sd,
        )  # fmt: skip
        ours = kind(**vars(ours))
        state, _ = ours.step(ours.start(one), one)
        return state.theta, state.p[6:18, 6:18]

    return run


def scores(
    seed: int,
    path: Path,
    runs: dict[str, Run],
    grade: turntable.Grade = turntable.T,
    devices: int = DEVICES,
) -> dict[str, Score]:
    """Return the score of each run over a seed's devices; names of gyros' runs begin with g."""
    found: dict[str, list[tuple[Array, Array, Array]]] = {name: [] for name in runs}
    for batch in range(devices // 10):
        made = turntable.draw(1000 * seed + batch, 10, path, grade)
        whole = track(made)
        for k in range(10):
            for name, run in runs.items():
                theta, covariance = run(made, whole.trial(k), grade)
                truth = made.gyro[k] if name[0] == "g" else made.acc[k]
                found[name].append((theta, covariance, truth))
    return {name: judged(name, rows) for name, rows in found.items()}


def judged(name: str, rows: Sequence[tuple[Array, Array, Array]]) -> Score:
    names = sensor().select_axes("w" if name[0] == "g" else "f").coefficients
    by = columns(names)
    off = np.array([theta - truth @ by for theta, _, truth in rows])
    covariance = np.array([one for _, one, _ in rows])
    return score(off, covariance, names, name[0])


def band(parameters: int = 12, devices: int = DEVICES) -> float:
    """Return three standard deviations of NEES by parameter."""
    return 3 * sqrt(2 / (parameters * devices))


RUNS = {
    "g 15, own part": gyros(own=True, bias_drift=False, table="exact", readback_sd=10 * ARCSEC),
    "g 19, own part": gyros(own=True, table="lean"),
    "g 19, whole": gyros(table="lean"),
    "g full": gyros(readback_sd=TABLE.white),
    "a 18": accelerometers(AccelerometerFilter, "exact", 10 * ARCSEC),
    "a 25": accelerometers(AsInTheNote, "lean", ARCSEC),
    "a drift": accelerometers(AccelerometerFilter, "lean", ARCSEC),
    "a full": accelerometers(AccelerometerFilter, "whole", velocity_sd=REST_VELOCITY_SD),
}


@cache
def of_grade_t(seed: int, devices: int = DEVICES) -> dict[str, Score]:
    return scores(seed, turntable.complete_path(), RUNS, devices=devices)


@pytest.mark.evidence  # it computes what the three seeds below compute, which other processes run
def test_scale_factors_on_the_sources_path():
    # Of 300 numbers the rms varies by 4 %; the third seed alone gives 33.02.
    squares = [of_grade_t(seed)["g 19, own part"].scale ** 2 for seed in ALL_SEEDS]
    assert sqrt(sum(squares) / len(ALL_SEEDS)) <= 33


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "devices"), sampled(30, DEVICES))
def test_the_notes_table_of_grade_t(seed: int, devices: int):
    found = of_grade_t(seed, devices)
    print(seed, {name: tuple(round(x, 4) for x in one) for name, one in found.items()})
    own, whole, full = (found[f"g {name}"] for name in ("19, own part", "19, whole", "full"))
    assert own.bias <= 0.016
    assert own.cross <= 7.3
    assert 0.85 <= own.nees <= 1.2
    for one in (whole, full):
        assert one.bias <= 0.006
        assert one.scale <= 19
        assert one.cross <= 4.2
    assert abs(full.nees - 1) <= band(devices=devices)
    held, exact = found["a 25"], found["a full"]
    shipped = found["a drift"]
    for one in (held, shipped, exact):
        assert one.bias <= 11
        assert one.scale <= 8
        assert one.cross <= 2.6
    assert 0.65 <= held.nees <= 1.1
    # The table's own right angles and harmonics, hold by hold, in the place of the note's 3.5″.
    assert 0.65 <= shipped.nees <= 1.2
    assert abs(exact.nees - 1) <= band(devices=devices)
    # The source's own states are overconfident: its table's errors are in none of them.
    assert found["g 15, own part"].nees > 1.2
    assert found["a 18"].nees > 8


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "devices"), sampled(30, DEVICES))
def test_fast_turns_both_ways(seed: int, devices: int):
    runs = {
        "g 19": gyros(own=True, table="lean"),
        "g full": gyros(own=True, readback_sd=TABLE.white),
    }
    found = scores(seed, FAST, runs, devices=devices)
    print(seed, {name: tuple(round(x, 4) for x in one) for name, one in found.items()})
    full = found["g full"]
    assert full.bias <= 0.0105
    assert full.scale <= 8
    assert full.cross <= 2.6
    assert 0.85 <= full.nees <= 1.2
    assert found["g 19"].nees > 1.35  # without the table's right angles it says too little


@pytest.mark.slow
@pytest.mark.parametrize(
    ("grade", "gyro", "accelerometer", "devices"),
    [
        evidence("I", (0.0023, 7.9, 2.2), (6.6, 4.6, 1.7), DEVICES),
        ("C", (0.041, 62.0, 12.9), (28.0, 18.0, 4.4), 30),
        evidence("C", (0.041, 62.0, 12.9), (28.0, 18.0, 4.4), DEVICES),
    ],
)
def test_the_notes_table_of_other_grades(
    grade: str, gyro: tuple[float, ...], accelerometer: tuple[float, ...], devices: int
):
    runs = {name: RUNS[name] for name in ("g 19, whole", "g full", "a full")}
    found = scores(1, turntable.complete_path(), runs, turntable.GRADES[grade], devices)
    print(grade, {name: tuple(round(x, 4) for x in one) for name, one in found.items()})
    # The note's figures are of other draws: RMS of 300 numbers or more vary by 8 % (two sd).
    for one, printed in ((found["g full"], gyro), (found["a full"], accelerometer)):
        assert all(x <= 1.15 * y for x, y in zip(one[:3], printed, strict=True))
        assert abs(one.nees - 1) <= band(devices=devices)


FOUR_MINUTES = [
    ("warm-up", (0, 0, 0), 30.0),
    *turntable.positions(10.0),
    *turntable.turns(360.0, 30.0),
]


@pytest.mark.slow
@pytest.mark.parametrize("base", SEEDS)
def test_flicker_over_four_minutes_is_as_stated(base: int):
    grade = replace(turntable.GRADES["C"], flicker=True)
    made = sensor(grade)
    off, stated = list[Array](), list[Array]()
    for batch in range(0, 60, 10):
        draw = turntable.draw(90_000 + 1000 * base + batch, 10, FOUR_MINUTES, grade, hz=50.0)
        found = METHOD.estimator("full")(observations(draw), made, bench(), ())
        one = found.select(made.coefficients)
        off.append(one.value - truth(draw, made.coefficients))
        stated.append(one.covariance)
    for kind in "ga":
        one = score(np.concatenate(off), np.concatenate(stated), made.coefficients, kind)
        print(base, kind, one)
        assert abs(one.nees - 1) <= band(devices=60)


@pytest.mark.evidence
def test_g_sensitivity_as_a_state_costs_little():
    device = turntable.Device(by_g=radians(50) / 3600 / turntable.G)
    rows = []
    for batch in range(3):
        made = turntable.draw(700 + batch, 10, turntable.complete_path(), device=device)
        whole, chosen = track(made), sensor(turntable.T, "g")
        for k in range(10):
            ours = GyroFilter.from_track(chosen, bench(), whole.trial(k), table="lean")
            state, _ = ours.step(ours.start(whole.trial(k)), whole.trial(k))
            names = ours.triad.sensor.coefficients
            at = [names.index(name) for name in sensor().select_axes("w").coefficients]
            p = state.p[3:, 3:]
            rows.append((state.theta[at], p[np.ix_(at, at)], made.gyro[k]))
    found = judged("g", rows)
    print(found)
    assert found.bias < 0.0075
    assert found.scale < 16
    assert found.cross < 4.2


@pytest.mark.slow
def test_packets_lost_unnoticed_spoil_the_bias_and_noticed_ones_do_not():
    judged_by: dict[str, Score] = {}
    for name, share, noticed in (("noticed", 1e-3, True), ("unnoticed", 1e-4, False)):
        rng, rows = np.random.default_rng(8), []
        for batch in range(2):
            made = turntable.draw(800 + batch, 10, turntable.complete_path())
            whole = track(made)
            for k in range(10):
                one = whole.trial(k)
                kept = np.flatnonzero(rng.random(one.time.size) >= share)
                time = one.time[kept] if noticed else one.time[: kept.size]
                # The readback keeps its own time: unnoticed, readings slip against it.
                angles = one.angles[kept] if noticed else one.angles[: kept.size]
                torn = Track(time, one.reading[kept], angles, one.hold[kept])
                ours = GyroFilter.from_track(sensor(), bench(), torn, table="lean")
                state, _ = ours.step(ours.start(torn), torn)
                rows.append((state.theta, state.p[3:15, 3:15], made.gyro[k]))
        judged_by[name] = judged("g", rows)
    print(judged_by)
    assert judged_by["noticed"].bias < 0.0065
    assert judged_by["noticed"].nees < 1.6
    assert judged_by["unnoticed"].bias > 0.02
    assert judged_by["unnoticed"].nees > 10


@pytest.mark.slow
def test_what_is_exact_in_the_bench_is_not_estimated():
    exact = replace(bench(), harmonics=(), square=0.0, lean=0.0)
    made = turntable.draw(5, 1, turntable.complete_path(20.0))
    one = track(made).trial(0)
    assert len(GyroFilter.from_track(sensor(), exact, one).states) == 3 + 12 + 3 + 2
    assert len(AccelerometerFilter.from_track(sensor(), exact, one).states) == 6 + 12 + 3


@pytest.mark.evidence
@pytest.mark.parametrize(("seed", "devices"), sampled(20, SMOOTHED))
@pytest.mark.parametrize(
    ("kind", "flicker"),
    chosen(
        product([GyroFilter, AccelerometerFilter], [False, True]),
        [(GyroFilter, False), (AccelerometerFilter, True)],
    ),
)
def test_the_smoothed_drift_is_off_as_it_says_and_less_than_the_filters(
    seed: int, devices: int, kind: type[GyroFilter] | type[AccelerometerFilter], flicker: bool
):
    grade = replace(turntable.T, flicker=flicker)
    squares, off, filtered = list[float](), list[float](), list[float]()
    for batch in range(devices // 10):
        made = turntable.draw(1000 * seed + batch, 10, turntable.complete_path(), grade)
        whole, drift = track(made), made.gyro_drift if kind is GyroFilter else made.acc_drift
        if flicker:
            # The states have no correlation below 0.8 s: what is faster is not drawn.
            drift = uniform_filter1d(drift, 50, axis=1)
        # A gap of 3 s within a turn: every other device has it.
        gap = int(np.flatnonzero(made.labels == "y+")[500])
        for k in range(10):
            kept = np.r_[0 : gap + 300 * (k % 2), gap + 300 : made.time.size]
            one = whole.trial(k)
            torn = Track(one.time[kept], one.reading[kept], one.angles[kept], one.hold[kept])
            ours: Any = kind.from_track(sensor(grade), bench(), torn)
            _, course = ours.step(ours.start(torn), torn, ours.time_varying_states)
            truth = drift[k, np.searchsorted(made.time, course.time - 1e-9)]
            names = [name for name in ours.time_varying_states if name.startswith("drift")]
            at = [ours.time_varying_states.index(name) for name in names]
            error = course.smoothed.value[:, at] - truth
            squares.append(float(np.mean((error / course.smoothed.std[:, at]) ** 2)))
            off.append(float(np.mean(error**2)))
            if not flicker:
                own = course.value[:, [course.names.index(name) for name in names]] - truth
                filtered.append(float(np.mean(own**2)))
    # Errors hang together over time: devices are what is independent.
    spread = 3 * float(np.std(squares)) / sqrt(devices)
    print(seed, np.mean(squares), spread, sqrt(np.mean(off)))
    assert spread < 0.3
    assert abs(np.mean(squares) - 1) <= (0.15 if flicker else spread)
    assert flicker or np.mean(off) < 0.9 * np.mean(filtered)
