"""Every parameter that a key of [bench] states can be qualified in place of the key.

Of an example of each bench all its parameters are put into one qualification, with the values and
deviations as typed, and the keys are taken out: the bench has the same parameters.
"""

import tomllib
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.runfile.key_sweep import EXAMPLES, toml

from inercal.basics.errors import InputError
from inercal.benches.kind_definition import KINDS
from inercal.benches.qualification import Qualification, QualifiedParameter
from inercal.benches.qualification.bench_keys import read_qualifications, with_qualified_keys
from inercal.benches.qualification.result import save
from inercal.runfile import Run, read

RUNS = {
    "ferraris_simulated/run.toml": {"g", "tilt1", "angle", "timebase"},
    "centrifuge/lab.toml": {"g", "radius", "latitude", "rate", "tilt", "mount_x", "index_z",
                            "dwell_rate"},
    "dividing_head/tumble.toml": {"g", "sin1", "cos2", "base", "lean", "division", "pier",
                                  "drift"},
    "rate_table/ship.toml": {"g", "radius", "seat", "pose_x", "speed", "lean_1"},
    "rate_platform/imu.toml": {"g", "rate_scale", "rate_asymmetry", "rate_stability", "setting_1",
                               "mounting_x", "attitude_2"},
    "turntable/mimu.toml": {"g", "azimuth", "lean_x", "square_1", "sin1[outer]", "cos2[inner]",
                            "latency"},
}  # fmt: skip
KEYS_WITHOUT = {"trim", "face", "earth_up", "earth1", "earth2", "earth_visit1", "earth_visit2",
                "level1", "level2", "clock"}  # fmt: skip


def qualification_of(run: Run, names: list[str]) -> Qualification:
    declared = {one.name: one for one in run.bench.parameters}
    # A dividing head adds the second order of its lean to gravity.
    declared["g"] = replace(declared["g"], sd=run.bench.gravity.sd)
    return Qualification(
        "test",
        run.kind.name,
        "",
        "b" * 64,
        date(2026, 1, 1),
        None,
        "as typed",
        "",
        "",
        tuple(
            QualifiedParameter(
                name, declared[name].unit, declared[name].value, "b" * 64, date(2026, 1, 1), None
            )
            for name in names
        ),
        np.diag([declared[name].sd ** 2 for name in names]),
    )


def possible(run: Run, content: dict[str, Any], folder: Path) -> dict[str, str]:
    """Return the keys of the parameters that can be qualified, by parameter."""
    section = {"kind": content["bench"].get("kind", "hand")}
    found: dict[str, str] = {}
    for one in run.bench.parameters:
        if one.sd <= 0:
            continue
        save(qualification_of(run, [one.name]), folder / "one.json")
        used = read_qualifications("one.json", folder)
        try:
            _, (found[one.name],) = with_qualified_keys(section, KINDS[run.kind.name], used)
        except InputError:
            assert one.name.rstrip("_xyz12") in {n.rstrip("12") for n in KEYS_WITHOUT} | {
                "pose_earth",
                "earth",
                "lever",
            }, one.name
    return found


@pytest.mark.parametrize("path", RUNS)
def test_a_qualification_states_what_the_keys_stated(path: str, tmp_path: Path):
    content = tomllib.loads((EXAMPLES / path).read_text(encoding="utf-8"))
    typed = read(EXAMPLES / path)
    keys = possible(typed, content, tmp_path)
    assert set(keys) >= RUNS[path]
    save(qualification_of(typed, list(keys)), tmp_path / "bench.json")
    bench = {k: v for k, v in content["bench"].items() if k not in keys.values()}
    content["bench"] = bench | {"qualification": "bench.json"}
    if path == "turntable/mimu.toml":
        (tmp_path / "path.csv").write_bytes((EXAMPLES / "turntable" / "path.csv").read_bytes())
    (tmp_path / "run.toml").write_text(toml(content), encoding="utf-8")
    found = read(tmp_path / "run.toml")
    expected = {one.name: one for one in typed.bench.parameters}
    for one in found.bench.parameters:
        assert one.sd == pytest.approx(expected[one.name].sd, rel=1e-12), one.name
        assert one.value == pytest.approx(expected[one.name].value, rel=1e-12), one.name
    assert set(found.qualified.keys) == set(keys.values())
