"""The main path end to end in Python: simulate, write, calibrate, apply."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused
from tests.runfile.run_file_texts import FERRARIS, SIX_POSITIONS, run_file

from inercal.basics.errors import InputError, NotObserved
from inercal.benches import Hand
from inercal.benches.hand.reading import nominal_plan
from inercal.benches.hand.simulation import simulate_hand_motion
from inercal.physics.sensors import G0
from inercal.pipeline import Outcome, apply, apply_data_columns, calibrate, simulate
from inercal.pipeline.correction import as_written
from inercal.pipeline.run_calibration import calibrate_run, observed
from inercal.recordings import Finding, Recording
from inercal.recordings.io.write import write_recording
from inercal.runfile import Run, read


def recorded(folder: Path, text: str, *changes: tuple[str, str], seed: int = 1) -> Run:
    """Write a run file and the recording that it names."""
    run = read(run_file(folder, text, *changes))
    write_recording(apply_data_columns(run, simulate(run, seed)), run.file(run.data.file))
    return run


def errors(outcome: Outcome, run: Run) -> np.ndarray:
    """Return the errors over their stated standard uncertainties."""
    names = outcome.calibration.sensor.coefficients
    truth = np.array([run.truth.get(name, 0.0) for name in names])
    return (outcome.calibration.values - truth) / outcome.calibration.std


@pytest.mark.parametrize("text", [FERRARIS, SIX_POSITIONS], ids=["ferraris", "six positions"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_simulated_truth_is_estimated_within_its_uncertainty(
    tmp_path: Path, text: str, seed: int
):
    run = recorded(tmp_path, text, seed=seed)
    outcome = calibrate(run)
    assert np.abs(errors(outcome, run)).max() < 4.5
    assert outcome.calibration.method == run.method.name
    assert [mark.label for mark in outcome.marks] == [step.label for step in run.steps]
    assert outcome.recording is not None
    assert outcome.calibration.provenance["recording sha256"] == outcome.recording.sha256


@pytest.mark.parametrize("suffix", ["csv", "npz"])
@pytest.mark.parametrize("marks", ["found", "labels"])
def test_marks_from_the_signal_and_from_a_column_give_one_answer(
    tmp_path: Path, suffix: str, marks: str
):
    changes = [('"log.csv"', f'"log.{suffix}"')]
    if marks == "labels":
        changes.append(('marks = "found"', 'marks = "labels"\nlabel = "label"'))
    run = recorded(tmp_path, FERRARIS, *changes)
    assert np.abs(errors(calibrate(run), run)).max() < 4.5


def test_marks_from_a_file_are_those_used(tmp_path: Path):
    run = recorded(tmp_path, FERRARIS, ('marks = "found"', 'marks = "marks.csv"'))
    labels = simulate(run, 1).labels
    assert labels is not None
    rows = ["label,start,end"]
    for step in run.steps:
        inside = np.flatnonzero(labels == step.label)
        rows.append(f"{step.label},{inside[0] + 10},{inside[-1] + 1}")
    (tmp_path / "marks.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    outcome = calibrate(run)
    marks = [f"{m.label},{m.start},{m.stop}" for m in outcome.marks]
    assert sorted(marks) == sorted(rows[1:])
    assert np.abs(errors(outcome, run)).max() < 4.5


def test_columns_are_named_by_header_or_by_number(tmp_path: Path):
    named = recorded(
        tmp_path,
        FERRARIS,
        ('file = "log.csv"', 'file = "log.csv"\naccelerometer = ["a", "b", "c"]'),
    )
    _, header, *lines = (tmp_path / "log.csv").read_text(encoding="utf-8").splitlines()
    assert header == "time,a,b,c,gyr_x,gyr_y,gyr_z,label"
    expected = calibrate(named).calibration.values
    # The same file without its header: columns are counted from 1.
    bare = [line.rpartition(",")[0] for line in lines]
    (tmp_path / "log.csv").write_text("\n".join(bare) + "\n", encoding="utf-8")
    numbered = run_file(
        tmp_path,
        FERRARIS,
        ('time = "time"', "time = 1"),
        ('file = "log.csv"', 'file = "log.csv"\naccelerometer = [2, 3, 4]\ngyro = [5, 6, 7]'),
    )
    assert calibrate(numbered).calibration.values == pytest.approx(expected, rel=1e-12)


def test_a_corrected_recording_is_close_to_the_true_motion(tmp_path: Path):
    changes = (
        ('tilt = "0.3 °"\nturn_a', 'tilt = "2 ″"\nturn_a'),
        ('turn_tilt = "0.3 °"', 'turn_tilt = "2 ″"'),
        ('turn_angle = "0.5 °"', 'turn_angle = "10 ″"'),
        ('latitude = "47 °"', 'latitude = "47 ° ± 0.001 °"'),
        ('"100 µg/√Hz"', '"1 µg/√Hz"'),
        ('"0.3 °/√h"', '"0.001 °/√h"'),
        ('bias_instability = "8 °/h"\n', ""),
        ('marks = "found"', 'marks = "labels"\nlabel = "label"'),
    )
    run = recorded(tmp_path, FERRARIS, *changes)
    corrected = apply(calibrate(run).calibration, run)
    # The bench's errors are the first that a simulation draws from its seed.
    assert run.rate_hz is not None
    assert isinstance(run.bench, Hand)
    true = simulate_hand_motion(
        run.bench, nominal_plan(run), run.rate_hz, np.random.default_rng(1)
    ).motion
    assert corrected.channels == ("fx", "fy", "fz", "wx", "wy", "wz")
    assert corrected.units == ("m/s²",) * 3 + ("rad/s",) * 3
    assert np.abs(corrected.data[:, :3] - true.f[0]).max() < 1e-3  # m/s²; 0.3 before
    assert np.abs(corrected.data[:, 3:] - true.w[0]).max() < 3e-4  # rad/s; 0.03 before


@pytest.mark.parametrize(("unit", "shown"), [("°C", 34.2), ("K", 307.35)])
def test_a_written_correction_has_few_digits_and_the_temperature_its_unit(
    tmp_path: Path, unit: str, shown: float
):
    run = recorded(tmp_path, SIX_POSITIONS)
    run = replace(run, data=run.data.model_copy(update={"temperature_unit": unit}))
    rng = np.random.default_rng(3)
    data = rng.normal(0, 9.8, (50, 3))
    data[3, 1], data[4, 1] = 0.0, 1e-30
    made = Recording(
        np.linspace(481.233, 482.213, 50),
        data,
        ("fx", "fy", "fz"),
        ("m/s²",) * 3,
        temperature=np.full(50, 34.2 + 273.15),
    )
    for suffix in ("csv", "npz"):
        written = as_written(made, run, text=suffix == "csv")
        write_recording(written, tmp_path / f"out.{suffix}")
        assert written.readback[f"temperature [{unit}]"][0] == shown
        np.testing.assert_allclose(written.data, made.data, rtol=1e-8)
        np.testing.assert_allclose(written.time, made.time, rtol=0, atol=1e-6)
        assert np.array_equal(written.data, made.data) == (suffix == "npz")
    head, *rows = (tmp_path / "out.csv").read_text(encoding="utf-8").splitlines()
    assert head == f"time,fx,fy,fz,temperature [{unit}]"
    assert max(len(cell) for row in rows for cell in row.split(",")) <= len("-0.0123456789e-30")
    assert max(len(row) for row in rows) <= 60


def test_a_calibration_of_other_units_is_not_applied(tmp_path: Path):
    run = recorded(tmp_path, SIX_POSITIONS)
    known = calibrate(run).calibration
    other = run_file(tmp_path, SIX_POSITIONS, ('unit = "g"', 'unit = "m/s²"'))
    (tmp_path / "log.csv").unlink()
    run = read(other)
    write_recording(apply_data_columns(run, simulate(run, 1)), run.file(run.data.file))
    with refused(InputError) as refusal:
        apply(known, run)
    assert "channel ax" in str(refusal.value)


def test_one_seed_gives_one_recording_and_trials_are_independent(tmp_path: Path):
    run = read(run_file(tmp_path, FERRARIS))
    first, again = simulate(run, 3), simulate(run, 3)
    assert np.array_equal(first.data, again.data)
    many = simulate(run, 3, trials=3)
    assert many.data.shape == (3, *first.data.shape)
    assert not np.array_equal(many.data[0], many.data[1])
    with refused(InputError):
        write_recording(many, tmp_path / "many.npz")


def test_a_simulation_without_a_rate_is_refused(tmp_path: Path):
    path = run_file(tmp_path, FERRARIS, ('rate = "50 Hz"\n', ""))
    with refused(InputError, file=path, key="[data] rate"):
        simulate(path)


def test_a_truth_beyond_the_method_is_simulated_and_shows_as_misfit(tmp_path: Path):
    # K₂ of 5 mg/g² is not part of the six-position model: up and down no longer agree.
    k2 = ('"ax.k0" = "32 mg"', '"ax.k0" = "32 mg"\n"ax.k2" = "5 mg/g²"')
    run = recorded(tmp_path, SIX_POSITIONS, k2, ('tilt = "0.3 °"', 'tilt = "0.01 °"'))
    outcome = calibrate(run)
    assert not outcome.estimate.consistent
    assert "the residuals are" in outcome.verdict.lines[0]


def recording_without_sections(run: Run, *labels: str) -> Recording:
    """Return the run's recording with some of its sections cut out, time going on."""
    made = simulate(run, 1)
    assert made.labels is not None
    cut = apply_data_columns(run, made.take(~np.isin(made.labels, labels)))
    return replace(cut, time=np.arange(cut.time.size) / 50.0)


@pytest.mark.parametrize(
    ("missing", "names"),
    [
        (["z_a"], ["az.k0", "az.k1"]),
        (["z_p", "z_a"], ["ax.delta_p", "ay.delta_o", "az.k1"]),
        (["y_p", "z_p"], ["ay.k0", "ay.k1", "az.k0", "az.k1"]),
    ],
)
def test_positions_that_are_missing_leave_coefficients_not_observed_by_name(
    tmp_path: Path, missing: list[str], names: list[str]
):
    labels = ('time = "time"', 'time = "time"\nmarks = "labels"\nlabel = "label"')
    run = read(run_file(tmp_path, SIX_POSITIONS, labels))
    write_recording(recording_without_sections(run, *missing), run.file(run.data.file))
    with refused(NotObserved, file=run.path) as refusal:
        calibrate(run)
    message = str(refusal.value)
    assert all(name in message for name in (*names, *missing)), message
    assert "\n" not in message


def test_a_refusal_begins_with_flaws_of_the_readings(tmp_path: Path):
    labels = ('time = "time"', 'time = "time"\nmarks = "labels"\nlabel = "label"')
    run = read(run_file(tmp_path, SIX_POSITIONS, labels))
    write_recording(recording_without_sections(run, "z_a"), run.file(run.data.file))
    seen = observed(run)
    flaws = (
        Finding("warning", "stuck", "ay stays at 1 in samples 8 to 9", "ay", 8, 10),
        Finding("warning", "moving", "rest y_a is not still", None, 20, 30),
        Finding("warning", "rests", "rest x_a is not used", None, 40, 50),
        Finding("warning", "missing", "no rest near 12 s", None, 60, 70),
    )
    seen = seen._replace(inputs=replace(seen.inputs, findings=(*seen.inputs.findings, *flaws)))
    with refused(NotObserved, file=run.path) as refusal:
        calibrate_run(run, seen=seen)
    message = str(refusal.value)
    assert message.index("samples 8 to 9") < message.index("az.k0")
    assert all(flaw.message in message for flaw in flaws)


def test_a_turn_that_is_missing_is_not_observed_by_name(tmp_path: Path):
    labels = ('marks = "found"', 'marks = "labels"\nlabel = "label"')
    run = read(run_file(tmp_path, FERRARIS, labels))
    write_recording(recording_without_sections(run, "z_rot"), run.file(run.data.file))
    with refused(NotObserved, file=run.path) as refusal:
        calibrate(run)
    assert "gz.scale" in str(refusal.value)
    assert "z_rot" in str(refusal.value)


def test_a_prior_supplies_the_coefficients_that_the_positions_do_not_observe(tmp_path: Path):
    labels = ('time = "time"', 'time = "time"\nmarks = "labels"\nlabel = "label"')
    prior = '\n[method.prior]\n"az.k0" = "0 mg ± 1 mg"\n'
    run = read(run_file(tmp_path, SIX_POSITIONS + prior, labels))
    write_recording(recording_without_sections(run, "z_a"), run.file(run.data.file))
    found = calibrate(run).calibration
    # The four faces with z level know the bias to half their tilt of 0.3°: 2.6 mg.
    level = 9.81 * np.radians(0.3) / 2
    expected = (1 / (1e-3 * G0) ** 2 + 1 / level**2) ** -0.5
    assert found.uncertainty("az.k0") == pytest.approx(expected, rel=0.02)
    # The drift that the slopes leave open adds some per cent.
    assert found.uncertainty("az.k1") == pytest.approx(expected / 9.81, rel=0.05)
    assert found.uncertainty("ax.k0") < 3e-4 * G0


MEANS = """\
position,acc_x,acc_y,acc_z
x_p,1.0300,0.0040,-0.0030
x_a,-0.9680,0.0010,0.0020
y_p,0.0310,0.9950,0.0000
y_a,0.0330,-0.9950,0.0000
z_p,0.0300,0.0000,1.0010
z_a,0.0330,0.0000,-1.0000
"""
OF_MEANS = (
    ('time = "time"\n', 'kind = "means"\nlabel = "position"\nsd = { accelerometer = "0.1 mg" }\n'),
    ('gravity = "9.81 m/s² ± 0.2 mm/s²"', 'gravity = "9.80665 m/s²"'),
    ('white = "100 µg/√Hz"\n', ""),
)


def test_means_typed_by_hand_are_calibrated_without_a_recording(tmp_path: Path):
    (tmp_path / "log.csv").write_text(MEANS, encoding="utf-8")
    outcome = calibrate(run_file(tmp_path, SIX_POSITIONS, *OF_MEANS))
    found = outcome.calibration
    assert outcome.recording is None
    # Half the sum and half the difference of up and down; half a degree adds 40 ppm at most.
    assert found.value("ax.k0") / G0 == pytest.approx((1.03 - 0.968) / 2, abs=2e-4)
    assert found.value("ax.k1") == pytest.approx((1.03 + 0.968) / 2 - 1, abs=2e-4)
    assert found.value("az.k0") / G0 == pytest.approx(0.0005, abs=2e-4)


@pytest.mark.parametrize(
    ("old", "new", "wrong"),
    [
        ("y_a,0.0330", "y_p,0.0330", "y_p"),
        ("y_a,0.0330", "w_a,0.0330", "w_a"),
        ("acc_z\n", "az\n", "acc_z"),
        ("-1.0000", "nan", "acc_z"),
        ("-1.0000", "low", "acc_z"),
    ],
)
def test_a_table_of_means_that_cannot_be_used_is_refused(
    tmp_path: Path, old: str, new: str, wrong: str
):
    assert MEANS.count(old) == 1
    (tmp_path / "log.csv").write_text(MEANS.replace(old, new), encoding="utf-8")
    with refused(InputError) as refusal:
        calibrate(run_file(tmp_path, SIX_POSITIONS, *OF_MEANS))
    message = str(refusal.value)
    assert "log.csv" in message
    assert f"'{wrong}'" in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("cell", "what"), [("", "empty"), ("inf", "too large"), ("1e300", "1e+300")]
)
def test_a_mean_that_cannot_be_used_is_called_what_it_is(tmp_path: Path, cell: str, what: str):
    (tmp_path / "log.csv").write_text(MEANS.replace("-1.0000", cell), encoding="utf-8")
    with refused(InputError, names=("acc_z",)) as refusal:
        calibrate(run_file(tmp_path, SIX_POSITIONS, *OF_MEANS))
    said = str(refusal.value).partition("'acc_z'")[2]
    assert what in said
    assert ("too large" in said) != ("empty" in said)


def test_means_without_a_stated_deviation_are_refused(tmp_path: Path):
    (tmp_path / "log.csv").write_text(MEANS, encoding="utf-8")
    changes = (
        ('time = "time"\n', 'kind = "means"\nlabel = "position"\n'),
        *OF_MEANS[1:],
    )
    with refused(InputError) as refusal:
        calibrate(run_file(tmp_path, SIX_POSITIONS, *changes))
    assert "[data.sd] accelerometer" in str(refusal.value)


def test_the_grade_does_not_depend_on_whether_advice_is_tried():
    run = read(Path(__file__).parents[2] / "examples" / "verdict" / "left_out.toml")
    tried, plain = (calibrate_run(run, advise=advise).verdict for advise in (True, False))
    assert (plain.grade, plain.reasons, plain.word) == (tried.grade, tried.reasons, tried.word)
    assert plain.suspect is not None
    assert tried.suspect is not None
    assert plain.suspect.name == tried.suspect.name
    assert [one.chi2 for one in plain.advice] != [one.chi2 for one in tried.advice]


SIX_FACES = """
[sensor]
name = "imu"
[sensor.accelerometer]
unit = "m/s²"
bias_instability = "1 µg"
[bench]
gravity = "9.81 m/s² ± 0.1 mm/s²"
tilt = "0.3 °"
[data]
file = "faces.csv"
rate = "10 Hz"
accelerometer = ["ax", "ay", "az"]
label = "label"
marks = "labels"
[method]
name = "six_position"
"""


def six_faces(folder: Path, *labels: str) -> Outcome:
    """Calibrate from level rests whose labels begin with the face."""
    rng = np.random.default_rng(3)
    rows = ["ax,ay,az,label"]
    for label in labels:
        k, sign = "xyz".index(label[0]), 1 if label[2] == "p" else -1
        force = 9.81 * sign * np.eye(3)[k]
        for values in force + 1e-3 * rng.standard_normal((100, 3)):
            rows.append(",".join(f"{x:.6f}" for x in values) + f",{label}")
    (folder / "faces.csv").write_text("\n".join(rows))
    (folder / "faces.toml").write_text(SIX_FACES)
    return calibrate(folder / "faces.toml")


FACES = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")


def test_a_label_that_resembles_a_step_warns_and_another_one_does_not(tmp_path: Path):
    found = six_faces(tmp_path, *FACES, "y_p2")
    assert "label" in found.verdict.warned
    assert any("y_p2" in line for line in found.verdict)
    assert "label" not in six_faces(tmp_path, *FACES).verdict.warned


def test_visits_that_agree_better_than_their_tilts_do_not_make_u_too_large(tmp_path: Path):
    again = [f"{face} ({visit})" for visit in (2, 3) for face in FACES]
    found = six_faces(tmp_path, *FACES, *again)
    (noise,) = found.verdict.noise
    assert noise.what == "shared tilts"
    assert noise.factor > 1
