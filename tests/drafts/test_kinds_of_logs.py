"""Drafts of logs with text that is no label, of tables of poses and rates, and of several files."""

import json
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests import generated_logs as logs
from tests.base_seeds import chosen as representative
from tests.base_seeds import evidence
from tests.io.log_files import SAMPLES
from tests.program import run_program
from tests.reports import report_file

import inercal
from inercal.basics.errors import InputError
from inercal.pipeline.drafts import Draft, draft_run_file
from inercal.pipeline.drafts.column_roles import recognise_columns
from inercal.pipeline.drafts.log_files import read_logs
from inercal.recordings.data.rest_marks import parse_face, planned_name
from inercal.recordings.io.column_table import Table


def drafted(files: Sequence[Path], folder: Path, **stated: str) -> Draft:
    values = {key.replace("__", "."): value for key, value in stated.items()}
    return draft_run_file(files, folder / "run.toml", values)


def calibrated(draft: Draft) -> inercal.Calibration:
    draft.path.write_text(draft.text, encoding="utf-8")
    return inercal.calibrate(draft.path).calibration


def chosen(draft: Draft) -> dict[str, Any]:
    return {f"{one.section}.{one.key}": one.value for one in draft.entries}


def assert_true(found: inercal.Calibration, truth: dict[str, float], k: float = 3.0) -> None:
    """Check values in g, rad/s or 1 against the truth, within k standard uncertainties."""
    for name, true in truth.items():
        assert abs(found.value(name) - true) < k * found.uncertainty(name), name


BIASES = {f"a{axis}.k0": float(b) * logs.G for axis, b in zip("xyz", logs.BIAS, strict=True)}


TEXTS: dict[str, Callable[[dict[str, np.ndarray]], list[str]]] = {
    "frame id": lambda log: ["imu_link"] * len(log["t"]),
    "status": lambda log: ["OK" if int(t) % 7 else "WARN" for t in log["t"]],
    "date": lambda log: [f"2026-11-29 12:{int(t) // 60:02d}:{int(t) % 60:02d}" for t in log["t"]],
    "checksum": lambda log: [f"*{(37 * k) % 256:02X}" for k in range(len(log["t"]))],
    "two devices": lambda log: ["left" if t < 30 else "right" for t in log["t"]],
    "rest or motion": lambda log: ["rest" if k >= 0 else "move" for k in log["rest"]],
}


@pytest.mark.parametrize(
    "text", representative(TEXTS, ["checksum", "two devices", "rest or motion"])
)
def test_text_that_names_no_sections_is_ignored_and_rests_are_found(text: str, tmp_path: Path):
    log = logs.by_hand(5, rests=12, hz=50.0)
    columns = [log["t"], TEXTS[text](log), *log["f"].T]
    path = logs.write(tmp_path / "log.csv", ("t", "state", "ax", "ay", "az"), columns)
    draft = drafted([path], tmp_path)
    assert "data.label" not in chosen(draft)
    assert any("state" in fact and "ignored" in fact for fact in draft.facts)
    assert chosen(draft)["method.name"] == "multi_position"
    assert_true(calibrated(draft), BIASES)


def test_a_name_for_each_rest_is_a_label(tmp_path: Path):
    log = logs.by_hand(5, rests=12, hz=50.0)
    names = [f"p{k}" if k >= 0 else "" for k in log["rest"]]
    columns = [log["t"], names, *log["f"].T]
    path = logs.write(tmp_path / "log.csv", ("t", "where", "ax", "ay", "az"), columns)
    assert chosen(drafted([path], tmp_path))["data.label"] == "where"


@pytest.mark.parametrize(
    ("head", "separator"),
    [
        ((), ","),
        evidence(("x", "y", "z"), " "),
        (("pose", "ax", "ay", "az"), "\t"),
        evidence(("n", "a_x", "a_y", "a_z"), ","),
        evidence((), " "),
        evidence((), "\t"),
    ],
)
def test_poses_need_no_labels(head: tuple[str, ...], separator: str, tmp_path: Path):
    means = logs.poses(3, 20) * 9.81
    columns: list[object] = list(means.T)
    if head[:1] == ("pose",):
        columns = [[f"p{k}" for k in range(len(means))], *columns]
    if head[:1] == ("n",):
        columns = [[str(k + 1) for k in range(len(means))], *columns]
    draft = drafted([logs.write(tmp_path / "means.txt", head, columns, separator)], tmp_path)
    assert chosen(draft)["method.name"] == "multi_position"
    assert_true(calibrated(draft), BIASES, k=4)


NAMES = {
    "+Z": ("+X", "-X", "+Y", "-Y", "+Z", "-Z"),
    "z up": ("x up", "x down", "y up", "y down", "z up", "z down"),
    "x_up": ("x_up", "x_down", "y_up", "y_down", "z_up", "z_down"),
    "face 3": ("face 1", "face 2", "face 3", "face 4", "face 5", "face 6"),
    "none": (),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "offset"),
    representative(
        [*((name, 0.0) for name in NAMES), ("x_up", 1.0), ("none", 1.0)],
        [("z up", 0.0), ("face 3", 0.0), ("none", 1.0)],
    ),
)
def test_six_faces_have_any_name_or_none(names: str, offset: float, tmp_path: Path):
    means = np.array(list(logs.FACES.values())) * (1 + logs.SCALE) + logs.BIAS + [0, 0, offset]
    order = [4, 0, 3, 2, 5, 1]
    columns: list[object] = list(means[order].T)
    if NAMES[names]:
        columns = [[NAMES[names][k] for k in order], *columns]
    head = (*(("side",) if NAMES[names] else ()), "ax", "ay", "az")
    draft = drafted([logs.write(tmp_path / "six.csv", head, columns)], tmp_path)
    assert chosen(draft)["method.name"] == "six_position"
    assert_true(calibrated(draft), BIASES | {"az.k0": (0.04 + offset) * logs.G})
    assert any("az" in fact and "off" in fact for fact in draft.facts) == bool(offset)


@pytest.mark.parametrize(
    ("text", "face"),
    [
        *(("+x up", "x"), ("x up", "x"), ("-y", "-y"), ("−Z", "-z"), ("y-", "-y"), ("x_a", "-x")),
        *(("z neg", "-z"), ("negative x", "-x"), ("y down", "-y"), ("z axis up", "z")),
        ("up", None),
        ("z_", None),
    ],
)
def test_faces_are_read_as_people_name_them(text: str, face: str | None):
    assert parse_face(text) == face


def test_a_turn_has_its_name_in_the_plan():
    assert [planned_name(one) for one in ("rot x", "x turn", "turning")] == ["x_rot", "x_rot", None]


@pytest.mark.slow
def test_a_stated_unit_replaces_a_guess_with_its_scale(tmp_path: Path):
    log = logs.by_hand(7, rests=24, hz=50.0)
    force = log["f"] * logs.G + [0, 0, logs.G]
    path = logs.write(tmp_path / "log.csv", ("t", "ax", "ay", "az"), [log["t"], *force.T])
    guess, stated = (
        drafted([path], tmp_path, **more) for more in ({}, {"sensor__accelerometer__unit": "m/s²"})
    )
    for draft in (guess, stated):
        assert chosen(draft)["sensor.accelerometer.unit"] == "m/s²"
        assert "sensor.accelerometer.scale" not in chosen(draft)
    found = calibrated(guess)
    assert_true(found, BIASES | {"az.k0": 1.04 * logs.G})
    assert found.uncertainty("az.k0") < 2e-4 * logs.G


def test_no_unit_is_asked_for_and_never_guessed_as_a_scale(tmp_path: Path):
    log = logs.by_hand(7, rests=14, hz=50.0)
    path = logs.write(
        tmp_path / "log.csv", ("t", "ax", "ay", "az"), [log["t"], *(3.3 * log["f"]).T]
    )
    draft = drafted([path], tmp_path)
    assert [one.name for one in draft.questions] == ["[sensor.accelerometer] unit"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "swapped"), [evidence(("X (g)", "X (rad/s)"), False), (("x", "x"), True)]
)
def test_gyros_with_a_clock_of_their_own_are_paired(
    names: tuple[str, str], swapped: bool, tmp_path: Path
):
    log = logs.by_hand(11, rests=16)
    at = np.arange(3e-3, log["t"][-1], 0.0103)
    rate = np.stack([np.interp(at, log["t"] + 5e-3, np.radians(w)) for w in log["w"].T])
    files = []
    for name, time, data, head in (
        ("Accelerometer.csv", log["t"] + 5e-3, log["f"].T, names[0]),
        ("Gyroscope.csv", at, rate, names[1]),
    ):
        axes = [head.lower().replace("x", axis, 1) for axis in "xyz"]
        order = (2, 1, 0)  # as phones export them
        files.append(
            logs.write(
                tmp_path / name,
                ("time", *(axes[k] for k in order)),
                [time, *(data[k] for k in order)],
            )
        )
    stated = {} if "rad" in names[1] else {"sensor__gyro__unit": "rad/s"}
    draft = drafted(files[::-1] if swapped else files, tmp_path, **stated)
    keys = chosen(draft)
    assert (keys["data.file"], keys["data.gyro_file"]) == ("Accelerometer.csv", "Gyroscope.csv")
    assert keys["data.gyro_time"] == "time"
    found = calibrated(draft)
    truth = {
        f"g{axis}.bias": np.radians(b) for axis, b in zip("xyz", (1.5, -0.8, 0.6), strict=True)
    }
    assert_true(found, BIASES | truth, k=4)


def chamber(folder: Path) -> list[Path]:
    files = []
    for k, celsius in enumerate((-20, 20, 60)):
        force, warm = logs.six_faces(k, celsius)
        time = np.arange(len(force)) / 50
        path = folder / f"soak_{celsius:+d}C.csv"
        files.append(logs.write(path, ("t", "ax", "ay", "az", "temp"), [time, *force.T, warm]))
    return files


@pytest.mark.slow
def test_a_file_for_each_temperature_is_calibrated_at_the_first_try(tmp_path: Path):
    folder = tmp_path / "soaks"
    folder.mkdir()
    files = chamber(folder)
    draft, other = (drafted(given, tmp_path) for given in (files, [folder / "soak_*.csv"]))
    assert chosen(draft)["method.temperature_order"] == "auto"
    assert other.text == draft.text
    outcome = calibrated(draft)
    slopes = {f"a{a}.k0_dT": s * logs.G for a, s in zip("xyz", (2e-4, -1e-4, 3e-4), strict=True)}
    slopes |= {f"a{a}.k1_dT": s for a, s in zip("xyz", (5e-5, -3e-5, 4e-5), strict=True)}
    assert_true(outcome, BIASES | slopes)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        evidence("imu_{}C.csv"),
        evidence("{} °C, run 1.csv"),
        "{}degC/run.csv",
        evidence("{}degC.csv"),
        evidence("t{}_celsius/x.csv"),
    ],
)
def test_temperatures_in_the_names_of_files_or_folders_are_used(name: str, tmp_path: Path):
    files = []
    for file, celsius in zip(chamber(tmp_path), (-20, 20, 60), strict=True):
        named = tmp_path / "soaks" / name.format(celsius)
        named.parent.mkdir(parents=True, exist_ok=True)
        lines = file.read_text("utf-8").splitlines()
        named.write_text("\n".join(line.rpartition(",")[0] for line in lines) + "\n", "utf-8")
        files.append(named)
    draft = drafted(files, tmp_path)
    keys = chosen(draft)
    assert (keys["data.temperature"], keys["method.temperature_order"]) == ("*", "auto")
    assert keys["data.file"] == f"soaks/{name.format('*')}"
    slopes = {f"a{a}.k0_dT": s * logs.G for a, s in zip("xyz", (2e-4, -1e-4, 3e-4), strict=True)}
    assert_true(calibrated(draft), BIASES | slopes)


@pytest.mark.slow
@pytest.mark.parametrize("names", [("a-20C", "b20C", "c60C"), evidence(("s20", "s40", "s60"))])
def test_names_without_a_temperature_are_not_read_as_one(names: tuple[str, ...], tmp_path: Path):
    files = chamber(tmp_path)
    (tmp_path / "soaks").mkdir()
    moved = [
        file.rename(tmp_path / "soaks" / f"{n}.csv") for file, n in zip(files, names, strict=True)
    ]
    for file in moved:
        lines = file.read_text("utf-8").splitlines()
        file.write_text("\n".join(line.rpartition(",")[0] for line in lines) + "\n", "utf-8")
    assert "data.temperature" not in chosen(drafted(moved, tmp_path))


@pytest.mark.slow
def test_a_star_that_is_no_temperature_is_refused(tmp_path: Path):
    files = chamber(tmp_path)
    draft = drafted(files, tmp_path)
    text = draft.text.replace('temperature = "temp"', 'temperature = "*"')
    draft.path.write_text(text.replace("soak_*", "soa*"), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        inercal.calibrate(draft.path)
    assert caught.value.key == "[data] temperature"


def test_a_file_for_each_pose_is_a_section(tmp_path: Path):
    rng = np.random.default_rng(4)
    folder = tmp_path / "poses"
    folder.mkdir()
    for name, up in logs.FACES.items():
        force = np.array(up) * (1 + logs.SCALE) + logs.BIAS + rng.normal(0, 5e-4, (300, 3))
        word = f"{name[-1]}_{'down' if name[0] == '-' else 'up'}"
        logs.write(
            folder / f"rest_{word}.csv", ("t", "ax", "ay", "az"), [np.arange(300) / 50, *force.T]
        )
    draft = drafted([folder], tmp_path)
    assert (chosen(draft)["data.marks"], chosen(draft)["method.name"]) == ("labels", "six_position")
    assert_true(calibrated(draft), BIASES)


def marked_log(folder: Path, *columns: str) -> Path:
    log = logs.by_hand(5, rests=12, hz=50.0)
    names = [f"p{k}" if k >= 0 else "" for k in log["rest"]]
    more = [names for _ in columns]
    return logs.write(
        folder / "log.csv", ("t", *columns, "ax", "ay", "az"), [log["t"], *more, *log["f"].T]
    )


def test_a_file_of_marks_beside_the_log_is_used(tmp_path: Path):
    path = marked_log(tmp_path)
    rest = logs.by_hand(5, rests=12, hz=50.0)["rest"]
    marks = {
        f"p{k}": {"start": int(at[0]), "end": int(at[-1]) + 1}
        for k in range(12)
        if (at := np.flatnonzero(rest == k)).size
    }
    (tmp_path / "marks.json").write_text(json.dumps(marks))
    out = tmp_path / "elsewhere"
    out.mkdir()
    draft = drafted([path], out)
    assert chosen(draft)["data.marks"] == "../marks.json"
    assert_true(calibrated(draft), BIASES)


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ('{"p1": {"start": 0, "end": 10000000}}', ()),
        ("[1, 2]", ()),
        ("no marks", ()),
        ('{"p1": {"start": 0, "end": 100}}', ("where",)),
        ('{"p1": {"start": 0, "end": 100}, "p2": {"start": 150, "end": 250}}', ()),
    ],
)
def test_marks_that_do_not_suit_the_log_are_left_out_and_named(
    text: str, columns: tuple[str, ...], tmp_path: Path
):
    path = marked_log(tmp_path, *columns)
    (tmp_path / "marks.json").write_text(text)
    draft = drafted([path], tmp_path)
    assert chosen(draft).get("data.marks", "found") == ("labels" if columns else "found")
    assert any("marks.json" in fact for fact in draft.facts)
    assert_true(calibrated(draft), BIASES)


@pytest.mark.slow
@pytest.mark.parametrize("given", ["folder", evidence("parts")])
def test_a_split_bag_is_one_recording(given: str, tmp_path: Path):
    ros = pytest.importorskip("tests.io.ros_files", reason="needs the extra inercal[ros]")
    listed = ros.write_split_bag(tmp_path / "bag", ros.messages(SAMPLES, first=False), ".mcap", 3)
    files = sorted(listed.parent.glob("*.mcap")) if given == "parts" else [listed.parent]
    marks = (Path(__file__).parents[2] / "examples" / "logs" / "marks.json").read_text()
    (listed.parent / "marks.json").write_text(marks)
    draft = drafted(files, tmp_path)
    keys = chosen(draft)
    assert (keys["data.file"], keys["method.name"]) == ("bag/metadata.yaml", "six_position")
    assert keys["sensor.name"] == "bag"
    calibrated(draft)


def test_files_that_do_not_belong_together_are_refused(tmp_path: Path):
    first = logs.write(tmp_path / "a.csv", ("ax", "ay", "az"), list(logs.poses(1, 9).T))
    second = logs.write(
        tmp_path / "b.csv", ("t", "ax", "ay", "az"), [range(9), *list(logs.poses(2, 9).T)]
    )
    with pytest.raises(InputError) as caught:
        drafted([first, second], tmp_path)
    assert caught.value.names == (str(first), str(second))


@pytest.mark.slow
@pytest.mark.parametrize(
    "head",
    [evidence("mounting,table_rate_dps"), evidence("up,omega"), "side,w_table (rad/s)"],
)
def test_a_rate_table_is_drafted_with_questions_about_its_bench(head: str, tmp_path: Path):
    faces, rows = logs.rates(2, 48.0, (-200, -50, -10, 0, 10, 50, 200))
    words = [f"+{one} up" if len(one) == 1 else one for one in faces]
    rate = np.radians(rows[:, 0]) if "rad" in head else rows[:, 0]
    names = (*head.split(","), "gx (deg/s)", "gy (deg/s)", "gz (deg/s)")
    path = logs.write(tmp_path / "rates.csv", names, [words, rate, *rows[:, 1:].T])
    asked = {one.key for one in drafted([path], tmp_path).questions}
    assert asked == {"latitude", "rate_scale", "rate_asymmetry", "rate_stability", "setting"}
    stated = {"bench.latitude": "48 °"}
    draft = draft_run_file([path], tmp_path / "run.toml", stated, typical=True)
    assert not draft.questions
    truth = {f"g{a}.bias": np.radians(b) for a, b in zip("xyz", (0.4, -0.25, 0.15), strict=True)}
    scales = {f"g{a}.scale": s for a, s in zip("xyz", (0.006, -0.005, 0.011), strict=True)}
    assert_true(calibrated(draft), truth | scales)


@pytest.mark.slow
def test_the_printed_command_answers_all_questions_at_once(tmp_path: Path):
    faces, rows = logs.rates(3, 48.0, (-200, -50, -10, 0, 10, 50, 200))
    names = ("axis", "rate", "gx (deg/s)", "gy (deg/s)", "gz (deg/s)")
    path = logs.write(tmp_path / "rates.csv", names, [faces, *rows.T])
    first = run_program("init", path, "--out", tmp_path / "run.toml")
    (command,) = [one for one in first.output.splitlines() if one.startswith("then: ")]
    answers = iter(["48 °", "500 ppm", "100 ppm", "100 ppm", "0.05 °"])
    words = [
        word.replace("…", next(answers)) if "…" in word else word
        for word in shlex.split(command.removeprefix("then: inercal "))
    ]
    second = run_program(*words)
    assert (second.status, "please state" in second.output) == (0, False)
    assert inercal.calibrate(tmp_path / "run.toml").verdict.grade == "consistent"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "unit", "size"), [("rate (rad/s)", "rad/s", np.pi / 30), ("arm_rate_dps", "°/s", 6.0)]
)
def test_the_unit_of_an_arm_s_rate_is_that_of_its_column(
    name: str, unit: str, size: float, tmp_path: Path
):
    turns = np.repeat([60.0, 90.0, 120.0], 20)
    columns = [range(60), turns * size, *logs.on_arm(turns).T]
    path = logs.write(tmp_path / "arm.csv", ("position", name, "ax", "ay", "az"), columns)
    draft = drafted([path], tmp_path, bench__radius="1 m ± 10 µm")
    assert chosen(draft)["data.arm_rate_unit"] == unit
    found = calibrated(draft)
    for axis, bias in BIASES.items():
        assert abs(found.value(axis) - bias) < 0.05 * logs.G


HEADS = [
    "t,U1_Accel_LN_X_CAL,U1_Accel_LN_Y_CAL,U1_Accel_LN_Z_CAL,U1_Gyro_X_CAL,U1_Gyro_Y_CAL,U1_Gyro_Z_CAL",
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]",
    "time,RateOfTurn_X,RateOfTurn_Y,RateOfTurn_Z,Acceleration_X,Acceleration_Y,Acceleration_Z",
    "timestamp,status,accelX,accelY,accelZ,gyroX,gyroY,gyroZ,temperature,deltaVelX,deltaVelY,deltaVelZ",
    "Week,Seconds,Status,Z Accel,-(Y Accel),X Accel,Z Gyro,-(Y Gyro),X Gyro",
    "TimeStartup,Ypr.x,Ypr.y,Ypr.z,AngularRate.x,AngularRate.y,AngularRate.z,Accel.x,Accel.y,Accel.z",
    "time,gFx,gFy,gFz,wx,wy,wz,Bx,By,Bz",
    "PacketCounter,Euler_X,Euler_Y,Euler_Z,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z,Mag_X,Mag_Y,Mag_Z",
    "t,X (g),Y (g),Z (g),rate_x (deg/s),rate_y (deg/s),rate_z (deg/s)",
]


@pytest.mark.parametrize("head", HEADS)
def test_other_loggers_name_both_triads(head: str):
    names = tuple(head.split(","))
    data: dict[str, Any] = {name: np.arange(8.0) for name in names}
    triads = recognise_columns(Table(names, data, "log.csv", "", 1, True)).triads
    assert set(triads) == {"accelerometer", "gyro"}
    for triad in triads.values():
        assert not any(word in name.lower() for name in triad for word in ("euler", "ypr", "delta"))


def test_a_name_with_a_minus_reverses_its_column(tmp_path: Path):
    log = logs.by_hand(5, rests=12, hz=50.0)
    names = ("t", "Z Accel", "-(Y Accel)", "X Accel")
    columns = [log["t"], log["f"][:, 2], -log["f"][:, 1], log["f"][:, 0]]
    draft = drafted([logs.write(tmp_path / "log.csv", names, columns)], tmp_path)
    assert_true(calibrated(draft), BIASES)


HAND = dict(zip(("ax.k0", "ay.k0", "az.k0"), (0.3, -0.2, 0.4), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "truth"),
    [
        # Logs of each of these kinds are generated above.
        evidence(["06_frame_id.csv"], HAND),
        evidence(["09_Accelerometer.csv", "09_Gyroscope.csv"], HAND),
        evidence(["12_z_offset_1g.csv"], {"az.k0": logs.G}),
        evidence(
            ["07_poses_no_label.csv"], {"ax.k0": 2.56e-3 * logs.G, "az.k0": 37.18e-3 * logs.G}
        ),
        (["07_poses_free_label.csv"], {"ay.k0": -5.82e-3 * logs.G}),
        (["07_six_other_names.csv"], {}),
    ],
)
def test_inputs_of_others_calibrate_at_the_first_try(
    names: list[str], truth: dict[str, float], tmp_path: Path
):
    draft = drafted([report_file(name) for name in names], tmp_path)
    assert not draft.questions
    assert_true(calibrated(draft), truth, k=2)


def rate_files(folder: Path, names: Sequence[str]) -> list[Path]:
    """Write a file of 3 s for each name such as "x_+30" or "-y_rest": steady readings, °/s."""
    rng, found = np.random.default_rng(6), list[Path]()
    for name in names:
        axis, _, rate = name.partition("_")
        up = np.array(
            [("xyz"[k] == axis[-1]) * (-1.0 if axis[0] == "-" else 1.0) for k in range(3)]
        )
        turn = up * (0.0 if rate == "rest" else float(rate.replace("p", "+").replace(",", ".")))
        force, gyro = (one + rng.normal(0, 1e-3, (300, 3)) for one in (up, turn))
        columns = [np.arange(300) / 100, *force.T, *gyro.T]
        heads = ("t", "ax", "ay", "az", "gx (deg/s)", "gy (deg/s)", "gz (deg/s)")
        found.append(logs.write(folder / f"log_{name}.csv", heads, columns))
    return found


def test_files_that_name_rates_are_turns_of_a_rate_table_and_not_rests(tmp_path: Path):
    faces = [f"{sign}{axis}" for axis in "xyz" for sign in ("", "-")]
    names = [f"{face}_{rate}" for face in faces for rate in ("rest", "+30", "-30", "+90,5")]
    draft = drafted(rate_files(tmp_path, names), tmp_path)
    keys = chosen(draft)
    assert (keys["bench.kind"], keys["method.name"]) == ("rate_platform", "rates_and_poses")
    assert (keys["data.file"], keys["data.marks"]) == ("log_*.csv", "labels")
    assert sorted({abs(rate) for rate in draft.roles.rates}) == pytest.approx(
        np.radians([0.0, 30.0, 90.5])
    )
    assert draft.rests is not None
    assert len(draft.rests.spans) == len(faces)
    assert {one.name for one in draft.trials} == {"rates_and_poses"}


def test_files_that_only_name_rests_state_no_rates(tmp_path: Path):
    names = [f"{sign}{axis}_rest" for axis in "xyz" for sign in ("", "-")]
    roles = read_logs(rate_files(tmp_path, names), {}).roles
    assert roles.rates == ()
    assert roles.marks == "labels"


def test_a_column_of_row_numbers_is_not_an_accelerometer():
    head = {k: np.round(np.arange(36.0) * 10, 3) for k in ("angle_deg",)}
    columns = {
        "row": np.arange(1.0, 37.0),
        **head,
        "u_mV": 3 * np.sin(np.radians(head["angle_deg"])),
    }
    roles = recognise_columns(Table((*columns,), columns, "d.csv", "", 1, True))
    assert roles.triads["accelerometer"] == ("u_mV",)
    assert roles.single["angle"] == "angle_deg"
