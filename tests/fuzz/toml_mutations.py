"""TOML files as a careless or hostile hand changes them: lines, values and characters."""

import re

from hypothesis import strategies as st

_KEY = re.compile(r"(\s*[\w.\"'-]+\s*=\s*).*")
_TEXTS = [
    " ",
    "0 m",
    "nan g",
    "1e400 m",
    "1e308 km",
    "9.8 m/s² ± -1",
    "± 1",
    "%",
    "../x",
    "/dev/zero",
    "/dev/stdin",
    "a\\u0000b",
    "ü¬°′″µ",
    "0 °",
    "1 µs",
    "-5 °C ± 1 K",
    "16/0 g",
    "2^-99 rad",
    "{ax:d}{ax:d}",
    "FA ax:i16",
]
_NUMBERS = ["0", "-1", "1", "2", "1e308", "-1e308", "nan", "inf", "-inf"]
_INTEGERS = [2**31, 2**53 + 1, 2**63 - 1, 2**63, 2**64, -(2**63), -(2**64), 10**400]
_LISTS = ["[]", "[1, 2, 3]", '["x", "y", "z"]', '["ax", "ax"]', "[[1]]", "{}", '{a = {b = "c"}}']
VALUES = [
    *(f'"{text}"' for text in ("", *_TEXTS, "x" * 5000)),
    *(*_NUMBERS, *map(str, _INTEGERS), "true", "false", "1979-05-27T07:32:00Z", "07:32:00"),
    *(*_LISTS, "[" * 40 + "]" * 40, "[" * 2000 + "]" * 2000),
]


@st.composite
def mutated(draw: st.DrawFn, texts: tuple[str, ...]) -> str:
    """Return one of the texts after one to four changes."""
    lines = draw(st.sampled_from(texts)).splitlines()
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(lines) - 1))
        change = draw(st.sampled_from(["value", "value", "value", "drop", "copy", "swap", "text"]))
        if change == "value" and (key := _KEY.fullmatch(lines[at])):
            lines[at] = key[1] + draw(st.sampled_from(VALUES))
        elif change == "drop" and len(lines) > 1:
            del lines[at]
        elif change == "copy":
            lines.insert(draw(st.integers(0, len(lines))), lines[at])
        elif change == "swap":
            other = draw(st.integers(0, len(lines) - 1))
            lines[at], lines[other] = lines[other], lines[at]
        else:
            begin = draw(st.integers(0, len(lines[at])))
            lines[at] = lines[at][:begin] + draw(st.text(max_size=4)) + lines[at][begin + 1 :]
    return "\n".join(lines)
