"""The numbers of all examples, studies and the self-check: ``python -m tools.numbers``.

Compares them with the stored record and prints the largest changes. Between processors only
results with an uncertainty are compared, within 1e-9 of it: others, such as the share of an error
that has no effect, may be nothing but rounding. `--exact` demands that all numbers are equal, as of
two commits on one machine, and `--write` renews the record.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from math import isfinite, sqrt
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).parents[1]
RECORD = ROOT / "tests" / "examples" / "numbers.json"
ROUNDING = 1e-9  # of a standard uncertainty
# The least uncertainty, SI, that counts: a difference of differences holds the last digits of four
# readings of 1 g, and other processors round them otherwise.
_FINEST = 4 * 9.80665 * sys.float_info.epsilon / ROUNDING
STUDIES = ("centrifuge", "dual-orthogonal", "one-sensor", "ship-model", "turntable")
TRIALS = "200"  # of a study: its claims need more, the comparison of numbers does not
# After `calibrate` of every run file, whose results are in `RESULTS`/<run file without suffix>.
RESULTS = "results"
_SESSIONS = tuple(f"{RESULTS}/repeat/session_{k}/session_{k}.calibration.json" for k in range(1, 5))
COMMANDS: tuple[tuple[str, ...], ...] = (
    *(("reproduce", name, "--trials", TRIALS, "--workers", "1", "--json") for name in STUDIES),
    *(
        ("qualify", f"qualify/{name}.toml", "--out", f"{name}.qualification.json", "--json")
        for name in ("gravity", "head", "radius", "rate")
    ),
    ("self-check", "--json"),
    ("budget", "six_position/run.toml", "--json"),
    ("budget", "ferraris_simulated/run.toml", "--workers", "1", "--json"),
    ("plan", "ferraris_simulated/run.toml", "--json"),
    ("plan", "rate_platform/imu.toml", "--json"),
    ("noise", "hand_held/simulated.toml", "--json"),
    ("repeat", *_SESSIONS, "--out", RESULTS, "--json"),
)
# What a clock, a machine or a file decides, and p-values, which restate χ².
_IGNORED = frozenset({"provenance", "p", "seconds", "versions", "sha256", "job", "sensor"})


def run_files(folder: Path) -> Iterator[str]:
    """Yield the run files of a copy of the examples whose data are there or can be simulated."""
    for path in sorted(folder.rglob("*.toml")):
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        if "method" not in content or "data" not in content or "sensor" not in content:
            continue
        files = [name for name in _strings(content["data"]) if "/shared/" in name]
        if not files:
            yield str(path.relative_to(folder))


def _strings(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for one in value.values():
            yield from _strings(one)
    elif isinstance(value, list):
        for one in value:
            yield from _strings(one)


def numbers_of(arguments: tuple[str, ...], folder: Path) -> Any:
    """Return the numbers that a command prints as JSON; None where it prints none."""
    if arguments[0] == "calibrate":
        # Refused where the recording is there already, or where the run file does not simulate.
        _program(("simulate", arguments[1]), folder)
        arguments += ("--out", f"{RESULTS}/{arguments[1].removesuffix('.toml')}", "--no-report")
    text = _program(arguments, folder)
    try:
        return _without_texts(json.loads(text))
    except ValueError:
        return None


def _program(arguments: tuple[str, ...], folder: Path) -> str:
    command = [sys.executable, "-m", "inercal", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False).stdout


def _without_texts(value: Any) -> Any:
    """Return the numbers of a JSON value; lists and objects without any are left out."""
    if isinstance(value, Mapping):
        kept = {k: _without_texts(v) for k, v in value.items() if k not in _IGNORED}
        return {k: v for k, v in kept.items() if v is not None} or None
    if isinstance(value, list):
        items = [_without_texts(one) for one in value]
        return items if any(one is not None for one in items) else None
    return None if isinstance(value, bool | str) else value


def all_numbers() -> dict[str, Any]:
    """Run every command, two at a time, and return the numbers by command."""
    with TemporaryDirectory() as name:
        folder = copy_examples(Path(name))
        found: dict[str, Any] = {}
        for commands in ([("calibrate", one, "--json") for one in run_files(folder)], COMMANDS):
            with ThreadPoolExecutor(2) as pool:
                numbers = pool.map(lambda one: numbers_of(one, folder), commands)
                found |= dict(zip(map(" ".join, commands), numbers, strict=True))
        return {name: one for name, one in found.items() if one is not None}


def copy_examples(to: Path) -> Path:
    """Copy the examples without what their user has made there, where git knows it."""
    listed = subprocess.run(
        ("git", "ls-files", "-z", "examples"), cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout
    if not listed:
        return Path(shutil.copytree(ROOT / "examples", to / "examples"))
    for one in listed.rstrip("\0").split("\0"):
        (to / one).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / one, to / one)
    return to / "examples"


def differences(before: Any, after: Any, where: str = "") -> Iterator[tuple[float, str]]:
    """Yield what differs: its size in units of the uncertainty or of the number, and its place."""
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        u = next((before[k] for k in ("std", "u") if isinstance(before.get(k), float)), None)
        for key in dict.fromkeys([*before, *after]):
            if key not in before or key not in after:
                yield float("inf"), f"{where}.{key}: only in one of both"
            elif (
                key == "value" and u and all(isinstance(one[key], float) for one in (before, after))
            ):
                yield from _difference(before[key], after[key], max(u, _FINEST), f"{where}.{key}")
            elif key == "covariance" and _is_square(before[key], after[key]):
                sd = [max(sqrt(abs(row[i])), _FINEST) for i, row in enumerate(before[key])]
                for i, row in enumerate(before[key]):
                    for k, one in enumerate(row):
                        yield from _difference(
                            one, after[key][i][k], sd[i] * sd[k], f"{where}.{key}"
                        )
            else:
                yield from differences(before[key], after[key], f"{where}.{key}")
    elif isinstance(before, list) and isinstance(after, list):
        if len(before) != len(after):
            yield float("inf"), f"{where}: {len(before)} and {len(after)} items"
        for k, (one, two) in enumerate(zip(before, after, strict=False)):
            yield from differences(one, two, f"{where}[{k}]")
    elif isinstance(before, int | float) and isinstance(after, int | float):
        yield from _difference(before, after, max(abs(before), abs(after)), where)
    elif before != after:
        yield float("inf"), f"{where}: {before} and {after}"


def beyond_rounding(before: Any, after: Any) -> list[str]:
    """Return the results with an uncertainty that differ by more than `ROUNDING` of it."""
    return [
        text
        for size, text in differences(before, after)
        if size > ROUNDING and re.search(r"\.value: |\.std: |\.covariance: |only in", text)
    ]


def _difference(one: float, two: float, scale: float, where: str) -> Iterator[tuple[float, str]]:
    if one != two:
        size = abs(one - two) / scale
        yield (size if isfinite(size) else float("inf")), f"{where}: {one!r} and {two!r}"


def _is_square(*values: Any) -> bool:
    """Return whether all values are square matrices of one size."""
    return all(
        isinstance(one, list)
        and len(one) == len(values[0])
        and all(isinstance(row, list) and len(row) == len(one) for row in one)
        for one in values
    )


def main() -> int:
    """Compare or store; the status is 1 where a number changed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="renew the record")
    parser.add_argument("--exact", action="store_true", help="demand equal numbers")
    stated = parser.parse_args()
    after = all_numbers()
    before = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}
    found = sorted(differences(before, after), reverse=True)
    for size, text in found[:20]:
        print(f"{size:.2g} {text}")
    print(f"{len(after)} commands, {len(found)} numbers differ, largest {found[0][0]:.2g}"
          if found else f"{len(after)} commands, all numbers are equal")  # fmt: skip
    if stated.write:
        RECORD.write_text(json.dumps(after, separators=(",", ":")) + "\n", encoding="utf-8")
        return 0
    return int(bool(found if stated.exact else beyond_rounding(before, after)))


if __name__ == "__main__":
    sys.exit(main())
