"""Constants of a bench without "±", and a stated gravity against that of its place."""

import shutil
from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused
from tests.runfile.run_file_texts import SIX_POSITIONS, run_file

from inercal.basics.errors import InputError
from inercal.benches import Centrifuge
from inercal.physics.earth import normal_gravity
from inercal.pipeline import Outcome, apply_data_columns, calibrate, simulate
from inercal.recordings.io.write import write_recording
from inercal.runfile import read

GRAVITY = 'gravity = "9.81 m/s² ± 0.2 mm/s²"'
CENTRIFUGE = Path(__file__).parents[2] / "examples" / "centrifuge"


def calibrate_with_gravity(folder: Path, gravity: str, *changes: tuple[str, str]) -> Outcome:
    """Return what six positions of a simulated sensor give with a line of gravity."""
    path = run_file(folder, SIX_POSITIONS)
    run = read(path)
    if not run.file(run.data.file).exists():
        write_recording(apply_data_columns(run, simulate(run, 1)), run.file(run.data.file))
    return calibrate(run_file(folder, SIX_POSITIONS, (GRAVITY, gravity), *changes))


def standard_uncertainty(outcome: Outcome) -> np.ndarray:
    return np.sqrt(np.diag(outcome.estimate.covariance))[: len(outcome.calibration.values)]


def test_half_a_unit_of_the_last_digit_counts_as_if_it_were_stated(tmp_path: Path):
    assumed = calibrate_with_gravity(tmp_path, 'gravity = "9.81000 m/s²"')
    stated = calibrate_with_gravity(tmp_path, f'gravity = "9.81 m/s² ± {5e-6 / sqrt(3):.9g} m/s²"')
    exact = calibrate_with_gravity(tmp_path, 'gravity = "9.81 m/s² ± 0"')
    np.testing.assert_allclose(
        standard_uncertainty(assumed), standard_uncertainty(stated), rtol=1e-6
    )
    assert (standard_uncertainty(assumed) > standard_uncertainty(exact)).any()
    (line,) = [line for line in assumed.calibration.notes if "without ±" in line]
    assert "gravity" in line
    assert not any("without ±" in x for one in (stated, exact) for x in one.calibration.notes)


@pytest.mark.slow
def test_an_assumed_part_larger_than_the_rest_is_refused_and_named(tmp_path: Path):
    # u of k1 from noise and tilt alone is some 1e-5; half a centimetre per s² is 3e-4 of gravity.
    with refused(InputError, key="[bench] gravity") as refusal:
        calibrate_with_gravity(tmp_path, 'gravity = "9.81 m/s²"')
    assert set(refusal.value.names) < {"ax.k1", "ay.k1", "az.k1"}
    exact = calibrate_with_gravity(tmp_path, 'gravity = "9.81 m/s² ± 0"')
    relative = standard_uncertainty(exact)[
        list(exact.calibration.sensor.coefficients).index("ax.k1")
    ]
    # Just below and above where the assumed part is all the rest: half a unit is 5e-(d + 1).
    for digits in range(2, 7):
        part = 0.5 * 10.0**-digits / sqrt(3) / 9.81
        gravity = f'gravity = "{9.81:.{digits}f} m/s²"'
        if part > 1.2 * relative:
            with refused(InputError, key="[bench] gravity"):
                calibrate_with_gravity(tmp_path, gravity)
        elif part < 0.8 * relative:
            calibrate_with_gravity(tmp_path, gravity)


def test_a_radius_without_deviation_is_refused_where_it_makes_the_result(tmp_path: Path):
    for file in CENTRIFUGE.iterdir():
        shutil.copy(file, tmp_path)
    path = tmp_path / "lab.toml"
    text = path.read_text(encoding="utf-8").replace("1.5 m ± 20 µm", "1.5 m")
    path.write_text(text, encoding="utf-8")
    bench = read(path).bench
    assert isinstance(bench, Centrifuge)
    assert bench.radius.sd == pytest.approx(0.05 / sqrt(3))
    with refused(InputError, file=path, key="[bench] radius"):
        calibrate(path)


@pytest.mark.parametrize("key", ["turn_angle", "tilt", "timebase"])
def test_a_deviation_takes_no_deviation(tmp_path: Path, key: str):
    section = (
        f'[bench]\n{key} = "1 ° ± 0.1 °"'
        if key != "timebase"
        else (f'[bench]\n{key} = "9 ppm ± 1 ppm"')
    )
    changes = (("[bench]", section), ('tilt = "0.3 °"\n', ""))
    if key == "tilt":
        changes = (('tilt = "0.3 °"', 'tilt = "0.3 ° ± 0.1 °"'),)
    with refused(InputError, key=f"[bench] {key}"):
        read(run_file(tmp_path, SIX_POSITIONS, *changes))


@pytest.mark.parametrize(
    ("off", "height", "severity"),
    [
        (0.0, 520.0, "note"),
        (0.8e-3, 520.0, "note"),  # an anomaly of 80 mGal
        (2.5e-3, 520.0, "warning"),
        (-2.5e-3, 520.0, "warning"),
        (-6e-3, None, "note"),  # 2 km up
        (-15e-3, None, "warning"),
        (2.5e-3, None, "warning"),  # below the sea
    ],
)
def test_gravity_is_compared_with_that_of_its_place(
    tmp_path: Path, off: float, height: float | None, severity: str
):
    gravity = round(normal_gravity(np.radians(48.1), height or 0.0).value + off, 5)
    up = "" if height is None else f'height = "{height:g} m"\n'
    stated = f'gravity = "{gravity:.6f} m/s² ± 0.1 mm/s²"\nlatitude = "48.1 °"\n{up}'
    (finding,) = read(run_file(tmp_path, SIX_POSITIONS, (GRAVITY, stated))).findings
    assert (finding.what, finding.severity) == ("gravity", severity)
    assert f"{gravity:.5f}" in finding.message


def test_an_uncertain_gravity_may_be_farther_off(tmp_path: Path):
    stated = 'gravity = "9.8150 m/s² ± 3 mm/s²"\nlatitude = "48.1 °"\nheight = "520 m"'
    (finding,) = read(run_file(tmp_path, SIX_POSITIONS, (GRAVITY, stated))).findings
    assert finding.severity == "note"


def test_the_comparison_is_in_the_outcome(tmp_path: Path):
    place = 'gravity = "9.81 m/s² ± 0.2 mm/s²"\nlatitude = "10 °"'
    outcome = calibrate_with_gravity(tmp_path, place)
    assert any("normal gravity at 10°" in line for line in outcome.calibration.notes)


def test_noise_far_from_its_stated_value_is_reported(tmp_path: Path):
    assert not any(f.what == "noise" for f in calibrate_with_gravity(tmp_path, GRAVITY).findings)
    for white in ("10 µg/√Hz", "1000 µg/√Hz"):  # made with 100
        findings = calibrate_with_gravity(tmp_path, GRAVITY, ("100 µg/√Hz", white)).findings
        (finding,) = [f for f in findings if f.what == "noise"]
        assert finding.severity == "warning"
        assert white in finding.message
