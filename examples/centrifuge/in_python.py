"""Accelerometers on a centrifuge: screen the table, repair what was mistyped, calibrate."""

from math import pi
from pathlib import Path

import numpy as np

from inercal.basics.units import format_quantity, parse_quantity
from inercal.benches import Centrifuge
from inercal.methods.centrifuge_norm import ml
from inercal.methods.centrifuge_norm.screening import screen_rows
from inercal.physics.plan import Spin
from inercal.physics.sensors import Readout, triad
from inercal.recordings import Observations
from inercal.recordings.io.read import read_table

table = read_table(Path(__file__).parent / "dwells.csv")
volts = np.stack([table.numbers(name) for name in ("ax", "ay", "az")], axis=-1)
spins = [
    Spin(f"{position} at {rpm:g} rpm", rpm * pi / 30)
    for position, rpm in zip(table.columns["position"], table.numbers("rpm"), strict=True)
]
bench = Centrifuge(
    gravity=parse_quantity("9.80123 m/s² ± 0.1 mm/s²", "m/s²"),
    radius=parse_quantity("1.00000 m ± 20 µm", "m"),
    latitude=parse_quantity("39 ° ± 0.1 °", "°"),
    rate=1e-6,
)
# 1.25 V/g nominal; 10 µV is the standard deviation of a mean.
readout = Readout(parse_quantity("1.25 V/g", "V/(m/s²)").value, 0.0, "V")
sensor = triad("triad", "f", "a", readout).with_coefficients("k0", "k1", "k2")


def observed(volts: np.ndarray) -> Observations:
    """Return the table as observations."""
    rows = len(volts)
    variance = (10e-6 / readout.scale) ** 2
    return Observations(
        labels=tuple(spin.label for spin in spins),
        mean=sensor.to_si(volts),
        covariance=np.broadcast_to(variance * np.eye(3), (rows, 3, 3)),
        duration=np.ones(rows),
        samples=np.ones(rows, dtype=np.int64),
        time=np.arange(rows, dtype=float),
        channels=sensor.channels,
    )


for suspect in screen_rows(observed(volts), sensor, bench, spins):
    print(suspect.describe())
    # Look at the original first; here it confirms the only repair there is.
    (repair,) = suspect.repairs
    for axis, value in repair.after.items():
        volts[suspect.row, sensor.channels.index(axis)] = value

estimate = ml(observed(volts), sensor, bench, spins)
agrees = "agrees" if estimate.consistent else "disagrees"
print(f"the table {agrees}: χ² = {estimate.chi2:.1f} with {estimate.dof} degrees of freedom")
for name, value, sd in zip(sensor.coefficients, estimate.value, estimate.std, strict=False):
    line = sensor.coefficient(name)
    print(f"{name:6} {format_quantity(value, 2 * sd, line.unit)}  ({line.meaning}, U with k = 2)")
