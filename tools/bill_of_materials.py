"""Write the software bill of materials: ``python -m tools.bill_of_materials``.

The file is CycloneDX 1.6 in JSON (ECMA-424). Its components are the packages that inercal and its
extras install, as `requirements.lock` pins them with their hashes; what only development needs is
left out. A package that the lock holds for another system only stands without scope and licence,
and a version for another Python without licence. The scope is "required" for packages of the core
and "optional" for those of extras.

There is no time and no serial number: equal locks give equal files.
"""

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError
from typing import Any, NamedTuple

from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tools.dependencies_page import MATERIALS, ROOT, core_packages, extras, package

_LOCK = ROOT / "requirements.lock"
_HASH = re.compile(r"--hash=sha256:([0-9a-f]{64})")


class LockedPackage(NamedTuple):
    """A package of the lock."""

    name: str
    version: str
    marker: str  # environments that take it; empty where all do
    hashes: Sequence[str]  # SHA-256 of each of its files


def locked_packages(lock: str) -> list[LockedPackage]:
    """Return the packages of the text of a lock."""
    found: list[LockedPackage] = []
    for line in lock.replace("\\\n", " ").splitlines():
        if not (stated := line.partition("--hash")[0].strip()):
            continue
        one = Requirement(stated)
        (pin,) = one.specifier
        name = str(canonicalize_name(one.name))
        marker = "" if one.marker is None else str(one.marker)
        found.append(LockedPackage(name, pin.version, marker, sorted(_HASH.findall(line))))
    return found


def bill_of_materials() -> dict[str, Any]:
    """Return the document: inercal and the packages that it needs at run time."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    core = core_packages()
    used: dict[str, list[str]] = {}
    for key, (_, added) in extras().items():
        for name in added:
            used.setdefault(name, []).append(key)
    locked = locked_packages(_LOCK.read_text(encoding="utf-8"))
    return {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": {
                "type": "library",
                **_identity(project["name"], project["version"]),
                "licenses": _licences(project["license"]),
            }
        },
        "components": [
            _component(one, core, used)
            for one in locked
            if one.name in core or one.name in used or not _is_installed(one.name)
        ],
    }


def _is_installed(name: str) -> bool:
    try:
        package(name)
    except PackageNotFoundError:
        return False
    return True


def _identity(name: str, version: str) -> dict[str, str]:
    purl = f"pkg:pypi/{name}@{version}"
    return {"bom-ref": purl, "name": name, "version": version, "purl": purl}


def _component(
    one: LockedPackage, core: set[str], used: Mapping[str, Sequence[str]]
) -> dict[str, Any]:
    """Return a component; `used` has the extras that add each package."""
    made: dict[str, Any] = {"type": "library", **_identity(one.name, one.version)}
    installed = package(one.name) if _is_installed(one.name) else None
    if installed is not None:
        made["scope"] = "required" if one.name in core else "optional"
    made["hashes"] = [{"alg": "SHA-256", "content": text} for text in one.hashes]
    if installed is not None and installed.version == one.version:
        made["licenses"] = _licences(installed.licence)
    properties = [("inercal:extra", key) for key in used.get(one.name, ())]
    properties += [("inercal:marker", one.marker)] * bool(one.marker)
    if properties:
        made["properties"] = [{"name": key, "value": value} for key, value in properties]
    return made


def _licences(stated: str) -> list[dict[str, Any]]:
    """Return a stated licence as an SPDX expression, or by its name where it is none."""
    try:
        expression = str(canonicalize_license_expression(stated))
    except InvalidLicenseExpression:
        return [{"license": {"name": stated, "acknowledgement": "declared"}}]
    return [{"expression": expression, "acknowledgement": "declared"}]


def as_text(document: Mapping[str, Any]) -> str:
    """Return the document as JSON with a component a line, which shows changes by package."""
    head = {key: value for key, value in document.items() if key != "components"}
    opening = json.dumps(head, indent=2, ensure_ascii=False).removesuffix("\n}")
    lines = ",\n".join(
        f"    {json.dumps(one, ensure_ascii=False)}" for one in document["components"]
    )
    return f'{opening},\n  "components": [\n{lines}\n  ]\n}}\n'


if __name__ == "__main__":
    MATERIALS.write_text(as_text(bill_of_materials()), encoding="utf-8")
    print(f"wrote {MATERIALS.name}")
