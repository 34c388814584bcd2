"""Forms of text logs, as exporters of phones, IMUs, flight controllers and sketches write them."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from tests.log_corpus.motion import Motion
from tests.log_corpus.text_forms import Form

A, W, AW = "a|a{x}", "w|g{x}", ("a|a{x}", "w|g{x}")
COARSE = np.radians(0.35)  # rad/s, noise of a gyro that is read in whole degrees per second


class TextCase(NamedTuple):
    """A form, how the sensor is moved, and the one answer that the data do not give."""

    form: Form
    motion: Motion = Motion()
    stated: Mapping[str, str] = {}


def _rate(hz: float) -> dict[str, str]:
    return {"data.rate": f"{hz:g} Hz"}


PHYPHOX = ("t|Time (s)", "a|Acceleration {x} (m/s^2)", "w|Gyroscope {x} (rad/s)")
PHONES: dict[str, TextCase] = {
    "phyphox": TextCase(
        Form(
            tuple(f'{one.partition("|")[0]}|"{one.partition("|")[2]}"' for one in PHYPHOX), digits=9
        ),
        Motion(hz=100),
    ),
    "phyphox tab": TextCase(Form(PHYPHOX, separator="\t", digits=9, suffix=".tsv"), Motion(hz=200)),
    "phyphox decimal comma": TextCase(Form(PHYPHOX, separator=";", comma=True, digits=9)),
    "physics toolbox": TextCase(
        Form(("t3|time", "a|gF{x}", "norm|TgF", "w|w{x}"), "g", "rad/s", digits=4),
        Motion(jitter=0.02),
    ),
    "physics toolbox with a clock": TextCase(
        Form(("clock|time", "a|gF{x}", "norm|TgF", "w|w{x}"), "g", "rad/s", digits=4)
    ),
    "androsensor": TextCase(
        Form(
            (
                "a|ACCELEROMETER {X} (m/s²)", "v|GRAVITY {X} (m/s²)",
                "l|LINEAR ACCELERATION {X} (m/s²)", "w|GYROSCOPE {X} (rad/s)",
                "m|MAGNETIC FIELD {X} (μT)", "e|ORIENTATION {X} (°)", "press|PRESSURE (hPa)",
                "ms|Time since start in ms ", "colons|YYYY-MO-DD HH-MI-SS_SSS",
            ),
            separator=";",
        ),
        Motion(hz=50),
    ),
    "sensorlog": TextCase(
        Form(
            (
                "isoz|loggingTime(txt)", "row|loggingSample(N)",
                "epoch|accelerometerTimestamp_sinceReboot(s)",
                "a|accelerometerAcceleration{X}(G)", "w|gyroRotation{X}(rad/s)",
                "l|motionUserAcceleration{X}(G)", "v|motionGravity{X}(G)",
                "e|motionAttitude{X}(rad)",
            ),
            "g",
        )
    ),
    "hyperimu": TextCase(
        Form(
            ("epoch_ms|Timestamp", "a|accelerometer.{x}", "w|gyroscope.{x}", "m|magnetometer.{x}"),
        ),
        Motion(hz=50, rests=20),
    ),
}  # fmt: skip

DEVICES: dict[str, TextCase] = {
    "xsens": TextCase(
        Form(
            (
                "u16|PacketCounter", "100us|SampleTimeFine", "unused|Year", "a|Acc_{X}",
                "w|Gyr_{X}", "m|Mag_{X}", "e|Roll_{X}", "hex|StatusWord",
            ),
            separator="\t",
            above=(
                "// Start Time: Unknown", "// Sample rate: 100.0Hz", "// Scenario: 4.9",
                "// Firmware Version: 4.0.2", "{head}",
            ),
            suffix=".txt",
        ),
        stated=_rate(100),
    ),
    "sbg": TextCase(
        Form(
            ("us|timestamp", "hex|status", "a|accel{X}", "w|gyro{X}", "temp|temp"),
            separator="\t",
            digits=6,
            below={"us": "(us)", "hex": "(na)", "a": "(m.s-2)", "w": "(rad.s-1)", "temp": "(degC)"},
            suffix=".txt",
        )
    ),
    "novatel counts": TextCase(
        Form(
            (
                "=2341|Week", "week_s|Seconds", "=77|Status", "a.z|{X} Accel", "a.y|-({X} Accel)",
                "a.x|{X} Accel", "w.z|{X} Gyro", "w.y|-({X} Gyro)", "w.x|{X} Gyro",
            ),
            counts=(20000.0, 2000.0),
        )
    ),
    "vectornav csv": TextCase(
        Form(
            ("late_t|TimeStartup", "a|Accel.{X}", "w|AngularRate.{X}", "m|MagField.{X}",
             "e|YawPitchRoll.{k}", "temp|Temperature", "press|Pressure")
        )
    ),
    "vectornav ascii": TextCase(
        Form(
            ("=$VNIMU|head", "m|m{x}", "a|a{x}", "w|w{x}", "temp|temp", "press|press"),
            header=False,
            suffix=".txt",
            digits=3,
            end="*6A",
        ),
        Motion(hz=40, accelerometer_noise=0.02),
        _rate(40),
    ),
    "witmotion": TextCase(
        Form(
            (
                "=0x50|address", "clock|Time(s)", "a|a{x}(g)", "w|w{x}(deg/s)", "e|Angle{X}(deg)",
                "temp|T(°)", "m|h{x}", "q|q0", "q0|q1",
            ),
            "g", "°/s", 4, "\t",
            above=("StartTime: 2026-11-29 12:00:01", "{head}"),
            suffix=".txt",
        ),
        Motion(hz=50),
    ),
    "witmotion new": TextCase(
        Form(
            (
                "spaced|Time", "=WT901BLE67|DeviceName", "a|Acceleration {X}(g)",
                "w|Angular velocity {X}(°/s)", "e|Angle {X}(°)", "m|Magnetic field {X}(ʯt)",
                "temp|Temperature(°C)", "q|Quaternions 0()", "q0|Quaternions 1()",
            ),
            "g", "°/s", 3, suffix=".txt",
        ),
        Motion(hz=50),
    ),
    "shimmer": TextCase(
        Form(
            (
                "epoch_ms|Shimmer_6749_Timestamp_Unix_CAL", "a|Shimmer_6749_Accel_LN_{X}_CAL",
                "w|Shimmer_6749_Gyro_{X}_CAL", "m|Shimmer_6749_Mag_{X}_CAL",
            ),
            "m/s²", "°/s", 6, "\t",
            above=('"sep=\t"', "{head}"),
            below={"epoch_ms": "ms", "a": "m/(s^2)", "w": "deg/s", "m": "local_flux"},
        )
    ),
    "movella dot": TextCase(
        Form(
            ("u16|PacketCounter", "us_wraps|SampleTimeFine", "e|Euler_{X}", "a|Acc_{X}",
             "w|Gyr_{X}", "m|Mag_{X}", "zero|Status"),
            gyro="°/s",
            digits=6,
            above=("sep=,", "DeviceTag:,Xsens DOT", "FirmwareVersion:,2.4.0", "AppVersion:,v2023.6",
                   "SyncStatus:,Synced", "OutputRate:,60Hz", "FilterProfile:,General",
                   "Measurement Mode:,Custom Mode 1", "StartTime:,2026-11-29_12-00-01", "{head}"),
        ),
        Motion(hz=60),
        _rate(60),
    ),
    "x-io": TextCase(
        Form(("us|Timestamp (us)", "w|Gyroscope {X} (deg/s)", "a|Accelerometer {X} (g)"),
             "g", "°/s", 6),
        Motion(hz=400, rests=14, still=1.6),
    ),
    "ngimu": TextCase(
        Form(("t|Time (s)", "w|Gyroscope {X} (deg/s)", "a|Accelerometer {X} (g)",
              "m|Magnetometer {X} (uT)", "press|Barometer (hPa)"), "g", "°/s", 6)
    ),
    "openimu": TextCase(
        Form(("row|sample", "t|time (s)", "a|{x}Accel", "w|{x}Rate", "m|{x}Mag"), gyro="°/s",
             digits=6)
    ),
    "openimu with units": TextCase(
        Form(("tms|timeITOW (ms)", "e|{x}_angle (deg)", "a|{x}_accel (m/s^2)",
              "w|{x}_rate (deg/s)", "temp|temp (C)"), gyro="°/s")
    ),
    "sensortile": TextCase(
        Form(("ms|T [ms]", "a|Acc{X} [mg]", "w|Gyro{X} [mdps]", "m|Mag{X} [mgauss]",
              "press|P [mB]", "temp|T ['C]", "zero|H [%]"), "mg", "m°/s", 0),
        Motion(hz=50),
    ),
    "stwin": TextCase(
        Form(("late_t|Time", "a|A_{x} [g]", "w|G_{x} [dps]"), "g", "°/s", 6),
        Motion(hz=208, rests=16, filter_hz=30),
    ),
    "bsx": TextCase(
        Form(("us|timestamp[us]", "a|acc_{x}[g]", "w|gyr_{x}[dps]", "m|mag_{x}[uT]"), "g", "°/s",
             4, ";", suffix=".dat")
    ),
    "betaflight": TextCase(
        Form(
            ('row|"loopIteration"', 'us|"time"', 'zero|"axisP[0]"', 'zero|"axisI[0]"',
             'zero|"rcCommand[0]"', 'w|"gyroADC[{k}]"', 'a|"accSmooth[{k}]"', 'zero|"motor[0]"'),
            counts=(2048.0, 1.0),
            above=('"Product","Blackbox flight data recorder by Nicholas Sherlock"',
                   '"firmwareType","Cleanflight"', '"looptime","125"', '"acc_1G","2048"', "{head}"),
        ),
        Motion(hz=250, rests=14, gyro_noise=COARSE),
        {"sensor.gyro.unit": "°/s"},
    ),
    "opensignals": TextCase(
        Form(("row|nSeq", "a|ACC_{X}", "w|GYR_{X}"), "g", "°/s", 5, "\t", suffix=".txt",
             above=("# OpenSignals Text File Format", "# EndOfHeader", "{head}")),
        stated=_rate(100),
    ),
    "axivity": TextCase(
        Form(("spaced|Time", "a|Accel-{X} (g)", "temp1|Temp (C)", "w|Gyro-{X} (d/s)"), "g", "°/s")
    ),
    "inertial sense": TextCase(
        Form(("week_s|time", "w|pqr[{k}]", "a|acc[{k}]"), digits=7),
        Motion(hz=125, filter_hz=40),
    ),
    "apdm": TextCase(
        Form(("epoch_us|Time", "a|Accelerometer {X} (m/s^2)", "w|Gyroscope {X} (rad/s)",
              "m|Magnetometer {X} (uT)", "press|Barometer (kPa)", "temp|Temperature (C)")),
        Motion(hz=128),
    ),
    "microstrain": TextCase(
        Form(("epoch_ns|Time", "a|{X} Accel [x8004]", "w|{X} Gyro [x8005]"), "g", digits=6,
             above=("SESSION_INFO", "Session Name,Session", "Timestamp,2026-11-29", "DATA_START",
                    "{head}")),
    ),
}  # fmt: skip

ROBOTS: dict[str, TextCase] = {
    "euroc": TextCase(
        Form(("epoch_ns|#timestamp [ns]", "w|w_RS_S_{x} [rad s^-1]", "a|a_RS_S_{x} [m s^-2]"),
             digits=8),
        Motion(hz=200, rests=16, filter_hz=60),
    ),
    "tum-vi": TextCase(
        Form(("epoch_ns|timestamp [ns]", "w|w_RS_S_{x} [rad s^-1]", "a|a_RS_S_{x} [m s^-2]",
              "temp|temperature [degree]"), digits=8),
        Motion(hz=200, rests=16),
    ),
    "rostopic": TextCase(
        Form(
            ("epoch_ns|%time", "u32|field.header.seq", "epoch_ns|field.header.stamp",
             "=imu_link|field.header.frame_id", "q|field.orientation.x", "q0|field.orientation.y",
             "zero|field.orientation.z", "q0|field.orientation.w",
             "=-1|field.orientation_covariance0", "w|field.angular_velocity.{x}",
             "zero|field.angular_velocity_covariance0", "a|field.linear_acceleration.{x}",
             "zero|field.linear_acceleration_covariance0"),
            digits=9,
        )
    ),
    "kitti": TextCase(
        Form(("=49.0150|lat", "=8.4343|lon", "=112.8|alt", "e|r{x}", "zero|vn", "zero|ve",
              "a|a{x}", "w|w{x}", "=0.6|acc", "=4|stat"),
             separator=" ", header=False, suffix=".txt", digits=7),
        Motion(hz=100),
        _rate(100),
    ),
    "plotjuggler": TextCase(
        Form(("epoch|__time", "q|/imu/data/orientation/x", "a|/imu/data/linear_acceleration/{x}",
              "w|/imu/data/angular_velocity/{x}"))
    ),
    "openlog artemis": TextCase(
        Form(("date|rtcDate", "clock|rtcTime", "a|a{X}", "w|g{X}", "m|m{X}", "temp|imu_degC",
              "=100.0|output_Hz"), "mg", "°/s", 2),
        stated=_rate(100),
    ),
    "openlog micros": TextCase(
        Form(("us_wraps|micros", "a|a{X}", "w|g{X}", "temp|imu_degC"), "mg", "°/s", 2)
    ),
}  # fmt: skip

_LABELLED = ("ax:", "ay:", "az:", "gx:", "gy:", "gz:")
_SENTENCE = ("Acceleration X: ", "Y: ", "Z: ", "Rotation X: ", "Y: ", "Z: ")
SKETCHES: dict[str, TextCase] = {
    "serial plotter": TextCase(
        Form(AW, "g", "°/s", 3, joined=_LABELLED, header=False, suffix=".txt"), stated=_rate(100)
    ),
    "serial plotter tabs": TextCase(
        Form(AW, "m/s²", "rad/s", 4, "\t", joined=_LABELLED, header=False, suffix=".txt"),
        Motion(hz=50), _rate(50),
    ),
    "a/g": TextCase(
        Form(AW, separator="\t", begin="a/g:\t", header=False, suffix=".txt", counts=(16384, 131)),
        stated=_rate(100),
    ),
    "serial monitor": TextCase(
        Form(AW, "m/s²", "°/s", 3, begin="12:01:02.123 -> ", header=False, suffix=".txt"),
        stated=_rate(100),
    ),
    "bare counts": TextCase(
        Form(("ms|ms", *AW), separator=" ", header=False, suffix=".txt", counts=(4096, 65.5))
    ),
    "sentence": TextCase(
        Form(AW, "m/s²", "rad/s", 4, ", ", joined=_SENTENCE, header=False, suffix=".txt",
             end=" rad/s"),
        stated=_rate(100),
    ),
    "equal signs": TextCase(
        Form(("ms|t", *AW), "g", "°/s", 3, "\t", header=False, suffix=".txt",
             joined=("t = ", "ax = ", "ay = ", "az = ", "gx = ", "gy = ", "gz = "))
    ),
    "json lines": TextCase(
        Form(
            ("ms|t", *AW), "g", "°/s", 3, begin="{", end="}", header=False, suffix=".jsonl",
            joined=('"t": ', '"ax": ', '"ay": ', '"az": ', '"gx": ', '"gy": ', '"gz": '),
        )
    ),
    "tuples": TextCase(
        Form(AW, "m/s²", "rad/s", 4, ", ", begin="(", end=")", header=False, suffix=".txt"),
        stated=_rate(100),
    ),
    "lists": TextCase(
        Form(("t|t", *AW), "m/s²", "°/s", 4, begin="[", end="]", header=False, suffix=".log"),
    ),
    "table with bars": TextCase(Form(("ms|t", *AW), "g", "°/s", 4, " | ", suffix=".log")),
    "centimetres": TextCase(
        Form(("ms|ms", "a|acc_{x} (cm/s^2)", "w|gyro_{x} (mrad/s)"), "Gal", "mrad/s", 1)
    ),
    "bars": TextCase(
        Form(("a|Ac{X}", "w|Gy{X}"), separator=" | ", header=False, suffix=".txt",
             joined=("AcX = ", "AcY = ", "AcZ = ", "GyX = ", "GyY = ", "GyZ = "),
             counts=(16384, 131)),
        stated=_rate(100),
    ),
    "mpu6050": TextCase(
        Form(("ms|millis", "a|Ac{X}", "temp|Tmp", "w|Gy{X}"), counts=(16384, 131))
    ),
    "2 g, 250": TextCase(Form(("ms|ms", *AW), counts=(16384, 131)), Motion(hz=50)),
    "4 g, 500": TextCase(Form(("us|us", *AW), counts=(8192, 65.5)), Motion(hz=125)),
    "8 g, 1000": TextCase(Form(("t|t", *AW), counts=(4096, 32.8))),
    "16 g, 2000": TextCase(Form(("ms|millis", *AW), counts=(2048, 16.4))),
    "lsm6ds3": TextCase(
        Form(("ms|millis", "a|XL_{X}", "w|G_{X}"), counts=(1000 / 0.061, 1000 / 8.75))
    ),
    "unsigned": TextCase(Form(("ms|millis", *AW), counts=(8192, 65.5), unsigned=True)),
    "bno055": TextCase(
        Form(("ms|t_ms", "a|acc_{x}", "w|gyr_{x}", "e|eul_{x}", "q|qw", "q0|qx", "temp1|temp"),
             "m/s²", "°/s", 2),
        Motion(hz=100),
    ),
    "icm20948": TextCase(
        Form(("ms|time", "a|Accel_{X}_mg", "w|Gyr_{X}_DPS", "m|Mag_{X}_uT", "temp|Tmp_C"),
             "mg", "°/s", 2)
    ),
}  # fmt: skip

CLOCKS: dict[str, TextCase] = {
    "8 bits": TextCase(Form(("u8|counter", *AW), "g", "°/s"), stated=_rate(100)),
    "16 bits": TextCase(Form(("u16|cnt", *AW), "g", "°/s"), stated=_rate(100)),
    "32 bits": TextCase(Form(("u32|packet_id", *AW), "g", "°/s"), stated=_rate(100)),
    "µs wrap": TextCase(Form(("us_wraps|micros", *AW), "g", "°/s")),
    "ms wrap": TextCase(Form(("ms_wraps|millis", *AW), "g", "°/s"), Motion(hz=50)),
    "ms of 16 bits": TextCase(Form(("ms16|ms", *AW), "g", "°/s"), Motion(hz=50, rests=30)),
    "iso": TextCase(Form(("iso|datetime", *AW), "g", "°/s")),
    "epoch s": TextCase(Form(("epoch|time", *AW), "m/s²", "°/s"), Motion(rests=28)),
    "epoch ms": TextCase(Form(("epoch_ms|ts", *AW)), Motion(hz=25, rests=24)),
    "epoch µs": TextCase(Form(("epoch_us|unix", *AW), "mg", "m°/s", 1)),
    "last column": TextCase(
        Form(("temp|temp", "w.zxy|g{x}", "m|mag{x}", "a.yzx|a{x}", "q|qw", "t|t"), "g", "°/s")
    ),
    "reversed names": TextCase(
        Form(("w|omega_{x}", "q|q_w", "a|f_{x}", "e|euler_{x}", "epoch_ns|stamp_ns"))
    ),
    "row of units": TextCase(
        Form(("t|time", "a|acc {x}", "w|gyro {x}"), "g", "°/s",
             below={"t": "[s]", "a": "[g]", "w": "[deg/s]"})
    ),
    "decimal comma dat": TextCase(
        Form(("ms|Zeit [ms]", "a|a{x}", "w|w{x}"), "g", "°/s", 4, ";", comma=True, suffix=".dat",
             newline="\r\n")
    ),
    "coarse gyro": TextCase(
        Form(("ms|ms", *AW), "g", "°/s", 2), Motion(gyro_noise=1e-4, accelerometer_noise=3e-3)
    ),
    "low noise": TextCase(
        Form(("t|t", *AW), "g", "°/s", 7),
        Motion(hz=400, rests=14, gyro_noise=np.radians(0.01), accelerometer_noise=2e-3, still=1.6),
    ),
    "filtered 10 Hz": TextCase(Form(("t|t", *AW), "g", "°/s"), Motion(hz=200, filter_hz=10)),
    "many rests": TextCase(Form(("t|t", *AW), "g", "°/s"), Motion(hz=50, rests=30)),
    "labels": TextCase(Form(("t|t", "label|label", *AW), "g", "°/s"), Motion(faces=True)),
    "labels and poses": TextCase(Form(("t|t", "label|pose", *AW), "g", "°/s"), Motion(hz=50)),
    "six faces": TextCase(
        Form(("t|t", *AW, "temp|temp"), "g", "°/s"), Motion(faces=True, still=4.0)
    ),
    "six faces of accelerometers": TextCase(
        Form(("ms|ms", A), counts=(1024, 1)), Motion(faces=True, hz=25, still=5.0)
    ),
}  # fmt: skip
