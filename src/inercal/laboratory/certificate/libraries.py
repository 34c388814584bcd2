"""Load the libraries of the extras; few of them have types, so their objects are `Any`."""

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
    """Import a module of the extra "certificate".

    Raises
    ------
    MissingExtra
        If the extra is not installed.
    """
    with require_extra(*CERTIFICATE):
        return import_module(name)


def signature_library(name: str) -> Any:
    """Import a module of the extra "signature".

    Raises
    ------
    MissingExtra
        If the extra is not installed.
    """
    with require_extra(*SIGNATURE):
        return import_module(name)
