"""What is entered is there, once, whole, and as it was; in SQLite and on a PostgreSQL server."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.refusals import refused
from tests.store.calibration_generator import DRIFTING, content, hashed, ten, write

from inercal.basics.errors import InputError
from inercal.laboratory.store import Register, RunFacts
from inercal.physics.sensors import Noise, Readout, imu, triad

PLAIN = Readout(1.0, 0.0, "m/s²"), Noise()


def made(**more: Any) -> dict[str, Any]:
    return content(DRIFTING, 0.0, np.random.default_rng(3), **more)


def facts(recording: str = "ab" * 32, **more: Any) -> RunFacts:
    sensor = imu(DRIFTING.sensor, PLAIN, (Readout(1.0, 0.0, "rad/s"), Noise()))
    given: dict[str, Any] = {
        "key": "k1",
        "sensor": sensor,
        "kind": "turntable",
        "bench": "table 2",
        "begun": "2026-11-22T14:00:00.123+00:00",
        "state": "running",
        "table": "pmac://10.0.0.5:1025",
        "imu": "tcp://10.0.0.6:1",
        "folder": "/runs/1",
        "files": {"recording.h5": (12, recording)},
    }
    return RunFacts(**given | more)


def test_a_calibration_comes_back_bit_for_bit(address: str, tmp_path: Path):
    written = made()
    path = write(tmp_path / "a.calibration.json", written)
    with Register(address, by="Ada") as register:
        number = register.enter_calibration(path)
        entry = register.calibration(number)
        rows = register.coefficients(number)
    assert entry.sha256 == written["sha256"]
    assert entry.calibration.values.tolist() == [c["value"] for c in written["coefficients"]]
    assert entry.calibration.covariance.tolist() == written["covariance"]
    found = np.sqrt(np.diag(np.array(written["covariance"]))).tolist()
    expected = [
        (c["name"], c["value"], std, c["unit"])
        for c, std in zip(written["coefficients"], found, strict=True)
    ]
    assert rows == expected
    assert (entry.by, entry.kind, entry.bench, entry.run) == ("Ada", "turntable", "", None)
    assert entry.measured == "2020-03-01T09:30:00.000+00:00"
    assert entry.measured_from == "created"


def test_entering_again_changes_nothing(address: str, tmp_path: Path):
    paths = ten(tmp_path)
    with Register(address, by="Ada") as register:
        first = [register.enter_calibration(path) for path in paths]
        before = register.calibrations(), register.sensors()
    with Register(address, by="Bob") as register:
        assert register.enter_calibrations(paths) == tuple(first)
        assert (register.calibrations(), register.sensors()) == before
        assert [entry.by for entry in register.calibrations()] == ["Ada"] * 10
    assert first == list(range(1, 11))


def test_a_sensor_says_how_often_and_when_it_was_calibrated_last(address: str, tmp_path: Path):
    with Register(address, by="Ada") as register:
        register.enter_sensor(triad("another", "f", "a", *PLAIN))
        register.enter_calibrations(ten(tmp_path))
        one, other = register.sensors()
        assert register.sensor(one.id) == register.sensor(DRIFTING.sensor) == one
    assert (one.name, one.calibrations, one.last) == ("MIMU № 17", 10, "2024-08-31")
    assert one.axes == DRIFTING.axes
    assert (other.name, other.calibrations, other.last) == ("another", 0, None)
    assert other.axes == ("ax", "ay", "az")
    assert one.by == "Ada"


def test_axes_that_come_later_are_added_and_others_are_refused(address: str):
    accelerometers = triad("board", "f", "a", *PLAIN)
    both = imu("board", PLAIN, (Readout(1.0, 0.0, "rad/s"), Noise()))
    with Register(address) as register:
        assert register.enter_sensor(accelerometers) == register.enter_sensor(both) == 1
        assert register.sensor("board").axes == ("ax", "ay", "az", "gx", "gy", "gz")
        turned = tuple(replace(axis, measures="w") for axis in accelerometers.axes)
        with refused(InputError, names=("ax",)):
            register.enter_sensor(replace(accelerometers, axes=turned))
        assert len(register.sensors()) == 1


def test_a_run_goes_on_and_nothing_but_state_folder_and_files_changes(address: str):
    with Register(address, by="Ada") as register:
        number = register.enter_run(facts(files={}))
        (begun,) = register.runs()
        again = facts(state="interrupted", folder="/elsewhere", table="pmac://other:1", bench="B")
        assert register.enter_run(again) == number
        (now,) = register.runs(DRIFTING.sensor)
    assert (begun.state, begun.files) == ("running", ())
    assert replace(now, state="running", folder="/runs/1", files=()) == begun
    assert (now.state, now.folder) == ("interrupted", "/elsewhere")
    assert now.files == (("recording.h5", 12, "ab" * 32),)
    assert (begun.kind, begun.bench, begun.by) == ("turntable", "table 2", "Ada")


def test_a_run_that_is_done_stays_done_whatever_an_older_copy_says(address: str):
    with Register(address) as register:
        register.enter_run(facts(state="done"))
        before = register.runs()
        register.enter_run(facts(recording="cd" * 32, state="interrupted"))
        assert register.runs() == before


def test_a_run_that_was_moved_is_at_its_new_place_and_no_older_copy_is_it(address: str):
    with Register(address) as register:
        register.enter_run(facts(state="done"))
        (before,) = register.runs()
        register.enter_run(facts(state="done", folder="/archive/1"))
        register.enter_run(facts(state="interrupted", folder="/copy/1"))
        assert register.runs() == (replace(before, folder="/archive/1"),)


@pytest.mark.parametrize("run_first", [True, False])
def test_a_calibration_belongs_to_the_run_of_its_recording(
    address: str, tmp_path: Path, run_first: bool
):
    written = made()
    path = write(tmp_path / "a.calibration.json", written)
    run = facts(written["provenance"]["recording sha256"])
    with Register(address) as register:
        if run_first:
            register.enter_run(run)
        number = register.enter_calibration(path)
        if not run_first:
            assert register.calibration(number).run is None
            register.enter_run(run)
        entry = register.calibration(number)
    assert (entry.run, entry.kind, entry.bench) == (1, "turntable", "table 2")
    assert (entry.measured, entry.measured_from) == ("2026-11-22T14:00:00.123+00:00", "run")


def test_a_date_that_the_user_states_stays(address: str, tmp_path: Path):
    written = made()
    path = write(tmp_path / "a.calibration.json", written)
    with Register(address) as register:
        number = register.enter_calibration(path, measured="2019-05-06T07:08:09+02:00")
        register.enter_run(facts(written["provenance"]["recording sha256"]))
        entry = register.calibration(number)
    assert (entry.run, entry.measured_from) == (1, "stated")
    assert entry.measured == "2019-05-06T05:08:09.000+00:00"


def test_a_run_and_its_calibration_are_entered_together_or_not_at_all(address: str, tmp_path: Path):
    path = write(tmp_path / "a.calibration.json", made())
    path.write_text(path.read_text(encoding="utf-8").replace("generator", "forger"))
    with Register(address) as register:
        with refused(InputError) as refusal:
            register.enter_run(facts(), path)
        assert str(path) in str(refusal.value)
        assert register.runs() == register.sensors() == ()
        write(path, made())
        register.enter_run(facts(), path)
        assert len(register.runs()) == len(register.calibrations()) == 1


def test_several_files_are_entered_all_or_none(address: str, tmp_path: Path):
    good, bad = ten(tmp_path)[:2]
    bad.write_text("{}")
    with Register(address) as register:
        with refused(InputError) as refusal:
            register.enter_calibrations([good, bad])
        assert str(bad) in str(refusal.value)
        assert register.calibrations() == ()


NAMES = (
    "../../etc/passwd",
    "'; DROP TABLE sensor; --",
    'quoted "twice" \\ back',
    "Gerät № 7 — 加速度计",
    "[red]bold[/red] <b>",
    "line\nbreak\ttab",
    "e\u0301 🛰",
    "%s %(name)s :name ?",
    "x" * 5000,
)


@pytest.mark.slow
def test_names_of_all_kinds_come_back_as_they_were(address: str, tmp_path: Path):
    written = made()
    for name in NAMES:
        written["sensor"]["name"] = name
        path = write(tmp_path / "a.calibration.json", hashed(written))
        run = facts(key=name, bench=name, folder=name, files={name: (1, "ab")})
        with Register(address, by=name) as register:
            number = register.enter_calibration(path)
            register.enter_run(run)
            assert register.sensor(name).name == name
            assert register.calibration(number).calibration.sensor.name == name
            assert register.history(name).sensor.by == name
    with Register(address) as register:
        for name, run in zip(NAMES, register.runs(), strict=True):
            assert (run.bench, run.folder, run.files[0].name) == (name, name, name)


def test_a_folder_of_all_kinds_of_characters_holds_a_register(tmp_path: Path):
    folder = tmp_path / "a?b #%20 é;&"
    folder.mkdir()
    for address in (folder / "r s.db", f"sqlite:///{folder}/other?.db"):
        with Register(str(address)) as register:
            assert register.sensors() == ()
            assert register.address.startswith(f"sqlite:///{folder}/")
    assert sorted(path.name for path in folder.iterdir()) == ["other?.db", "r s.db"]


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"conditions": 7}, "conditions"),
        ({"provenance": {"created": 3}}, "provenance"),
        ({"provenance": {"created": "yesterday"}}, "'yesterday'"),
        ({"provenance": {}}, "--measured"),
        ({"method": 7}, "method"),
        ({"covariance": (-np.eye(24)).tolist()}, "variance"),
        ({"notes": ["\ud800"]}, "Unicode"),
    ],
)
def test_content_that_a_register_cannot_keep_is_refused(
    tmp_path: Path, change: dict[str, Any], wrong: str
):
    path = tmp_path / "a.calibration.json"
    written = made() | change
    if "notes" in change:  # json writes half of a pair as it is escaped
        path.write_text(json.dumps(written | {"sha256": ""}))
    else:
        write(path, hashed(written))
    with Register(str(tmp_path / "r.db")) as register:
        with refused(InputError) as refusal:
            register.enter_calibration(path)
        assert str(refusal.value).startswith(str(path))
        assert wrong in str(refusal.value)
        assert register.calibrations() == register.sensors() == ()


def test_a_text_with_a_zero_is_refused_by_a_server_in_one_line(database: str, tmp_path: Path):
    written = made()
    written["sensor"]["name"] = "a\0b"
    path = write(tmp_path / "a.calibration.json", hashed(written))
    with Register(database) as register, refused(InputError, key="--register"):
        register.enter_calibration(path)


def test_a_method_of_another_version_leaves_the_bench_unknown(address: str, tmp_path: Path):
    path = write(tmp_path / "a.calibration.json", made(method="by_pendulum"))
    with Register(address) as register:
        entry = register.calibration(register.enter_calibration(path))
    assert (entry.kind, entry.bench, entry.method) == ("", "", "by_pendulum")


def test_what_is_not_there_is_said_with_what_is(address: str, tmp_path: Path):
    with Register(address) as register:
        with refused(InputError, names=("x",)):
            register.sensor("x")
        with refused(InputError, names=("#1",)):
            register.calibration(1)
        register.enter_calibrations(ten(tmp_path))
        register.enter_sensor(triad("bare", "f", "a", *PLAIN))
        with refused(InputError, names=("x",)) as refusal:
            register.history("x")
        assert "'MIMU № 17', 'bare'" in str(refusal.value)
        with refused(InputError, names=("#11",)):
            register.calibration(11)
        with refused(InputError, names=("bare",)):
            register.history("bare")


def test_a_stated_date_replaces_only_the_date_of_the_file(address: str, tmp_path: Path):
    path = write(tmp_path / "a.calibration.json", made())
    with Register(address, by="Ada") as register:
        number = register.enter_calibration(path)
        assert register.calibration(number).measured_from == "created"
        for _ in range(2):  # the same date again is no change
            assert register.enter_calibration(path, measured="2019-12-20") == number
            entry = register.calibration(number)
            assert (entry.measured[:10], entry.measured_from) == ("2019-12-20", "stated")
        with pytest.raises(InputError, match="2019-12-20"):
            register.enter_calibration(path, measured="2019-12-21")
        assert register.calibration(number).measured[:10] == "2019-12-20"
        assert register.enter_calibration(path) == number  # without a date nothing is said
        assert register.calibration(number).measured[:10] == "2019-12-20"
