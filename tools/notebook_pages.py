"""Write the pages of the notebooks, with outputs: ``python -m tools.notebook_pages [NAME …]``.

Each notebook of the examples is run twice, with light and with dark figures. The page has its
text, code and outputs; figures are in `docs/images`. The notebooks themselves hold no outputs.
"""

import base64
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
PAGES = ROOT / "docs" / "notebooks"
IMAGES = ROOT / "docs" / "images"
SCHEMES = {"light": "", "dark": "-dark"}
_PATIENCE = 600  # s a cell; kernels are compiled once on a machine
_STYLE = "\n".join(
    [
        "from matplotlib import pyplot as _plt",
        "_plt.style.use('{style}')",
        "_plt.rcParams['savefig.transparent'] = True",
    ]
)
_SHEET = re.compile(r"<style.*?</style>", re.S)


def run_notebook(path: Path, *more: str, first: str = "") -> nbformat.NotebookNode:
    """Return a notebook with its outputs.

    Parameters
    ----------
    path : Path
        Its cells find files beside it.
    *more : str
        Code of cells that follow the notebook's own.
    first : str
        Code of a cell before them; it is taken away again.
    """
    notebook = nbformat.read(path, as_version=4)
    codes = [nbformat.v4.new_code_cell(code) for code in (first, *more)]
    notebook.cells = [codes[0], *notebook.cells, *codes[1:]]
    resources = {"metadata": {"path": str(path.parent)}}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the kernel's own packages
        client = NotebookClient(
            notebook, timeout=_PATIENCE, kernel_name="python3", resources=resources
        )
        client.execute()
    del notebook.cells[0]
    return notebook


def page_text(name: str, cells: Sequence[Any]) -> str:
    """Return the page of a notebook of this name, whose cells have outputs."""
    parts: list[str] = []
    pictures = 0
    for cell in cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            data = output.get("data", {})
            if "image/png" in data:
                pictures += 1
                title = next(one for one in parts if one.startswith("# "))
                words = title.split("\n")[0].strip("# ")
                parts.append(f"![{words}, figure {pictures}](../images/{name}-{pictures}.png)")
            elif "text/html" in data:
                parts.append(_table(data["text/html"]))
            else:
                text = output.get("text", "") or data["text/plain"]
                parts.append(f"```text\n{text.rstrip()}\n```")
    link = f"Written by `make notebooks` from [examples/{name}.ipynb](../../examples/{name}.ipynb)."
    return "\n\n".join([*parts, link]) + "\n"


def pictures(cells: Sequence[Any]) -> Iterator[bytes]:
    """Yield the figures of a notebook, PNG."""
    for cell in cells:
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if "image/png" in data:
                yield base64.b64decode(data["image/png"])


def _table(html: str) -> str:
    """Return a table without a style of its own, as one block: no line is empty."""
    plain = _SHEET.sub("", html).replace(' border="1"', "")
    lines = [line.strip() for line in plain.splitlines() if line.strip()]
    return "\n".join(["<div>", *lines, "</div>"])


def write_page(path: Path) -> None:
    """Write the page and the figures of a notebook."""
    PAGES.mkdir(exist_ok=True)
    for scheme, end in SCHEMES.items():
        style = "dark_background" if scheme == "dark" else "default"
        cells = run_notebook(path, first=_STYLE.format(style=style)).cells
        for k, picture in enumerate(pictures(cells), start=1):
            (IMAGES / f"{path.stem}-{k}{end}.png").write_bytes(picture)
        if scheme == "light":
            page = PAGES / f"{path.stem}.md"
            page.write_text(page_text(path.stem, cells), encoding="utf-8")
            print(f"wrote {page.name}")


if __name__ == "__main__":
    for found in sorted(EXAMPLES.glob("*.ipynb")):
        if len(sys.argv) == 1 or found.stem in sys.argv[1:]:
            write_page(found)
