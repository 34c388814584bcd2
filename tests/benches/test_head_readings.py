"""Readings beside the head's angle, and the keys by which a run file or a draft uses them."""

import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from tests.refusals import refused

from inercal import runfile
from inercal.basics.arrays import Array
from inercal.basics.units import Measured
from inercal.benches.dividing_head.bench import DividingHead, mounted_sensor
from inercal.benches.dividing_head.reading import observe
from inercal.calibration.best_cause import SuspectedCause, action_on
from inercal.calibration.plausible_sizes import scale_remarks
from inercal.estimation import Estimate
from inercal.methods import Fit
from inercal.methods.dividing_head_problem import remarks
from inercal.physics.plan import Index
from inercal.pipeline.advisor import RunAdvisor
from inercal.pipeline.drafts import draft_run_file
from inercal.pipeline.outcome import FittedRun

EXAMPLES = Path(__file__).parents[2] / "examples" / "dividing_head"
G = Measured(9.8, 0.0)


def changed_lab(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the example with the worksheet, with changes of its run file; return the path."""
    shutil.copytree(EXAMPLES, folder, dirs_exist_ok=True)
    text = (EXAMPLES / "lab.toml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "lab.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_readings_that_the_bench_would_ignore_are_refused(tmp_path: Path):
    keys = ('autocollimation = "pairs"', 'polygon = "polygon.csv"')
    gone = [(f"{key}\n", "") for key in (*keys, 'autocollimator = "0.1 ″"')]
    gone.append(('certificate = "0.05 ″"\n', ""))
    with refused(key="[bench] autocollimation"):
        observe(runfile.read(changed_lab(tmp_path, *gone)))
    unread = changed_lab(tmp_path, *gone, ('autocollimator = "autocollimator"\n', ""))
    assert len(observe(runfile.read(unread)).steps) == 24


def test_a_scale_in_another_unit_or_with_another_sign_is_refused(tmp_path: Path):
    with refused(key="[sensor.accelerometer] scale") as refusal:
        runfile.read(changed_lab(tmp_path, ('"3 V/g"', '"3 mA/g"')))
    assert "mA" in str(refusal.value)
    keys = '"a.k3" = "ax.k3"\n"b.k3" = "ay.k3"\n'
    prior = (f'[method.prior_from."centrifuge.calibration.json"]\n{keys}', "")
    run = runfile.read(changed_lab(tmp_path, ('"3 V/g"', '"-3 V/g"'), prior))
    with refused(key="[data] accelerometer") as refusal:
        observe(run)
    assert "[sensor.accelerometer]" in run.sensor.negative_scales
    assert run.sensor.negative_scales in str(refusal.value)


@pytest.mark.parametrize(("size", "count"), [(0.18, 1), (-0.18, 1), (0.05, 0)])
def test_scale_factors_far_from_the_stated_one_are_remarked(size: float, count: int):
    sensor = mounted_sensor().with_coefficients("k0", "k1")
    estimate = cast(Estimate, SimpleNamespace(value=np.array([0.5, 0.01, 0.5, size])))
    assert len(list(scale_remarks(estimate, sensor))) == count


@pytest.mark.parametrize(("filled", "mode"), [("", "pairs"), ("0.5", "every")])
def test_a_draft_uses_a_filled_autocollimator_column(filled: str, mode: str, tmp_path: Path):
    lines = (EXAMPLES / "lab.csv").read_text(encoding="utf-8").replace(",,", f",{filled},")
    head, _, rows = lines.partition("\n")
    names = "position,angle [deg],a [mV],b [mV],autocollimator [µrad],level"
    assert head == "position,angle,a,b,autocollimator,level"
    (tmp_path / "lab.csv").write_text(f"{names}\n{rows}", encoding="utf-8")
    stated = {"method.name": "dual_orthogonal"}
    draft = draft_run_file([tmp_path / "lab.csv"], tmp_path / "run.toml", stated)
    found = {one.dotted: one.value for one in draft.entries}
    assert found["bench.autocollimation"] == mode
    assert found["data.autocollimator_unit"] == "µrad"
    assert found["data.angle_unit"] == "deg"
    assert found["sensor.accelerometer.unit"] == "mV"
    assert found["sensor.accelerometer.scale"] == "2.999 mV/g"


@pytest.mark.parametrize(
    ("angle", "base", "told"), [(0.04, 5e-5, 1), (0.04, 0.01, 0), (3e-3, 5e-5, 0)]
)
def test_a_mounting_angle_of_degrees_may_be_the_zero_of_the_head(
    angle: float, base: float, told: int
):
    sensor, bench = mounted_sensor().with_coefficients("k0", "delta_o"), DividingHead(G, base=base)
    estimate = SimpleNamespace(value=np.array([0.1, -angle, 0.1, 1e-4]))
    fit = SimpleNamespace(sensor=sensor, bench=bench, estimate=estimate)
    assert len(remarks(cast("Fit[DividingHead, Index]", fit)).findings) == told


@pytest.mark.parametrize(("name", "estimated"), [("a.k1_prime", False), ("a.k0_dT", True)])
def test_the_advice_says_if_no_method_for_the_head_estimates_a_coefficient(
    name: str, estimated: bool, tmp_path: Path
):
    run = runfile.read(changed_lab(tmp_path))
    estimate = SimpleNamespace(score_tests=SimpleNamespace(chi2=50.0), noise_dof=np.inf)
    done = SimpleNamespace(stated=run, run=run, estimate=estimate, expected={})
    advisor = RunAdvisor(cast(FittedRun, done), "position", lambda _: cast(FittedRun, done))
    cause = SimpleNamespace(name=name, kind="coefficient", components=(name,), changes=())
    cause.chi2, cause.dof, cause.remaining_chi2 = 40.0, 1, 10.0
    cause = cast(SuspectedCause, cause)
    given = advisor.on_cause(cause)
    assert not given.changes
    assert (given.action == action_on(cause, "position")) == estimated


TURN = np.arange(12) * 30.0
RUN = """
[sensor]
name = "S"

[sensor.accelerometer]
unit = "V"
scale = "1.3 V/g"

[bench]
kind = "dividing_head"
gravity = "9.81 m/s² ± 5 µm/s²"

[data]
kind = "means"
file = "day.csv"
label = "position"
accelerometer = ["current"]
angle = "angle"

[data.sd]
accelerometer = "1 µg"

[method]
name = "tumble"
"""
Change = Callable[[Array, Array], object]


def back_and_forth(folder: Path, change: Change) -> Path:
    """Write a run of two passes, whose angles (°) and readings (V) a function changes."""
    angle = np.concatenate([TURN, TURN[::-1]]).astype(np.float64)
    reading = 1.3 * np.sin(np.radians(angle)) + 1e-6 * np.random.default_rng(3).normal(size=24)
    change(angle, reading)
    names = [f"f{k:02d}" for k in range(12)] + [f"r{k:02d}" for k in range(12)]
    rows = zip(names, angle.tolist(), reading.tolist(), strict=True)
    lines = ["position,angle,current", *(f"{a},{b:.6f},{c:.8f}" for a, b, c in rows)]
    (folder / "day.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "run.toml").write_text(RUN, encoding="utf-8")
    return folder / "run.toml"


def reverse(angle: Array, _: Array) -> None:
    angle[12:] = angle[12:][::-1].copy()


def negate(_: Array, reading: Array) -> None:
    reading[12:] *= -1


def rescale(_: Array, reading: Array) -> None:
    reading[12:] *= 1000


def turn(angle: Array, _: Array) -> None:
    angle += 30.0


def in_gon(angle: Array, _: Array) -> None:
    angle /= 0.9


def freeze(angle: Array, _: Array) -> None:
    angle[15:] = angle[15]


def mirror(angle: Array, _: Array) -> None:
    angle *= -1


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (reverse, ["only the pass from r00 to r11", "opposite order"]),
        (negate, ["only the pass from r00 to r11", "opposite sign"]),
        (rescale, ["only the pass from r00 to r11", "unit"]),
        (turn, ["zero", " 30°"]),
        (in_gon, ["gon"]),
        (freeze, ["constant from r03 to r11"]),
        (mirror, ["sign of the head's angle"]),
    ],
)
def test_what_is_wrong_with_the_angles_or_a_pass_is_named(
    change: Change, parts: list[str], tmp_path: Path
):
    run = runfile.read(back_and_forth(tmp_path, change))
    with refused(key="[data] accelerometer") as refusal:
        observe(run)
    assert all(part in str(refusal.value) for part in parts)


def test_two_right_passes_are_accepted(tmp_path: Path):
    run = runfile.read(back_and_forth(tmp_path, lambda *_: None))
    assert len(observe(run).steps) == 24


def test_a_head_without_autocollimator_readings_is_said_to_be_trimmed(tmp_path: Path):
    read = observe(runfile.read(changed_lab(tmp_path / "read", ("", ""))))
    column = ('autocollimator = "autocollimator"\n', "")
    trimmed = observe(runfile.read(changed_lab(tmp_path / "trimmed", column)))
    assert not any("autocollimator" in note for note in read.notes)
    (note,) = (note for note in trimmed.notes if "[data] names no autocollimator" in note)
    assert "270°" in note
