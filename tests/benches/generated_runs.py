"""A run file of every method, made of what its kind of bench and the method itself declare."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.units import parse_quantity
from inercal.benches import MeanBench
from inercal.benches.kind_definition import KINDS, Kind
from inercal.methods import METHODS
from inercal.pipeline import Outcome, calibrate, simulate_files
from inercal.recordings.data import DataSection
from inercal.recordings.io.write import write_recording
from inercal.runfile import Run, read

# What a laboratory states beside the keys that a kind of bench cannot do without: so little that
# what errors do to the means is linear in them.
BENCHES: Mapping[str, tuple[str, ...]] = {
    "centrifuge": ('rate_error = "1 ppm"', 'tilt = "2 ″"', 'dwell_rate = "0.5 ppm"'),
    "dividing_head": ('autocollimation = "every"', 'autocollimator = "0.1 ″"', 'lean = "20 ″"'),
    "rate_table": ('pose = "0.02 °"', 'speed = "0.05 %"'),
    "rate_platform": (
        'rate_scale = "5 ppm"',
        'rate_asymmetry = "5 ppm"',
        'rate_stability = "2 ppm"',
        'setting = "0.02 °"',
    ),
    "turntable": ('square = "2 ″"', 'lean = "5 ″"', 'harmonics = ["2 ″", "1 ″"]'),
}
TURNS = ('turn_angle = "0.02 °"', 'turn_tilt = "0.02 °"')
HAND: Mapping[str, tuple[str, ...]] = {
    "six_position": ('tilt = "0.02 °"',),
    "ferraris": ('tilt = "0.02 °"', *TURNS),
}
# Columns that a kind names by default, and whose names a simulation takes from the run file.
COLUMNS: Mapping[str, tuple[str, ...]] = {
    "turntable": ('table = ["outer", "middle", "inner"]',),
    "rate_platform": ('axis = "axis"', 'table_rate = "rate"'),
}
TURN_COLUMNS: Mapping[str, tuple[str, ...]] = {"ferraris": ('seconds = "seconds"',)}
AXES: Mapping[str, tuple[str, ...]] = {"dual_orthogonal": ("a", "b"), "tumble": ("a",)}
# Temperatures of a method that follows them, and the lines of its plan.
ENVIRONMENT = (
    "[environment]",
    'kind = "ramp"',
    'temperatures = ["0 °C", "40 °C", "0 °C"]',
    'ramp_rate = "4 K/min"',
)
PRIORS: Mapping[str, tuple[str, ...]] = {
    "dual_orthogonal": ('prior."a.kip" = "0 ± 20 µg/g²"', 'prior."b.kip" = "0 ± 20 µg/g²"')
}
WHITE = 'white = "20 µg/√Hz"'
GYRO_WHITE = 'white = "0.1 °/√h"'
SD = "5 µg"  # of a mean, from the white noise of a sample and some seconds
GYRO_SD = "1 °/h"
SMALL = 1e-4  # of coefficients' natural sizes: what closed formulas leave out is then nothing


def kind_for(method: str) -> Kind[Any, Any]:
    """Return the kind of bench that a method is for."""
    (found,) = (kind for kind in KINDS.values() if kind.bench is METHODS[method].bench)
    return found


def write_run(method: str, folder: Path, more: str = "") -> Path:
    """Write the run file of a recording; `more` are lines of [method]."""
    kind, axes = kind_for(method), AXES.get(method, ("ax", "ay", "az"))
    section, data = kind.section.model_fields, kind.data.model_fields
    needed = [key for key, one in section.items() if one.is_required() and key != "kind"]
    columns = [key for key, one in data.items() if one.is_required()]
    columns = [key for key in columns if key not in DataSection.model_fields]
    field = "m" in METHODS[method].needs
    ramp = METHODS[method].follows_rest and not field
    gyros = "w" in METHODS[method].default_coefficients
    # Without angles, what a table errs by is not stated, and no column of it is read.
    read_angles = not METHODS[method].without_angles
    bench = BENCHES.get(kind.name, HAND.get(method, ()))
    table = COLUMNS.get(kind.name, TURN_COLUMNS.get(method, ()))
    lines = [
        "[sensor]",
        'name = "sensor"',
        *(() if field else ("[sensor.accelerometer]", 'unit = "g"', WHITE)),
        *(("[sensor.gyro]", 'unit = "°/s"', GYRO_WHITE) if gyros else ()),
        *(("[sensor.magnetometer]", 'unit = "µT"', 'white = "20 nT/√Hz"') if field else ()),
        "[bench]",
        f'kind = "{kind.name}"',
        *(('field = "50 µT ± 10 nT"',) if field else ()),
        *(() if ramp or field else ('gravity = "9.8073 m/s² ± 0.1 mm/s²"',)),
        *(f'{key} = "0.25 m ± 0.1 mm"' for key in needed),
        *(('latitude = "48.1 °"',) if "latitude" in section and not (ramp or field) else ()),
        *(bench if read_angles else ()),
        "[data]",
        'file = "made.npz"',
        'time = "time"',
        'rate = "50 Hz"',
        'label = "label"',
        *(() if METHODS[method].unknown_attitudes or kind.sampled else ('marks = "labels"',)),
        f"accelerometer = {[] if field else list(axes)}",
        *(('magnetometer = ["mx", "my", "mz"]',) if field else ()),
        *(('gyro = ["gx", "gy", "gz"]',) if gyros else ()),
        *(f'{key} = "{key}"' for key in columns),
        *(table if read_angles else ()),
        *(('temperature = "temp"', *ENVIRONMENT) if ramp else ()),
        "[method]",
        *(('seconds = "1200 s"',) if ramp else ()),
        f'name = "{method}"',
        *PRIORS.get(method, ()),
        more,
    ]
    path = folder / f"{method}.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def simulate_run(path: Path, seed: int) -> Run:
    """Return the run of a sensor that is drawn, and write what it gives on the simulated bench."""
    run = read(path)
    rng = np.random.default_rng(seed)
    sensor = run.whole_sensor
    c = SMALL * rng.standard_normal(len(sensor.coefficients)) * sensor.unit_scale
    truth = dict(zip(sensor.coefficients, c.tolist(), strict=True))
    for prior in run.priors:
        of_prior = rng.multivariate_normal(prior.mean, prior.covariance)
        truth |= dict(zip(prior.names, of_prior.tolist(), strict=True))
    run = replace(run, truth=truth)
    for name, recording in simulate_files(run, seed).items():
        write_recording(recording, run.file(name))
    return run


def calibrate_run(run: Run) -> tuple[Outcome, float]:
    """Return what a drawn run gives, and its NEES over the number of coefficients."""
    found = calibrate(run)
    error = found.calibration.values - [run.truth[n] for n in found.calibration.sensor.coefficients]
    weighed = error @ np.linalg.solve(found.calibration.covariance, error)
    return found, float(weighed) / len(error)


def read_off(run: Run, rng: np.random.Generator) -> dict[str, list[float]]:
    """Return the mean readings of each step, output units, on a bench with errors as stated."""
    off = {
        name: np.array(one.value + one.sd * rng.standard_normal())
        for name, one in run.bench.nuisances(run.steps, run.sensor).items()
    }
    assert isinstance(run.bench, MeanBench)
    motion = run.bench.mean_motion(run.steps, off).motion
    c = np.array([run.truth[name] for name in run.sensor.coefficients])
    si = run.sensor.forward(motion, c)
    sd = {"f": parse_quantity(SD, "g").value, "w": parse_quantity(GYRO_SD, "°/s").value}
    si += [sd[axis.measures] for axis in run.sensor.axes] * rng.standard_normal(si.shape)
    return {
        step.label: row
        for step, row in zip(run.steps, run.sensor.to_output(si).tolist(), strict=True)
    }


def state_means(run: Run, table: str, *, labelled: bool) -> None:
    """Let the run file of a recording be that of a table of means, with or without labels."""
    text = run.path.read_text(encoding="utf-8")
    deviations = f'accelerometer = "{SD}"'
    if run.sensor.select_axes("w").axes:
        deviations += f'\ngyro = "{GYRO_SD}"'
    for old, new in (
        ("made.npz", table),
        (WHITE, ""),
        ("[data]", '[data]\nkind = "means"'),
        ('marks = "labels"', ""),
        *(() if labelled else (('label = "label"', ""),)),
        ('rate = "50 Hz"', ""),
        ('time = "time"', ""),
        (GYRO_WHITE, ""),
        ("[method]", f"[data.sd]\n{deviations}\n[method]"),
    ):
        text = text.replace(old, new)
    run.path.write_text(text, encoding="utf-8")
