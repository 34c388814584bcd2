"""What is wrong with a turntable's recording is named before it is filtered."""

from dataclasses import replace
from functools import cache
from math import degrees, pi, radians

import numpy as np
import pytest
from tests.accuracy import turntable as tt
from tests.base_seeds import evidence
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.basics.units import Measured
from inercal.benches.stated_axes import SignedPermutation, signed_permutations
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading.dropped_samples import dropped_sample_findings
from inercal.benches.turntable.reading.sample_checks import require_angle_unit, wild_samples
from inercal.benches.turntable.reading.track_checks import ColumnNames, check_track
from inercal.physics.quantities import Measures
from inercal.physics.sensors.catalogue import imu
from inercal.recordings import Track

SEED, SEEDS = 3, (3, 17)
SENSOR = imu()
BENCH = Turntable(Measured(tt.G, 0.0), radians(38))
UP = {
    "z up": (0, 0, 0), "y up": (0, 90, 0), "z down": (0, 180, 0), "y down": (0, 270, 0),
    "x down": (0, 0, 90), "x up": (0, 0, -90),
}  # fmt: skip
WARM: tt.Stand = ("warm-up", (0, 0, 0), 120.0)
DISCRETE: list[tt.Stand | tt.Turn] = [WARM]
for up, there in UP.items():
    DISCRETE += [(up, there, 60.0), (f"{up}+", 0, 1080.0, 30.0), (f"{up}-", 0, -1080.0, 30.0)]
FAST = [WARM, *tt.positions(), *tt.turns(1080, 30, back=True)]
PATHS = {"paper": tt.complete_path(), "fast": FAST, "discrete": DISCRETE}
# Each refusal tries all orders and signs; "fast" has the steps of "paper".
FITTED = ["paper", pytest.param("fast", marks=pytest.mark.slow), evidence("discrete")]
HZ = 40.0


@cache
def draw_four_devices(path: str, seed: int) -> Track:
    """Return the runs of four devices."""
    made = tt.draw(seed, 4, PATHS[path], tt.GRADES["C"], hz=HZ)
    hold = np.full(made.time.size, -1)
    for k, name in enumerate([n for n in np.unique(made.labels) if n and n[-1] not in "+-"]):
        hold[made.labels == name] = k
    return Track(made.time, np.concatenate([made.forces, made.rates], -1), made.angles, hold)


def draw_first_device(path: str, seed: int = SEED) -> Track:
    """Return the run of the first of them."""
    return draw_four_devices(path, seed).trial(0)


def check_message(track: Track) -> str:
    with pytest.raises(InputError) as caught:
        check_track("run.toml", track, SENSOR, BENCH)
    said = str(caught.value)
    assert said.startswith("run.toml: ")
    assert "\n" not in said
    return said


def number_after(words: str, said: str) -> float:
    """Return the number that follows some words."""
    return float(said.split(words)[1].split()[0].rstrip(",;"))


def exchange_channels(
    track: Track, way: SignedPermutation | None, force: SignedPermutation | None = None
) -> Track:
    """Return readings whose gyros, or accelerometers, are exchanged."""
    f, w = track.reading[..., :3], track.reading[..., 3:]
    f, w = f if force is None else force.reorder(f), w if way is None else way.reorder(w)
    return replace(track, reading=np.concatenate([f, w], -1))


def inverse_exchange(way: SignedPermutation) -> SignedPermutation:
    """Return what undoes an exchange."""
    order = tuple(int(k) for k in np.argsort(way.order))
    return SignedPermutation(order, tuple(way.signs[k] for k in order))


@pytest.mark.slow
@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("seed", [SEEDS[0], *map(evidence, SEEDS[1:])])
def test_ordinary_runs_pass_without_a_finding(path: str, seed: int):
    assert check_track("run.toml", draw_four_devices(path, seed), SENSOR, BENCH) == ()


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("seed", [SEEDS[0], *map(evidence, SEEDS[1:])])
def test_poor_but_honest_sensors_pass(path: str, seed: int):
    """Biases 1 °/s and 100 mg, scale factors off 5 %, misalignments of 5°, each of any sign."""
    track, rng = draw_first_device(path, seed), np.random.default_rng(seed)
    for _ in range(5):
        off = rng.choice([-1, 1], (2, 3, 3)) * np.tan(radians(5))
        off[:, range(3), range(3)] = rng.choice([-1, 1], (2, 3)) * 0.05
        bias = rng.choice([-1, 1], (2, 3)) * np.array([[0.1 * tt.G], [radians(1)]])
        parts = [
            track.reading[:, 3 * k : 3 * k + 3] @ (np.eye(3) + off[k]).T + bias[k] for k in range(2)
        ]
        poor = Track(track.time, np.concatenate(parts, -1), track.angles, track.hold)
        # 100 mg and 5 % may make a norm at rest that is 10 % off, which is worth a question.
        noticed = check_track("run.toml", poor, SENSOR, BENCH)
        assert {finding.what for finding in noticed} <= {"units"}


@pytest.mark.parametrize("path", FITTED)
@pytest.mark.parametrize("seed", [SEED, pytest.param(17, marks=pytest.mark.slow)])
def test_exchanged_and_reversed_columns_are_named_with_what_fits(path: str, seed: int):
    track, rng = draw_first_device(path, seed), np.random.default_rng(seed)
    ways = signed_permutations(3)
    chosen = [ways[k] for k in 1 + rng.choice(len(ways) - 1, 2, replace=False)]
    for way in (
        SignedPermutation((0, 1, 2), (1, -1, 1)),
        SignedPermutation((1, 0, 2), (1, 1, 1)),
        *chosen,
    ):
        mend = inverse_exchange(way)
        said = check_message(replace(track, angles=way.reorder(track.angles)))
        assert f"[data] table = {mend.signed_names(BENCH.names)}" in said
        said = check_message(exchange_channels(track, way))
        assert f"[data] gyro = {mend.signed_names(('gx', 'gy', 'gz'))}" in said
        said = check_message(exchange_channels(track, None, way))
        assert f"[data] accelerometer = {mend.signed_names(('ax', 'ay', 'az'))}" in said


def test_a_different_imu_mounting_is_identified_by_both_triads():
    way = SignedPermutation((1, 0, 2), (1, -1, 1))
    said = check_message(exchange_channels(draw_first_device("paper"), way, way))
    assert f"[data] gyro = {inverse_exchange(way).signed_names(('gx', 'gy', 'gz'))} and " in said
    assert (
        f"[data] accelerometer = {inverse_exchange(way).signed_names(('ax', 'ay', 'az'))}" in said
    )


@pytest.mark.parametrize("path", PATHS)
def test_degrees_and_radians_exchanged_are_detected_by_gravity(path: str):
    track = draw_first_device(path)
    said = check_message(replace(track, angles=np.degrees(track.angles)))
    assert "[data] table_unit: it is in °, read as rad" in said
    said = check_message(replace(track, angles=np.radians(track.angles)))
    assert "[data] table_unit: it is in rad, read as °" in said
    gyros = np.repeat([1.0, degrees(1)], 3)
    said = check_message(replace(track, reading=track.reading * gyros))
    assert "[data] gyro: it is in °/s, read as rad/s" in said
    said = check_message(replace(track, reading=track.reading / gyros))
    assert "[data] gyro: it is in rad/s, read as °/s" in said


@pytest.mark.parametrize(
    ("unit", "size", "start", "stop", "right"),
    [
        ("rad", 1.0, 0.0, 360.0, "°"),
        ("″", pi / 648_000, -180.0, 180.0, "°"),
        ("°", pi / 180, -pi, pi, "rad"),
        ("deg", pi / 180, 0.0, 360.0, None),
        ("rad", 1.0, 0.0, 2 * pi, None),
        ("°", pi / 180, 0.0, 300.0, None),
        ("rad", 1.0, 0.0, 720.0, None),
    ],
)
def test_angles_that_start_again_after_a_whole_turn_show_their_unit(
    unit: str, size: float, start: float, stop: float, right: str | None
):
    steady = np.linspace(start, stop, 500)
    angles = np.stack([np.zeros(1000), np.concatenate([steady, steady])], axis=-1)
    if right is None:
        require_angle_unit("run.toml", angles, size, ("outer", "inner"))
    else:
        with refused(key="[data] table_unit", names=("inner",)) as refusal:
            require_angle_unit("run.toml", angles, size, ("outer", "inner"))
        assert f'table_unit = "{right}"' in str(refusal.value)


@pytest.mark.slow
@pytest.mark.parametrize("path", FITTED)
def test_factors_of_two_are_reported_with_their_device(path: str):
    track = draw_first_device(path)
    said = check_message(replace(track, angles=2 * track.angles))
    assert number_after("the gyros read ", said) == pytest.approx(0.5, rel=0.03)
    assert "[data] table" in said
    assert "[data] gyro" not in said
    for times in (2.0, 0.5):
        said = check_message(replace(track, reading=track.reading * np.repeat([1, times], 3)))
        assert "[data] gyro" in said
        assert "[data] table" not in said
        said = check_message(replace(track, reading=track.reading * np.repeat([times, 1], 3)))
        assert "[data] accelerometer: at rest the readings' norm" in said
    said = check_message(replace(track, reading=track.reading * np.array([1, 1, 1, 1, 1, 2])))
    # All turns of "discrete" are about the vertical: only there does no axis turn gz alone.
    name = ", gz " if path == "discrete" else "rate: outer "
    assert number_after(name, said) == pytest.approx(2, rel=0.03)
    said = check_message(replace(track, reading=track.reading * np.array([2, 1, 1, 1, 1, 1])))
    assert number_after("[data] accelerometer: ax ", said) == pytest.approx(2, rel=0.03)


def test_one_axis_of_the_readback_in_degrees_is_named():
    track = draw_first_device("paper")
    said = check_message(replace(track, angles=track.angles * np.array([1, degrees(1), 1])))
    assert "middle 0.017" in said


def test_accelerometers_in_g_are_named():
    track = draw_first_device("paper")
    said = check_message(replace(track, reading=track.reading / np.repeat([tt.G, 1], 3)))
    assert "0.10" in said
    assert "[sensor.accelerometer]" in said


@pytest.mark.parametrize(("wild", "rows"), [(131.0, 1), (-16.0, 1), (1000.0, 5)])
def test_a_few_wild_readings_are_found_and_do_not_look_like_a_wrong_unit(wild: float, rows: int):
    track = draw_first_device("paper")
    reading = track.reading.copy()
    at = int(np.flatnonzero(track.hold >= 0)[100])
    reading[at : at + rows, 1] = wild * tt.G
    reading[at : at + rows, 4] = wild * tt.G
    assert check_track("run.toml", replace(track, reading=reading), SENSOR, BENCH) == ()
    kinds: dict[int, Measures] = {1: "f", 4: "w"}
    for column, kind in kinds.items():
        assert wild_samples(track.reading[:, column], kind).size == 0
        assert wild_samples(reading[:, column], kind).tolist() == [[at, at + rows]]


def test_a_table_that_never_moved_and_a_frozen_readback_differ():
    track = draw_first_device("paper")
    frozen = replace(track, angles=np.zeros_like(track.angles))
    with refused(key="[data] table"):
        check_track("run.toml", frozen, SENSOR, BENCH)
    with refused(key=None):
        check_track("run.toml", track.slice(0, int(100 * HZ)), SENSOR, BENCH)


def test_too_few_attitudes_and_turns_are_warned_of():
    track = draw_first_device("paper")
    end = int(np.flatnonzero(track.hold >= 0)[0] + HZ * 320)  # the third position
    found = check_track("run.toml", track.slice(0, end), SENSOR, BENCH)
    assert [(one.severity, one.what) for one in found] == [
        ("warning", "attitudes"),
        ("warning", "turns"),
    ]
    assert number_after("have ", found[0].message) == 3


def test_many_rows_lost_in_a_turn_are_one_cause_with_its_time():
    track = draw_first_device("paper")
    turning = np.abs(np.diff(track.angles, axis=0)).max(axis=1) > 1e-3
    lengths = np.convolve(turning, np.ones(200), mode="same")
    k = int(np.argmax(lengths))
    kept = np.delete(np.arange(track.time.size), np.arange(k, k + 30))
    time = track.time[: kept.size]
    some = Track(time, track.reading[kept], track.angles[kept], track.hold[kept])
    (found,) = dropped_sample_findings(some, SENSOR, BENCH)
    assert found.cause.endswith(f"samples lost without a gap at {time[k - 1]:.6g} s")
    assert dropped_sample_findings(track, SENSOR, BENCH) == ()


def test_angles_in_gon_are_named_by_their_ratio():
    track = draw_first_device("paper")
    said = check_message(replace(track, angles=track.angles / 0.9))
    assert number_after("angles change ", said) == pytest.approx(1.11, abs=0.02)
    assert "(gon, read as °, would give 1.11): check the unit of the angles" in said


@pytest.mark.parametrize("unit", [1.0, 1 / tt.G])
def test_accelerometers_on_a_vertical_axis_are_checked_by_their_mean(unit: float):
    rng, time = np.random.default_rng(SEED), np.arange(0, 60, 1 / HZ)
    rate = np.where(abs(time - 30) < 15, 1.0, 0.0)
    force = np.array([0.01, 0.0, 1.01]) * tt.G + 0.01 * rng.standard_normal((time.size, 3))
    rates = rate[:, None] * [0, 0, 1] + 1e-4 * rng.standard_normal((time.size, 3))
    hold = np.select([time < 14, time > 46], [0, 1], -1)
    angles = np.cumsum(rate)[:, None] / HZ
    track = Track(time, np.hstack([force * unit, rates]), angles, hold)
    gyros = SENSOR.with_coefficients("gz.bias", "gz.scale")
    bench = replace(BENCH, axes="z")
    if unit == 1.0:
        assert check_track("run.toml", track, gyros, bench) == ()  # no accelerometer is calibrated
        found = check_track("run.toml", track, SENSOR, bench)
        assert [one.what for one in found] == ["attitudes", "turns"]
    else:
        with refused(key="[data] accelerometer") as caught:
            check_track("run.toml", track, gyros, bench)
        assert "0.103 times gravity" in str(caught.value)


def test_gaps_are_counted_and_long_ones_named():
    track = draw_first_device("paper")
    kept = np.ones(track.time.size, bool)
    kept[[500, 900, 901]] = False
    kept[20_000 : 20_000 + int(0.7 * HZ)] = False
    some = Track(track.time[kept], track.reading[kept], track.angles[kept], track.hold[kept])
    note, warning = check_track("run.toml", some, SENSOR, BENCH)
    assert note.severity == "note"
    assert note.message.startswith("3 gaps")
    assert number_after("gaps: ", note.message) == 3 + int(0.7 * HZ)
    assert warning.severity == "warning"
    assert f"after {19_999 / HZ:.6g} s" in warning.message


def test_messages_name_the_users_columns():
    track = draw_first_device("paper")
    columns = ColumnNames(("A1", "A2", "A3"), ("G1", "G2", "G3"), ("Z", "X", "Y"))
    turned = SignedPermutation((0, 1, 2), (1, 1, -1))
    with refused(names=('[data] table = ["Z", "X", "-Y"]',)):
        check_track(
            "run", replace(track, angles=turned.reorder(track.angles)), SENSOR, BENCH, columns
        )
