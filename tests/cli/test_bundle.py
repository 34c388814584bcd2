"""`inercal bundle` and `inercal reproduce`: the same calibration again, and nothing else."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import ZIP_BZIP2, ZIP_DEFLATED, ZIP_LZMA, ZipFile

import numpy as np
import pytest
from tests.program import run_program

from inercal.basics.errors import InputError
from inercal.calibration.comparison import largest_change
from inercal.calibration.files import load, save
from inercal.pipeline.bundles import reproduce_bundle

EXAMPLE = Path(__file__).parents[2] / "examples" / "six_position"


@pytest.fixture
def bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a bundle, with what it came from beside it."""
    for name in ("run.toml", "positions.csv"):
        shutil.copy(EXAMPLE / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    assert run_program("calibrate", "run.toml", "--no-report").status == 0
    ended = run_program("bundle", "run.toml")
    assert ended.status == 0, ended.error
    return tmp_path / "run.zip"


def rewrite(path: Path, change: Callable[[str, bytes], tuple[str, bytes]]) -> None:
    with ZipFile(path) as archive:
        entries = [change(name, archive.read(name)) for name in archive.namelist()]
    with ZipFile(path, "w") as archive:
        for name, content in entries:
            archive.writestr(name, content)


def with_manifest(change: Callable[[dict[str, Any]], object]) -> Callable[..., tuple[str, bytes]]:
    def changed(name: str, content: bytes) -> tuple[str, bytes]:
        if name == "manifest.json":
            manifest = json.loads(content)
            change(manifest)
            content = json.dumps(manifest).encode()
        return name, content

    return changed


def test_a_bundle_is_reproduced_without_the_files_that_it_came_from(bundle: Path, tmp_path: Path):
    for name in ("run.toml", "positions.csv", "run.calibration.json"):
        (tmp_path / name).unlink()
    ended = run_program("reproduce", bundle, "--json")
    assert ended.status == 0, ended.error
    found = json.loads(ended.output)
    assert found["reproduced"] is True
    assert found["difference"] == 0.0
    assert found["changed"] == {}
    assert [path.name for path in tmp_path.iterdir()] == ["run.zip"]


def test_equal_files_are_bundled_as_equal_entries(bundle: Path):
    with ZipFile(bundle) as archive:
        first = {one.filename: (one.CRC, one.date_time) for one in archive.infolist()}
    assert run_program("bundle", "run.toml", "--force").status == 0
    with ZipFile(bundle) as archive:
        second = {one.filename: (one.CRC, one.date_time) for one in archive.infolist()}
    del first["manifest.json"], second["manifest.json"]  # which holds the time
    assert first == second
    assert set(first) == {"run.toml", "positions.csv", "result/run.calibration.json"}


@pytest.mark.slow
def test_a_calibration_that_differs_is_not_reproduced(bundle: Path, tmp_path: Path):
    made = load(tmp_path / "run.calibration.json")
    moved = made.values.copy()
    moved[0] += 0.01 * made.std[0]
    save(replace(made, values=moved), tmp_path / "run.calibration.json")
    assert run_program("bundle", "run.toml", "--force").status == 0
    ended = run_program("reproduce", bundle, "--json")
    assert ended.status == 3
    assert json.loads(ended.output)["difference"] == pytest.approx(0.01, rel=1e-6)


@pytest.mark.slow
def test_other_versions_are_named(bundle: Path):
    rewrite(bundle, with_manifest(lambda made: made["made_with"].update(numpy="1.0")))
    found = json.loads(run_program("reproduce", bundle, "--json").output)
    assert list(found["changed"]) == ["numpy"]
    assert found["changed"]["numpy"][0] == "1.0"


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda n, c: (n, c.replace(b"x_p", b"x_a") if n == "positions.csv" else c), "positions"),
        (lambda n, c: (n, c + b"1" if n == "positions.csv" else c), "positions"),
        (lambda n, c: ("x", c) if n == "positions.csv" else (n, c), "damaged"),
        (lambda n, c: ("m", c) if n == "manifest.json" else (n, c), "manifest.json"),
        (with_manifest(lambda made: made.update(schema="other")), "manifest.json"),
        (with_manifest(lambda made: made.update(files=3)), "manifest.json"),
        (with_manifest(lambda made: made.update(run_file="other.toml")), "manifest.json"),
        (with_manifest(lambda m: m["files"].update({"../x": m["files"]["run.toml"]})), "'../x'"),
        (with_manifest(lambda m: m["files"].update({"/x": m["files"]["run.toml"]})), "'/x'"),
        (with_manifest(lambda m: m["files"]["run.toml"].update(bytes=10**15)), "TMPDIR"),
    ],
)
def test_a_changed_bundle_is_refused(
    bundle: Path, change: Callable[[str, bytes], tuple[str, bytes]], word: str
):
    rewrite(bundle, change)
    ended = run_program("reproduce", bundle)
    assert ended.status == 2
    assert word in ended.error


@pytest.mark.parametrize("method", [ZIP_DEFLATED, ZIP_BZIP2, ZIP_LZMA])
def test_a_damaged_bundle_is_one_line(bundle: Path, tmp_path: Path, method: int):
    """Each compression raises an error of its own on bytes that were changed."""
    packed = tmp_path / "packed.zip"
    with ZipFile(bundle) as archive, ZipFile(packed, "w", method) as target:
        for name in archive.namelist():
            target.writestr(name, archive.read(name))
    good = packed.read_bytes()
    rng = np.random.default_rng(1)
    refusals = list[InputError]()
    for _ in range(40):
        raw = bytearray(good)
        for place in rng.integers(30, len(raw), 4).tolist():
            raw[place] ^= int(rng.integers(1, 256))
        packed.write_bytes(raw)
        try:
            reproduce_bundle(packed)
        except InputError as error:
            refusals.append(error)
    assert len(refusals) > 30
    assert all(packed.name in str(one) for one in refusals)


@pytest.mark.parametrize("name", ["run.toml", "positions.csv"])
def test_a_calibration_of_other_files_is_not_bundled(bundle: Path, tmp_path: Path, name: str):
    path = tmp_path / name
    path.write_text(path.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    ended = run_program("bundle", "run.toml", "--force")
    assert ended.status == 2
    assert name in ended.error


def test_files_outside_the_folder_are_refused(bundle: Path, tmp_path: Path):
    (tmp_path / "run").mkdir()
    text = (tmp_path / "run.toml").read_text(encoding="utf-8")
    inner = tmp_path / "run" / "run.toml"
    inner.write_text(text.replace("positions.csv", "../positions.csv"), encoding="utf-8")
    assert run_program("calibrate", inner, "--no-report", "--force").status == 0
    ended = run_program("bundle", inner, "--out", "other.zip")
    assert ended.status == 2
    assert "positions.csv" in ended.error
    assert not (tmp_path / "other.zip").exists()


@pytest.mark.parametrize(
    "words",
    [
        ("reproduce", "no.zip"),
        ("reproduce", "run.zip", "--seed", "1"),
        ("bundle", "run.toml"),
        ("bundle", "run.toml", "--out", "run.tar"),
    ],
)
def test_what_cannot_be_is_refused_and_leaves_the_bundle(bundle: Path, words: tuple[str, ...]):
    before = bundle.read_bytes()
    assert run_program(*words).status == 2
    assert bundle.read_bytes() == before


def test_the_largest_change_is_of_values_and_of_u(bundle: Path, tmp_path: Path):
    made = load(tmp_path / "run.calibration.json")
    names = made.sensor.coefficients
    assert largest_change(made, names, made.values, made.std) == 0.0
    moved = made.values + np.arange(made.values.size) * made.std
    assert largest_change(made, names, moved, made.std) == pytest.approx(made.values.size - 1)
    assert largest_change(made, names, made.values, made.std / 2) == pytest.approx(1.0)
    assert largest_change(made, names[1:], made.values, made.std) == np.inf
