"""The share of slow tests that one run takes, drawn anew for each commit.

All slow tests together take longer than a change should wait for. `make slow` takes half of the
test functions, drawn by the commit, so that the same commit always gets the same tests and a few
commits get them all. `make evidence` takes all.
"""

import hashlib
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest


def read_commit(root: Path) -> str:
    """Return the commit that is checked out, or "no commit" outside a repository."""
    try:
        said = subprocess.run(
            ["git", "rev-parse", "HEAD"], cwd=root, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return "no commit"
    return said.stdout.strip()


def draw(
    items: Sequence[pytest.Item], one_in: int, seed: str
) -> tuple[list[pytest.Item], list[pytest.Item]]:
    """Return the items of the functions that are drawn, and the others."""
    drawn: list[pytest.Item] = []
    others: list[pytest.Item] = []
    for item in items:
        function = item.nodeid.split("[")[0]
        number = int(hashlib.sha256(f"{seed} {function}".encode()).hexdigest(), 16)
        (others if number % one_in else drawn).append(item)
    return drawn, others
