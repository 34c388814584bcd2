"""The readings of examples/prior: ``python -m tests.type_prior.example_files`` writes them.

They are drawn with NumPy alone. Five accelerometers of a type were tumbled on a head whose
harmonics are the same in all tests. Two others were then mounted at right angles, and tested with
an autocollimator at four positions.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tests.accuracy.dividing_head import ARCSEC, angles, readings

Array = NDArray[np.float64]
FOLDER = Path(__file__).parents[2] / "examples" / "prior"
SEED = 14
VOLT_PER_G = 3.0
MEAN = {"k0": 0.0, "k1": 0.0, "delta": 0.0, "k2": 12e-6, "k3": -3e-6, "kip": 25e-6}
SCATTER = {"k0": 300e-6, "k1": 200e-6, "delta": 40 * ARCSEC, "k2": 6e-6, "k3": 3e-6, "kip": 8e-6}
HARMONICS = (0.5 * ARCSEC, 0.4 * ARCSEC)
DIVISION = 0.3 * ARCSEC
NOISE = 0.5e-6


def example_truth(rng: np.random.Generator) -> dict[str, Array]:
    """Return the coefficients by term, (7, 2) in g: rows 0 to 4 are tumbled, row 5 is the pair."""
    return {name: MEAN[name] + SCATTER[name] * rng.standard_normal((7, 2)) for name in MEAN}


def example_tables() -> dict[str, tuple[str, Array]]:
    """Return header and rows of each table."""
    rng = np.random.default_rng(SEED)
    truth = example_truth(rng)
    theta = angles(12, reverse=True)
    amplitude = rng.standard_normal(4) * np.repeat(HARMONICS, 2)
    graduation = DIVISION * rng.standard_normal(12)
    head = sum(
        amplitude[2 * k] * np.sin((k + 1) * theta) + amplitude[2 * k + 1] * np.cos((k + 1) * theta)
        for k in range(2)
    )
    head = head + np.concatenate([graduation, graduation[::-1]])
    lean, base = 10 * ARCSEC * rng.standard_normal(7), 5 * ARCSEC * rng.standard_normal(7)
    tables: dict[str, tuple[str, Array]] = {}
    for k in range(5):
        one = {name: values[k] for name, values in truth.items()}
        y = readings(one, theta + head + base[k], lean[k]) + NOISE * rng.standard_normal((24, 2))
        rows = np.column_stack([np.degrees(theta), VOLT_PER_G * y[:, 0]])
        tables[f"QA_{21 + k}.csv"] = ("angle,current", rows)
    pair = {name: values[5] for name, values in truth.items()}
    collimator = 0.1 * ARCSEC * rng.standard_normal(24)
    for row in (0, 3, 23, 20):  # the head is adjusted at 180° and 270° to the reading at 0° and 90°
        other = row + 6 if row < 12 else row - 6
        head[other] = head[row] + collimator[other] - collimator[row]
    y = readings(pair, theta + head + base[5], lean[5]) + 0.2e-6 * rng.standard_normal((24, 2))
    rows = np.column_stack([np.degrees(theta), VOLT_PER_G * y])
    tables["pair.csv"] = ("angle,a,b", rows)
    return tables


def table_text(header: str, rows: Array) -> str:
    """Return a table as the text of its file."""
    lines = [",".join([f"{row[0]:.0f}", *(f"{x:.8f}" for x in row[1:])]) for row in rows]
    return "\n".join([header, *lines]) + "\n"


if __name__ == "__main__":
    for name, table in example_tables().items():
        (FOLDER / name).write_text(table_text(*table), encoding="utf-8")
