"""Logs as careless hands change them: `inercal init` drafts a run file, or says one clear line."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.fuzz.log_mutations import FORMATS, TEXTS, drafted, write_mutation
from tests.program import run_program

MUTATIONS = 200  # of each format


def _parts() -> Iterator[object]:
    """Yield the mutations of each format in three parts; other processes read binary files."""
    for name in FORMATS:
        fast, slow = 3, 16 if name in TEXTS else 9
        for numbers, marks in (
            (range(fast), ()),
            (range(fast, slow), pytest.mark.slow),
            (range(slow, MUTATIONS), pytest.mark.evidence),
        ):
            yield pytest.param(
                name, numbers, marks=marks, id=f"{name} {numbers.start}-{numbers.stop}"
            )


@pytest.mark.slow
@pytest.mark.parametrize(("name", "numbers"), [*_parts()])
def test_a_mutated_log_is_drafted_or_refused_by_one_line(
    name: str, numbers: range, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    told = [drafted(write_mutation(name, tmp_path, 0, number)) for number in numbers]
    assert capfd.readouterr().err == ""
    assert len(told) < 10 or told.count("refused") < len(told)


@pytest.mark.parametrize(
    "name",
    [
        name if name in ("csv", "npz") else pytest.param(name, marks=pytest.mark.slow)
        for name in FORMATS
    ],
)
def test_the_program_ends_with_a_run_file_or_with_one_line(name: str, tmp_path: Path):
    path = write_mutation(name, tmp_path, 1, 0)
    run_file = tmp_path / "run.toml"
    done = run_program("init", path, "--yes", "--out", run_file)
    if done.status == 0:
        assert run_file.is_file()
        assert done.error == ""
    else:
        assert done.status == 2
        assert done.error.startswith("inercal: ")
