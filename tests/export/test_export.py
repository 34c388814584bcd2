"""The verb, the explanation in each file, and refusals."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.export.calibrations import (
    COUNTS,
    LINEAR,
    NOISE,
    OPTIONS,
    RANGES,
    TEMPERATURE,
    make_calibration,
    make_magnetometer,
)
from tests.program import run_program
from tests.refusals import refused

import inercal
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.calibration.files import calibration_object
from inercal.cli.export_command import cost_lines, default_path
from inercal.export import TARGETS, export_calibration
from inercal.export.model import parse_axes
from inercal.export.target_definition import Rendering, Request, Target
from inercal.export.term_kinds import kinds_of
from inercal.physics.quantities import ANGULAR_RATE, SPECIFIC_FORCE
from inercal.physics.sensors import Sensor, cluster, imu, triad

# One term at least of each kind that a target leaves out.
SOME = (*LINEAR, *TEMPERATURE, "k2", "k1_dT", "g_ii")


@pytest.mark.usefixtures("few_samples")
@pytest.mark.parametrize("to", list(TARGETS))
def test_every_file_states_formula_frame_units_source_and_losses(to: str):
    inertial = set(TARGETS.find(to).holds) != {"m"}
    calibration = (
        make_calibration(*SOME, readouts=COUNTS)
        if inertial
        else make_magnetometer("bias_dT", "scale_dT")
    )
    made = export_calibration(
        calibration, to, options=OPTIONS.get(to), source="a/x.calibration.json"
    )
    header = "\n".join(made.header)
    sha256 = calibration_object(calibration)["sha256"]
    for word in (
        sha256,
        "x.calibration.json",
        "formula: ",
        "frame: mount",
        "m/s^2" if inertial else "in T",
        "error of this",
    ):
        assert word in header
    assert all(line.isascii() for line in made.header)
    in_json = to in ("imucal", "magcal", "basalt", "realsense")
    inside = json.loads(made.text)["comment"] if in_json else made.text
    assert all(line in inside for line in made.header)
    for one in made.losses:
        assert set(one.names) <= set(calibration.sensor.coefficients)
        assert one.effect > 0
    exact = to in ("c", "cpp", "matlab", "python", "ros2-node")
    assert bool(made.losses) is not exact
    assert any(one.exceeds for one in made.costs) is not exact


def test_every_coefficient_is_of_one_kind_by_its_declaration():
    sensor = imu().with_coefficients(*(t.name for table in inercal_tables() for t in table))
    kinds = dict(zip(sensor.coefficients, (kind for _, kind, _ in kinds_of(sensor)), strict=True))
    expected = {
        "ax.k0": "bias", "ax.k1": "scale", "ax.delta_p": "misalignment", "gx.g_p": "g",
        "ax.k0_dT2": "bias_temperature", "gx.bias_dT": "bias_temperature", "ax.k2": "polynomial",
        "ax.k0_prime": "polynomial", "ax.k1_dT": "polynomial", "gx.scale_dT": "polynomial",
        "ax.kspin": "polynomial", "ax.kang": "angular_acceleration",
        "ax.k0_dTdt": "temperature_rate", "gx.bias_dTdt": "temperature_rate",
        "ax.arm_p": "angular_acceleration", "ax.arm_i": "polynomial", "gx.scale": "scale",
        "gx.g_ii": "polynomial", "gx.delta_o": "misalignment",
    }  # fmt: skip
    assert {name: kinds[name] for name in expected} == expected


def inercal_tables():
    from inercal.physics.sensors import TABLES

    return TABLES.values()


def test_lossless_refuses_an_error_above_u_and_passes_one_below():
    exact = make_calibration(*LINEAR)
    with refused(key="--lossless"):
        export_calibration(exact, "vectornav", lossless=True)  # g-sensitivity
    assert export_calibration(exact, "imucal", lossless=True).losses == ()
    # The same loss is below U where U is large.
    rough = make_calibration(*LINEAR, u=1e-3)
    made = export_calibration(rough, "vectornav", lossless=True)
    assert [one.word for one in made.losses] == ["g-sensitivity"]


@pytest.mark.usefixtures("few_samples")
def test_a_loss_without_a_stated_range_is_unknown_and_not_lossless():
    cold = make_calibration(*LINEAR, "k0_dT", "k1_dT", "k2", "kang", "k0_dTdt")
    cold = replace(cold, validity=replace(RANGES, temperature=None))
    for to, groups in (("imucal", 4), ("c", 2)):
        made = export_calibration(cold, to)
        unknown = [one for one in made.losses if np.isnan(one.effect)]
        names = {name.partition(".")[2] for one in unknown for name in one.names}
        assert len(unknown) == groups
        derivatives = {"kang", "k0_dTdt"}
        assert names == (derivatives if to == "c" else derivatives | {"k0_dT", "k1_dT"})
        with refused(key="--lossless"):
            export_calibration(cold, to, lossless=True)
    # Without kang, code holds everything: nothing is unknown.
    ranged = replace(make_calibration(*LINEAR, "k0_dT"), validity=cold.validity)
    assert export_calibration(ranged, "c", lossless=True).losses == ()

    # Gyros without accelerometers: nothing gives the force to their g-sensitivity.
    gyros = triad("t", "w", "g").with_coefficients("bias", "scale", "g")
    values = np.full(len(gyros.coefficients), 1e-3)
    alone = inercal.Calibration(gyros, values, np.eye(values.size) * 1e-12, validity=RANGES)
    for to in ("vectornav", "c"):
        (loss,) = export_calibration(alone, to).losses
        assert {name.partition(".")[2] for name in loss.names} == {"g_i", "g_p", "g_o"}
        assert np.isnan(loss.effect)


def test_the_cost_of_a_misalignment_is_its_angle_times_the_force_across():
    sensor = triad("t").with_coefficients("bias", "scale", "misalignment")
    c = np.zeros(len(sensor.coefficients))
    c[sensor.coefficients.index("x.delta_o")] = 1e-3
    calibration = inercal.Calibration(
        sensor, c, 1e-18 * np.eye(c.size), validity=replace(RANGES, rate=None)
    )
    made = export_calibration(calibration, "px4", options={"acc_id": 1})
    assert made.costs[0].largest == pytest.approx(20e-3, rel=1e-6)
    assert made.losses[0].effect == pytest.approx(20e-3, rel=1e-6)


@pytest.mark.slow
def test_a_refit_lessens_the_error_of_what_is_left_out():
    calibration = make_calibration(*LINEAR, "k2", "k3")
    plain = export_calibration(calibration, "imucal")
    fitted = export_calibration(calibration, "imucal", refit=True)
    assert fitted.costs[0].rms < 0.8 * plain.costs[0].rms
    assert "refit" in "\n".join(fitted.header)
    with refused(key="--refit"):
        export_calibration(calibration, "c", refit=True)


@pytest.mark.parametrize(
    ("to", "options"),
    [
        ("px4", {}),
        ("px4", {"acc_id": "x", "gyro_id": 1}),
        ("px4", {"acc_id": 1, "gyro_id": 1, "instance": 9}),
        ("px4", {"acc_id": 1, "gyro_id": 1, "nothing": 9}),
        ("kalibr", {}),
        ("kalibr", {**NOISE, "update_rate": 0}),
        ("openvins", {"noise": "no such file"}),
        ("adis", {"order": "scale"}),
        ("adis", {**OPTIONS["adis"], "bias_bits": 0}),
        ("adis", {**OPTIONS["adis"], "acc_bias_lsb": 0}),
        ("px4", {**OPTIONS["px4"], "acc_id": 99999999999}),
        ("px4", {**OPTIONS["px4"], "gyro_id": "-5"}),
        ("px4", {**OPTIONS["px4"], "priority": 101}),
        ("px4", {**OPTIONS["px4"], "mag_rotation": "1e400"}),
        ("ardupilot", {"gyro_id": 1 << 31}),
        ("kalibr", {**NOISE, "gyroscope_noise_density": "nan"}),
        ("inav", {**OPTIONS["inav"], "gravity": "30 m/s^2"}),
        ("adis", {**OPTIONS["adis"], "order": "both"}),
        ("adis", {**OPTIONS["adis"], "acc_bias_lsb": "1 V"}),
        ("ardupilot", {"imu": 7}),
        ("imu_tk", {"part": "magnetometer"}),
        ("c_fixed", {"lsb": 0}),
    ],
)
def test_options_that_are_missing_or_wrong_are_refused(to: str, options: dict[str, object]):
    with refused():
        export_calibration(make_calibration(), to, options=options)


def test_sensors_that_a_target_cannot_take_are_refused():
    pair = cluster("pair", [[1, 0, 0], [0.6, 0.8, 0]]).with_coefficients("bias")
    with refused(names=("s1", "s2")):
        export_calibration(inercal.Calibration(pair, np.zeros(2), np.eye(2)), "csv")
    alone = triad("t", "f", "a").with_coefficients("bias")
    accelerometers = inercal.Calibration(alone, np.zeros(3), np.eye(3))
    with refused():
        export_calibration(accelerometers, "imucal")
    with refused(names=("nothing",)):
        export_calibration(accelerometers, "nothing")
    crossed = Sensor("t", (alone.axes[1], alone.axes[0], alone.axes[2])).with_coefficients("bias")
    with refused(names=("ay",)):
        export_calibration(
            inercal.Calibration(crossed, np.zeros(3), np.eye(3)), "px4", options={"acc_id": 1}
        )
    for axes in ("x y", "x y -z", "x x z", "a b c"):
        with refused(key="axes"):
            parse_axes(axes)


@pytest.mark.parametrize("to", ["px4", "ardupilot"])
def test_no_export_corrects_two_kelvin_beyond_the_temperatures_of_the_calibration(to: str):
    calibration, options = make_calibration(*LINEAR, *TEMPERATURE), OPTIONS.get(to, {})
    assert RANGES.temperature is not None
    low, high = RANGES.temperature
    export_calibration(calibration, to, options=options, temperature=(low, high + 0.9))
    with refused(key="temperature"):
        export_calibration(calibration, to, options=options, temperature=(low, high + 2))
    with refused(key="--set"):
        export_calibration(calibration, to, options={**options, "lowest": low - ZERO_CELSIUS - 2})


def test_temperature_is_refused_where_no_range_is_known():
    calibration = replace(make_calibration("bias", "k0_dT"), validity=None)
    with refused(key="temperature"):
        export_calibration(calibration, "px4", options=OPTIONS["px4"])
    made = export_calibration(
        calibration, "px4", options=OPTIONS["px4"], temperature=(273.15, 323.15)
    )
    assert "TC_A0_TMAX\t50\t" in made.text
    short = (293.15, 298.15)
    with refused(key="temperature"):
        export_calibration(calibration, "ardupilot", temperature=short)


def test_the_noise_of_an_analysis_is_taken_from_its_file(tmp_path: Path):
    path = tmp_path / "imu.yaml"
    path.write_text("\n".join(f"{key}: {value}" for key, value in NOISE.items()), encoding="utf-8")
    text = export_calibration(make_calibration(), "kalibr", options={"noise": str(path)}).text
    assert "  gyroscope_random_walk: 1.0e-05\n" in text
    path.write_text("gyroscope_random_walk: 1e\n", encoding="utf-8")
    with refused(key="gyroscope_random_walk"):
        export_calibration(make_calibration(), "kalibr", options={"noise": str(path)})


def test_a_target_of_another_package_is_found():
    def render(request: Request) -> Rendering:
        correct = lambda y, dT: y  # noqa: E731
        return Rendering(correct, lambda header: "\n".join(header), ("out = in",))

    with TARGETS.with_("raw", Target("raw", "Readings as they are", ".txt", {}, render)):
        made = export_calibration(make_calibration(), "raw")
    assert len(made.losses) == 7
    assert made.costs[0].exceeds


@pytest.mark.parametrize(
    ("to", "wanted"),
    [("matlab", "imu_7_correct.m"), ("python", "imu_7_correct.py"), ("px4", "run.px4.params")],
)
def test_code_that_is_found_by_its_file_gets_the_name_of_its_function(to: str, wanted: str):
    path = default_path(Path("a/run.calibration.json"), TARGETS.find(to), "IMU-7")
    assert path == Path(wanted)
    assert path.stem.isidentifier() is (to != "px4")


@pytest.mark.parametrize(
    ("to", "wanted"),
    [
        ("matlab", "left_arm_correct.m"),
        ("px4", "left_arm.px4.params"),
        ("csv", "left_arm.export.csv"),
    ],
)
def test_a_stated_name_is_that_of_every_file_and_no_suffix_is_doubled(to: str, wanted: str):
    path = default_path(Path("run.calibration.json"), TARGETS.find(to), "IMU-7", "left/arm")
    assert path == Path(wanted)


@pytest.mark.slow
def test_the_verb_writes_beside_what_it_says(tmp_path: Path):
    path = inercal.save(make_calibration(), tmp_path / "run.calibration.json")
    out = tmp_path / "board.params"
    arguments = ("export", path, "--to", "px4", "--out", out)
    ids = ("--set", "acc_id=0x2", "--set", "gyro_id=3")
    assert run_program(*arguments).status == 2
    assert not out.exists()
    ended = run_program(*arguments, *ids, "--json")
    content = json.loads(ended.output)
    assert ended.status == 0
    assert content["errors"]["f"]["exceeds_U"]
    assert "CAL_ACC0_ID\t2\t6" in out.read_text(encoding="utf-8")
    assert run_program(*arguments, *ids).status == 2
    assert run_program(*arguments, *ids, "--force", "--over-force", "-2 2 g").status == 0
    reversed_range = ["--over-force", "4 -4 g"]
    for wrong in (["--over-force", "2 g"], ["--over-rate", "-1 1 V"], reversed_range):
        assert run_program(*arguments, *ids, "--force", *wrong).status == 2
    assert run_program(*arguments, *ids, "--force", "--set", "acc_id").status == 2
    renamed = run_program(*arguments, *ids, "--force", "--name", "my imu;")
    assert "my_imu" in renamed.output
    assert run_program(*arguments, *ids, "--force", "--lossless").status == 2
    assert run_program("export", path, "--to", "csv", "--out", path, "--force").status == 2


@pytest.mark.usefixtures("few_samples")
@pytest.mark.parametrize("to", ["csv", "c", "python"])
def test_a_file_with_uncertainties_does_not_deny_them(to: str):
    calibration = make_calibration("k0")
    made = export_calibration(calibration, to)
    u = f",{calibration.uncertainty('ax.k0'):.6g},"
    assert (u in made.text) == (to == "csv")
    denied = any("uncertainties" in line and "only" in line for line in made.header)
    assert denied == (to != "csv")


@pytest.mark.usefixtures("few_samples")
@pytest.mark.parametrize(
    ("to", "options", "given"),
    [
        ("imu_tk", {"part": "gyro"}, "angular rate"),
        ("imu_tk", {"part": "accelerometer"}, "specific force"),
        ("imu_calib", {}, "specific force"),
    ],
)
def test_a_file_of_one_triad_says_what_it_gives_in_one_unit(
    to: str, options: dict[str, str], given: str
):
    made = export_calibration(make_calibration(*SOME, readouts=COUNTS), to, options=options)
    takes = " ".join(made.header).partition("; gives ")[2].partition(" frame: ")[0]
    assert [one.name in takes for one in (SPECIFIC_FORCE, ANGULAR_RATE)] == [
        one.name == given for one in (SPECIFIC_FORCE, ANGULAR_RATE)
    ]
    for kind in (SPECIFIC_FORCE, ANGULAR_RATE):
        lines = [line for line in cost_lines(made) if kind.name in line]
        units = set(re.findall(r"[\d.]+ ([^\s,;()]*[g°][^\s,;()]*)", " ".join(lines)))
        assert len(units) == 1, lines


# What a temperature ramp at rest determines.
RAMP = ("k0_dT", "k0_dT2", "gx.bias", "gy.bias", "gz.bias", "bias_dT")


@pytest.mark.parametrize(
    ("to", "kept", "written"),
    [
        ("px4", ("CAL_ACC0_XOFF", "CAL_ACC0_XSCALE"), ("TC_A0_X1_0", "CAL_GYRO0_XOFF")),
        ("ardupilot", ("INS_ACCOFFS_X", "INS_ACCSCAL_X"), ("INS_TCAL1_ACC1_X", "INS_GYROFFS_X")),
        ("inav", ("acczero_x", "accgain_x"), ("gyro_zero_x",)),
    ],
)
def test_a_board_keeps_what_a_calibration_does_not_determine(
    to: str, kept: tuple[str, ...], written: tuple[str, ...]
):
    made = export_calibration(make_calibration(*RAMP), to, options=OPTIONS.get(to))
    assert not any(name in made.text for name in kept)
    assert all(name in made.text for name in written)


@pytest.mark.parametrize("to", ["px4", "c", "csv", "vectornav", "inav"])
def test_no_u_is_stated_for_a_kind_whose_bias_is_not_determined(to: str):
    ramp = make_calibration(*RAMP)
    made = export_calibration(ramp, to, options=OPTIONS.get(to))
    assert any("bias of ax, ay, az" in text for text in made.undetermined)
    assert {one.measures: one.expanded > 0 for one in made.costs} == {"f": False, "w": True}
    assert "NOT calibrated" in made.text
    with pytest.raises(InputError, match="bias of ax, ay, az"):
        export_calibration(ramp, to, options=OPTIONS.get(to), lossless=True)
    whole = export_calibration(make_calibration(), to, options=OPTIONS.get(to))
    assert not whole.undetermined


def test_a_range_of_temperature_without_temperature_terms_is_refused():
    with refused(key="temperature"):
        export_calibration(
            make_calibration("bias"), "px4", options=OPTIONS["px4"], temperature=(273.15, 323.15)
        )
