"""Run files on a turntable whose readback has a file and a clock of its own."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2
from tests.accuracy import turntable as tt
from tests.methods.turntable_cases import truth as drawn_truth
from tests.refusals import refused
from tests.runfile.run_file_texts import changed

from inercal.basics.errors import InputError
from inercal.cli.app import app, main
from inercal.pipeline import apply, calibrate, simulate_files
from inercal.recordings import Recording
from inercal.recordings.io.write import write_recordings
from inercal.runfile import Run, read

EXAMPLE = Path(__file__).parents[2] / "examples" / "turntable"
NPZ = (('"mimu_packets.csv"', '"imu.npz"'), ('"table.csv"', '"table.npz"'))
STEADY = (('clock = "50 ppm"', 'clock = "0 ppm"'),)
LOST = 1e-3  # of the packets
OFFSET, DRIFT = 0.3, 50e-6
Change = tuple[str, str]
Files = dict[str, Recording]


def copy_run(folder: Path, *changes: Change) -> Run:
    text = (EXAMPLE / "two_clocks.toml").read_text(encoding="utf-8")
    shutil.copy(EXAMPLE / "path.csv", folder)
    path = folder / "two_clocks.toml"
    path.write_text(changed(text, *changes), encoding="utf-8")
    return read(path)


def drop_packets(files: Files, seed: int = 0) -> Files:
    """Lose packets, as their counter tells."""
    (name, whole), *others = files.items()
    kept = np.random.default_rng(seed).random(whole.time.size) > LOST
    kept[0] = True
    return {name: whole.take(kept), **dict(others)}


def speed_up_table_clock(files: Files) -> Files:
    """Let the table's clock run fast."""
    table = files["table.npz"]
    return {**files, "table.npz": replace(table, time=table.time * (1 + DRIFT))}


def write_files(run: Run, files: Files) -> Run:
    write_recordings({run.file(name): one for name, one in files.items()})
    return run


def simulate_files_of_run(
    run: Run, seed: int = 0, change: Callable[[Files], Files] = drop_packets
) -> Run:
    return write_files(run, change(simulate_files(run, seed)))


@pytest.fixture(scope="module")
def lossless_files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """Return what the example records, nothing lost."""
    return simulate_files(copy_run(tmp_path_factory.mktemp("plain"), *NPZ))


@pytest.fixture(scope="module")
def text_recording_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the example's recording as text."""
    folder = tmp_path_factory.mktemp("texts")
    simulate_files_of_run(copy_run(folder), change=lambda files: files)
    return folder


@pytest.mark.slow
def test_clock_offset_and_drift_are_estimated_and_reported(tmp_path: Path):
    run = simulate_files_of_run(
        copy_run(tmp_path, *NPZ, *STEADY),
        0,
        lambda files: drop_packets(speed_up_table_clock(files)),
    )
    outcome = calibrate(run)
    (note,) = (line for line in outcome.calibration.notes if "clock" in line)
    words = note.split()
    offset, drift = float(words[4]), float(words[words.index("gains") + 1])
    offset_sd, drift_sd = float(words[6]), float(words[words.index("gains") + 3])
    assert abs(offset - OFFSET * (1 + DRIFT) * 1e3) < 3 * offset_sd < 0.15  # ms
    assert abs(drift - DRIFT * 1e6) < 3 * drift_sd < 1.5  # ppm
    conditions = outcome.calibration.conditions
    assert conditions["table's clock ahead (k = 1)"] in note
    assert conditions["table's clock gains (k = 1)"] in note
    assert "latency of the readback" not in conditions
    assert outcome.calibration.provenance["readback"] == "table.npz"
    assert len(outcome.calibration.provenance["readback sha256"]) == 64


@pytest.mark.slow
def test_lost_packets_are_gaps_that_a_finding_counts(tmp_path: Path, lossless_files: Files):
    sent = lossless_files["imu.npz"].time.size
    outcome = calibrate(write_files(copy_run(tmp_path, *NPZ), drop_packets(lossless_files)))
    assert outcome.recording is not None
    lost = sent - outcome.recording.time.size
    assert lost > 10
    said = [finding.message for finding in outcome.findings if finding.what == "gap"]
    assert any(f": {lost} samples lost, {lost / 100:.3g} s in all" in text for text in said)
    assert not any(finding.what == "slip" for finding in outcome.findings)


@pytest.mark.slow
def test_two_clocks_agree_with_one_clock(tmp_path: Path):
    """Within a part of the uncertainty: the noise of the readback is another, and packets miss."""
    for seed in range(2):
        two = copy_run(tmp_path, *NPZ)
        one = copy_run(
            tmp_path,
            ('"mimu_packets.csv"', '"one.npz"'),
            ('time = "packet"', 'time = "time"'),
            ('time_unit = "sample"\n', ""),
            ("counter_modulus = 256\n", ""),
            ('table_file = "table.csv"\n', ""),
            ('table_time = "time"\n', ""),
            ('latency = "0.3 s ± 0"', 'latency = "0 ms ± 5 ms"'),
            ('clock = "50 ppm"', 'clock = "0 ppm"'),
        )
        made = calibrate(simulate_files_of_run(two, seed)).calibration
        same = calibrate(simulate_files_of_run(one, seed, lambda files: files)).calibration
        np.testing.assert_allclose(made.std, same.std, rtol=0.01)
        apart = (made.values - same.values) / same.std
        assert np.sqrt(np.mean(apart**2)) < 0.3


DENSE = 10
PATH = [("warm-up", (0, 0, 0), 30.0), *tt.positions(10), *tt.turns(1080, 30, back=True)]
UNITS = (
    ('unit = "g"', 'unit = "m/s²"'),
    ('unit = "°/s"', 'unit = "rad/s"'),
    ('path = "path.csv"', ""),
    ('harmonics = ["2 ″", "1 ″"]', "harmonics = []"),
    ('"9.80123 m/s² ± 10 µm/s²"', '"9.80665 m/s²"'),
    ("table = [", 'table_unit = "rad"\ntable = ['),
)


def generate_run(seed: int) -> tuple[tt.Draw, Files]:
    """Return a run of the independent generator, the table by a clock of its own."""
    grade = replace(tt.T, arw=tt.T.arw / DENSE**0.5, vrw=tt.T.vrw / DENSE**0.5)
    table = replace(tt.Table(), harmonics=(0.0, 0.0), white=0.0, latency=0.0)
    made = tt.draw(seed, 1, PATH, grade, table, hz=DENSE * 100.0)
    reading = np.concatenate([made.forces[0], made.rates[0]], axis=-1)[::DENSE]
    names = ("ax", "ay", "az", "gx", "gy", "gz")
    units = ("m/s²",) * 3 + ("rad/s",) * 3
    count = np.array([float(k % 256) for k in range(len(reading))])
    stamps = np.array(range(-50, round(100 * made.time[-1]) + 100)) / 100
    t = (stamps - OFFSET) / (1 + DRIFT)
    angles = np.stack([np.interp(t, made.time, one) for one in made.true.T], axis=-1)
    angles += tt.Table().white * np.random.default_rng(seed).standard_normal(angles.shape)
    axes = ("outer", "middle", "inner")
    imu = Recording(count, reading, names, units, made.labels[::DENSE], time_name="packet")
    return made, {
        "imu.npz": replace(imu, label_name="step"),
        "table.npz": Recording(stamps, angles, axes, ("rad",) * 3),
    }


@pytest.mark.slow
def test_of_an_independent_generator_errors_are_as_large_as_stated(tmp_path: Path):
    run, seeds = copy_run(tmp_path, *NPZ, *UNITS), range(1, 4)
    total = 0.0
    for seed in seeds:
        made, files = generate_run(seed)
        write_recordings({run.file(name): one for name, one in drop_packets(files, seed).items()})
        found = calibrate(run).calibration
        error = found.values - drawn_truth(made, found.sensor.coefficients)[0]
        total += error @ np.linalg.solve(found.covariance, error)
    freedom = 24 * len(seeds)
    assert chi2.ppf(1e-3, freedom) < total < chi2.ppf(1 - 1e-3, freedom)


@pytest.mark.slow
def test_without_labels_the_plan_names_the_steps(tmp_path: Path):
    run = simulate_files_of_run(copy_run(tmp_path, *NPZ, ('label = "step"\n', "")))
    labels = calibrate(run).observations.labels
    assert labels == tuple(step.label for step in run.steps)


@pytest.mark.slow
def test_a_calibration_corrects_the_recording_alone(tmp_path: Path, lossless_files: Files):
    run = write_files(copy_run(tmp_path, *NPZ), drop_packets(lossless_files))
    corrected = apply(calibrate(run).calibration, run)
    assert np.linalg.norm(corrected.data[500:2500, :3].mean(axis=0)) == pytest.approx(9.8, abs=2e-3)
    assert not corrected.readback


@pytest.mark.slow
def test_clocks_far_apart_need_their_offset_stated(tmp_path: Path):
    """Sensors count from when they are switched on, tables from a midnight."""

    def at_noon(files: Files) -> Files:
        table = files["table.npz"]
        return {**files, "table.npz": replace(table, time=table.time + 43_200e3)}

    unit = ('table_time = "time"', 'table_time = "time"\ntable_time_unit = "ms"')
    run = simulate_files_of_run(copy_run(tmp_path, *NPZ, unit), 0, at_noon)
    refused_run(run, "43199.8 s to 43436.8 s", names=("[bench] latency",))
    stated = ('latency = "0.3 s ± 0"', 'latency = "43200 s"')
    assert any(
        "43200.3" in line
        for line in calibrate(copy_run(tmp_path, *NPZ, unit, stated)).calibration.notes
    )


def refused_run(run: Run, mention: str = "", **data: Any) -> None:
    """Expect a refusal of the readback's file, with this data, that mentions a value."""
    with refused(**data) as refusal:
        calibrate(run)
    assert str(refusal.value).isprintable()
    assert str(refusal.value).startswith(f"{run.path}: [data] table_file: ")
    assert refusal.value.key == "[data] table_file"
    assert mention in str(refusal.value)


def change_table_file(change: Callable[[Recording], Recording]) -> Callable[[Files], Files]:
    return lambda files: {**files, "table.npz": change(files["table.npz"])}


def set_value(name: str, at: int, value: float) -> Callable[[Recording], Recording]:
    def change(table: Recording) -> Recording:
        time, data = table.time.copy(), table.data.copy()
        place = time if name == "time" else data[:, table.channels.index(name)]
        place[at] = value
        return replace(table, time=time, data=data)

    return change


def remove_rows(first: float, last: float) -> Callable[[Recording], Recording]:
    return lambda table: table.take((table.time < first) | (table.time > last))


@pytest.mark.parametrize(
    ("change", "mention", "names"),
    [
        (set_value("time", 700, 1.0), "sample 700", None),
        (set_value("time", 700, np.nan), "sample 700", None),
        (set_value("inner", 700, np.inf), "inner at sample 700", None),
        (remove_rows(150.0, 151.0), "1.02 s", ()),
        (remove_rows(150.0, 1e9), "-0.2 s to 149.99 s", ("[bench] latency",)),
        (lambda table: replace(table, time=table.time - 120), "", ("[bench] latency",)),
        (
            lambda table: replace(table, time=table.time[0] + 2 * (table.time - table.time[0])),
            "±1 s",
            (),
        ),
        (lambda table: replace(table, data=table.data[::-1]), "±1 s", ()),
        (lambda table: table.take(slice(None, None, 10)), "10 readings", ()),
        (lambda table: table.take(slice(10)), "10 samples", ("the readback's time",)),
    ],
    ids=["back", "nan", "inf", "gap", "short", "late", "half", "reversed", "slow", "few"],
)
def test_a_readback_of_another_motion_or_time_is_refused(
    tmp_path: Path,
    lossless_files: Files,
    change: Callable[[Recording], Recording],
    mention: str,
    names: tuple[str, ...] | None,
):
    run = write_files(copy_run(tmp_path, *NPZ), change_table_file(change)(lossless_files))
    data = {} if names is None else {"file": "table.npz", "names": names}
    refused_run(run, mention, **data)


@pytest.mark.parametrize(
    ("change", "data"),
    [
        (lambda table: replace(table, data=0 * table.data), {"key": "[data] table"}),
        (lambda table: replace(table, data=np.radians(table.data)), {"key": "[data] table_unit"}),
        (
            lambda table: replace(table, data=table.data[:, [1, 0, 2]]),
            {"names": ('[data] table = ["middle", "outer", "inner"]',)},
        ),
        (
            lambda table: replace(table, data=-table.data),
            {"names": ('[data] table = ["-outer", "-middle", "-inner"]',)},
        ),
    ],
    ids=["still", "rad", "exchanged", "reversed"],
)
def test_columns_and_units_of_the_readback_are_named_as_in_one_file(
    tmp_path: Path,
    lossless_files: Files,
    change: Callable[[Recording], Recording],
    data: dict[str, Any],
):
    run = write_files(copy_run(tmp_path, *NPZ), change_table_file(change)(lossless_files))
    with refused(**data):
        calibrate(run)


@pytest.mark.slow
def test_a_file_of_the_readback_that_cannot_be_read_is_refused(tmp_path: Path):
    run = simulate_files_of_run(copy_run(tmp_path, NPZ[0]))
    table = run.file("table.csv")
    whole = table.read_bytes()
    table.write_bytes(whole[: whole.rindex(b",", 0, len(whole) // 2)])
    refused_run(run, "table.csv line ")
    table.write_bytes(b"")
    refused_run(run, "table.csv")
    table.unlink()
    refused_run(run, "table.csv")


@pytest.mark.parametrize(
    ("old", "new", "mention"),
    [
        ('"middle", "inner"]', '"middle"]', "[data] table"),
        ('"middle", "inner"]', '"middle", "tilt"]', "'tilt'"),
        ('"middle", "inner"]', '"middle", "time"]', "'time'"),
        ('table_file = "table.csv"\n', "", "table_file"),
        ('table_time = "time"\n', "", "table_time"),
        ('table_time = "time"', 'table_time = "clock"', "'clock'"),
        ('table_time = "time"', 'table_time = "time"\ntable_time_unit = "sample"', "_time_unit"),
        ("_modulus = 256", "_modulus = 2", "counter_modulus"),
        ("_modulus = 256", "_modulus = 200", "sample 200"),
        ("_modulus = 256", "_modulus = 65536", "65536"),
        ('time_unit = "sample"\n', "", "time_unit"),
        ('rate = "100 Hz"\n', "", "[data] rate"),
    ],
)
def test_run_files_that_cannot_be_are_refused(
    text_recording_folder: Path, old: str, new: str, mention: str
):
    with pytest.raises(InputError) as refusal:
        calibrate(copy_run(text_recording_folder, (old, new)))
    assert str(refusal.value).isprintable()
    assert mention in str(refusal.value)


@pytest.mark.parametrize("order", [[0, 1, 2, 2, 3], [0, 1, 3, 2, 4]], ids=["twice", "out of order"])
def test_packets_twice_or_out_of_order_are_refused(
    tmp_path: Path, lossless_files: Files, order: list[int]
):
    imu = lossless_files["imu.npz"]
    shuffled = {**lossless_files, "imu.npz": imu.take(np.r_[order, 5 : imu.time.size])}
    run = write_files(copy_run(tmp_path, *NPZ), shuffled)
    with pytest.raises(InputError) as refusal:
        calibrate(run)
    assert "imu.npz: counter" in str(refusal.value)


@pytest.mark.slow
def test_the_verbs_go_from_two_files_to_a_calibration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    run = copy_run(tmp_path)

    def said(*words: str) -> str:
        app(list(words), standalone_mode=False)
        return capsys.readouterr().out

    made = json.loads(said("simulate", str(run.path), "--json"))
    assert made["recording"] == str(tmp_path / "mimu_packets.csv")
    assert made["readback"] == str(tmp_path / "table.csv")
    assert made["seconds"] == pytest.approx((made["samples"] - 1) / 100)
    head = (tmp_path / "mimu_packets.csv").read_text(encoding="utf-8").splitlines()[1]
    assert head == "packet,ax,ay,az,gx,gy,gz,step"
    assert "ahead of the sensor's" in said(
        "calibrate", str(run.path), "--out", str(tmp_path), "--explain", "--no-report"
    )
    (tmp_path / "mimu_packets.csv").unlink()
    with pytest.raises(InputError):
        said("simulate", str(run.path))
    assert not (tmp_path / "mimu_packets.csv").exists()
    (tmp_path / "table.csv").unlink()
    (tmp_path / "table.csv").mkdir()
    with pytest.raises(InputError):
        said("simulate", str(run.path), "--force")
    assert not (tmp_path / "mimu_packets.csv").exists()
    monkeypatch.setattr("sys.argv", ["inercal", "calibrate", str(run.path)])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
