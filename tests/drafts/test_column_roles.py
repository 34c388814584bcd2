"""Columns by names that common loggers write, by values, and as the user states them."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence

from inercal.basics.errors import InputError
from inercal.physics.frames import exp_so3
from inercal.pipeline.drafts import UnknownAccelerometers, draft_run_file
from inercal.pipeline.drafts.column_roles import ColumnRoles, recognise_columns
from inercal.pipeline.drafts.stated_keys import stated_values
from inercal.recordings.io.column_table import Column, Table

G = 8192.0  # LSB/g
PER_DEGREE = 32.8  # LSB/(°/s)
RATE = 50.0  # Hz


def table_of(data: np.ndarray, names: tuple[str, ...], *, header: bool = True) -> Table:
    columns = {name: data[:, k] for k, name in enumerate(names)}
    return Table(names, columns, "log.csv", "", 1, header)


def by_names(head: str) -> ColumnRoles:
    """Return the roles of a short table with this header; times are the columns that grow."""
    names = tuple(head.split(","))
    data = np.tile(np.arange(8.0)[:, None], (1, len(names)))
    return recognise_columns(table_of(data, names))


@pytest.mark.parametrize(
    ("head", "accelerometers", "gyros", "single"),
    [
        (
            "millis,AcX,AcY,AcZ,Tmp,GyX,GyY,GyZ",
            "AcX,AcY,AcZ",
            "GyX,GyY,GyZ",
            {"time": "millis", "temperature": "Tmp"},
        ),
        ("micros,ax,ay,az,gx,gy,gz,temp", "ax,ay,az", "gx,gy,gz", {"time": "micros"}),
        (
            "Time (s),Acceleration x (m/s^2),Acceleration y (m/s^2),Acceleration z (m/s^2)",
            "Acceleration x (m/s^2),Acceleration y (m/s^2),Acceleration z (m/s^2)",
            "",
            {"time": "Time (s)"},
        ),
        (
            "loggingTime(txt),motionUserAccelerationX(G),motionUserAccelerationY(G),"
            "motionUserAccelerationZ(G),accelerometerAccelerationX(G),accelerometerAccelerationY(G)"
            ",accelerometerAccelerationZ(G),motionRotationRateX(rad/s),motionRotationRateY(rad/s),"
            "motionRotationRateZ(rad/s)",
            "accelerometerAccelerationX(G),accelerometerAccelerationY(G),"
            "accelerometerAccelerationZ(G)",
            "motionRotationRateX(rad/s),motionRotationRateY(rad/s),motionRotationRateZ(rad/s)",
            {"time": "loggingTime(txt)"},
        ),
        (
            "PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,FreeAcc_E,Gyr_X,Gyr_Y,Gyr_Z,Mag_X",
            "Acc_X,Acc_Y,Acc_Z",
            "Gyr_X,Gyr_Y,Gyr_Z",
            {"time": "PacketCounter"},
        ),
        (
            "%time,field.header.seq,field.angular_velocity.x,field.angular_velocity.y,"
            "field.angular_velocity.z,field.linear_acceleration.x,field.linear_acceleration.y,"
            "field.linear_acceleration.z",
            "field.linear_acceleration.x,field.linear_acceleration.y,field.linear_acceleration.z",
            "field.angular_velocity.x,field.angular_velocity.y,field.angular_velocity.z",
            {"time": "%time"},
        ),
        (
            "timestamp,accelerometer_x,accelerometer_y,accelerometer_z,gyroscope_x,gyroscope_y,"
            "gyroscope_z,gravity_x,gravity_y,gravity_z",
            "accelerometer_x,accelerometer_y,accelerometer_z",
            "gyroscope_x,gyroscope_y,gyroscope_z",
            {"time": "timestamp"},
        ),
        (
            "GRAVITY X (m/s²),LINEAR ACCELERATION X (m/s²),LINEAR ACCELERATION Y (m/s²),LINEAR "
            "ACCELERATION Z (m/s²),ACCELEROMETER X (m/s²),ACCELEROMETER Y (m/s²),ACCELEROMETER Z "
            "(m/s²)",
            "ACCELEROMETER X (m/s²),ACCELEROMETER Y (m/s²),ACCELEROMETER Z (m/s²)",
            "",
            {},
        ),
        ("t_ms,XL_X,XL_Y,XL_Z,G_X,G_Y,G_Z", "XL_X,XL_Y,XL_Z", "G_X,G_Y,G_Z", {"time": "t_ms"}),
        (
            "us,Accel_X_mg,Accel_Y_mg,Accel_Z_mg,Gyro_X_dps,Gyro_Y_dps,Gyro_Z_dps",
            "Accel_X_mg,Accel_Y_mg,Accel_Z_mg",
            "Gyro_X_dps,Gyro_Y_dps,Gyro_Z_dps",
            {"time": "us"},
        ),
        ("accX_raw,accY_raw,accZ_raw,wx,wy,wz", "accX_raw,accY_raw,accZ_raw", "wx,wy,wz", {}),
        ("xAccel,yAccel,zAccel,xGyro,yGyro,zGyro", "xAccel,yAccel,zAccel", "xGyro,yGyro,zGyro", {}),
    ],
)
def test_names_of_common_loggers_are_known(
    head: str, accelerometers: str, gyros: str, single: dict[str, str]
):
    for written in (head, head.upper()):
        upper = written != head
        roles = by_names(written)
        expected = {"accelerometer": accelerometers, "gyro": gyros}
        found = {kind: ",".join(columns) for kind, columns in roles.triads.items()}
        if upper and ("loggingTime" in head or "xAccel" in head):
            continue  # words that only case divides
        assert found == {k: v.upper() if upper else v for k, v in expected.items() if v}
        assert {k: v.upper() if upper else v for k, v in single.items()}.items() <= (
            roles.single.items()
        )


@pytest.mark.parametrize(
    "head", ["mag_x,mag_y,mag_z", "roll,pitch,yaw", "lat,lon,alt", "price,volume,share"]
)
def test_other_quantities_are_no_sensors(head: str):
    assert not by_names(head).triads


@cache
def imu_log(seed: int = 2) -> np.ndarray:
    """Return counts of an IMU turned by hand between rests: time, 3 acc, temperature, 3 gyro."""
    rng = np.random.default_rng(seed)
    attitude, force, rate = np.eye(3), [], []
    for k in range(10):
        turn = np.eye(3)[k % 3] * np.deg2rad(85.0 + k) * (-1) ** (k // 3)
        force.append(np.tile(attitude[2], (150, 1)))
        rate.append(np.zeros((150, 3)))
        for _ in range(40):
            attitude = attitude @ exp_so3(turn / 40)
            force.append(attitude[2:3] + rng.normal(0, 0.1, (1, 3)))
            rate.append(np.degrees(turn[None]) / 40 * RATE)
    acc = G * np.concatenate(force) + [90, -130, 300]
    gyro = PER_DEGREE * np.concatenate(rate) + [35, -24, 14]
    n = len(acc)
    temperature = np.round(34.2 + np.linspace(0, 0.6, n), 1)
    sensors = np.rint(np.hstack([acc, gyro]) + rng.normal(0, 12, (n, 6)))
    millis = 481233 + 20 * np.arange(n)
    return np.column_stack([millis, sensors[:, :3], temperature, sensors[:, 3:]])


@pytest.mark.parametrize("header", [True, False])
@pytest.mark.parametrize(
    "columns", [range(8), (0, 1, 2, 3, 5, 6, 7), range(1, 8), (1, 2, 3, 5, 6, 7), (7, 6, 5, 3, 2)]
)
def test_values_tell_the_triads_where_names_do_not(columns: range | tuple[int, ...], header: bool):
    names = ("p", "q", "r", "s", "u", "v", "w", "z") if header else tuple("12345678")
    data = imu_log()
    chosen = tuple(names[k] for k in columns)
    roles = recognise_columns(table_of(data[:, list(columns)], chosen, header=header))
    if len(columns) < 6:
        assert "accelerometer" not in roles.triads or not header
        return
    assert roles.triads["accelerometer"] == names[1:4]
    assert roles.triads["gyro"] == names[5:8]
    assert roles.single.get("time") == (names[0] if 0 in columns else None)


def test_one_known_triad_leaves_the_other_to_its_values():
    data = imu_log()
    for head in ("t,a_x,a_y,a_z,k,l,m,n", "t,k,l,m,n,gx,gy,gz"):
        names = tuple(head.split(","))
        roles = recognise_columns(table_of(data, names))
        assert roles.triads == {"accelerometer": names[1:4], "gyro": names[5:8]}


def test_columns_of_one_letter_have_the_order_of_the_axes():
    data = imu_log()[:, [0, 3, 2, 1]]
    roles = recognise_columns(table_of(data, ("seconds_elapsed", "z", "y", "x")))
    assert roles.triads == {"accelerometer": ("x", "y", "z")}


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log.csv"
    data = imu_log()
    np.savetxt(path, data, fmt="%g", delimiter=",", header="p,q,r,s,u,v,w,volume", comments="")
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    "text", ["q,r,s", "[2, 3, 4]", evidence('["q", "r", "s"]'), evidence("[q, r, s]")]
)
def test_stated_columns_are_used(text: str, log: Path):
    stated = {"data.accelerometer": text, "data.gyro": "6,7,8", "data.temperature": "u"}
    draft = draft_run_file([log], log.with_name("run.toml"), stated)
    found = {one.name: one.value for one in draft.entries}
    assert found["[data] accelerometer"] == ["q", "r", "s"]
    assert found["[data] gyro"] == ["v", "w", "volume"]
    assert found["[data] temperature"] == "u"
    assert found["[data] time"] == "p"
    assert found["[data] time_unit"] == "ms"
    assert found["[sensor.accelerometer] scale"] == "8192 LSB/g"
    assert found["[sensor.gyro] scale"] == "32.8 LSB/(°/s)"


@pytest.mark.slow
def test_columns_without_use_are_named(log: Path):
    draft = draft_run_file([log], log.with_name("run.toml"))
    assert "not used: u" in draft.facts
    assert "8196.72" in draft.text  # the other nominal scale factor that is near


def test_unknown_accelerometers_are_asked_for_by_the_logs_own_names(tmp_path: Path):
    log = tmp_path / "log.csv"
    log.write_text("AX1,AX2,AX3\n1,2,3\n3,4,5\n", encoding="utf-8")
    with pytest.raises(UnknownAccelerometers) as caught:
        draft_run_file([log], tmp_path / "run.toml")
    assert caught.value.columns == ("AX1", "AX2", "AX3")
    assert """--set data.accelerometer='["AX1", "AX2", "AX3"]'""" in str(caught.value)


@pytest.mark.parametrize(
    ("key", "near"),
    [
        ("data.acelerometer", "data.accelerometer"),
        ("bench.lattitude", "bench.latitude"),
        ("sensor.acelerometer.unit", "sensor.accelerometer"),
        ("sensor.gyro.unti", "sensor.gyro.unit"),
    ],
)
def test_an_unknown_key_is_refused_with_the_nearest(key: str, near: str):
    with pytest.raises(InputError, match=near) as caught:
        stated_values({key: "1"})
    assert caught.value.names == (key,)


def test_values_have_the_types_of_their_keys():
    stated = {
        "sensor.gyro.offset": "0.5",
        "data.time": "1",
        "data.label": "part",
        "method.also": "g,k2",
        "data.sd.accelerometer": "30 µg",
        "sensor.name": "7",
    }
    assert list(stated_values(stated).values()) == [0.5, 1, "part", ["g", "k2"], "30 µg", "7"]


@pytest.mark.slow
def test_the_stated_method_is_the_only_one_tried(log: Path):
    stated = {"method.name": "six_position"}
    draft = draft_run_file([log], log.with_name("run.toml"), stated)
    assert [trial.name for trial in draft.trials] == ["six_position"]
    assert [one.value for one in draft.entries if one.name == "[method] name"] == ["six_position"]


def dated_table(step_s: float, rows: int, **texts: list[str]) -> Table:
    """Return a table of readings with a column of ISO dates, named Datum, and columns of text."""
    start = np.datetime64("2026-11-23T03:10:09.120")
    dates = start + (1000 * step_s * np.arange(rows)).astype("timedelta64[ms]")
    columns: dict[str, Column] = {"Datum": np.datetime_as_string(dates)}
    columns |= {name: np.array(values) for name, values in texts.items()}
    columns |= {axis: np.random.default_rng(k).normal(size=rows) for k, axis in enumerate("xyz")}
    return Table(tuple(columns), columns, "log.csv", "", 1, True)


POSES = [f"{axis}_{sign}" for axis in "zxy" for sign in "pa"]


def test_a_column_of_positions_is_the_label_before_dates_and_other_texts():
    table = dated_table(60.0, 6, Person=list("abcdef"), Lage=POSES)
    roles = recognise_columns(table)
    assert roles.means
    assert roles.single == {"label": "Lage"}


def test_dates_of_means_are_ignored_under_any_name():
    table = dated_table(60.0, 6)
    columns = {name.replace("Datum", "date"): one for name, one in table.columns.items()}
    for one in (table, Table(tuple(columns), columns, "log.csv", "", 1, True)):
        roles = recognise_columns(one)
        assert roles.means
        assert roles.triads["accelerometer"] == ("x", "y", "z")
        assert not roles.single


def test_iso_dates_in_equal_steps_are_the_time_under_any_name():
    assert recognise_columns(dated_table(0.02, 600)).single["time"] == "Datum"
    assert "time" not in recognise_columns(dated_table(2.0, 600)).single
