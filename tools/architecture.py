"""Draw the rooms by layers, with their imports, and list them: ``python -m tools.architecture``.

Layers are those of import-linter in pyproject.toml, from high to low; the imports are those of the
import graph. An import that others imply is left out: where a imports b and b imports c, the arc
from a to c is not drawn.
"""

import ast
import tomllib
from html import escape
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
MAP = ROOT / "CONTRIBUTING.md"
_BEGIN, _END = "<!-- rooms -->\n", "<!-- /rooms -->\n"
_ROW, _BOX, _LEFT, _WIDTH, _TOP = 30, 130, 210, 1000, 12  # pixels
_STYLE = """text { font: 14px system-ui, sans-serif; fill: #1c2430 }
.what { fill: #5d6876; font-size: 13px }
rect { fill: #e9edf2; stroke: #5d6876 }
path { fill: none; stroke: #1f5fa8; stroke-opacity: .55 }
line { stroke: #c3cad3 }
@media (prefers-color-scheme: dark) {
  text { fill: #e4e8ee } .what { fill: #a0abb9 } rect { fill: #29313c; stroke: #a0abb9 }
  path { stroke: #86b7f5 } line { stroke: #4a5563 }
}"""


def layers() -> list[list[str]]:
    """Return the packages and modules of each layer, the highest first."""
    content = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contract = content["tool"]["importlinter"]["contracts"][0]
    return [[name.strip() for name in layer.split("|")] for layer in contract["layers"]]


def imports() -> dict[str, set[str]]:
    """Return which packages each package imports by some module, those implied left out."""
    graph = grimp.build_graph("inercal", cache_dir=None)
    names = [name for layer in layers() for name in layer]
    direct: dict[str, set[str]] = {name: set() for name in names}
    for module in graph.modules:
        for imported in graph.find_modules_directly_imported_by(module):
            ends = [one.split(".")[1] for one in (module, imported) if "." in one]
            if len(ends) == 2 and ends[0] != ends[1] and ends[0] in direct:  # not __main__
                direct[ends[0]].add(ends[1])
    reached: dict[str, set[str]] = {}
    for name in reversed(names):  # what is imported stands lower
        reached[name] = set(direct[name]).union(*(reached[one] for one in direct[name]))
    return {
        name: {one for one in ends if not any(one in reached[other] for other in ends)}
        for name, ends in direct.items()
    }


def summary(name: str) -> str:
    """Return the first sentence of the docstring of a package or module."""
    folder = ROOT / "src" / "inercal" / name
    path = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    first = " ".join(text.split("\n\n")[0].split())
    return first.removesuffix(".")


def picture() -> str:
    """Return the picture, SVG."""
    rows = [(name, k) for k, layer in enumerate(layers()) for name in layer]
    place = {name: i for i, (name, _) in enumerate(rows)}
    height = 2 * _TOP + _ROW * len(rows)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" role="img">',
        "<title>The rooms of inercal from high to low, and what each imports</title>",
        f"<style>{_STYLE}</style>",
    ]
    for name, ends in imports().items():
        for end in sorted(ends, key=place.__getitem__):
            begin_y, end_y = (_TOP + _ROW * (place[one] + 0.5) for one in (name, end))
            reach = min(25 + 10 * (place[end] - place[name]), _LEFT - 15)
            x = _LEFT - reach
            parts.append(
                f'<path d="M{_LEFT} {begin_y:.0f}C{x} {begin_y:.0f} {x} {end_y:.0f} {_LEFT} '
                f'{end_y:.0f}"/>'
            )
    for i, (name, layer) in enumerate(rows):
        y = _TOP + _ROW * i
        if i and rows[i - 1][1] != layer:
            parts.append(f'<line x1="{_LEFT}" x2="{_WIDTH}" y1="{y}" y2="{y}"/>')
        parts.append(
            f'<rect x="{_LEFT}" y="{y + 3}" width="{_BOX}" height="{_ROW - 6}" rx="4"/>'
            f'<text x="{_LEFT + 8}" y="{y + 20}">{name}</text>'
            f'<text class="what" x="{_LEFT + _BOX + 12}" y="{y + 20}">'
            f"{escape(summary(name))}</text>"
        )
    return "\n".join([*parts, "</svg>\n"])


def with_map(page: str) -> str:
    """Return the text of `MAP` with its table of the rooms renewed."""
    rows = [
        f"| [`{name}`](src/inercal/{name}) | {summary(name)} |" for one in layers() for name in one
    ]
    before, _, rest = page.partition(_BEGIN)
    table = "\n".join(["| room | what it holds |", "|---|---|", *rows])
    return f"{before}{_BEGIN}\n{table}\n\n{_END}{rest.partition(_END)[2]}"


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
    MAP.write_text(with_map(MAP.read_text(encoding="utf-8")), encoding="utf-8")
    print(f"wrote {PICTURE.relative_to(ROOT)} and the map in {MAP.relative_to(ROOT)}")
