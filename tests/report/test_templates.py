"""Templates are compiled once, not for each report."""

from pathlib import Path
from typing import Any

import pytest
from jinja2 import Environment

from inercal.report import templates

# pyright: reportPrivateUsage=false


def test_a_compiled_template_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    compiled: list[str] = []
    compile_source: Any = Environment._generate

    def counted(*given: Any, **options: Any) -> str:
        compiled.append(given[2])
        return compile_source(*given, **options)

    tmp_path.chmod(0o750)
    monkeypatch.setattr(templates, "_COMPILED", str(tmp_path))
    monkeypatch.setattr(Environment, "_generate", counted)
    pages: list[str] = []
    for _ in range(2):
        templates._environment.cache_clear()
        pages.append(templates.glossary_page())
    templates._environment.cache_clear()
    assert pages[0] == pages[1]
    assert "glossary.html" in compiled
    assert len(compiled) == len(set(compiled))
    assert {file.stat().st_mode & 0o777 for file in tmp_path.iterdir()} == {0o640}


def test_pages_need_no_folder_for_compiled_templates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(templates, "_COMPILED", str(tmp_path / "missing"))
    templates._environment.cache_clear()
    assert templates.glossary_page().startswith("<!")
    templates._environment.cache_clear()
    assert not (tmp_path / "missing").exists()
