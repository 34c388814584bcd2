"""Run files on a centrifuge, from the file to the verdict; what is wrong is said in one line."""

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tests.accuracy.centrifuge import PAPER_G, Triad
from tests.base_seeds import evidence
from tests.refusals import refused

from inercal.basics.errors import InercalError, InputError, NotObserved
from inercal.benches import Centrifuge
from inercal.benches.centrifuge.kind import sheet
from inercal.calibration.files import save
from inercal.methods.centrifuge_norm.screening import screen_rows
from inercal.physics.plan import Spin
from inercal.pipeline import Outcome, apply_data_columns, calibrate, simulate
from inercal.pipeline.budget.experiment_from_runfile import experiment_from_run
from inercal.recordings.io.write import write_recording
from inercal.report import write_report
from inercal.runfile import read

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples" / "centrifuge"
# Signs that print lost, by position and rate of the arm.
LOST = {(p, rpm, "az") for p in (1, 5, 9, 13, 17, 10) for rpm in (60, 120, 180)}
LOST |= {(p, 60, "ax") for p in (6, 15, 16, 19, 20)}


def table(name: str, data_dir: Path, folder: Path) -> Outcome:
    if not (data_dir / "centrifuge_table1").exists():
        pytest.skip(f"{data_dir / 'centrifuge_table1'} is missing")
    return calibrate(changed(folder, name, ("../../../shared/data", data_dir.as_posix())))


def changed(folder: Path, name: str, *changes: tuple[str, str]) -> Path:
    """Return a run file of the examples with some of its text replaced, beside its table."""
    text = (EXAMPLES / f"{name}.toml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / f"{name}.toml"
    path.write_text(text, encoding="utf-8")
    for data in EXAMPLES.glob("*.csv"):
        shutil.copy(data, folder)
    return path


def simulated(folder: Path, *changes: tuple[str, str], seed: int = 0) -> Outcome:
    run = read(changed(folder, "arm_run", *changes))
    write_recording(apply_data_columns(run, simulate(run, seed)), run.file(run.data.file))
    return calibrate(run)


@pytest.fixture(scope="module")
def arm_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("arm")


@pytest.fixture(scope="module")
def arm_run(arm_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Outcome]:
    """Return a function that simulates and calibrates an arm run once for each list of changes."""

    @cache
    def once(*changes: tuple[str, str]) -> Outcome:
        folder = tmp_path_factory.mktemp("arm") if changes else arm_folder
        return simulated(folder, *changes)

    return once


def nees(outcome: Outcome) -> float:
    calibration = outcome.calibration
    run = dict.fromkeys(calibration.sensor.coefficients, 0.0)
    run |= {
        name: value for name, value in read(EXAMPLES / "arm_run.toml").truth.items() if name in run
    }
    error = calibration.values - np.array(list(run.values()))
    return float(error @ np.linalg.solve(calibration.covariance, error)) / error.size


@pytest.mark.slow
def test_the_printed_table_does_not_pass_quietly(data_dir: Path, tmp_path: Path):
    outcome = table("printed", data_dir, tmp_path)
    assert outcome.verdict.grade == "unreliable"
    told = [finding.message for finding in outcome.findings if finding.what == "norm"]
    assert len(told) == 23
    for position, rpm, axis in LOST:
        (line,) = (t for t in told if t.startswith(f"{position} at {rpm * 3.14159265:.0f}")
                   or t.startswith(f"{position} at {rpm} rpm"))  # fmt: skip
        assert f"the sign of {axis} (" in line
        assert line.endswith("would correct it")
    assert all(line in outcome.calibration.notes for line in told)


def test_the_corrected_table_gives_the_source_s_truth(data_dir: Path, tmp_path: Path):
    outcome = table("corrected", data_dir, tmp_path)
    assert outcome.estimate.consistent
    # as its header says: the paper's g is larger than gravity at the equator
    assert (outcome.verdict.grade, outcome.verdict.warned) == ("reservations", ("gravity",))
    assert outcome.verdict.suspect is None
    assert outcome.estimate.chi2 == pytest.approx(29, abs=0.5)
    device, nominal = Triad(), 1.25
    for k, a in enumerate(("ax", "ay", "az")):
        value = {n: outcome.calibration.value(f"{a}.{n}") for n in ("k0", "k1", "k2")}
        scale = nominal * (1 + value["k1"])
        assert scale == pytest.approx(device.scale[k], abs=1e-8)
        assert value["k0"] * nominal / PAPER_G == pytest.approx(device.bias[k], abs=1.5e-7)
        bend = value["k2"] / (1 + value["k1"]) * PAPER_G
        assert bend == pytest.approx(device.bend[k], abs=2e-10)


@pytest.mark.slow
def test_a_laboratory_table_states_the_gain_by_its_attitudes():
    outcome = calibrate(EXAMPLES / "lab.toml")
    assert outcome.estimate.consistent
    assert any(
        line.startswith("Because the attitudes are known") for line in outcome.calibration.notes
    )
    # made with 0.1 V/g times these
    for a, scale in zip(("ax", "ay", "az"), (1.0021, 0.9987, 1.0008), strict=True):
        error = outcome.calibration.value(f"{a}.k1") - (scale - 1)
        assert abs(error) < 4 * outcome.calibration.uncertainty(f"{a}.k1")


NORMS = (("indexing", "#"), ("mounting", "#"))
DWELL = 'dwell_rate = "0.5 ppm"'


COUNTER_ROTATING = (DWELL, f'{DWELL}\nplatform = "counter-rotating"')
INDEXED = (
    (DWELL, f'{DWELL}\nindexing = "0.05 °"'),
    ('arm_rate = "rpm"', 'arm_rate = "rpm"\nattitude = ["psi", "theta"]'),
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [(), (COUNTER_ROTATING,), evidence(((DWELL, f'{DWELL}\nsense = "clockwise"'),)), INDEXED],
    ids=["locked", "counter-rotating", "clockwise", "attitudes"],
)
def test_arm_runs_are_calibrated_to_their_truth(
    arm_run: Callable[..., Outcome], changes: tuple[tuple[str, str], ...]
):
    outcome = arm_run(*changes)
    assert outcome.estimate.p_value > 1e-3
    # χ² of nine coefficients over nine: 0.01 % and 99.99 % points
    assert 0.06 < nees(outcome) < 3.8


@pytest.mark.parametrize("acceleration", [3.0, 0.7])
def test_a_plan_takes_as_long_as_its_simulation(tmp_path: Path, acceleration: float):
    stated = f'{DWELL}\nmax_acceleration = "{acceleration} rad/s²"'
    run = read(changed(tmp_path, "arm_run", (DWELL, stated)))
    recording, seconds = simulate(run, 0), sheet(run).seconds
    # Each of the 20 × 4 ramps and 20 × 5 holds is a whole number of samples.
    assert recording.time[-1] == pytest.approx(seconds, abs=180 * 0.5 / 50)
    rate = recording.readback["arm_rate"]
    steepest = np.abs(np.diff(rate)).max() * 50
    assert steepest == pytest.approx(acceleration, rel=0.01)


@pytest.mark.slow
def test_an_arm_run_with_a_slow_arm_is_calibrated_to_its_truth(tmp_path: Path):
    outcome = simulated(tmp_path, (DWELL, f'{DWELL}\nmax_acceleration = "20 °/s²"'))
    assert outcome.estimate.p_value > 1e-3
    assert 0.06 < nees(outcome) < 3.8
    with refused(InputError, key="[bench] max_acceleration"):
        read(changed(tmp_path, "arm_run", (DWELL, f'{DWELL}\nmax_acceleration = "0 °/s²"')))


@pytest.mark.slow
def test_lever_arms_of_an_arm_run_are_found(tmp_path: Path):
    arms = ("ax.arm_i", "ax.arm_o", "ay.arm_i", "az.arm_i", "az.arm_p")
    also = f"also = {list(arms)}".replace("'", '"')
    outcome = simulated(
        tmp_path,
        ("turns = 10", f"turns = 10\n{also}"),
        (
            '"az.k2" = "-30 µg/g²"',
            '"az.k2" = "-30 µg/g²"\n"ax.arm_i" = "20 mm"\n"az.arm_p" = "-15 mm"',
        ),
        ('arm_rate = "rpm"', 'arm_rate = "rpm"\nattitude = ["psi", "theta"]'),
        ('radius = "1 m ± 10 µm"', 'radius = "1 m ± 0"'),
    )
    assert outcome.estimate.consistent
    for name, true in (("ax.arm_i", 0.02), ("az.arm_p", -0.015), ("ay.arm_i", 0.0)):
        error = outcome.calibration.value(name) - true
        assert abs(error) < 4 * outcome.calibration.uncertainty(name)
        assert outcome.calibration.uncertainty(name) < 1e-4


PRIOR = ("turns = 10", 'turns = 10\nprior_file = "static.calibration.json"')


def test_a_static_calibration_is_a_prior(
    arm_run: Callable[..., Outcome], arm_folder: Path, tmp_path: Path
):
    at_rest = arm_run()
    shutil.copytree(arm_folder, tmp_path, dirs_exist_ok=True)
    # As if a static test had found the same with the same uncertainty.
    static = replace(at_rest.calibration, method="six_position")
    save(static, tmp_path / "static.calibration.json")
    twice = calibrate(changed(tmp_path, "arm_run", PRIOR))
    for name in ("ax.k0", "ay.k1"):
        ratio = twice.calibration.uncertainty(name) / at_rest.calibration.uncertainty(name)
        assert 0.65 < ratio < 0.8  # two equal measurements: 1/√2


def test_a_prior_of_another_sensor_or_of_the_same_data_is_refused(
    arm_run: Callable[..., Outcome], arm_folder: Path, tmp_path: Path
):
    found = arm_run().calibration
    shutil.copytree(arm_folder, tmp_path, dirs_exist_ok=True)
    path = tmp_path / "static.calibration.json"
    run = changed(tmp_path, "arm_run", PRIOR)
    other = replace(found.sensor, name="B")
    for calibration in (found, replace(found, method="six_position", sensor=other)):
        save(calibration, path)
        with pytest.raises(InputError):
            read(run)
    path.unlink()
    with pytest.raises(InputError):
        read(run)
    save(replace(found, method="six_position"), path)
    assert read(run).priors


@pytest.mark.slow
def test_drift_that_the_sensor_states_is_in_the_uncertainty(tmp_path: Path):
    """Each attitude's dwells share it: χ² was 4 to 6 times its degrees of freedom without."""
    drifting = ('white = "20 µg/√Hz"', 'white = "20 µg/√Hz"\nbias_instability = "30 µg"')
    ratios: list[float] = []
    for seed in range(4):
        outcome = simulated(tmp_path, drifting, seed=seed)
        ratios.append(float(outcome.estimate.chi2) / outcome.estimate.dof)
    assert 0.7 < np.mean(ratios) < 1.4, ratios


@pytest.mark.slow
def test_one_bad_azimuth_is_the_only_suspect(arm_run: Callable[..., Outcome]):
    outcome = arm_run(COUNTER_ROTATING)
    assert isinstance(outcome.bench, Centrifuge)
    spins = [step for step in outcome.steps if isinstance(step, Spin)]
    mean = outcome.observations.mean.copy()
    mean[37, 0] += 0.5
    seen = replace(outcome.observations, mean=mean)
    nominal = read(EXAMPLES / "arm_run.toml").sensor
    (suspect,) = screen_rows(seen, nominal, outcome.bench, spins)
    assert suspect.row == 37


def simulate_aligned_sensor(folder: Path, *changes: tuple[str, str]) -> Outcome:
    """Return what comes of a sensor without a mounting angle: a crooked one would tell a little."""
    run = read(changed(folder, "arm_run", *changes))
    assert isinstance(run.bench, Centrifuge)
    run = replace(run, bench=replace(run.bench, mounting=0.0))
    write_recording(apply_data_columns(run, simulate(run, 0)), run.file(run.data.file))
    return calibrate(run)


@pytest.mark.slow
def test_one_rate_in_half_a_circle_is_refused_and_all_round_accepted(tmp_path: Path):
    one = ('rates = ["60 rpm", "120 rpm", "180 rpm"]', 'rates = ["60 rpm"]')
    half = ('attitudes = "full-circle"', 'attitudes = "half-circle"')
    with pytest.raises(NotObserved) as refusal:
        simulate_aligned_sensor(tmp_path, one, half)
    assert "ay.k0" in str(refusal.value)
    assert simulate_aligned_sensor(tmp_path, one).estimate.consistent


@pytest.mark.slow
def test_an_estimate_without_uncertainty_is_refused(tmp_path: Path):
    paper = ('name = "centrifuge_norm"', 'name = "centrifuge_norm"\nestimator = "paper"')
    with pytest.raises(InputError):
        simulated(tmp_path, paper)


@pytest.mark.slow
def test_a_saturated_dwell_is_omitted_and_reported(tmp_path: Path):
    outcome = simulated(tmp_path, ('full_scale = "60 g"', 'full_scale = "33 g"'))
    assert any(f.what == "dwell" for f in outcome.findings)
    assert len(outcome.steps) < 60


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ([('arm_rate = "rpm"\n', "")], ["[data] arm_rate"]),
        ([('arm_rate = "rpm"', 'arm_rate = "speed"')], ["'speed'", "rpm"]),
        ([('attitude = ["psi", "theta"]\n', "")], ["[data] attitude", "indexing"]),
        ([('accelerometer = "1 µV"', 'accelerometer = "1 µA"')], ["[data.sd] accelerometer"]),
        ([('radius = "1.5 m ± 20 µm"', 'radius = "-1.5 m"')], ["[bench] radius", "'-1.5 m'"]),
        ([('radius = "1.5 m ± 20 µm"', 'radius = "20 µm ± 1.5 m"')],
         ["[bench] radius", "uncertainty"]),
        ([('radius = "1.5 m ± 20 µm"\n', "")], ["[bench] radius"]),
        ([('sense = "clockwise"', 'sense = "left"')], ["[bench] sense", "'left'", "clockwise"]),
        ([('sense = "clockwise"', 'turn = "1 °"')], ["bench.turn", "dwell_rate"]),
        ([('kind = "centrifuge"', 'kind = "hand"')], ["bench.radius"]),
        ([('name = "centrifuge_norm"', 'name = "six_position"')], ["[bench] kind", "'hand'"]),
        ([("indexing", 'platform = "counter-rotating"\n#'), NORMS[1]], ["[bench] platform"]),
        ([('arm_rate = "rpm"', 'arm_rate = "rpm"\narm_rate_unit = "V"')], ["arm_rate_unit"]),
        ([("[method]\n", '[method]\nalso = ["misalignment"]\n'), *NORMS],
         ["nonorthogonality"]),
        ([('tilt = "2 ″"', 'tilt = "80 °"')], ["[bench] tilt", "1°"]),
        ([('arm_rate = "rpm"', 'arm_rate = "rpm"\narm_rate_unit = "0 rpm"')],
         ["arm_rate_unit"]),
        ([('arm_rate = "rpm"', 'arm_rate = "rpm"\nseconds = "rpm"')], ["[data] seconds"]),
        ([("[method]\n", '[method]\nalso = ["ax.delta_o"]\n'), *NORMS,
          ('name = "SN 0417"', 'frame = "symmetric"')], ["misalignment"]),
        ([("[method]\n", '[method]\nalso = ["nonorthogonality"]\n'), *NORMS,
          ('name = "SN 0417"', 'frame = "symmetric"')], ["misalignment"]),
        ([('name = "SN 0417"', 'frame = "symmetric"'), *NORMS],
         ["misalignment"]),
        ([("[method]\n", '[method]\nestimator = "paper"\nalso = ["k3"]\n')], ["paper", "k2"]),
    ],
)  # fmt: skip
def test_a_user_error_gives_one_line(
    tmp_path: Path, changes: list[tuple[str, str]], words: list[str]
):
    with pytest.raises(InercalError) as error:
        calibrate(changed(tmp_path, "lab", *changes))
    message = str(error.value)
    assert "\n" not in message
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("row", "column"),
    [
        ("99,10,20,0,0.1,0.1,0.1", "'rpm'"),
        ("99,10,20,nan,0.1,0.1,0.1", "rpm"),
        ("99,10,20,40,nan,0.1,0.1", "'ax'"),
        ("1,10,20,40,0.1,0.1", "line"),
    ],
)
def test_a_bad_row_is_named(tmp_path: Path, row: str, column: str):
    path = changed(tmp_path, "lab")
    data = tmp_path / "lab.csv"
    data.write_text(data.read_text(encoding="utf-8") + row + "\n", encoding="utf-8")
    with pytest.raises(InputError) as error:
        calibrate(path)
    line = len(data.read_text(encoding="utf-8").splitlines())
    assert f"line {line}" in str(error.value)
    assert column in str(error.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('rates = ["60 rpm", "120 rpm", "180 rpm"]', "rates = []"), ["[method]", "rates"]),
        (
            ('attitudes = "full-circle"', 'attitudes = "x"'),
            ["[method]", "attitudes 'x'", "half-circle"],
        ),
        (('rates = ["60 rpm", "120 rpm", "180 rpm"]', 'rates = ["9e6 rpm"]'), ["samples"]),
    ],
)
def test_a_plan_that_cannot_be_is_one_line(
    tmp_path: Path, change: tuple[str, str], words: list[str]
):
    with pytest.raises(InputError) as error:
        simulate(changed(tmp_path, "arm_run", change))
    assert all(word in str(error.value) for word in words), str(error.value)


def test_attitudes_of_a_recording_are_its_positions(arm_run: Callable[..., Outcome]):
    names = arm_run(*INDEXED).estimate.names
    indexed = {name for name in names if name.startswith("index_x")}
    assert len(indexed) == 20


def test_a_budget_is_of_a_plan_and_of_a_locked_platform(tmp_path: Path):
    with pytest.raises(InputError):
        experiment_from_run(read(EXAMPLES / "lab.toml"))
    still = changed(tmp_path, "arm_run", COUNTER_ROTATING)
    with pytest.raises(InputError):
        experiment_from_run(read(still))
    assert len(experiment_from_run(read(EXAMPLES / "arm_run.toml")).steps) == 60


def test_keys_of_a_centrifuge_are_refused_elsewhere(tmp_path: Path):
    path = tmp_path / "run.toml"
    text = (ROOT / "examples" / "six_position" / "run.toml").read_text(encoding="utf-8")
    path.write_text(text.replace("[data]\n", '[data]\narm_rate = "rpm"\n'), encoding="utf-8")
    with pytest.raises(InputError) as refusal:
        read(path)
    assert "arm_rate" in str(refusal.value)


@pytest.mark.slow
def test_the_report_of_an_arm_run_shows_bench_norms_and_dwells(
    arm_run: Callable[..., Outcome], tmp_path: Path
):
    outcome = arm_run()
    assert isinstance(outcome.bench, Centrifuge)
    page = write_report(outcome, tmp_path / "report.html").read_text(encoding="utf-8")
    for text in (
        "static radius",
        "latitude",
        "p01 at 60 rpm",
        "norm of the specific force on the bench",
    ):
        assert text in page


def in_unit(unit: str) -> tuple[str, str]:
    return ('arm_rate = "rpm"', f'arm_rate = "rpm"\narm_rate_unit = "{unit}"')


def of_radius(text: str) -> tuple[str, str]:
    return ('"1.5 m ± 20 µm"', f'"{text}"')


@pytest.mark.parametrize(
    ("change", "key", "unit"),
    [
        *((in_unit(unit), "[data] arm_rate_unit", "rpm") for unit in ("rad/s", "°/s", "rev/s")),
        (of_radius("1500 m ± 20 mm"), "[bench] radius", "mm"),
        (of_radius("1.5 mm ± 0.02 µm"), "[bench] radius", "mm"),
        (of_radius("150 m ± 2 mm"), "[bench] radius", "cm"),
    ],
)
def test_a_wrong_unit_of_rate_or_radius_is_named(
    change: tuple[str, str], key: str, unit: str, tmp_path: Path
):
    with pytest.raises(InputError) as caught:
        calibrate(changed(tmp_path, "lab", change))
    assert (caught.value.key, caught.value.names) == (key, (unit,))


@pytest.mark.parametrize(("unit", "size"), [("rad/s", np.pi / 30), ("°/s", 6.0), ("rev/s", 1 / 60)])
def test_rates_of_a_table_in_another_unit_than_rpm_are_named(
    unit: str, size: float, tmp_path: Path
):
    path = changed(tmp_path, "lab")
    head, *rows = (tmp_path / "lab.csv").read_text(encoding="utf-8").splitlines()[1:]
    place = head.split(",").index("rpm")
    cells = [row.split(",") for row in rows]
    for row in cells:
        row[place] = repr(float(row[place]) * size)
    text = "\n".join([head, *(",".join(row) for row in cells)])
    (tmp_path / "lab.csv").write_text(text + "\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        calibrate(path)
    assert (caught.value.key, caught.value.names) == ("[data] arm_rate_unit", (unit,))


@pytest.mark.parametrize(
    ("columns", "right", "reversed_column"),
    [
        (("ay", "ax", "az"), '["ay", "ax", "az"]', ""),
        (("az", "ax", "ay"), '["ay", "az", "ax"]', ""),
        (("ax", "-ay", "az"), '["ax", "ay", "az"]', "ay"),
    ],
)
@pytest.mark.parametrize("changes", [(), NORMS])
def test_exchanged_or_reversed_columns_are_named_by_the_known_attitudes(
    columns: tuple[str, ...],
    right: str,
    reversed_column: str,
    changes: tuple[tuple[str, str], ...],
    tmp_path: Path,
):
    path = changed(tmp_path, "lab", *changes)
    comment, head, *rows = (tmp_path / "lab.csv").read_text(encoding="utf-8").splitlines()
    names = head.split(",")
    cells = [dict(zip(names, row.split(","), strict=True)) for row in rows]
    for row in cells:
        # The logger wrote these columns under the names ax, ay and az.
        read = [float(row[one.removeprefix("-")]) * (-1) ** one.startswith("-") for one in columns]
        row |= dict(zip(("ax", "ay", "az"), map(repr, read), strict=True))
    lines = [comment, head, *(",".join(row.values()) for row in cells)]
    (tmp_path / "lab.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        calibrate(path)
    assert (caught.value.key, caught.value.names) == ("[data] accelerometer", (right,))
    _, _, signs = str(caught.value).partition(" and the sign of ")
    assert signs.partition(" ")[0] == reversed_column


@pytest.mark.slow
def test_a_wrong_unit_of_the_rate_is_named_before_dwells_are_sought(tmp_path: Path):
    run = read(changed(tmp_path, "arm_run", ("turns = 10", "turns = 5")))
    write_recording(apply_data_columns(run, simulate(run, 0)), run.file(run.data.file))
    change = ('arm_rate = "rpm"', 'arm_rate = "rpm"\narm_rate_unit = "0.1 rpm"')
    with pytest.raises(InputError) as caught:
        calibrate(changed(tmp_path, "arm_run", change))
    assert (caught.value.key, caught.value.names) == ("[data] arm_rate_unit", ("rpm",))


def test_a_wrong_unit_of_the_readings_is_told_apart_by_gravity(tmp_path: Path):
    scale = ('scale = "0.1 V/g"', 'scale = "0.1 V/(m/s²)"')
    with pytest.raises(InputError) as caught:
        calibrate(changed(tmp_path, "lab", scale))
    assert "[sensor.accelerometer]" in str(caught.value)
    assert "[bench] radius" not in str(caught.value).partition(" give ")[2]


def test_units_that_gravity_cannot_tell_apart_are_both_named(tmp_path: Path):
    path = changed(tmp_path, "lab", ('scale = "0.1 V/g"', 'scale = "0.0001 V/g"'))
    rows = (tmp_path / "lab.csv").read_text(encoding="utf-8").splitlines()
    place = rows[1].split(",").index("rpm")
    fast = max(float(row.split(",")[place]) for row in rows[2:])
    kept = [row for row in rows[2:] if float(row.split(",")[place]) == fast]
    (tmp_path / "lab.csv").write_text("\n".join([*rows[:2], *kept, ""]), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        calibrate(path)
    after = str(caught.value).partition(" give ")[2]
    assert "[sensor.accelerometer]" in after
    assert "[bench] radius" in after


@pytest.mark.slow
def test_coefficients_that_the_attitudes_do_not_show_are_taken_out_of_the_key(tmp_path: Path):
    method = 'name = "centrifuge_norm"'
    with pytest.raises(NotObserved) as caught:
        calibrate(changed(tmp_path, "lab", (method, f'{method}\nalso = ["arm", "k3"]')))
    assert len(caught.value.names) == 4
    advised = re.search(r"also = (\[.*?\])", str(caught.value))
    assert advised is not None
    added = calibrate(changed(tmp_path, "lab", (method, f"{method}\n{advised[0]}"))).calibration
    assert {f"{a}.k3" for a in ("ax", "ay", "az")} < set(added.sensor.coefficients)
    assert sum(".arm_" in name for name in added.sensor.coefficients) == 5
