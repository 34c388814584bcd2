"""Loads the libraries of the extras; few of them ship types, so their objects are `Any`."""

from importlib import import_module
from typing import Any

from inercal.basics.errors import require_extra

CERTIFICATE = ("certificate", "certificates need typst and lxml", ("typst", "lxml"))
SIGNATURE = (
    "signature",
    "signing and verifying certificates needs pyHanko and signxml",
    ("pyhanko", "signxml", "cryptography"),
)


def certificate_library(name: str) -> Any:
    """Return a module of the extra "certificate".

    Raises
    ------
    MissingExtra
        It is not installed.
    """
    with require_extra(*CERTIFICATE):
        return import_module(name)


def signature_library(name: str) -> Any:
    """Return a module of the extra "signature".

    Raises
    ------
    MissingExtra
        It is not installed.
    """
    with require_extra(*SIGNATURE):
        return import_module(name)
