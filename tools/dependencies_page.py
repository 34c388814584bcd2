"""Write the page of the dependencies: ``python -m tools.dependencies_page``.

Names, versions, licences and sizes are those of the packages in this environment, which is made
from `requirements.lock`. A size is that of the installed files, without compiled bytecode.
"""

import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import Distribution, distribution, requires
from pathlib import Path
from platform import machine
from tempfile import TemporaryDirectory
from textwrap import fill
from typing import NamedTuple

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reference" / "dependencies.md"
MATERIALS = PAGE.with_suffix(".cdx.json")
_MB = 1e6
_OSI = "License :: OSI Approved :: "
_LONGEST = 60  # characters of a licence's name; what is longer is its text
_WIDTH = 118  # characters of a line
_COPYLEFT = ("GPL", "MPL", "Mozilla")
_FORMS = {"Apache License 2.0": "Apache-2.0", "Apache 2.0": "Apache-2.0", "MIT License": "MIT"}
_HEAD = """\
# Dependencies

What `pip install inercal` brings, what each extra adds, and the licences: written by
`make dependencies` from the installed packages. Sizes are those of their files on
{system}, without compiled bytecode. They are added up for each extra
alone; extras that are installed together share packages.

The [software bill of materials](dependencies.cdx.json) (CycloneDX 1.6) lists these packages with
version, package URL, licence and the hashes of `requirements.lock`.
"""


class Package(NamedTuple):
    """An installed package."""

    name: str
    version: str
    licence: str
    size: float  # bytes


def package(name: str) -> Package:
    """Return an installed package by its name."""
    found = distribution(name)
    size = sum(_bytes(found, path) for path in found.files or ())
    return Package(found.metadata["Name"], found.version, _licence(found), size)


def _bytes(found: Distribution, path: object) -> int:
    file = Path(str(found.locate_file(str(path))))
    return file.stat().st_size if file.suffix != ".pyc" and file.is_file() else 0


def _licence(found: Distribution) -> str:
    """Return what the metadata state: an SPDX expression, a short name, or the classifiers."""
    meta = found.metadata
    if expressions := meta.get_all("License-Expression"):
        return expressions[0]
    classes = [one for one in meta.get_all("Classifier") or [] if one.startswith(_OSI)]
    stated = ", ".join(one.removeprefix(_OSI) for one in classes)
    stated = stated or "".join(meta.get_all("License") or []).strip()
    if not stated or len(stated) > _LONGEST or "\n" in stated:
        stated = stated.split("\n")[0][:_LONGEST] or "not stated"
    return _FORMS.get(stated, stated)


def closure(requirements: Iterable[str], extra: str = "") -> set[str]:
    """Return the names of the packages that requirements bring, with those that these bring."""
    found: set[str] = set()
    seen: set[tuple[str, str]] = set()
    waiting = [(Requirement(one), extra) for one in requirements]
    while waiting:
        one, of = waiting.pop()
        if one.marker is not None and not one.marker.evaluate({"extra": of}):
            continue
        name = str(canonicalize_name(one.name))
        found.add(name)
        for asked in ("", *one.extras):
            if (name, asked) not in seen:
                seen.add((name, asked))
                waiting += [(Requirement(line), asked) for line in requires(name) or ()]
    return found


def extras() -> Mapping[str, tuple[list[str], set[str]]]:
    """Return the requirements of each extra, and the packages that it adds to the core's."""
    lines = requires("inercal") or []
    core = core_packages()
    found: dict[str, tuple[list[str], set[str]]] = {}
    for line in lines:
        one = Requirement(line)
        if one.marker is None:
            continue
        name = str(one.marker).split('"')[1]
        asked, added = found.setdefault(name, ([], set()))
        asked.append(one.name)
        added |= closure([line], name) - core
    return dict(sorted(found.items()))


def core_packages() -> set[str]:
    """Return the names of the packages that inercal needs without extras."""
    return closure(line for line in requires("inercal") or () if "extra ==" not in line)


def wheel_size() -> int:
    """Return the size of the wheel, bytes."""
    with TemporaryDirectory() as name:
        command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", name]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
        (wheel,) = Path(name).glob("*.whl")
        return wheel.stat().st_size


def dependencies_page() -> str:
    """Return the page: the core, the extras, and the licence of every package."""
    added = extras()
    found = {
        name: package(name) for name in core_packages().union(*(one for _, one in added.values()))
    }
    system = f"{sys.platform} {machine()}, Python {sys.version_info[0]}.{sys.version_info[1]}"
    parts = [
        _HEAD.format(system=system),
        *("## The core", "", _core_words(found), ""),
        *("## Extras", "", "| extra | asks for | adds packages | adds MB |", "|---|---|---|---|"),
    ]
    for name, (asked, names) in added.items():
        size = sum(found[one].size for one in names) / _MB
        decimals = 0 if size > 10 else 1
        parts.append(f"| `{name}` | {', '.join(asked)} | {len(names)} | {size:.{decimals}f} |")
    parts += ["", *("## Licences", "", _licence_words(list(found.values())), "")]
    parts += ["| package | version | licence | MB |", "|---|---|---|---|"]
    for _, one in sorted(found.items()):
        parts.append(f"| {one.name} | {one.version} | {one.licence} | {one.size / _MB:.1f} |")
    return "\n".join(parts) + "\n"


def _core_words(found: Mapping[str, Package]) -> str:
    direct = [Requirement(one).name for one in requires("inercal") or () if "extra ==" not in one]
    core = [found[name] for name in core_packages()]
    return fill(
        f"The wheel of inercal has {wheel_size() / _MB:.2f} MB. It needs "
        f"{', '.join(f'`{one}`' for one in direct)}; with what these need, {len(core)} packages of "
        f"{sum(one.size for one in core) / _MB:.0f} MB.",
        _WIDTH,
    )


def _licence_words(found: Sequence[Package]) -> str:
    copyleft = [
        f"{one.name} ({one.licence})"
        for one in sorted(found)
        if any(word in one.licence for word in _COPYLEFT)
    ]
    return fill(
        f"As the packages state them. With all extras there are {len(found)} packages of "
        f"{sum(one.size for one in found) / _MB:.0f} MB. Licences with copyleft have: "
        f"{', '.join(copyleft)}.",
        _WIDTH,
    )


if __name__ == "__main__":
    PAGE.write_text(dependencies_page(), encoding="utf-8")
    print(f"wrote {PAGE.name}")
