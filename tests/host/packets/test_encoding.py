from typing import Any

import numpy as np
import pytest
from tests.host.packets.cases import fed, motion
from tests.refusals import refused

from inercal.host.packets import PRESETS, Flag, encode, read_layout


@pytest.mark.parametrize("name", PRESETS)
def test_what_is_sent_comes_back_within_half_a_step(name: str):
    layout = read_layout(name)
    given = motion(layout, 500)
    packets, counts = fed(layout, encode(layout, **given))
    assert counts.packets == 500
    assert (counts.discarded, counts.lost) == (0, 0)
    steps = {f.role: layout.resolution(f) for frame in layout.frames for f in frame.fields}
    for k, role in enumerate(("ax", "ay", "az", "gx", "gy", "gz")):
        # Real numbers of 32 bits are rounded to 2^-24 of themselves.
        half = 0.5 * steps[role] * (1 + 1e-9) or 2.0**-24 * 40
        error = np.abs(packets.readings[:, k] - given["readings"][:, k])
        assert error.max() <= half
        assert error.max() > 0.5 * half or not steps[role]  # no finer than declared
    if "temperature" in steps:
        half = 0.5 * steps["temperature"] * (1 + 1e-9) or 300 * 2.0**-24
        np.testing.assert_allclose(packets.temperature, given["temperature"], rtol=0, atol=half)
    if packets.time is not None:
        half = 0.5 * steps["time"] + 1e-12
        np.testing.assert_allclose(packets.time, given["time"], rtol=0, atol=half)


def test_temperature_is_sent_in_the_packets_that_carry_it():
    layout = read_layout("xsens")
    given = motion(layout, 30)
    data = encode(layout, **given)
    assert len(data) == 27 * 47 + 3 * 54
    packets, _ = fed(layout, data)
    np.testing.assert_array_equal(np.isnan(packets.temperature), np.isnan(given["temperature"]))


def test_readings_beyond_the_full_scale_are_sent_at_it():
    layout = read_layout("witmotion")
    packets, _ = fed(layout, encode(layout, [[500, -500, 0, 99, -99, 0]], temperature=[300]))
    g = 9.80665
    np.testing.assert_allclose(packets.readings[0, :3], [16 * g * (1 - 2**-15), -16 * g, 0])
    assert packets.flags.tolist() == [Flag.SATURATED]


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"readings": np.zeros((2, 3))}, "readings"),
        ({"readings": np.full((2, 6), np.nan)}, "ax"),
        ({"time": None}, "time"),
        ({"temperature": None}, "temperature"),
    ],
)
def test_what_packets_carry_has_to_be_given(change: dict[str, Any], key: str):
    layout = read_layout("vn100")
    with refused(key=key):
        encode(layout, **(motion(layout, 2) | change))
