"""Sensors whose readings are rounded, by the methods of a hand: right within what is stated.

Sessions are those of `tests.accuracy.handheld` and `tests.accuracy.ferraris`, which import nothing
of inercal; rounding, digits of a text and dead bands are put on them here.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy import ferraris, handheld
from tests.accuracy.ferraris import DEGREE, Handling, Imu, mems
from tests.base_seeds import chosen, evidence
from tests.evidence.violation_cells import case_cells, device_files
from tests.methods.test_multi_position import BENCH, SESSION, observed, truth

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.methods import method
from inercal.methods.multi_position import METHOD, joint
from inercal.physics.sensors import Sensor, imu
from inercal.pipeline import Outcome, calibrate
from inercal.recordings import Mark, Recording
from inercal.recordings.segments.section_means import average_sections
from inercal.runfile import read

Array = NDArray[np.float64]
ReadOut = Callable[[Array], Array]
G = 9.80665


def steps_of(step: float, digit: float = 0.0) -> ReadOut:
    """Return a read-out in steps, rad/s, which are written with a last digit."""

    def read_out(rate: Array) -> Array:
        stepped = np.rint(rate / step) * step
        return np.rint(stepped / digit) * digit if digit else stepped

    return read_out


def dead_band(width: float) -> ReadOut:
    """Return a read-out of 0 within a width, and of 0.001 °/s beyond it."""
    fine = steps_of(1e-3 * DEGREE)
    return lambda rate: np.where(np.abs(rate) < width, 0.0, fine(rate))


def device(rng: np.random.Generator, noise: float, bias: float | None = None) -> Imu:
    """Return a sensor by the noise of a sample of its gyros and their largest bias, rad/s."""
    made = replace(mems(rng), G=np.zeros((3, 3)), white_g=noise / 10)
    return made if bias is None else replace(made, b_g=rng.uniform(-bias, bias, 3))


def by_hand(
    made: Imu, read_out: ReadOut, rng: np.random.Generator, coarse: float = 0.0
) -> tuple[Estimate, Sensor]:
    """Return the estimate of a session of 14 rests."""
    session = handheld.record(made, replace(SESSION, positions=14, hold_seconds=2.0), rng)
    data = session.data.copy()
    data[..., 3:] = read_out(data[..., 3:])
    if coarse:
        data[..., :3] = np.rint(data[..., :3] / coarse) * coarse
    sensor = METHOD.prepare(imu())
    seen = observed(replace(session, data=data), sensor)
    return joint(seen, sensor, BENCH, ()), sensor


def deviations(estimate: Estimate, sensor: Sensor, expected: Array) -> dict[str, float]:
    """Return the error of each coefficient over its standard deviation."""
    p = len(sensor.coefficients)
    sd = np.sqrt(np.diag(estimate.covariance)[:p])
    z = (estimate.value[:p] - expected) / sd
    return dict(zip(sensor.coefficients, z.tolist(), strict=True))


CASES = {
    "two decimals of °/s": (0.02 * DEGREE, 0.0, 0.2),
    "no decimals of °/s": (1.0 * DEGREE, 0.0, 0.05),
    "steps of 3 °/s": (3.0 * DEGREE, 0.0, 0.3),
    "four decimals of rad/s": (0.02 * DEGREE, 1e-4, 0.4),
    "sixteen bits of 500 °/s": (DEGREE / 65.5, 0.0, 0.1),
}


def z_of_case(name: str, seeds: range) -> tuple[Array, Array]:
    """Return z of the gyros' biases and of all else."""
    step, digit, noise = CASES[name]
    biases: list[float] = []
    others: list[float] = []
    for seed in seeds:
        rng = np.random.default_rng([seed, 11])
        made = device(rng, noise * step)
        estimate, sensor = by_hand(made, steps_of(step, digit), rng)
        for key, z in deviations(estimate, sensor, truth(made, sensor)).items():
            (biases if key.endswith(".bias") else others).append(z)
    return np.array(biases), np.array(others)


@pytest.mark.parametrize("name", chosen(CASES, [*CASES][::2]))
def test_gyros_in_steps_are_within_three_deviations(name: str):
    biases, others = z_of_case(name, range(1))
    assert np.abs(biases).max() < 3
    assert np.abs(others).max() < 4


@pytest.mark.evidence
@pytest.mark.parametrize("name", CASES)
def test_biases_of_gyros_in_steps_are_covered(name: str):
    biases, others = z_of_case(name, range(12))
    assert np.mean(np.abs(biases) < 2) > 0.83  # 36 biases: 99.9 % of .95
    assert np.mean(biases**2) < 1.9
    assert np.mean(others**2) < 1.35


@pytest.mark.parametrize("seed", [0, evidence(1)])
@pytest.mark.parametrize("width", [0.1, 1.0])
def test_a_dead_band_is_in_the_uncertainty_of_the_bias(width: float, seed: int):
    """All rests read exactly zero; today's ± tiny was up to 15 000 standard deviations off."""
    rng = np.random.default_rng([seed, 5])
    made = device(rng, 0.002 * DEGREE, 0.9 * width * DEGREE)
    estimate, sensor = by_hand(made, dead_band(width * DEGREE), rng)
    z = deviations(estimate, sensor, truth(made, sensor))
    assert max(abs(z[f"g{axis}.bias"]) for axis in "xyz") < 3


@pytest.mark.evidence
@pytest.mark.parametrize("width", [0.1, 0.3, 1.0])
def test_a_dead_band_is_covered(width: float):
    z: list[float] = []
    for seed in range(12):
        rng = np.random.default_rng([seed, 6])
        made = device(rng, 0.002 * DEGREE, 0.9 * width * DEGREE)
        estimate, sensor = by_hand(made, dead_band(width * DEGREE), rng)
        found = deviations(estimate, sensor, truth(made, sensor))
        z += [found[f"g{axis}.bias"] for axis in "xyz"]
    assert np.mean(np.abs(z) > 2) <= 0.07


def test_rounding_is_no_quiet_hand():
    rng = np.random.default_rng(2)
    made = device(rng, 0.2 * 0.02 * DEGREE)
    estimate, _ = by_hand(made, steps_of(0.02 * DEGREE), rng)
    assert [group.spread.share for group in estimate.groups] == [1.0, 1.0, 1.0]


def test_accelerometers_in_steps_of_a_twentieth_of_g():
    rng = np.random.default_rng(3)
    made = device(rng, 0.01 * DEGREE)
    estimate, sensor = by_hand(made, lambda rate: rate, rng, coarse=0.05 * G)
    z = deviations(estimate, sensor, truth(made, sensor))
    assert max(abs(value) for name, value in z.items() if name[0] == "a") < 3
    k0 = sensor.coefficients.index("ax.k0")
    assert estimate.covariance[k0, k0] ** 0.5 > 0.001 * G


@pytest.mark.parametrize("name", [evidence("six_position"), "ferraris"])
@pytest.mark.parametrize(
    ("read_out", "noise"),
    [
        (steps_of(0.02 * DEGREE), 0.002 * DEGREE),
        (steps_of(0.5 * DEGREE), 0.1 * DEGREE),
        (dead_band(0.3 * DEGREE), 0.002 * DEGREE),
    ],
)
def test_positions_and_turns_in_steps(name: str, read_out: ReadOut, noise: float):
    z: list[float] = []
    use = method(name)
    for seed in range(3):
        rng = np.random.default_rng([seed, 9])
        made = replace(device(rng, noise, 0.25 * DEGREE))
        hands = Handling(latitude=0.8)
        session = ferraris.record(made, hands, rng, moves=True)
        data = session.data[0].copy()
        data[:, 3:] = read_out(data[:, 3:])
        sensor, steps = use.prepare(imu()), use.plan()
        wanted = [step.label for step in steps]
        marks = [Mark(k, a + 5, b - 5) for k, (a, b) in session.marks.items() if k in wanted]
        marks = [Mark(m.label, *session.marks[m.label]) if "rot" in m.label else m for m in marks]
        recording = Recording(session.time, data, sensor.channels, ("SI",) * 6)
        bench = Hand(
            Measured(hands.gravity, hands.gravity_sd),
            hands.latitude,
            tilt=hands.tilt,
            turn_angle=hands.turn_angle,
            turn_tilt=hands.turn_tilt,
        )
        seen = average_sections(recording, sensor, marks, steps, drifting=True)
        estimate = use.estimator("")(seen, sensor, bench, steps, ())
        expected = np.array([made.coefficients()[key] for key in sensor.coefficients])
        z += deviations(estimate, sensor, expected).values()
    assert np.abs(z).max() < 4
    assert np.mean(np.square(z)) < 1.4


def outcome_of(reports: Path, folder: Path, file: str, rest: str) -> Outcome:
    (folder / file).write_bytes((reports / file).read_bytes())
    path = folder / "run.toml"
    path.write_text(
        f'[sensor.accelerometer]\nunit = "m/s²"\n[sensor.gyro]\nunit = "°/s"\n'
        f'[bench]\ngravity = "9.80 m/s² ± 0.02 m/s²"\n[data]\nfile = "{file}"\n'
        'accelerometer = ["ax", "ay", "az"]\ngyro = ["gx", "gy", "gz"]\ntime = "time"\n'
        f"[method]\n{rest}",
        encoding="utf-8",
    )
    return calibrate(read(path))


@pytest.mark.slow
def test_the_gyros_of_a_log_of_two_decimals(reports_dir: Path, tmp_path: Path):
    outcome = outcome_of(
        reports_dir, tmp_path, "02_gyro_two_decimals.csv", 'name = "multi_position"\n'
    )
    found = outcome.calibration
    for axis, bias in zip("xyz", (6821.3, -3377.2, 1483.2), strict=True):
        error = np.degrees(found.value(f"g{axis}.bias")) * 3600 - bias
        assert abs(error) < 2 * np.degrees(found.uncertainty(f"g{axis}.bias")) * 3600
    assert found.verdict is not None
    rounded = found.verdict.rounding
    assert [one.channel for one in rounded] == ["gx", "gy", "gz"]
    assert all(np.degrees(one.step) == pytest.approx(0.02) for one in rounded)
    assert all(group.spread.share == 1 for group in outcome.estimate.groups)


def test_a_coarse_gyro_that_turns_in_one_sense(reports_dir: Path, tmp_path: Path):
    outcome = outcome_of(
        reports_dir, tmp_path, "17_coarse_gyro_one_sense.csv", 'name = "six_position"\n'
    )
    assert not [one for one in outcome.findings if one.what == "saturation"]
    found = outcome.calibration
    assert found.verdict is not None
    for one in found.verdict.rounding:
        # The error by rounding is common to all six positions.
        assert found.uncertainty(f"{one.channel}.bias") > 0.9 * one.std
    assert {one.channel for one in found.verdict.rounding} >= {"gx", "gy"}


def rounded_on_a_table(case: str, folder: Path) -> tuple[Outcome, dict[str, float]]:
    (cell,) = (one for one in case_cells(case) if "rounding" in one.violation)
    files, true = device_files(cell, 0)
    for name, content in files.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return calibrate(read(folder / "run.toml")), true


@pytest.mark.slow
def test_steps_of_gyros_are_no_fault_of_the_table(tmp_path: Path):
    outcome, true = rounded_on_a_table("turntable_discrete", tmp_path)
    assert not [one for one in outcome.findings if one.what == "readback"]
    found = outcome.calibration
    assert all(abs(found.value(n) - true[n]) < 3 * found.uncertainty(n) for n in true)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["turntable_kalman", "turntable_trajectory"])
def test_methods_that_follow_samples_name_the_steps(case: str, tmp_path: Path):
    found = rounded_on_a_table(case, tmp_path)[0].calibration
    assert found.verdict is not None
    assert found.verdict.grade == "unreliable"
    assert "rounding" in found.verdict.lines[1]
    assert "turntable_discrete" in found.verdict.lines[2]
