"""The container: what its file says, and how its steps are read from it."""

import re
import tomllib
from pathlib import Path, PurePath

import pytest
from tools.container import (
    CONTAINERFILE,
    IGNORED,
    ROOT,
    Folder,
    Step,
    ignore_patterns,
    is_ignored,
    steps,
)

STEPS = steps(CONTAINERFILE.read_text(encoding="utf-8"))
PATTERNS = ignore_patterns(IGNORED.read_text(encoding="utf-8"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def texts(name: str) -> list[str]:
    return [" ".join(step.text.split()) for step in STEPS if step.name == name]


def environment(text: str) -> dict[str, str]:
    return dict(one.split("=", 1) for one in text.split())


def test_the_image_has_two_stages_of_one_official_python_that_is_supported():
    build, final = (text.split() for text in texts("FROM"))
    assert build[0] == final[0]
    found = re.fullmatch(r"python:(3\.\d+)-slim", final[0])
    assert found
    assert f"Programming Language :: Python :: {found[1]}" in PROJECT["classifiers"]
    assert STEPS[0].name == "FROM"
    assert not any("://" in step.text for step in STEPS)


def test_the_user_is_not_root_and_is_stated_after_the_last_step():
    names = [step.name for step in STEPS]
    (user,) = texts("USER")
    number, group = user.split(":")
    assert int(number) > 0
    assert int(group) > 0
    assert names.index("USER") > max(k for k, name in enumerate(names) if name in ("RUN", "COPY"))


def test_all_packages_are_those_of_the_lock_with_their_hashes():
    own, others, build = (text for text in texts("RUN") if "pip install" in text)
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert own.split()[-1] in re.findall(r"uv==[\d.]+", makefile)
    assert {"--require-hashes", "requirements.lock", "pyproject.toml"} <= set(others.split())
    assert {"--no-deps", "--require-build-hashes", "requirements.lock"} <= set(build.split())
    extras = re.findall(r"--extra (\w+)", others)
    assert extras
    assert set(extras) <= set(PROJECT["optional-dependencies"])


def test_kernels_are_compiled_and_used_for_the_same_kind_of_processor():
    build, final = map(environment, texts("ENV"))
    assert build["NUMBA_CPU_NAME"] == final["NUMBA_CPU_NAME"] == "generic"
    assert any("inercal compile" in text for text in texts("RUN"))


def test_the_entry_point_is_the_program_of_the_package():
    (entry,) = texts("ENTRYPOINT")
    assert entry == '["inercal"]'
    assert "inercal" in PROJECT["scripts"]


def test_every_copied_file_exists_and_is_sent_to_the_builder():
    for text in texts("COPY"):
        *sources, _ = text.split()
        if sources[0].startswith("--from="):
            continue
        for source in sources:
            assert (ROOT / source).exists()
            assert not is_ignored(PurePath(source), PATTERNS)


@pytest.mark.parametrize(
    "path",
    [
        ".git/config",
        ".venv/bin/python",
        "demo-output/run.csv",
        "tests/conftest.py",
        "tools/container.py",
        "src/inercal/__pycache__/x.pyc",
        "secret.pem",
    ],
)
def test_what_the_build_does_not_need_is_ignored(path: str):
    assert is_ignored(PurePath(path), PATTERNS)


@pytest.mark.parametrize("path", ["src/inercal/cli/app.py", "tools/long_description.py", "LICENSE"])
def test_what_the_build_needs_is_not_ignored(path: str):
    assert not is_ignored(PurePath(path), PATTERNS)


def test_docker_ignores_the_same_files():
    assert IGNORED.with_name(".dockerignore").read_bytes() == IGNORED.read_bytes()


def test_lines_are_joined_and_comments_left_out():
    text = "# first\nFROM a AS b\n\nRUN one \\\n  # no\n  two\nUSER 3\n"
    joined = [Step(name, " ".join(words.split())) for name, words in steps(text)]
    assert joined == [Step("FROM", "a AS b"), Step("RUN", "one two"), Step("USER", "3")]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Folder:
    monkeypatch.setattr("tools.container.subprocess.run", lambda *_, **__: None)  # makes no venv
    made = Folder(tmp_path)
    monkeypatch.undo()
    return made


def test_steps_are_carried_out_inside_the_folder(folder: Folder):
    for text in (
        "ENV KIND=generic PATH=/opt/x/bin:$PATH",
        "RUN mkdir -m 1777 /data",
        "WORKDIR /data/work",
        "COPY pyproject.toml LICENSE ./",
        'RUN echo "$KIND" > /opt/kind && test -f LICENSE',
        'ENTRYPOINT ["inercal"]',
        "USER 10001:10001",
    ):
        folder.carry_out(*steps(text))
    assert folder.place == folder.root / "data" / "work"
    assert (folder.place / "pyproject.toml").read_bytes() == (ROOT / "pyproject.toml").read_bytes()
    assert (folder.root / "opt" / "kind").read_text() == "generic\n"
    assert folder.environment["PATH"].startswith(f"{folder.root}/opt/x/bin:")
    assert folder.entry == ["inercal"]


@pytest.mark.parametrize("text", ["RUN false", "ADD a b", "RUN exit 3"])
def test_a_step_that_fails_or_is_unknown_ends_the_program(folder: Folder, text: str):
    with pytest.raises(SystemExit):
        folder.carry_out(*steps(text))
