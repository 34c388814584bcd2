"""Differences against the scatter from run to run, over simulated laboratories of known scatter."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.program import run_program
from tests.repeatability.laboratory import KIND, MICRO, NAMES, Laboratory, draw, rotation
from tests.repeatability.sessions import sessions_of

from inercal.basics.documents import document_text
from inercal.calibration.comparison import compare
from inercal.calibration.comparison.run_to_run import RunScatter, against_scatter
from inercal.calibration.files import save
from inercal.laboratory.repeatability import repeat, repeatability_object
from inercal.laboratory.store import Register

TURN_ON = np.array([60.0, 30.0, 0.0])[KIND] * MICRO
SCATTER = np.diag(TURN_ON**2) + (40 * MICRO) ** 2 * rotation() @ rotation().T
STEP = 500 * MICRO  # of ax.k0, 6 standard deviations of a difference


def test_ordinary_runs_are_ordinary_and_all_exceed_their_own_uncertainties(seed: int):
    """Known scatter: 5 % by it, nearly all by the uncertainties of the calibrations alone."""
    rng = np.random.default_rng(seed)
    known = RunScatter("known", NAMES, SCATTER, np.full(12, np.inf))
    pairs = 400
    rejected, ordinary, single = 0, 0, 0
    for _ in range(pairs):
        first, second = (one.calibration for one in sessions_of(draw(Laboratory(), 2, rng)))
        compared = compare(first, second)
        found = against_scatter(compared, known)
        assert found is not None
        assert found.joint is not None
        assert compared.joint_test is not None
        rejected += compared.joint_test.p_value < 0.05
        ordinary += found.joint.p_value < 0.05
        single += len(found.beyond)
    assert rejected > 0.98 * pairs
    assert 0.02 * pairs < ordinary < 0.09 * pairs
    assert 0.03 < single / (12 * pairs) < 0.06


@pytest.mark.slow
def test_a_scatter_of_few_sessions_has_the_coverage_of_its_t(seed: int):
    """Four sessions: nine degrees of freedom, and three to nine of misalignments."""
    rng = np.random.default_rng(seed)
    beyond, laboratories = 0, 120
    for _ in range(laboratories):
        drawn = sessions_of(draw(Laboratory(), 6, rng))
        found = repeat(drawn[:4])
        scatter = RunScatter("file", found.names, found.run_to_run, found.next_use.dof)
        compared = compare(drawn[4].calibration, drawn[5].calibration)
        judged = against_scatter(compared, scatter)
        assert judged is not None
        beyond += len(judged.beyond)
    assert beyond / (12 * laboratories) < 0.085


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with eight sessions, the last with a step of ax.k0, and their scatter."""
    folder = tmp_path_factory.mktemp("runs")
    sessions = sessions_of(draw(Laboratory(), 8, np.random.default_rng(4)))
    for k, one in enumerate(sessions):
        found = one.calibration
        if k == 7:
            found = replace(found, values=found.values + STEP * (np.arange(12) == 0))
        when = {"created": f"2026-01-{k + 1:02d}T08:00:00+00:00", "recording sha256": f"{k:064x}"}
        save(replace(found, provenance=when), folder / f"{k}.calibration.json")
    text = document_text(repeatability_object(repeat(sessions[:6])))
    (folder / "TRIAD-1.repeatability.json").write_text(text, encoding="utf-8")
    with Register(str(folder / "register.db")) as register:
        register.enter_calibrations(sorted(folder.glob("*.calibration.json")))
    return folder


def compared_by_verb(folder: Path, *arguments: str) -> dict[str, object]:
    ended = run_program(*arguments, "--json")
    assert ended.status == 0, ended.error
    return json.loads(ended.output)["run_to_run"]


@pytest.mark.slow
def test_compare_takes_a_file_and_diff_the_register(folder: Path):
    files = [str(folder / f"{k}.calibration.json") for k in (5, 6, 7)]
    file = ("--repeatability", str(folder / "TRIAD-1.repeatability.json"))
    register = ("--register", str(folder / "register.db"))
    assert compared_by_verb(folder, "compare", *files[:2]) is None
    for ordinary, moved in (
        (("compare", *files[:2], *file), ("compare", *files[1:], *file)),
        (("store", "diff", "6", "7", *register), ("store", "diff", "7", "8", *register)),
        (("store", "diff", "6", "7", *file, *register), ("store", "diff", *files[1:], *file)),
    ):
        found = compared_by_verb(folder, *ordinary)
        assert found["beyond"] == []
        assert found["within"]
        assert compared_by_verb(folder, *moved)["beyond"] == ["ax.k0"]
    # Of a history: the newest against the previous.
    found = compared_by_verb(folder, "store", "history", "TRIAD-1", *register)
    assert found["beyond"] == ["ax.k0"]
    assert found["source"] == "6 other calibrations in the register"


def test_a_mounting_that_the_bench_answers_for_belongs_to_the_scatter(folder: Path):
    content = json.loads((folder / "TRIAD-1.repeatability.json").read_text(encoding="utf-8"))
    k = NAMES.index("ax.delta_o")
    assert content["run_to_run"][k][k] > 4 * content["scatter"][k][k]


def test_a_file_in_other_terms_is_refused(folder: Path):
    content = json.loads((folder / "TRIAD-1.repeatability.json").read_text(encoding="utf-8"))
    other = folder / "other.json"
    files = [folder / f"{k}.calibration.json" for k in (5, 6)]
    for key, value, words in (
        ("frame", "symmetric", "its frame is symmetric"),
        ("run_to_run", [[1.0]], "run_to_run must be 12 × 12"),
    ):
        other.write_text(json.dumps(content | {key: value}), encoding="utf-8")
        ended = run_program("compare", *files, "--repeatability", other)
        assert ended.status == 2
        assert words in ended.error
