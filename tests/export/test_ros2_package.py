"""The files of the ROS 2 package, and the verb that writes them."""

import json
import runpy
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from tests.export.calibrations import make_calibration
from tests.export.ros_exports import NAME, Loaded, export, linear, nine_axes
from tests.export.ros_stand_in import modules
from tests.program import run_program
from tests.refusals import refused

import inercal
from inercal.physics.sensors import axes_along, triad


def test_the_files_of_the_package_agree_with_one_another(
    load: Loaded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    made = export(make_calibration(), maintainer="A <B>", email='c"@d.org', update_rate=200)
    node, world = load(made)
    folder = tmp_path / "package"
    root = ET.parse(folder / "package.xml").getroot()
    assert root.findtext("name") == NAME
    assert root.findtext("maintainer") == "A <B>"
    assert root.findtext("export/build_type") == "ament_python"
    needed = {one.text for one in root.iter("exec_depend")}
    used = {name.partition(".")[0] for name in modules(world)}
    assert needed == used

    stated: dict[str, Any] = {}
    setuptools = ModuleType("setuptools")
    monkeypatch.setattr(setuptools, "setup", lambda **one: stated.update(one), raising=False)
    monkeypatch.setitem(sys.modules, "setuptools", setuptools)
    runpy.run_path(str(folder / "setup.py"))
    installed = {name for _, names in stated["data_files"] for name in names}
    assert installed <= {made.place, *made.beside}
    assert stated["data_files"][0][1] == [f"resource/{NAME}"]
    assert stated["packages"] == [NAME]
    assert stated["entry_points"]["console_scripts"] == [f"correct = {NAME}.node:main"]
    assert f"$base/lib/{NAME}" in (folder / "setup.cfg").read_text(encoding="utf-8")

    yaml = pytest.importorskip("yaml")
    parameters = yaml.safe_load((folder / "config" / f"{NAME}.yaml").read_text(encoding="utf-8"))
    parameters = parameters["/**"]["ros__parameters"]
    assert parameters == {name: default for name, (default, _) in node.PARAMETERS.items()}
    assert [*map(type, parameters.values())] == [type(x) for x, _ in node.PARAMETERS.values()]


def test_the_launch_file_remaps_every_topic_of_the_node(load: Loaded, tmp_path: Path):
    node, world = load(nine_axes())
    node.CorrectionNode()
    launch = runpy.run_path(str(tmp_path / "package" / "launch" / f"{NAME}.launch.py"))
    *arguments, started = launch["generate_launch_description"]()
    defaults = dict(arguments)
    remapped = {topic: defaults[to.strip("<>")] for topic, to in started["remappings"]}
    assert remapped == {topic: topic for topic in remapped}  # by default, nothing changes
    relative = {topic for topic in (*world.subscriptions, *world.published) if topic[0] != "/"}
    assert set(remapped) == relative
    assert (started["package"], started["executable"]) == (NAME, "correct")
    assert defaults["params_file"] == f"share of {NAME}/config/{NAME}.yaml"
    assert started["parameters"] == ["<params_file>"]


def test_the_own_test_of_the_package_passes_and_detects_a_changed_number(
    load: Loaded, tmp_path: Path
):
    load(nine_axes(), "settings")
    test = runpy.run_path(str(tmp_path / "package" / "test" / "test_correction.py"))
    test["test_the_check_reading_is_corrected_as_at_the_export"]()
    settings = sys.modules[f"{NAME}.settings"]
    settings.CHECK_RESULT["linear_acceleration"] = (0.0, 0.0, 0.0)
    with pytest.raises(AssertionError):
        test["test_the_check_reading_is_corrected_as_at_the_export"]()


def test_sensors_without_three_aligned_axes_are_refused():
    sensor = replace(triad("t"), axes=axes_along(["x", "y"], "f", "a")).with_coefficients("bias")
    two = inercal.Calibration(sensor, np.zeros(2), np.eye(2))
    with refused(names=("ax", "ay")):
        export(two)
    turned = replace(triad("t"), axes=axes_along(["y", "x", "z"], "f", "a"))
    with refused(names=("ay",)):
        export(inercal.Calibration(turned.with_coefficients("bias"), np.zeros(3), np.eye(3)))


@pytest.mark.slow
def test_the_verb_writes_a_folder_whole_and_overwrites_nothing_unasked(tmp_path: Path):
    path = inercal.save(make_calibration(), tmp_path / "run.calibration.json")
    out = tmp_path / "ws" / "imu"
    arguments = ("export", path, "--to", "ros2-node", "--out", out)
    assert run_program(*arguments, "--set", "nothing=1").status == 2
    assert not out.parent.exists()
    ended = run_program(*arguments, "--json")
    assert ended.status == 0, ended.error
    assert json.loads(ended.output)["file"] == str(out)
    files = {one.relative_to(out).as_posix() for one in out.rglob("*") if one.is_file()}
    assert {"package.xml", "resource/imu_7_correct", "imu_7_correct/node.py"} <= files
    assert not [one for one in out.parent.iterdir() if one != out]

    own = out / "config" / "own.yaml"
    own.write_text("mine", encoding="utf-8")
    (out / "setup.py").write_text("changed", encoding="utf-8")
    ended = run_program(*arguments)
    assert ended.status == 2
    assert ended.error.count("\n") == 1
    assert (out / "setup.py").read_text(encoding="utf-8") == "changed"
    assert run_program(*arguments, "--force").status == 0
    assert "setup(" in (out / "setup.py").read_text(encoding="utf-8")
    assert own.read_text(encoding="utf-8") == "mine"

    foreign = tmp_path / "foreign"
    foreign.mkdir()
    (foreign / "setup.py").write_text("mine", encoding="utf-8")
    for force in ((), ("--force",)):
        ended = run_program("export", path, "--to", "ros2-node", "--out", foreign, *force)
        assert ended.status == 2
        assert [one.name for one in foreign.iterdir()] == ["setup.py"]
    assert run_program("export", path, "--to", "ros2-node", "--out", path).status == 2


def test_a_folder_that_cannot_be_written_leaves_nothing(tmp_path: Path):
    made = linear()
    broken = replace(made, beside={**made.beside, "package.xml/x": "a file below a file"})
    with refused():
        broken.write(tmp_path / "ws" / "package")
    assert not list(tmp_path.iterdir())
