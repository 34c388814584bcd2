"""Calibrate one sensor by all methods, to test whether the results agree within their U.

Every method calibrates the same simulated IMU in a separate laboratory, whose bench has errors as
stated in its run file. The run files and the sensor are in `laboratories`.
"""

from collections.abc import Mapping, Sequence
from importlib.resources import files
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from inercal.basics.parallel import Executor, in_order
from inercal.calibration import Calibration
from inercal.calibration.comparison import compare
from inercal.pipeline import calibrate, simulate_files
from inercal.recordings.io.write import write_recordings
from inercal.runfile import read
from inercal.studies import study
from inercal.studies.claim import shown

TEXT = study.read_section_text(__name__, "agreement")
LABORATORIES = (
    "six_position",
    "ferraris",
    "multi_position",
    "centrifuge_norm",
    "rates_and_poses",
    "turntable_kalman",
    "systematic",
)
TRIALS_PER_SENSOR, FEWEST = 80, 6
LEAST_P = 1e-3
_ACCELEROMETERS_ALONE = ("centrifuge_norm",)
_SIZES = {
    "k0": (5.0, "mg"),
    "k1": (2000.0, "ppm"),
    "bias": (30.0, "°/h"),
    "scale": (2000.0, "ppm"),
    "delta_o": (10.0, "′"),
    "delta_p": (10.0, "′"),
}
"""Standard deviations of the true coefficients."""
_TRIANGULAR = ("ax.delta_o", "ax.delta_p", "ay.delta_o")
"""True values that are zero, because every laboratory uses the accelerometers' body frame."""


class PairTest(NamedTuple):
    """χ² of the difference between two calibrations, its degrees of freedom and p."""

    chi2: float
    dof: int
    p_value: float


Pair = tuple[str, str]


def run(trials: int, seed: int, say: study.MessageCallback, executor: Executor) -> study.Study:
    """Compute the study; see `inercal.studies.reproduce`."""
    sensors = max(trials // TRIALS_PER_SENSOR, FEWEST)
    indices = [executor.submit(compare_pairs, seed, k) for k in range(sensors)]
    found: list[Mapping[Pair, PairTest]] = []
    for one in in_order(executor, indices[0]):
        found.append(one)
        say(f"sensor {len(found)} of {sensors} through {len(LABORATORIES)} laboratories")
    return study.build_study(
        __name__, [section(found)], sensors=sensors, seed=seed, laboratories=", ".join(LABORATORIES)
    )


def compare_pairs(seed: int, k: int) -> Mapping[Pair, PairTest]:
    """Test how well each pair of laboratories agrees on sensor number `k` for a seed."""
    made = calibrations(seed, k)
    found: dict[Pair, PairTest] = {}
    for pair in combinations(LABORATORIES, 2):
        joint = compare(*(made[name] for name in pair)).joint_test
        # All laboratories find the biases and scale factors of the accelerometers.
        assert joint is not None
        found[pair] = PairTest(joint.chi2, joint.rank, joint.p_value)
    return found


def calibrations(seed: int, k: int) -> dict[str, Calibration]:
    """Return each laboratory's calibration of sensor number `k` for a seed."""
    truth = draw_truth(np.random.default_rng((seed, k)))
    made: dict[str, Calibration] = {}
    with TemporaryDirectory() as name:
        folder = Path(name)
        path = files("inercal").joinpath("demo_path.csv").read_text(encoding="utf-8")
        (folder / "path.csv").write_text(path, encoding="utf-8")
        for i, laboratory in enumerate(LABORATORIES):
            run_file = folder / f"{laboratory}.toml"
            run_file.write_text(run_file_text(laboratory, truth), encoding="utf-8")
            run = read(run_file)
            noise_seed = int(np.random.SeedSequence((seed, k, i)).generate_state(1)[0])
            recordings = simulate_files(run, noise_seed)
            write_recordings({run.file(name): one for name, one in recordings.items()})
            made[laboratory] = calibrate(run).calibration
    return made


def draw_truth(rng: np.random.Generator) -> dict[str, str]:
    """Draw a sensor's true coefficients, as text for a run file."""
    truth: dict[str, str] = {}
    for axis in ("ax", "ay", "az", "gx", "gy", "gz"):
        terms = ("k0", "k1") if axis.startswith("a") else ("bias", "scale")
        for term in (*terms, "delta_o", "delta_p"):
            size, unit = _SIZES[term]
            value = size * rng.normal()
            if f"{axis}.{term}" not in _TRIANGULAR:
                truth[f"{axis}.{term}"] = f"{value:.6g} {unit}"
    return truth


def run_file_text(laboratory: str, truth: Mapping[str, str]) -> str:
    """Return the run file of a laboratory for a sensor with these true coefficients."""
    folder = files(__name__).joinpath("laboratories")
    sensor = folder.joinpath("sensor.toml").read_text(encoding="utf-8")
    if laboratory in _ACCELEROMETERS_ALONE:
        sensor = sensor.split("[sensor.gyro]")[0]
        truth = {name: text for name, text in truth.items() if name.startswith("a")}
    lines = [f'"{name}" = "{text}"' for name, text in truth.items()]
    bench = folder.joinpath(f"{laboratory}.toml").read_text(encoding="utf-8")
    return "\n".join([sensor, "[sensor.truth]", *lines, "", bench])


def section(found: Sequence[Mapping[Pair, PairTest]]) -> study.StudySection:
    """Build the section with both claims and a table of the pairs."""
    pairs = list(found[0])
    chi2 = np.array([[one[pair].chi2 for pair in pairs] for one in found])
    dof = np.array([[one[pair].dof for pair in pairs] for one in found])
    p = np.array([[one[pair].p_value for pair in pairs] for one in found])
    agree = (p > LEAST_P).mean(axis=0)
    per_sensor = chi2.sum(axis=1) / dof.sum(axis=1)
    pooled = chi2.sum() / dof.sum()
    u = float(per_sensor.std(ddof=1) / np.sqrt(len(found)))
    worst = pairs[int(agree.argmin())]
    findings = (
        TEXT.judge("pairs", float(agree.min()), 0.0,
            f"{' and '.join(worst)}: {int((p > LEAST_P)[:, agree.argmin()].sum())} of "
            f"{len(found)} sensors"),
        TEXT.judge("pooled", float(pooled), u,
            f"{len(pairs)} pairs of {len(found)} sensors, u from the scatter between sensors"),
    )  # fmt: skip
    rows = [
        (
            " and ".join(pair),
            (
                str(int(dof[0, j])),
                shown(float(chi2[:, j].sum() / dof[:, j].sum())),
                f"{p[:, j].min():.2g}",
            ),
        )
        for j, pair in enumerate(pairs)
    ]
    table = study.StudyTable("Pairs", "laboratories", ("coefficients", "χ²/ν", "smallest p"), rows)
    return TEXT.section(*findings, table)
