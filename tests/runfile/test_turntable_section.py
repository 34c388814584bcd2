"""The section of a turntable in a run file, and the bench that is built from it."""

from math import pi, radians
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from tests.refusals import refused
from tests.runfile.run_file_texts import FERRARIS

from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.benches.turntable.settings import TurntableSection, build
from inercal.runfile import read, schema

ARCSEC = radians(1 / 3600)
HERE = Path()


def built(**keys: Any) -> Turntable:
    section = TurntableSection.model_validate({"kind": "turntable", "latitude": "38 °"} | keys)
    bench = build(section, HERE)
    assert isinstance(bench, Turntable)
    return bench


def test_defaults_are_of_an_ordinary_table():
    bench = built()
    assert bench.gravity.value == pytest.approx(9.80, abs=0.01)
    assert bench.gravity.sd == pytest.approx(1.825e-3, rel=1e-3)  # no height is stated
    assert bench.latitude == pytest.approx(radians(38))
    assert bench.azimuth.value == 0
    assert bench.azimuth.sd == pytest.approx(radians(0.1))
    assert (bench.lean, bench.square) == pytest.approx((5 * ARCSEC, 2 * ARCSEC))
    assert bench.harmonics == pytest.approx((2 * ARCSEC, ARCSEC))
    assert bench.white == pytest.approx(0.5 * ARCSEC)
    assert bench.latency == Measured(0.0, 5e-3)
    (limits,) = bench.limits
    assert (limits.rate, limits.acceleration) == pytest.approx((pi / 6, pi / 6))
    assert limits.jerk is None


def test_each_axis_may_have_limits_of_its_own():
    bench = built(rate=("60 °/s", "60 °/s", "120 °/s"), jerk=("300 °/s³",))
    assert [limits.rate for limits in bench.limits] == pytest.approx([pi / 3, pi / 3, 2 * pi / 3])
    assert [limits.acceleration for limits in bench.limits] == pytest.approx([pi / 6] * 3)
    assert [limits.jerk for limits in bench.limits] == pytest.approx([radians(300)] * 3)


def test_values_and_axes_are_as_stated():
    bench = built(axes="z", clock="20 ppm", lever=("80 mm ± 1 mm", "0 mm", "15 mm"))
    assert bench.names == ("outer",)
    assert bench.clock == pytest.approx(20e-6)
    assert bench.lever == (Measured(0.08, 0.001), Measured(0.0, 0.0), Measured(0.015, 0.0))


@pytest.mark.parametrize(
    ("keys", "key"),
    [
        ({"latitude": None, "gravity": "9.8 m/s²"}, "[bench] latitude"),
        ({"axes": "zz"}, "axes"),
        ({"latitude": "91 °"}, "latitude"),
        ({"lean": "2 °"}, "[bench] lean"),
        ({"harmonics": ("2 °",)}, "[bench] harmonics"),
        ({"clock": "-1 ppm"}, "[bench] clock"),
        ({"rate": ("30 °/s", "30 °/s")}, "limits"),
        ({"rate": ("30 °/s",) * 3, "jerk": ("1 °/s³",) * 2}, "[bench] jerk"),
        ({"rate": ()}, "[bench] rate"),
        ({"acceleration": ("0 °/s²",)}, "acceleration"),
        ({"jerk": ("300 °/s²",)}, "[bench] jerk"),
        ({"latency": "2 °"}, "[bench] latency"),
    ],
)
def test_a_section_that_cannot_be_is_refused(keys: dict[str, Any], key: str):
    with refused(key=key):
        built(**keys)


def test_a_method_of_another_bench_says_so(tmp_path: Path):
    path = tmp_path / "run.toml"
    path.write_text(FERRARIS.replace("[bench]", '[bench]\nkind = "turntable"'), encoding="utf-8")
    with refused(key="[bench] tilt", file=path):
        read(path)
    text = path.read_text(encoding="utf-8")
    start = text.index("latitude")
    own = text[start : text.index("\n", start)]
    bench = text[text.index("[bench]") : text.index("[data]")]
    path.write_text(
        text.replace(bench, f'[bench]\nkind = "turntable"\n{own}\n\n'), encoding="utf-8"
    )
    with refused(key="[bench] kind", file=path, names=("hand", "turntable")):
        read(path)


def test_a_reversed_column_goes_with_a_recording():
    data = {"file": "means.csv", "kind": "means", "accelerometer": ("-ax", "ay", "az")}
    with pytest.raises(ValidationError) as no:
        schema.DataSection.model_validate(data)
    assert [found["type"] for found in no.value.errors()] == ["value_error"]
    assert schema.DataSection.model_validate(data | {"kind": "recording"}).accelerometer[0] == "-ax"
