"""How `make docs` builds the site from these pages: Sphinx, MyST, Furo; nothing from other hosts.

The pages are also read in an editor and on a code host. So the tree beside each page is made from
the lists in `index.md` and `architecture.md`, and links to files outside this folder become
downloads. A link to the folder of the examples becomes a download of all of them, for readers who
have only the site and the wheel.
"""

import re
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

from sphinx.application import Sphinx

DOCS = Path(__file__).parent
EXAMPLES = DOCS.parent / "examples"

project = "inercal"
author = "the inercal developers"
copyright = author
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]
html_theme = "furo"
html_title = "inercal"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
smartquotes = False  # --option and "quotes" in texts must stay as a shell needs them
html_show_sourcelink = False
napoleon_use_rtype = False
autodoc_typehints = "none"  # docstrings state types with shapes and units
autodoc_member_order = "bysource"
add_module_names = False

_LISTS = {"index", "architecture"}  # pages whose sections list other pages
_HEADING = re.compile(r"^## (.+)$", re.M)
_PAGE_LINK = re.compile(r"\]\(([^)#:]+)\.md\)")
_PICTURE = re.compile(r"^!\[([^\]]*)\]\(([^)]+)\.png\)$", re.M)
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((\.\.[^)#]*)(#[^)]*)?\)")


def add_tree(lists: str) -> str:
    """Return the text of a page with a hidden tree of the pages that each section lists."""
    parts = _HEADING.split(lists)
    trees: list[str] = []
    for heading, text in zip(parts[1::2], parts[2::2], strict=True):
        if pages := dict.fromkeys(_PAGE_LINK.findall(text)):
            caption = f":caption: {heading}"
            trees.append("\n".join(["```{toctree}", ":hidden:", caption, "", *pages, "```", ""]))
    return "\n".join([lists, *trees])


def keep_links_inside(text: str, folder: Path) -> str:
    """Return the text of a page without links to folders and pages outside the site.

    The site has neither; links to other files stay, as downloads.
    """

    def kept(found: re.Match[str]) -> str:
        words, target = found[1], (folder / found[2]).resolve()
        if target == EXAMPLES:
            up = "../" * len(folder.relative_to(DOCS).parts)
            return f'<a href="{up}examples.zip" download>{words}</a>'
        inside = target.is_relative_to(DOCS)
        return found[0] if inside or (target.is_file() and target.suffix != ".md") else words

    return _LINK.sub(kept, text)


def show_both(text: str, folder: Path) -> str:
    """Return the text of a page with the dark picture beside the light one, where there is one."""

    def both(found: re.Match[str]) -> str:
        words, name = found.groups()
        if not (folder / f"{name}-dark.png").is_file():
            return found[0]
        return "\n\n".join(
            f"```{{image}} {name}{end}.png\n:alt: {words}\n:class: only-{scheme}\n```"
            for scheme, end in (("light", ""), ("dark", "-dark"))
        )

    return _PICTURE.sub(both, text)


def _prepare(_: Sphinx, name: str, content: list[str]) -> None:
    content[0] = keep_links_inside(content[0], (DOCS / name).parent)
    content[0] = show_both(content[0], (DOCS / name).parent)
    if name in _LISTS:
        content[0] = add_tree(content[0])


def _pack_examples(app: Sphinx, error: Exception | None) -> None:
    if error is not None:
        return
    with ZipFile(app.outdir / "examples.zip", "w", ZIP_DEFLATED) as archive:
        for path in sorted(EXAMPLES.rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                archive.write(path, path.relative_to(EXAMPLES.parent))


def setup(app: Sphinx) -> None:
    """Prepare each page before it is parsed, and pack the examples when all are written."""
    app.connect("source-read", _prepare)
    app.connect("build-finished", _pack_examples)
