"""A noise of magnetometers that is stated too large is told, with the factor by which U is."""

from pathlib import Path

import numpy as np
import pytest
from tests.magnetometer import generator as sim
from tests.magnetometer.recorded import STILL, recording, table

from inercal.pipeline import Outcome, calibrate

WHITE = sim.SIGMA_M * np.sqrt(STILL)  # T/√Hz, for the usual noise of a mean


def factors(outcome: Outcome) -> list[float]:
    return [one.factor for one in outcome.findings if one.what == "noise" and one.factor]


@pytest.mark.parametrize(
    ("kind", "factor"),
    [("recording", 0.1), ("recording", 1.0), ("recording", 4.0), ("means", 1.0), ("means", 4.0)],
)
def test_the_factor_is_found_and_the_verdict_is_not_consistent(
    factor: float, kind: str, tmp_path: Path
):
    rng = np.random.default_rng(7)
    own, attitude = sim.device(rng), sim.scattered(rng, 24)
    if kind == "recording":
        sensor = [f'white = "{factor * WHITE * 1e9:.9g} nT/√Hz"']
        path = recording(tmp_path, attitude, own, rng, field="50 µT", sensor=sensor)
    else:
        path = table(tmp_path, sim.rests(rng, attitude, own), attitude, rng, field="50 µT")
        text = path.read_text(encoding="utf-8")
        old, new = (f'magnetometer = "{x * sim.SIGMA_M * 1e9} nT"' for x in (1, factor))
        assert old in text
        path.write_text(text.replace(old, new), encoding="utf-8")
    outcome = calibrate(path)
    assert outcome.verdict.grade == ("consistent" if factor <= 1 else "reservations")
    assert len(factors(outcome)) == (factor > 1)
    assert all(one == pytest.approx(factor, rel=0.35) for one in factors(outcome))
