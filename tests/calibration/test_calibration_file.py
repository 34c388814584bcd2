"""Calibrations come back from disk as they were, and changed ones do not come back."""

import errno
import hashlib
import json
import os
import re
from collections.abc import Callable
from dataclasses import replace
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.refusals import refused

from inercal.calibration import Calibration, SharedError, Validity
from inercal.calibration.files import (
    calibration_object,
    calibration_text,
    canonical_text,
    load,
    parse,
    save,
)
from inercal.physics.frames import exp_so3
from inercal.physics.sensors import G0, Readout, imu


def calibration(seed: int = 1) -> Calibration:
    """Return one whose numbers have all their digits."""
    rng = np.random.default_rng(seed)
    readouts = Readout(2048 / G0, 1 / 3, "LSB", 32768.0), Readout(180 / np.pi, 0.0, "°/s")
    blank = imu()
    sensor = imu(
        "Gerät № 7", (readouts[0], blank.axes[0].noise), (readouts[1], blank.axes[3].noise)
    ).with_coefficients("bias", "scale", "misalignment", "g", "k2")
    p = len(sensor.coefficients)
    root = rng.standard_normal((p, p)) * 10.0 ** rng.uniform(-8, 2, p)
    return Calibration(
        sensor,
        rng.standard_normal(p) * 10.0 ** rng.uniform(-12, 3, p),
        root @ root.T,
        "ferraris",
        "ml",
        {"gravity": "9.81 ± 0.01 m/s²"},
        {"recording": "log.csv", "created": "2026-01-02T03:04:05+00:00"},
        ("the first line", "another; with „quotes“ and \\ and \n"),
        "triangular",
        exp_so3(rng.standard_normal(3)),
        shared=(
            SharedError("g", "m/s²", 1 / 3e4, rng.standard_normal(p), "ab12", "2025-11-30"),
            SharedError("sin1[outer]", "rad", 1e-5, 1e-9 * rng.standard_normal(p), "cd34"),
        ),
        validity=Validity(rate=(-1 / 3, 2.5), temperature=(293.15, 298.0)),
        job={"order": "2026-17", "customer": "Werk № 4"},
    )


def changed(
    path: Path, change: Callable[[dict[str, Any]], object], *, hashed: bool = False
) -> Path:
    """Change the content of a saved file; with the hash made to fit where `hashed`."""
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    if hashed:
        content.pop("sha256", None)
        text = json.dumps(content, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
        content["sha256"] = hashlib.sha256(text.encode()).hexdigest()
    path.write_text(json.dumps(content, ensure_ascii=False), encoding="utf-8")
    return path


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    return save(calibration(), tmp_path / "a.calibration.json")


@pytest.mark.parametrize("seed", range(5))
def test_every_number_comes_back_bit_for_bit(tmp_path: Path, seed: int):
    written = calibration(seed)
    path = tmp_path / "a.calibration.json"
    assert save(written, path) == path
    found = load(path)
    for name in ("values", "covariance", "mount"):
        assert getattr(found, name).tobytes() == getattr(written, name).tobytes(), name
    # Noise describes the recording, not the correction: it is left out.
    assert [(a.name, a.measures, a.i, a.p, a.readout) for a in found.sensor.axes] == [
        (a.name, a.measures, a.i, a.p, a.readout) for a in written.sensor.axes
    ]
    for name in ("name", "coefficients", "form", "reference_temperature"):
        assert getattr(found.sensor, name) == getattr(written.sensor, name)
    for name in ("method", "estimator", "conditions", "provenance", "notes", "frame", "job"):
        assert getattr(found, name) == getattr(written, name)
    assert found.validity == written.validity
    assert [vars(one) | {"covariance": one.covariance.tobytes()} for one in found.shared or ()] == [
        vars(one) | {"covariance": one.covariance.tobytes()} for one in written.shared or ()
    ]


def test_saving_what_was_loaded_writes_the_same_bytes(saved: Path, tmp_path: Path):
    assert save(load(saved), tmp_path / "b.json").read_bytes() == saved.read_bytes()


def test_what_is_not_known_is_left_out_and_none_is_not_nothing(tmp_path: Path):
    path = tmp_path / "a.calibration.json"
    bare = replace(calibration(), shared=None, validity=None, job={})
    content = json.loads(save(bare, path).read_text(encoding="utf-8"))
    assert not {"shared", "validity", "job"} & set(content)
    assert (load(path).shared, load(path).validity, load(path).job) == (None, None, {})
    save(replace(bare, shared=(), validity=Validity()), path)
    assert (load(path).shared, load(path).validity) == ((), Validity())


def test_coefficients_are_written_with_si_units(saved: Path):
    rows = {r["name"]: r for r in json.loads(saved.read_text(encoding="utf-8"))["coefficients"]}
    assert rows["ax.k0"]["unit"] == "m/s²"
    assert rows["gz.bias"]["unit"] == "rad/s"
    assert rows["ay.delta_p"]["unit"] == "rad"
    assert rows["az.k2"]["unit"] == "(m/s²)⁻¹"
    assert rows["gx.g_i"]["unit"] == "(rad/s)/(m/s²)"


def test_a_file_laid_out_anew_is_still_the_same_calibration(saved: Path):
    before = load(saved)
    content = json.loads(saved.read_text(encoding="utf-8"))
    shuffled = dict(reversed(content.items()))
    saved.write_text(json.dumps(shuffled, indent=4), encoding="utf-8")
    assert load(saved).values.tobytes() == before.values.tobytes()


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c["coefficients"][0].update(value=np.nextafter(c["coefficients"][0]["value"], 9)),
        lambda c: c["coefficients"][3].update(unit="1"),
        lambda c: c["covariance"][2].__setitem__(5, c["covariance"][2][5] * (1 + 4e-16) + 1e-300),
        lambda c: c["mount"][0].__setitem__(0, 0.5),
        lambda c: c["sensor"]["axes"][1]["readout"].update(scale=2049.0),
        lambda c: c["sensor"].update(name="another"),
        lambda c: c["conditions"].update(gravity="9.82 m/s²"),
        lambda c: c["notes"].pop(),
        lambda c: c.update(more=1),
        lambda c: c.pop("sha256"),
        lambda c: c.update(sha256="0" * 64),
    ],
)
def test_any_change_of_the_content_is_detected(saved: Path, change: Callable[[Any], object]):
    with refused(file=saved, key="sha256"):
        load(changed(saved, change))


def test_a_changed_digit_in_the_text_is_detected(saved: Path):
    text = saved.read_text(encoding="utf-8")
    at = text.index('"value": ') + len('"value": ') + 4
    digit = "1" if text[at] != "1" else "2"
    saved.write_text(text[:at] + digit + text[at + 1 :], encoding="utf-8")
    with refused(file=saved, key="sha256"):
        load(saved)


@pytest.mark.parametrize(
    "schema", ["inercal/calibration/1", "inercal/calibration/3", "imucal/1", None, 7]
)
def test_another_schema_is_refused(saved: Path, schema: object):
    with refused(file=saved, key="schema"):
        load(changed(saved, lambda c: c.update(schema=schema), hashed=True))


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("covariance", lambda c: c.pop("covariance")),
        ("covariance", lambda c: c["coefficients"].pop()),
        (None, lambda c: c["coefficients"][0].update(name="ax.k9")),
        ("coefficients[0].value", lambda c: c["coefficients"][0].update(value="much")),
        ("coefficients[0].value", lambda c: c["coefficients"][0].update(value=True)),
        ("coefficients[0].value", lambda c: c["coefficients"][0].update(value="1.5")),
        ("coefficients[0].value", lambda c: c["coefficients"][0].update(value=10**400)),
        ("coefficients[0].std", lambda c: c["coefficients"][0].update(std=-1e-3)),
        ("coefficients", lambda c: c["coefficients"][0].update(unit="g")),
        ("coefficients", lambda c: c["coefficients"][1].update(name="ax.k0")),
        ("covariance", lambda c: c["coefficients"][0].update(std=1e3)),
        ("covariance", lambda c: c["covariance"][1].__setitem__(1, -1e-9)),
        ("covariance", lambda c: c["covariance"][1].__setitem__(0, 1e3)),
        ("covariance", lambda c: correlate(c["covariance"], 1.01)),
        ("covariance", lambda c: c["covariance"][0].pop()),
        ("covariance[0][0]", lambda c: c["covariance"][0].__setitem__(0, None)),
        (None, lambda c: c["sensor"]["axes"].pop()),
        (None, lambda c: c["sensor"]["axes"][0].update(i=[1, 1, 0])),
        ("sensor.axes[0].readout.gain", lambda c: c["sensor"]["axes"][0]["readout"].update(gain=1)),
        ("sensor", lambda c: c.update(sensor=[])),
        ("mount[0]", lambda c: c.update(mount=[[1, 0], [0, 1]])),
        ("mount", lambda c: c.update(mount=[[1, 0, 0], [0, 1, 0], [0, 0, -1]])),
        ("mount[0][0]", lambda c: c.update(mount=[[2, 0, 0], [0, 1, 0], [0, 0, 1]])),
        ("sensor", lambda c: c["sensor"].update(name=" \n")),
        ("created", lambda c: c["provenance"].update(created="mount")),
        ("created", lambda c: c["provenance"].update(created="9999-12-31T23:59:59-14:00")),
        ("frame", lambda c: c.update(frame="sideways")),
        ("sensor.form", lambda c: c["sensor"].update(form="twisted")),
        ("notes", lambda c: c.update(notes=7)),
        (None, lambda c: c["shared"][0]["covariance"].pop()),
        ("shared[0].determination", lambda c: c["shared"][0].pop("determination")),
        ("shared[0].date", lambda c: c["shared"][0].update(date=[])),
        (None, lambda c: c["shared"][0].update(std=0.0)),
        (None, lambda c: c["shared"][1].update(name="g")),
        ("shared", lambda c: c.update(shared=7)),
        ("validity", lambda c: c.update(validity=[1, 2])),
        ("validity.pressure.[key]", lambda c: c["validity"].update(pressure=[0, 1])),
        (None, lambda c: c["validity"].update(rate=[1, -1])),
        ("job.order", lambda c: c.update(job={"order": 7})),
        ("job", lambda c: c.update(job=["7"])),
    ],
)
def test_fields_that_do_not_fit_are_refused(
    saved: Path, key: str | None, change: Callable[[Any], object]
):
    with refused(file=saved, key=key):
        load(changed(saved, change, hashed=True))


def correlate(covariance: list[list[float]], correlation: float) -> None:
    """Have two coefficients correlated, more than is possible above 1."""
    covariance[0][1] = covariance[1][0] = correlation * sqrt(covariance[0][0] * covariance[1][1])


@pytest.mark.parametrize("text", ["NaN", "Infinity", "1e400"])
def test_a_number_that_is_none_is_refused(saved: Path, text: str):
    whole = saved.read_text(encoding="utf-8")
    saved.write_text(re.sub(r'"value": [^,]*,', f'"value": {text},', whole, count=1), "utf-8")
    with refused(file=saved):
        load(saved)


@pytest.mark.parametrize(
    "change", [lambda t: t, lambda t: t.replace('"method":"', '"method":"x', 1)]
)
def test_a_canonical_text_is_proven_as_any_other(saved: Path, change: Callable[[str], str]):
    content = json.loads(saved.read_text(encoding="utf-8"))
    text = canonical_text(content)
    if change(text) == text:
        assert parse(text, "canonical").values.tolist() == load(saved).values.tolist()
    else:
        with refused(key="sha256"):
            parse(change(text), "canonical")


@pytest.mark.parametrize("without", [{}, {"shared": None, "validity": None}])
def test_the_text_of_a_calibration_is_the_canonical_text_of_its_object(without: dict[str, Any]):
    made = replace(calibration(), **without)
    assert calibration_text(made) == canonical_text(calibration_object(made))


@pytest.mark.parametrize("colon", [":", " :", "\n\t:", ' : "a\\":", "method":'])
def test_a_key_that_is_there_twice_is_refused(saved: Path, colon: str):
    whole = saved.read_text(encoding="utf-8")
    saved.write_text(whole.replace('"method":', f'"method"{colon} "other", "method":', 1), "utf-8")
    with refused(file=saved):
        load(saved)


@pytest.mark.parametrize("place", ["fifo", "/dev/zero", "."])
def test_what_is_no_regular_file_is_refused_at_once(tmp_path: Path, place: str):
    path = tmp_path / place
    if place == "fifo":
        os.mkfifo(path)
    with refused(file=path):
        load(path)


@pytest.mark.parametrize("kept", [0, 1, 100, 2000])
def test_a_truncated_file_is_refused(saved: Path, kept: int):
    saved.write_bytes(saved.read_bytes()[:kept])
    with refused(file=saved, key=None):
        load(saved)


@pytest.mark.parametrize(
    "content",
    [bytes(range(256)), b"[1, 2]", b"7", b"null", b"[" * 100_000, b'{"schema": ' * 100_000],
    ids=["binary", "list", "number", "null", "nested lists", "nested objects"],
)
def test_another_content_than_a_calibration_is_refused(tmp_path: Path, content: bytes):
    path = tmp_path / "junk.json"
    path.write_bytes(content)
    with refused(file=path):
        load(path)


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path):
    for path in (tmp_path / "none.json", tmp_path):
        with refused(file=path):
            load(path)


def test_a_missing_folder_is_made_and_a_file_is_no_folder(tmp_path: Path):
    save(calibration(), tmp_path / "new" / "a.json")
    with refused(file="b.json"):
        save(calibration(), tmp_path / "new" / "a.json" / "b.json")
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.json"]


def test_a_disk_that_fills_up_leaves_the_old_file_and_nothing_else(
    saved: Path, monkeypatch: pytest.MonkeyPatch
):
    before = saved.read_bytes()

    def full(path: Path, text: str, **_: object) -> int:
        path.write_bytes(text.encode()[:100])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with refused(file=saved):
        save(calibration(2), saved)
    assert saved.read_bytes() == before
    assert list(saved.parent.iterdir()) == [saved]
