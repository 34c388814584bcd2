"""The bill of materials states what the lock holds, and is that of the installed packages."""

import json
import platform
import re
import sys
from typing import Any

import pytest
from packaging.utils import canonicalize_name
from tests.install.test_wheel import ROOT
from tools.bill_of_materials import as_text, bill_of_materials, locked_packages
from tools.dependencies_page import MATERIALS, PAGE, core_packages, extras, package

DOCUMENT: dict[str, Any] = json.loads(MATERIALS.read_text(encoding="utf-8"))
COMPONENTS: list[dict[str, Any]] = DOCUMENT["components"]
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
SYSTEM = f"{sys.platform} {platform.machine()}, Python {sys.version_info[0]}.{sys.version_info[1]}"
same_system = pytest.mark.skipif(
    SYSTEM not in PAGE.read_text(encoding="utf-8"), reason=f"the file is not of {SYSTEM}"
)


def locked_hashes() -> dict[tuple[str, str], set[str]]:
    """Return the hashes of each name and version of the lock, read line by line."""
    found: dict[tuple[str, str], set[str]] = {}
    hashes: set[str] = set()
    for line in LOCK.splitlines():
        if pinned := re.match(r"([A-Za-z0-9._-]+)==(\S+)", line):
            hashes = found.setdefault((pinned[1], pinned[2]), set())
        hashes |= set(re.findall(r"sha256:(\w+)", line))
    return found


def test_every_component_has_the_version_and_hashes_of_the_lock():
    listed = {
        (one["name"], one["version"]): {each["content"] for each in one["hashes"]}
        for one in COMPONENTS
    }
    assert len(listed) == len(COMPONENTS)
    locked = locked_hashes()
    assert listed == {one: locked[one] for one in listed}, "run make dependencies"
    assert all(each["alg"] == "SHA-256" for one in COMPONENTS for each in one["hashes"])


def test_package_urls_name_package_and_version():
    for one in COMPONENTS:
        assert one["purl"] == one["bom-ref"] == f"pkg:pypi/{one['name']}@{one['version']}"
        assert one["name"] == canonicalize_name(one["name"])


def test_the_file_has_no_time_and_no_serial_number():
    assert (DOCUMENT["bomFormat"], DOCUMENT["specVersion"]) == ("CycloneDX", "1.6")
    assert "serialNumber" not in DOCUMENT
    assert set(DOCUMENT["metadata"]) == {"component"}


@pytest.mark.slow
@same_system
def test_the_file_is_what_the_tool_writes():
    written = MATERIALS.read_text(encoding="utf-8")
    assert written == as_text(bill_of_materials()), "run make dependencies"


@pytest.mark.slow
@same_system
def test_scopes_are_those_of_core_and_extras():
    scopes = {one["name"]: one.get("scope") for one in COMPONENTS}
    core = core_packages()
    optional = set[str]().union(*(added for _, added in extras().values())) - core
    assert {name for name, scope in scopes.items() if scope == "required"} == core
    assert {name for name, scope in scopes.items() if scope == "optional"} == optional
    assert not {"pytest", "ruff", "sphinx"} & scopes.keys()


@same_system
def test_every_installed_version_has_the_licence_that_it_declares():
    without = [one for one in COMPONENTS if "licenses" not in one]
    assert all("inercal:marker" in str(one["properties"]) for one in without)
    (numpy,) = (one for one in COMPONENTS if one["purl"].startswith("pkg:pypi/numpy@2.4"))
    assert numpy["licenses"][0]["expression"] == package("numpy").licence


def test_a_lock_of_two_versions_gives_both_with_their_markers():
    found = locked_packages(
        "six==1.0 ; python_version < '3.12' \\\n    --hash=sha256:" + "a" * 64 + "\n"
        "six==2.0 \\\n    --hash=sha256:" + "c" * 64 + " \\\n    --hash=sha256:" + "b" * 64 + "\n"
    )
    assert [(one.version, one.marker) for one in found] == [
        ("1.0", 'python_version < "3.12"'),
        ("2.0", ""),
    ]
    assert found[1].hashes == ["b" * 64, "c" * 64]
