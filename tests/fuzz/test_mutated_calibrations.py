"""Calibration files, changed anywhere and hashed again: read as they stand, or refused."""

import hashlib
import json
import random
import shutil
from copy import deepcopy
from math import isclose
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, seed
from hypothesis import strategies as st
from tests.base_seeds import evidence, slow
from tests.fuzz.test_mutated_toml import EXAMPLES, require_one_line, tried
from tests.program import run_program
from tests.runfile.run_file_texts import SIX_POSITIONS, run_file

from inercal.basics.errors import InercalError
from inercal.calibration.files import calibration_object, load

# As `json.dumps` writes them; a calibration holds none of them where a test puts it by chance.
VALUES = (
    None, True, False, 0, -1, 7, 10**30, 10**400, 0.0, -0.0, 1e-320, -1e-9, 1e308, float("nan"),
    float("inf"), "", "1", "nan", "ax.k0", "az.delta_p", "m/s²", "1", "\ud800", "a\nb\x1b[2J", [],
    [1.0], [[1.0]], {}, {"name": "ax.k0"}, "mount", "triangular", "tilted", "good", "f", "w",
)  # fmt: skip


def places(content: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the paths of all that a document holds."""
    inner = content.items() if isinstance(content, dict) else enumerate(content)
    found: list[tuple[Any, ...]] = []
    for key, value in inner:
        found.append((*path, key))
        if isinstance(value, dict | list):
            found += places(value, (*path, key))
    return found


def mutate(content: dict[str, Any], rng: random.Random) -> None:
    """Replace, remove, double, swap or scale one to three things of a document."""
    for _ in range(rng.randint(1, 3)):
        *outer, key = rng.choice([path for path in places(content) if path != ("sha256",)])
        parent: Any = content
        for one in outer:
            parent = parent[one]
        match rng.randrange(6):
            case 0:
                del parent[key]
            case 1 if isinstance(parent, list):
                parent.insert(key, deepcopy(parent[key]))
            case 2:
                keys = list(parent) if isinstance(parent, dict) else range(len(parent))
                parent[key] = deepcopy(parent[rng.choice(keys)])
            case 3 if isinstance(parent[key], float):
                parent[key] *= rng.choice((-1.0, 1 + 1e-12, 2.0))
            case 4 if isinstance(parent, dict):
                parent[key + rng.choice(("x", " ", ""))] = parent.pop(key)
            case _:
                parent[key] = rng.choice(VALUES)


def hashed(content: dict[str, Any]) -> str:
    """Return the text of a file whose hash is right."""
    content.pop("sha256", None)
    text = json.dumps(content, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
    return json.dumps(content | {"sha256": digest})


def strict(content: Any, like: Any) -> bool:
    """Return whether what was read is what a file states; a deviation follows the covariance."""
    if isinstance(like, dict):
        return isinstance(content, dict) and all(
            strict(content.get(key), value) for key, value in like.items()
        )
    if like is None:
        return content is None
    if isinstance(like, list):
        return (
            isinstance(content, list)
            and len(content) == len(like)
            and all(map(strict, content, like))
        )
    if isinstance(like, float):
        return type(content) in (int, float) and isclose(content, like, rel_tol=1e-6)
    return type(content) is type(like) and content == like


@pytest.mark.slow
@pytest.mark.parametrize(("count", "used"), [(20, 4), slow(200, 40), evidence(100_000, 400)])
def test_a_mutated_calibration_is_refused_or_read_as_it_stands(
    tmp_path: Path, count: int, used: int
):
    """Of the files, about as many as `used` are given to the verbs that read calibrations."""
    run = run_file(tmp_path, SIX_POSITIONS)
    assert run_program("simulate", run).status == 0
    assert run_program("calibrate", run, "--out", tmp_path, "--no-report").status == 0
    sources = [
        json.loads(path.read_text("utf-8"))
        for path in (
            tmp_path / "run.calibration.json",
            EXAMPLES / "dividing_head" / "centrifuge.calibration.json",
        )
    ]
    path, seen = tmp_path / "mutated.calibration.json", {"refused": 0, "read": 0}
    work = tmp_path / "work"
    # A report of a run whose prior knowledge is a calibration.
    for name in ("lab.toml", "lab.csv"):
        shutil.copy(EXAMPLES / "dividing_head" / name, tmp_path)
    report = tmp_path / "lab.toml"
    text = report.read_text("utf-8")
    assert text.count("centrifuge.calibration.json") == 1
    report.write_text(text.replace("centrifuge.calibration.json", path.name), "utf-8")

    @seed(count)
    @tried(count)
    @given(st.integers(0, 2**63), st.sampled_from(range(len(sources))))
    def once(chance: int, source: int) -> None:
        rng = random.Random(chance)
        content = deepcopy(sources[source])
        mutate(content, rng)
        path.write_text(hashed(content), "utf-8")
        try:
            read = load(path)
        except InercalError as error:
            require_one_line(error)
            seen["refused"] += 1
            expected = 2
        else:
            again = calibration_object(read)
            for key in ("schema", "sha256"):
                del again[key]
            if again.get("verdict"):
                del again["verdict"]["word"]  # what the grade is called today
                for key in ("advice", "noise"):  # which files of earlier versions do not have
                    if not content["verdict"].get(key):
                        assert again["verdict"].pop(key) == []
                kept = content["verdict"]
                # What a file does not state follows from its reasons and notes; empty headings go.
                kept["explanation"] = [o for o in kept.get("explanation", ()) if o["lines"]]
                for key in ("lines", "warned", "explanation"):
                    if not kept.get(key):
                        again["verdict"].pop(key)
                        kept.pop(key, None)
            assert strict(content, again)
            seen["read"] += 1
            expected = 0
        if rng.random() < used / count:
            shutil.rmtree(work, ignore_errors=True)
            work.mkdir()
            register = work / "register.db"
            # A mutation may have taken the date of measurement away, which a register needs.
            into = ("store", "import", path, "--register", register, "--measured", "2026-01-02")
            assert run_program(*into).status == expected
            if expected == 0:
                assert run_program("store", "show", "1", "--register", register).status == 0
                assert (
                    run_program("store", "show", "1", "--json", "--register", register).status == 0
                )
            applied = run_program("apply", path, run, "--out", work / "corrected.csv").status
            assert applied == 2 if expected else applied in (0, 2)
        # Drawing takes a second: where the file is refused nothing is drawn.
        if rng.random() < (used if expected else used / 10) / count:
            reported = run_program("report", report, "--out", tmp_path / "lab.html").status
            assert reported == 2 if expected else reported in (0, 2)

    once()
    assert seen["refused"] > 0.3 * count
    assert seen["read"] > 0.01 * count
