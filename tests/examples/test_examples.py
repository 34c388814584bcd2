"""Every example runs, and gives what the pages say of it."""

import ast
import json
import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.base_seeds import slow
from tests.refusals import refused

import inercal
from inercal.host.bench_run import BenchRun
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.preparation import precompile_run
from inercal.host.run_execution import finish_run
from inercal.host.run_folder import create_run
from inercal.pipeline import Outcome, calibrate, simulate_files
from inercal.recordings.io.write import write_recordings
from inercal.runfile import read

ROOT = Path(__file__).parents[2]
SESSIONS = ("session_a", "session_b")
# Values that imucal 2.6.0 gives for these recordings, from its K and R matrices, in SI.
ARCSEC = np.pi / 648_000
IMUCAL = {
    "session_a": {
        "ax.k0": 0.537117424,
        "ay.k0": -0.616202993,
        "az.k0": 0.398867342,
        "ax.k1": 0.996745865 * 0.999862 - 1,
        "az.k1": 1.023395348 * 0.999909 - 1,
        "ax.delta_o": 0.996745865 * -0.0148306,
        "gx.scale": 1.027924326 * 0.999979 - 1,
        "gx.bias": np.radians(-0.599668630),
    },
    "session_b": {
        "ax.k1": 208.545673 * 0.9999125 * 9.80665 / 2048 - 1,
        "ay.k0": -48.287874 * 9.80665 / 2048,
        "az.delta_p": 214.784554 * 9.80665 / 2048 * 0.0107818795,
        "gx.scale": 16.677696 * 0.9999144 / 16.4 - 1,
    },
}


@pytest.fixture
def examples(tmp_path: Path) -> Path:
    """Copy of the examples, so that what they write stays out of the repository."""
    return Path(shutil.copytree(ROOT / "examples", tmp_path / "examples"))


def session(name: str, folder: Path, data_dir: Path, more: str = "") -> Outcome:
    """Calibrate a recorded session by a copy of its run file, the folder of its data replaced."""
    run_file = folder / f"{name}.toml"
    example = ROOT / "examples" / "ferraris_recordings" / f"{name}.toml"
    text = example.read_text(encoding="utf-8")
    assert "../../../shared/data" in text
    data = str(data_dir).replace("\\", "/")
    run_file.write_text(text.replace("../../../shared/data", data) + more, encoding="utf-8")
    return calibrate(run_file)


def test_every_run_file_of_the_examples_is_run_by_a_test():
    found = {
        str(path.relative_to(ROOT / "examples"))
        for path in ROOT.glob("examples/**/*.toml")
        if path.name != "pyproject.toml"
    }
    run = {"six_position/run.toml", "ferraris_simulated/run.toml", "hand_held/simulated.toml"}
    run |= {f"hand_held/{name}.toml" for name in ("xsens", "mpu9150")}  # by tests/accuracy
    run |= {"six_position/archive.toml"}
    run |= {"six_position/job.toml", "six_position/lab.toml"}  # by tests/runfile/test_job.py
    run |= {"certificate/run.toml", "certificate/lab.toml"}  # by tests/certificate
    run |= {"six_position/specification.toml"}  # by tests/runfile/test_specification_section.py
    run |= {f"temperature/{name}.toml" for name in ("soaks", "ramp")}
    run |= {"six_position/soaks.toml"}  # by tests/runs/test_temperature_runs.py
    # by tests/runs/test_centrifuge_runs.py
    run |= {f"centrifuge/{name}.toml" for name in ("printed", "corrected", "lab", "arm_run")}
    # by tests/runs/test_dividing_head_runs.py
    # by tests/runs/test_rate_platform_runs.py
    run |= {f"rate_platform/{name}.toml" for name in ("gyros", "imu")}
    # by tests/repeatability/test_next_use_conformity.py
    run |= {f"repeat/session_{n}.toml" for n in range(1, 5)}
    # by tests/type_prior/test_prior_runs.py
    run |= {
        f"prior/{name}.toml" for name in ("pair", "QA.prior", *(f"QA_{n}" for n in range(21, 26)))
    }
    # by tests/qualification/test_qualified_runs.py
    run |= {f"qualify/{name}.toml" for name in ("gravity", "head", "radius", "rate", "tumble")}
    run |= {"check_standard/job.toml"}  # by tests/check_standard/test_control_example.py
    run |= {"fleet/run.toml"}  # by tests/fleet/test_fleet_commands.py
    run |= {"noise/data_sheet.toml"}  # by tests/noise/test_data_sheet.py
    run |= {"measure/plate.toml"}  # by tests/host/test_guided_example.py
    run |= {"measure/head.toml"}  # by tests/host/test_visa_measurement.py
    run |= {"rate_table/ship.toml"}  # by tests/runs/test_rate_table_runs.py
    run |= {"rate_table/ship_bench.toml"}  # by tests/host/test_ship_run.py
    run |= {"rate_table/ship_recording.toml"}  # by tests/runs/test_rate_table_simulated.py
    run |= {f"turntable/{name}.toml" for name in ("mimu", "two_clocks", "filter_keys")}
    run |= {"turntable/soaks.toml"}  # by tests/host/test_soak_runs.py
    run |= {"systematic/imu.toml"}
    run |= {"bench/packets.toml"}  # by tests/host/packets/test_how_to_page.py
    run |= {"bench/plan.toml", "verdict/left_out.toml"}
    run |= {"magnetometer/nine_axes.toml", "magnetometer/motion.toml"}
    run |= {"live/imu.toml"}  # by tests/examples/test_live_example.py
    run |= {"verdict/auto.toml"}  # by tests/runs/test_added_coefficients.py
    run |= {"own_bench/tilt.toml"}  # by tests/benches/test_external_kind.py
    run |= {"one_axis_arm/arm.toml"}  # by tests/examples/test_one_axis_arm.py
    # by tests/runs/test_log_runs.py
    run |= {f"logs/{path.name}" for path in (ROOT / "examples" / "logs").glob("*.toml")}
    run |= {f"single_axis/{name}.toml" for name in ("record_player", "cluster")}
    run |= {f"dividing_head/{name}.toml" for name in ("pair", "lab", "tumble")}
    # by tests/runs/test_characteristic_runs.py
    run |= {"rate_platform/small_rates.toml", "dividing_head/small_tilts.toml"}
    assert found == run | {f"ferraris_recordings/{name}.toml" for name in SESSIONS}


def test_six_positions_from_a_table_of_means_agree_with_its_half_sums(examples: Path):
    outcome = calibrate(examples / "six_position" / "run.toml")
    assert outcome.estimate.consistent
    bias = (1.00545 - 0.99708) / 2 * 9.80665
    assert outcome.calibration.value("ax.k0") == pytest.approx(bias, abs=1e-5 * 9.80665)


@pytest.mark.slow
def test_a_compressed_recording_is_calibrated_within_the_limit_that_its_run_file_states(
    examples: Path,
):
    path = examples / "six_position" / "archive.toml"
    run = read(path)
    write_recordings({run.file(name): made for name, made in simulate_files(run).items()})
    calibration = calibrate(path).calibration
    sd = dict(zip(calibration.sensor.coefficients, calibration.std, strict=True))["ay.k1"]
    assert calibration.value("ay.k1") == pytest.approx(-0.004, abs=4 * sd)
    text = path.read_text("utf-8")
    path.write_text(text.replace("most_values = 100_000", "most_values = 20_000"), "utf-8")
    with refused(key="[data] most_values"):
        calibrate(path)


@pytest.mark.evidence  # `inercal demo` carries out a like plan in make slow
def test_the_plan_of_the_bench_is_carried_out_on_a_simulated_one(examples: Path, tmp_path: Path):
    run = read(examples / "bench" / "plan.toml")
    with BenchSimulator(run.path, seed=1) as bench:
        addresses = bench.addresses
        # So seldom, it is over in some 10 s; compiling comes on top, once.
        folder, journal = create_run(tmp_path / "run", run, addresses, poll=0.05)
        with journal:
            precompile_run(folder.run)
            with BenchRun(folder, journal, addresses) as run_process:
                assert run_process.execute_plan(), run_process.trouble
            calibration = finish_run(
                folder, journal, run_process.recorder.live_estimator
            ).outcome.calibration
    truth = np.array([run.truth.get(name, 0.0) for name in calibration.sensor.coefficients])
    error = calibration.values - truth
    # χ² with 24 degrees of freedom: these are its 0.5 % and 99.9 % points.
    assert 9.9 < error @ np.linalg.solve(calibration.covariance, error) < 51


@pytest.fixture(scope="module", params=SESSIONS)
def recorded(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, data_dir: Path
) -> tuple[str, Outcome]:
    """Return the name of a recorded session, and what it is calibrated to."""
    return request.param, session(request.param, tmp_path_factory.mktemp("session"), data_dir)


@pytest.mark.slow
def test_recorded_sessions_agree_with_noise_and_bench_as_stated(recorded: tuple[str, Outcome]):
    assert recorded[1].estimate.consistent


@pytest.mark.parametrize("name", SESSIONS)
def test_classical_formulas_give_what_imucal_gives(name: str, tmp_path: Path, data_dir: Path):
    outcome = session(name, tmp_path, data_dir, 'estimator = "classical"\n')
    for coefficient, value in IMUCAL[name].items():
        # imucal's numbers are printed with six to nine digits
        assert outcome.calibration.value(coefficient) == pytest.approx(value, abs=2e-6), coefficient


def test_maximum_likelihood_agrees_with_imucal_within_its_uncertainty(
    recorded: tuple[str, Outcome],
):
    name, outcome = recorded
    calibration = outcome.calibration
    for coefficient, value in IMUCAL[name].items():
        error = calibration.value(coefficient) - value
        assert abs(error) < 2 * calibration.uncertainty(coefficient), coefficient


@pytest.mark.slow
def test_the_script_prints_a_verdict_and_leaves_a_calibration_and_a_report(
    examples: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(examples / "calibrate_in_python.py"), run_name="__main__")
    assert capsys.readouterr().out.startswith("Consistent: the data agree")
    calibration = inercal.load(tmp_path / "six_position.calibration.json")
    assert calibration.sensor.name == "accelerometer SN 0417"
    assert "<html" in (tmp_path / "six_position.report.html").read_text(encoding="utf-8")


def test_the_readme_shows_the_script_and_what_it_prints(examples: Path):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    code = (examples / "calibrate_in_python.py").read_text(encoding="utf-8")
    assert code.split('"""\n\n')[1] in readme
    outcome = calibrate(examples / "six_position" / "run.toml")
    for line in outcome.verdict.lines:
        assert line in readme


def test_the_calibration_of_an_example_is_the_documented_json(examples: Path, tmp_path: Path):
    outcome = calibrate(examples / "six_position" / "run.toml")
    path = inercal.save(outcome.calibration, tmp_path / "run.calibration.json")
    page = (ROOT / "docs" / "reference" / "calibration-file.md").read_text(encoding="utf-8")
    content = json.loads(path.read_text(encoding="utf-8"))
    for key in (*content, *content["sensor"], *content["sensor"]["axes"][0]):
        assert f"`{key}`" in page, key
    for key in (*content["sensor"]["axes"][0]["readout"], "Birge"):
        assert key in page, key


@pytest.mark.parametrize("name", [slow("five_years"), slow("first_interval")])
def test_the_register_guide_prints_what_its_examples_print_and_a_page_is_left(
    name: str, tmp_path: Path
):
    done = subprocess.run(
        [sys.executable, "-W", "error", ROOT / "examples" / "register" / f"{name}.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONIOENCODING": "utf-8"},
        capture_output=True,
        encoding="utf-8",
        check=True,
    )
    guide = (ROOT / "docs" / "how-to" / "register.md").read_text(encoding="utf-8")
    assert f"```text\n{done.stdout}```" in guide
    pages = list(tmp_path.glob("*.html"))
    assert len(pages) == (name == "five_years")
    assert all("<svg" in page.read_text(encoding="utf-8") for page in pages)


@pytest.mark.slow
def test_the_centrifuge_guide_prints_what_its_example_prints(capsys: pytest.CaptureFixture[str]):
    runpy.run_path(str(ROOT / "examples" / "centrifuge" / "in_python.py"), run_name="__main__")
    guide = (ROOT / "docs" / "how-to" / "centrifuge.md").read_text(encoding="utf-8")
    assert f"```text\n{capsys.readouterr().out}```" in guide


def test_a_coefficient_left_out_is_the_suspect_and_estimated_the_data_agree(examples: Path):
    run_file = examples / "verdict" / "left_out.toml"
    verdict = calibrate(run_file).verdict
    assert verdict.grade == "unreliable"
    assert verdict.suspect is not None
    assert verdict.suspect.name == "a.k2"
    assert "harmonic 1" in verdict.suspect.indistinguishable
    estimated = examples / "verdict" / "estimated.toml"
    text = run_file.read_text(encoding="utf-8")
    estimated.write_text(f'{text}also = ["a.k2"]\n', encoding="utf-8")
    outcome = calibrate(estimated)
    assert outcome.verdict.grade == "consistent"
    # The size that the suspect was given is that which comes out.
    (size,), (sd,) = verdict.suspect.sizes, verdict.suspect.sds
    assert abs(outcome.calibration.value("a.k2") - size) < sd


def test_a_session_in_python_takes_as_few_statements_as_imucal_and_gives_more(
    examples: Path, data_dir: Path, capsys: pytest.CaptureFixture[str]
):
    if not (data_dir / "ferraris_imucal").is_dir():
        pytest.skip("no shared data")
    script = examples / "ferraris_recordings" / "in_python.py"
    code = script.read_text(encoding="utf-8")
    guide = (ROOT / "docs" / "how-to" / "ferraris.md").read_text(encoding="utf-8")
    assert code.split('"""\n\n')[1] in guide
    # imucal: readings, marks, regions, calibration, compute, calibrate.
    kept = [line for line in ast.parse(code).body if isinstance(line, ast.Assign)]
    assert len(kept) - len(["FOLDER"]) <= 6
    text = code.replace('Path(__file__).parents[3] / "shared" / "data"', f"Path({str(data_dir)!r})")
    made: dict[str, Any] = {}
    exec(compile(text, script, "exec"), made)
    outcome, motion = made["outcome"], made["motion"]
    for coefficient, value in IMUCAL["session_a"].items():
        error = outcome.calibration.value(coefficient) - value
        assert abs(error) < 2 * outcome.calibration.uncertainty(coefficient), coefficient
    assert set(outcome.calibration.sensor.coefficients) >= set(IMUCAL["session_a"])
    assert capsys.readouterr().out.startswith("Consistent: the data agree")
    start, end = made["marks"]["z_p"].values()
    assert np.linalg.norm(motion.f[start:end].mean(axis=0)) == pytest.approx(9.81, abs=0.01)
