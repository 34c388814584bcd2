"""XML of a DCC for tests, by lxml, which ships no types."""

from importlib import import_module
from typing import Any

etree: Any = import_module("lxml.etree")
