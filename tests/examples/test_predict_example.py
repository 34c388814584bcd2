"""The example and the snippet of the page on predictions run and agree."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_the_example_of_predictions_prints_what_the_snippet_of_the_page_computes(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(ROOT)
    page = (ROOT / "docs" / "how-to" / "predict.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, flags=re.S)
    of_page: dict[str, object] = {}
    exec(compile(code, "predict.md", "exec"), of_page)
    capsys.readouterr()
    of_example = runpy.run_path(str(ROOT / "examples" / "predict" / "in_python.py"))
    printed = capsys.readouterr().out
    snippet, example = of_page["found"], of_example["found"]
    np.testing.assert_array_equal(snippet.expanded, example.expanded)  # type: ignore[attr-defined]
    numbers = re.findall(r"U after correction (\d+) µg", printed)
    assert [int(n) for n in numbers] == [
        round(1e6 * u / 9.80665)
        for u in example.expanded[:, 2].tolist()  # type: ignore[attr-defined]
    ]
    # az.k0 of the example rises by 310 µg/K, and its scale factor falls by 70 ppm/K.
    cold, _, warm = (example.raw_error[:, 2] / 9.80665).tolist()  # type: ignore[attr-defined]
    assert warm - cold == pytest.approx(60 * (310.0e-6 - 69.7e-6), rel=0.01)
