"""File names with a star that stand for several files, such as "rest_*.csv"."""

import re
from pathlib import Path

from inercal.basics.errors import InputError
from inercal.basics.small_files import is_file

_STAR = "*"
_MOST_FILES = 1000


def is_pattern(path: Path) -> bool:
    """Return whether a path stands for several files: its name has a star and is no file."""
    return _STAR in path.name and not is_file(path)


def matching_files(pattern: Path) -> dict[str, Path]:
    """Return the matching files by label, in the order of their labels; numbers sort by value.

    Raises
    ------
    InputError
        The pattern has more than one star, or it matches no file or more than 1000 files.
    """
    before, _, after = pattern.name.partition(_STAR)
    if _STAR in after:
        raise InputError(f"{pattern}: use only one star, which stands for the label", file=pattern)
    files: dict[str, Path] = {}
    if pattern.parent.is_dir():
        for path in pattern.parent.iterdir():
            name = path.name
            fits = len(name) > len(before) + len(after) and path.is_file()
            if fits and name.startswith(before) and name.endswith(after):
                files[name[len(before) : len(name) - len(after)]] = path
    if not 0 < len(files) <= _MOST_FILES:
        found = (
            f"{len(files)} files match, more than {_MOST_FILES}; name fewer"
            if files
            else "no file matches; check the folder and the name"
        )
        raise InputError(
            f"{pattern}: {found}: the star stands for the label of each section", file=pattern
        )
    return dict(sorted(files.items(), key=lambda one: _natural(one[0])))


def _natural(label: str) -> list[tuple[int, str]]:
    """Return a key that sorts "p2" before "p10"."""
    return [(int(k), "") if k.isdecimal() else (-1, k) for k in re.split(r"(\d+)", label) if k]
