"""Make the XML elements of a DCC; the XML library escapes all text.

Few libraries of the extras have types, so their objects are `Any`.
"""

from collections.abc import Sequence
from importlib import import_module
from typing import Any

from inercal.basics.errors import require_extra
from inercal.basics.visible_text import visible_text
from inercal.laboratory.certificate.content import Texts

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


etree = certificate_library("lxml.etree")
DCC_NAMESPACE = "https://ptb.de/dcc"
SI_NAMESPACE = "https://ptb.de/si"
_NAMESPACES = {
    "dcc": DCC_NAMESPACE,
    "si": SI_NAMESPACE,
    "xsi": "http://www.w3.org/2001/XMLSchema-instance",
}


def dcc(name: str, *children: Any, **attributes: str) -> Any:
    """Return an element of the DCC; children are elements or texts, and None is omitted."""
    return _element(DCC_NAMESPACE, name, children, attributes)


def si(name: str, *children: Any) -> Any:
    """Return an element of D-SI."""
    return _element(SI_NAMESPACE, name, children, {})


def content(name: str, texts: Texts, *lines: str, more: Sequence[Any] = ()) -> Any:
    """Return lines of text in the certificate's language, followed by other elements."""
    return dcc(name, *(dcc("content", line, lang=texts.language) for line in lines), *more)


def list_label(name: str) -> str:
    """Return a name without blanks, because blanks separate the entries of a list."""
    return "_".join(name.split())


def to_bytes(root: Any) -> bytes:
    """Return the XML document as UTF-8 bytes."""
    etree.indent(root, space=" ")
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8") + b"\n"


def _element(namespace: str, name: str, children: Sequence[Any], attributes: dict[str, str]) -> Any:
    element = etree.Element(f"{{{namespace}}}{name}", nsmap=_NAMESPACES)
    for key, value in attributes.items():
        element.set(key, value)
    for child in children:
        if isinstance(child, str):
            # According to the schema, a text must not be empty, must not contain control
            # characters, and must not begin or end with white space.
            element.text = visible_text(child.strip(), keep="\n\t") or "–"
        elif child is not None:
            element.append(child)
    return element
