"""Drafts for an arm: the units of its rate and radius are found from norms, or named."""

from pathlib import Path

import numpy as np
import pytest
from tests import generated_logs as logs
from tests.base_seeds import evidence
from tests.drafts.test_kinds_of_logs import chosen, drafted

from inercal.basics.errors import InputError

UNITS = {"rpm": 1.0, "rad/s": np.pi / 30, "°/s": 6.0, "rev/s": 1 / 60}


def arm(folder: Path, unit: str, scale: float = 1.0) -> Path:
    """Write means of a triad on an arm of 1 m, in `scale` LSB/g."""
    turns = np.repeat([30.0, 60.0, 90.0], 20)
    columns = [range(60), turns * UNITS[unit], *(scale * logs.on_arm(turns)).T]
    return logs.write(folder / "arm.csv", ("position", "rate", "ax", "ay", "az"), columns)


@pytest.mark.parametrize(
    ("unit", "scale"),
    [("rpm", 1.0), ("°/s", 4321.0), evidence("rad/s", 1.0), evidence("rev/s", 1.0)],
)
def test_the_unit_of_the_rate_follows_from_norms_if_no_name_states_it(
    unit: str, scale: float, tmp_path: Path
):
    keys = chosen(drafted([arm(tmp_path, unit, scale)], tmp_path, bench__radius="1 m ± 10 µm"))
    assert keys.get("data.arm_rate_unit", "rpm") == unit
    if scale > 1:
        text, _, _ = str(keys["sensor.accelerometer.scale"]).partition(" ")
        assert float(text) == pytest.approx(scale, rel=0.05)


@pytest.mark.parametrize(("radius", "unit"), [("1000 m", "mm"), ("1 mm", "mm"), ("100 m", "cm")])
@pytest.mark.parametrize("scale", [1.0, 4321.0])
def test_a_radius_in_another_unit_is_named(scale: float, radius: str, unit: str, tmp_path: Path):
    path = arm(tmp_path, "rpm", scale)
    with pytest.raises(InputError) as caught:
        drafted([path], tmp_path, bench__radius=radius, data__arm_rate_unit="rpm")
    assert (caught.value.key, caught.value.names) == ("[bench] radius", (unit,))


def test_a_stated_unit_of_the_rate_is_used(tmp_path: Path):
    path = arm(tmp_path, "rad/s", 4321.0)
    stated = {"bench__radius": "1 m ± 10 µm", "data__arm_rate_unit": "rad/s"}
    keys = chosen(drafted([path], tmp_path, **stated))
    text, _, _ = str(keys["sensor.accelerometer.scale"]).partition(" ")
    assert float(text) == pytest.approx(4321, rel=0.05)
