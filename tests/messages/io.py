"""Families of messages of recordings, files, units and calibrations."""

from collections.abc import Callable
from pathlib import Path

from inercal.units import parse_quantity

CASES: dict[str, Callable[[Path], object]] = {
    "quantity of another dimension": lambda _: parse_quantity("2 mm", "rad"),
}
