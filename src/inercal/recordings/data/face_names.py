"""Read the names that people give to the faces of a case: "+Z", "z up", "x_up", "-y", "x_a"."""

import re

_SIGNS = {"+": 1, "-": -1, "up": 1, "down": -1, "p": 1, "a": -1, "n": -1, "m": -1}
_WORD = r"\+|-|up|down|pos|neg|plus|minus"
_FACE = re.compile(
    rf"(?P<before>{_WORD})?(?P<axis>[xyz])(axis|face)?(?P<after>{_WORD})?(?P<end>up|down|p|a|n|m)?"
)
_TURN = re.compile(r"(rot|rotation|turn)?([xyz])(rot|rotation|turn)?")


def _letters(text: str) -> str:
    words = re.sub(r"[−–]", "-", text.strip().lower())
    words = re.sub(r"\b(positive|negative)", lambda found: found[0][:3], words)
    return re.sub(r"(?<=up)wards?|(?<=down)wards?|[\s_]+", "", words)


def parse_face(text: str) -> str | None:
    """Return the case axis that is up according to a face's name, or None if it names no face.

    >>> [parse_face(one) for one in ("+Z", "z up", "x_down", "-y", "-y up", "x_a", "p1")]
    ['z', 'z', '-x', '-y', '-y', '-x', None]
    """
    found = _FACE.fullmatch(_letters(text))
    if found is None:
        return None
    sign = 1
    for word in (found["before"], found["after"], found["end"]):
        if word is not None:
            sign *= _SIGNS.get(word) or (1 if word in ("pos", "plus") else -1)
    return "-" * (sign < 0) + found["axis"]


def planned_name(text: str) -> str | None:
    """Return the name of the step in plans by hand that a label means; None if there is none.

    >>> planned_name("z down"), planned_name("turn x"), planned_name("face 3")
    ('z_a', 'x_rot', None)
    """
    if (face := parse_face(text)) is not None:
        return f"{face[-1]}_{'a' if face.startswith('-') else 'p'}"
    found = _TURN.fullmatch(_letters(text))
    return None if found is None else f"{found[2]}_rot"
