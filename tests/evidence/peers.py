"""What other programs find on the same recordings, with the uncertainty of inercal beside it.

imucal and allantools run here; the algorithm of imu_tk is written anew (`imu_tk_algorithm`), and
its authors' program, or the paper of a recording, is quoted from the folders of the data.

`python -m tests.evidence.peers` works out all of it, and writes docs/evidence/peers.json and the
page beside it. It needs the public recordings.
"""

import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import allantools
import imucal
import numpy as np
import pandas as pd
from tests.accuracy.test_ferraris_recordings import run_file as ferraris_run_file
from tests.accuracy.test_hand_held_recordings import upper
from tests.evidence import imu_tk_algorithm as imu_tk
from tests.evidence.stored_counts import FOLDER
from tests.evidence.stored_runs import write_page

import inercal
from inercal.calibration import Calibration
from inercal.recordings.samples import Recording

ROOT = Path(__file__).parents[2]
DATA, PAGE = FOLDER / "peers.json", FOLDER / "peers.md"
Array = np.ndarray[Any, np.dtype[np.float64]]

RATES_AND_TURNS = {"A": (102.4, -360), "B": (204.8, 360)}  # Hz, °
# Printed by imu_tk for its own recording, and in the papers, as the folders of the data quote them.
PUBLISHED = {  # scale factors and offsets of accelerometers, scale factors of gyros
    "xsens": (
        (414.459, 412.010, 414.649),
        (33124.18, 33275.18, 32364.42),
        (4777.96, 4764.21, 4773.66),
    ),
    "mpu9150": ((1.00363, 1.00315, 1.00647), (0.103, 0.097, 0.344), (1.00041, 1.00457, 1.00826)),
}
HAND_HELD = {"xsens": "Xsens MTi, by hand", "mpu9150": "MPU-9150, by hand"}
SEED, NOISE, RATE, LONG = 5, 0.3, 100.0, 1_000_000  # N is 0.3 °/√h


class Row(NamedTuple):
    """One quantity of a recording: what the peer finds, and inercal with its U (k = 2)."""

    recording: str
    quantity: str
    unit: str
    peer: str
    theirs: float
    published: float | None
    ours: float
    expanded: float


def data_folder() -> Path:
    """Return where the public recordings lie, as the tests find them."""
    return Path(os.environ.get("INERCAL_DATA", ROOT.parent / "shared" / "data"))


def ferraris_rows(session: str, scratch: Path, data: Path) -> Iterator[Row]:
    """Compare scale factors and biases of a session with those of imucal, in output units."""
    rate, turn = RATES_AND_TURNS[session]
    folder = data / "ferraris_imucal"
    if session == "A":
        table = pd.read_csv(folder / "example_ferraris_session.csv")
        parts = json.loads((folder / "example_ferraris_session_list.json").read_text())
        regions = imucal.ferraris_regions_from_section_list(table, pd.DataFrame(parts).T)
    else:
        table = pd.read_csv(folder / "annotated_session.csv").set_index(["part", "samples"])
        regions = imucal.ferraris_regions_from_df(table)
    units_of = ("m/s^2", "deg/s") if session == "A" else ("a.u.", "a.u.")
    peer = imucal.FerrarisCalibration(expected_angle=-360)
    theirs = peer.compute(
        regions, sampling_rate_hz=rate, from_acc_unit=units_of[0], from_gyr_unit=units_of[1]
    )
    run_file = ferraris_run_file(folder, scratch, session, turn).path
    found = inercal.calibrate(run_file).calibration
    for kind, letter, k1, k0 in (("a", "a", "k1", "k0"), ("g", "g", "scale", "bias")):
        for i, axis in enumerate("xyz"):
            scale, bias, u_scale, u_bias = axis_terms(found, f"{letter}{axis}", k1, k0)
            if letter == "g":  # imucal's turns are degrees
                scale, u_scale = scale * np.pi / 180, u_scale * np.pi / 180
            name = f"imucal, session {session}"
            unit = {"a": "m/s²", "g": "°/s"}[kind]
            output = {"A": unit, "B": "LSB"}[session]
            ratio = "1" if session == "A" else f"LSB/({unit})"
            K = np.diag(getattr(theirs, f"K_{kind}"))
            b = getattr(theirs, f"b_{kind}")
            yield Row(name, f"{letter}{axis} scale", ratio, "imucal", K[i], None, scale, u_scale)
            yield Row(name, f"{letter}{axis} bias", output, "imucal", b[i], None, bias, u_bias)


def axis_terms(found: Calibration, axis: str, k1: str, k0: str) -> tuple[float, ...]:
    """Return the norm of an axis' row, its bias, and U of both, in output units."""
    readout = {one.name: one.readout for one in found.sensor.axes}[axis]
    names = found.sensor.coefficients
    cross = [found.value(f"{axis}.{d}") for d in ("delta_o", "delta_p") if f"{axis}.{d}" in names]
    scale = readout.scale * np.linalg.norm([1 + found.value(f"{axis}.{k1}"), *cross])
    bias = readout.scale * found.value(f"{axis}.{k0}")
    u = [2 * readout.scale * found.uncertainty(f"{axis}.{name}") for name in (k1, k0)]
    return float(scale), float(bias), *u


def forward(found: Calibration, letter: str, k1: str) -> Array:
    """Return the forward matrix of a triad, output per SI unit."""
    readouts = {one.name: one.readout for one in found.sensor.axes}
    values = dict(zip(found.sensor.coefficients, found.values, strict=True))
    matrix = np.eye(3)
    for k, axis in enumerate("xyz"):
        p, o = (k + 1) % 3, (k + 2) % 3
        matrix[k, k] += values[f"{letter}{axis}.{k1}"]
        matrix[k, p] = values.get(f"{letter}{axis}.delta_o", 0.0)
        matrix[k, o] = -values.get(f"{letter}{axis}.delta_p", 0.0)
        matrix[k] *= readouts[f"{letter}{axis}"].scale
    return matrix


def hand_held_rows(name: str, scratch: Path, data: Path) -> Iterator[Row]:
    """Compare what the algorithm of imu_tk finds in a recording made by hand."""
    if name == "xsens":
        folder = data / "xsens_mti_multiposition"
        accelerations = np.loadtxt(folder / "xsens_acc.mat")
        rates = np.loadtxt(folder / "xsens_gyro.mat")[:, 1:]
        time, a, g, first = accelerations[:, 0], accelerations[:, 1:], 9.81744, 5000
        start = imu_tk.Triad(np.eye(3) / 415, np.full(3, 32768.0))
        gyro_start = imu_tk.Triad(np.eye(3) / 4770, np.zeros(3))
    else:
        table = np.loadtxt(data / "mpu9150_multiposition" / "imu0.log")
        a, rates, g, first = table[:, :3], table[:, 3:6], 9.81, 500
        time = np.arange(len(table)) / 100
        start = gyro_start = imu_tk.Triad(np.eye(3), np.zeros(3))
    theirs, spans = imu_tk.accelerometers(a, first, g, start)
    felt = (a - theirs.offset) @ theirs.matrix.T
    their_gyros = imu_tk.gyros(rates, time, first, felt, spans, gyro_start)
    run_file = scratch / f"{name}.toml"
    text = (ROOT / "examples" / "hand_held" / f"{name}.toml").read_text(encoding="utf-8")
    run_file.write_text(text.replace("../../../shared/data", str(data.resolve())), "utf-8")
    found = inercal.calibrate(run_file, also="auto").calibration
    scales = np.diag(upper(forward(found, "a", "k1")))
    _, offsets = found.affine_correction()
    readouts = {one.name: one.readout for one in found.sensor.axes}
    printed, title, peer = PUBLISHED[name], HAND_HELD[name], "algorithm of imu_tk"
    counts = name == "xsens"
    for i, axis in enumerate("xyz"):
        scale = readouts[f"a{axis}"].scale
        u = 2 * found.uncertainty(f"a{axis}.k1") * scale
        unit = "LSB/(m/s²)" if counts else "1"
        row = Row(title, f"a{axis} scale", unit, peer, theirs.inverse_scale[i], printed[0][i],
                  scales[i], u)  # fmt: skip
        yield row
        u = 2 * found.uncertainty(f"a{axis}.k0") * scale
        unit = "LSB" if counts else "m/s²"
        yield Row(title, f"a{axis} offset", unit, peer, theirs.offset[i], printed[1][i],
                  offsets[i], u)  # fmt: skip
    gyro_scales = np.diag(forward(found, "g", "scale"))
    for i, axis in enumerate("xyz"):
        u = 2 * found.uncertainty(f"g{axis}.scale") * readouts[f"g{axis}"].scale
        quoted = printed[2][i]
        inverse = their_gyros.inverse_scale[i]
        unit = "LSB/(rad/s)" if counts else "1"
        yield Row(title, f"g{axis} scale", unit, peer, inverse, quoted, gyro_scales[i], u)


def noise_row() -> Row:
    """Compare N of a simulated recording at rest with the Allan deviation of allantools."""
    drawn = np.random.default_rng(SEED).standard_normal(LONG) * NOISE / 60 * np.sqrt(RATE)
    time = np.arange(LONG) / RATE
    recording = Recording(time, drawn[:, None], ("gx",), ("°/s",))
    _, deviations, _, _ = allantools.oadev(drawn, RATE, "freq", [1 / RATE])
    found = inercal.analyse_noise(recording, kinds=()).channels[0].coefficient("N")
    assert found is not None
    theirs = float(deviations[0]) * 60 / np.sqrt(RATE)
    name = "simulated white noise, 10⁶ samples"
    return Row(
        name,
        "N",
        found.unit,
        "allantools",
        theirs,
        NOISE,
        found.value / found.size,
        2 * found.u / found.size,
    )


def work_out() -> list[Row]:
    """Return the rows of all recordings."""
    with tempfile.TemporaryDirectory() as name:
        scratch, data = Path(name), data_folder()
        return [
            *ferraris_rows("A", scratch, data),
            *ferraris_rows("B", scratch, data),
            *hand_held_rows("xsens", scratch, data),
            *hand_held_rows("mpu9150", scratch, data),
            noise_row(),
        ]


def stored() -> list[Row]:
    """Return the rows that the page shows."""
    return [Row(**row) for row in json.loads(DATA.read_text(encoding="utf-8"))]


def digits(value: float, expanded: float) -> str:
    """Return a value with as many decimals as two digits of U have."""
    return f"{value:.{max(0, 1 - int(np.floor(np.log10(expanded))))}f}"


def page(rows: list[Row]) -> str:
    """Return the page of the comparison."""
    lines = [
        "# Compared with other programs",
        "",
        "Written by `python -m tests.evidence.peers`; do not edit. Each row states what another",
        "program and inercal find in the same recording. imucal 2.6.0 and allantools were run. The",
        "algorithm of imu_tk was written anew from its paper, without code of imu_tk or inercal.",
        "The column *published* contains the results of imu_tk itself for the Xsens recording, of",
        "the paper of the MPU-9150 recording (Mikov, Reginya, Moschevikin, ICINS 2020), and the",
        "true value of the simulated noise. U (k = 2) is that of inercal; the other programs state",
        "no uncertainty. The last column is the difference between inercal and the other program,",
        "divided by U.",
        "",
        "The differences of more than U concern gyros in recordings by hand, and have two causes:",
        "the algorithm of imu_tk takes the mean of the first rest as the bias, and its model has",
        "no sensitivity of the gyros to acceleration. In the Xsens recording this sensitivity is",
        "significant. Without it, inercal finds 4781, 4768 and 4768 LSB/(rad/s) with a U of 7 to",
        "10 LSB/(rad/s), and all differences are smaller than U. In the MPU-9150 recording, the",
        "largest difference decreases from 2.2 U to 1.5 U if the algorithm fits the biases too;",
        "from the published value it is 0.9 U.",
        "",
        "inercal was not compared with PSINS and Kalibr, because no recordings with results of",
        "these programs were available, nor with pyins, which could not be installed. The",
        "formulas of Kalibr are tested with the files that inercal exports.",
        "",
        "| recording | quantity | unit | program | it finds | published | inercal | U | off / U |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        published = "" if row.published is None else digits(row.published, row.expanded)
        values = [digits(v, row.expanded) for v in (row.theirs, row.ours, row.expanded)]
        off = (row.ours - row.theirs) / row.expanded
        lines.append(
            f"| {row.recording} | {row.quantity} | {row.unit} | {row.peer} | {values[0]} "
            f"| {published} | {values[1]} | {values[2]} | {off:+.2f} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    found = work_out()
    text = json.dumps([row._asdict() for row in found], ensure_ascii=False, indent=1)
    DATA.write_text(text + "\n", encoding="utf-8")
    write_page(PAGE, page(found))
