"""Calibration files, registers and pairs of them that cannot be used."""

from tests.bad_inputs.bad_input import BadInput, Change, rehashed, swap

TRIAD, IMU = "@run.calibration.json", "@imu.calibration.json"
APPLY = f"apply {TRIAD} @run.toml --out @c.csv"
NAME = "run.calibration.json"
STORE = "--register @reg.db"


def changed(change: Change, *words: str) -> BadInput:
    """Return a calibration with a change, applied."""
    return BadInput(APPLY, (NAME, *words), {NAME: change})


CASES: dict[str, BadInput] = {
    "no byte": changed(b"", "empty"),
    "half": changed(lambda text: text[: len(text) // 2], "line", "damaged"),
    "UTF-16": changed(lambda text: text.encode("utf-16"), "JSON"),
    "marks of a conflict": changed(swap('"method"', '<<<<<<< HEAD\n"method"'), "line"),
    "a list around it": changed(lambda text: f"[{text}]", "schema"),
    "a later schema": changed(swap("calibration/2", "calibration/3"), "calibration/3"),
    "a value changed by hand": changed(swap('"value": ', '"value": 1'), "changed"),
    "a variance of zero beside a deviation": changed(
        rehashed(lambda c: c["covariance"][0].__setitem__(0, 0.0)), "covariance"
    ),
    "a negative variance": changed(
        rehashed(lambda c: c["covariance"][1].__setitem__(1, -1e-9)), "covariance"
    ),
    "no sensor": changed(rehashed(lambda c: c.pop("sensor")), "sensor"),
    "numbers as text": changed(
        rehashed(lambda c: c["coefficients"][0].update(value="0.3")), "coefficients[0].value"
    ),
    "another kind of JSON": BadInput("show @marks.json", ("marks.json", "no schema")),
    "exchanged arguments": BadInput(f"apply @run.toml {TRIAD} --out @c.csv", ("run.toml",)),
    "a point outside": BadInput(
        ("predict", TRIAD, "--at", "f = 3 g, 0, 0"), ("ax", "--extrapolate")
    ),
    "the log": BadInput("apply @log.csv @run.toml --out @c.csv", ("log.csv", "calibration")),
    "a device": BadInput("apply /dev/null @run.toml --out @c.csv", ("/dev/null",)),
    "six axes to three": BadInput(f"apply {IMU} @run.toml --out @c.csv", ("log.csv", "'gx'")),
    "three axes to counts": BadInput(
        f"apply {TRIAD} @imu.toml --out @c.csv", ("imu.csv", "ax", "LSB")
    ),
    "applied to means": BadInput(
        f"apply {TRIAD} @means.toml --out @c.csv", ("means.toml", "[data] kind")
    ),
    "applied to another readout": BadInput(
        APPLY,
        ("log.csv", "gravity"),
        {"run.toml": swap('unit = "g"', 'unit = "LSB"\nscale = "2048 LSB/g"')},
    ),
    "applied onto the recording": BadInput(
        f"apply {TRIAD} @run.toml --out @log.csv --force", ("log.csv",)
    ),
    "applied onto itself": BadInput(
        f"apply {TRIAD} @run.toml --out {TRIAD} --force", (NAME, ".csv")
    ),
    "applied into a folder": BadInput(f"apply {TRIAD} @run.toml --out @", ("folder",)),
    "applied into a file of MATLAB": BadInput(
        f"apply {TRIAD} @run.toml --out @c.mat", ("c.mat", ".csv")
    ),
    "applied below a file": BadInput(
        f"apply {TRIAD} @run.toml --out @log.csv/c.csv", ("log.csv/c.csv",)
    ),
    "a name that is too long": BadInput(
        f"apply {TRIAD} @run.toml --out @{'c' * 300}.csv", ("too long",)
    ),
    "a name that is no UTF-8": BadInput(
        f"apply {TRIAD} @run.toml --out @c\udcff.csv", ("c\\udcff.csv", "UTF-8")
    ),
    "sensors of other readouts": BadInput(
        f"compare {TRIAD} {IMU}", (NAME, "imu.calibration.json", "ax")
    ),
    "compared with a recording": BadInput(f"compare @log.csv {TRIAD}", ("log.csv",)),
    "compared with nothing": BadInput(f"compare {TRIAD}", ("'second'",)),
    "two sensors of a register": BadInput(
        f"store diff 1 {IMU} {STORE}", ("imu.calibration.json", "ax")
    ),
    "no number of a register": BadInput(f"store show 99 {STORE}", ("#99", "#1")),
    "no sensor of a register": BadInput(f"store history nope {STORE}", ("'nope'", "'triad 3'")),
    "a gyro of a triad": BadInput(
        ("store", "history", "triad 3", "gx.bias", *STORE.split()), ("gx.bias", "ax, ay, az")
    ),
    "a page as PDF": BadInput(
        ("store", "history", "triad 3", "--out", "@h.pdf", *STORE.split()), ("h.pdf", ".html")
    ),
    "a folder as register": BadInput("store list --register @", ("register", "folder")),
    "the log as register": BadInput("store list --register @log.csv", ("log.csv", "SQLite")),
    "bytes of no register": BadInput(
        f"store list {STORE}",
        ("reg.db", "SQLite"),
        {"reg.db": b"SQLite format 3\0" + bytes(84) + b"x"},
    ),
    "a register of another server": BadInput("store list --register mysql://a/b", ("mysql",)),
    "a date without a month": BadInput(
        f"store import {IMU} --measured 2026-13-01 {STORE}", ("2026-13-01",)
    ),
    "one date for two": BadInput(
        f"store import {IMU} {TRIAD} --measured 2026-01-01 {STORE}", ("--measured",)
    ),
    "the run file into a register": BadInput(f"store import @run.toml {STORE}", ("run.toml",)),
    "an edited file into a register": BadInput(
        f"store import {IMU} {STORE}",
        ("imu.calibration.json", "changed"),
        {"imu.calibration.json": swap('"value": ', '"value": 1')},
    ),
}
