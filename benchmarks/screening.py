"""The screening of a centrifuge table that violates the norm: the paper's, as it is printed."""

import numpy as np
from tests.accuracy.centrifuge import RATES, printed_attitudes, sensed_motion
from tests.methods.test_centrifuge_norm import BENCH, table

from benchmarks import DATA, Row, Skipped, best
from inercal.methods.centrifuge_norm.screening import screen_rows

FOLDER, LIMIT = "centrifuge_table1", 2.0  # s
WRONG = 23  # signs that the print has lost


def rows() -> list[Row | Skipped]:
    """Find the wrong rows, then time it."""
    name = f"screening of 60 dwells, {WRONG} signs wrong"
    if not (DATA / FOLDER).is_dir():
        return [Skipped(name, f"no {FOLDER} in {DATA}; set INERCAL_DATA to its folder")]
    file = DATA / FOLDER / "table1_as_printed.csv"
    output = np.loadtxt(file, delimiter=",", skiprows=1)[:, 3:]
    _, rates = sensed_motion(printed_attitudes(), RATES)
    seen, sensor, spins = table(output, rates)
    assert len(screen_rows(seen, sensor, BENCH, spins)) == WRONG
    return [Row(name, best(lambda: screen_rows(seen, sensor, BENCH, spins), 3), LIMIT, "limit")]
