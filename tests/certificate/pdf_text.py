"""The text of a PDF by its content streams and ToUnicode tables alone, as a search finds it."""

import re
from pathlib import Path

import pikepdf

_HEX = re.compile(rb"<([0-9a-fA-F]+)>")


def page_texts(path: Path) -> list[str]:
    """Return the text of each page, without white space."""
    with pikepdf.open(path) as document:
        return [_page_text(page) for page in document.pages]


def squeezed(text: str) -> str:
    """Return a text without white space, as `page_texts` has it."""
    return re.sub(r"\s+", "", text)


def _page_text(page: pikepdf.Page) -> str:
    fonts = {name: _unicode_table(font) for name, font in page.resources.get("/Font", {}).items()}
    table: dict[int, str] = {}
    found: list[str] = []
    for operands, operator in pikepdf.parse_content_stream(page):
        word = str(operator)
        if word == "Tf":
            table = fonts[str(operands[0])]
        elif word in ("Tj", "TJ"):
            parts = operands[0] if word == "TJ" else [operands[0]]
            for part in parts:
                if isinstance(part, pikepdf.String):
                    found += _decoded(bytes(part), table)
    return squeezed("".join(found))


def _decoded(codes: bytes, table: dict[int, str]) -> list[str]:
    return [
        table.get(int.from_bytes(codes[k : k + 2], "big"), "\ufffd")
        for k in range(0, len(codes), 2)
    ]


def _unicode_table(font: pikepdf.Object) -> dict[int, str]:
    """Return the characters of the codes, by the CMap of a font."""
    cmap = font["/ToUnicode"].read_bytes()
    table: dict[int, str] = {}
    for block in re.findall(rb"beginbfchar(.*?)endbfchar", cmap, re.DOTALL):
        words = _HEX.findall(block)
        table |= {
            int(code, 16): _text(to) for code, to in zip(words[::2], words[1::2], strict=True)
        }
    for block in re.findall(rb"beginbfrange(.*?)endbfrange", cmap, re.DOTALL):
        words = _HEX.findall(block)
        for low, high, to in zip(words[::3], words[1::3], words[2::3], strict=True):
            first = ord(_text(to))
            table |= {
                code: chr(first + code - int(low, 16))
                for code in range(int(low, 16), int(high, 16) + 1)
            }
    return table


def _text(word: bytes) -> str:
    return bytes.fromhex(word.decode()).decode("utf-16-be")
