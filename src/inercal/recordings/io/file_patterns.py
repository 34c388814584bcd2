"""Find the files of a recording with one file per section: "rest_*.csv".

The star may also be in the name of a folder, as in "*degC/run.csv".
"""

import re
from math import inf
from pathlib import Path

from inercal.basics.errors import InputError
from inercal.basics.small_files import is_file

_STAR = "*"
_MOST_FILES = 1000
_SIGNED = re.compile(r"[-+−]?\d+(\.\d+)?")


def is_pattern(path: Path) -> bool:
    """Return whether a path stands for several files: it has a star and no file has this name.

    The star is in the name of the file, or in that of its folder.
    """
    return _STAR in f"{path.parent.name}{path.name}" and not is_file(path)


def matching_files(pattern: Path) -> dict[str, Path]:
    """Return the matching files by label, in the order of their labels; numbers sort by value.

    Raises
    ------
    InputError
        The pattern has more than one star, or it matches no file or more than 1000 files.
    """
    in_folder = _STAR in pattern.parent.name
    varied = pattern.parent if in_folder else pattern
    before, _, after = varied.name.partition(_STAR)
    if _STAR in after or (in_folder and _STAR in pattern.name):
        raise InputError(f"{pattern}: use only one star, which stands for the label", file=pattern)
    files: dict[str, Path] = {}
    if varied.parent.is_dir():
        for one in varied.parent.iterdir():
            name = one.name
            path = one / pattern.name if in_folder else one
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


def _natural(label: str) -> list[tuple[float, str]]:
    """Return a key that sorts "p2" before "p10", and "-10" before "+5"."""
    parts = [label] if _SIGNED.fullmatch(label) else re.split(r"(\d+)", label)
    return [(_number(part), "") if part[-1].isdecimal() else (-inf, part) for part in parts if part]


def _number(text: str) -> float:
    return float(text.replace("−", "-"))
