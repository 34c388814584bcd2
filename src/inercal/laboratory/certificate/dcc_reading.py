"""Read the results back from a DCC that inercal wrote, and validate a DCC.

The laboratory supplies the XML schema. The schema imports other schemas by address. They are looked
up by namespace in the folder of the schema, and nothing is loaded from the network. The content of
an XML signature is not validated here, because `certificate verify` checks the signature itself.
"""

import base64
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.calibration import Calibration
from inercal.calibration.files import parse
from inercal.laboratory.certificate.dcc_elements import DCC_NAMESPACE, SI_NAMESPACE, etree

_NAMES = {"dcc": DCC_NAMESPACE, "si": SI_NAMESPACE}
_COEFFICIENTS = "inercal_coefficients"  # type of the quantity with the rounded results


@dataclass(frozen=True, eq=False)
class StatedResults:
    """The results of one measurement in a DCC, in SI units.

    Parameters
    ----------
    names, units : tuple of str
        Names without blanks, and units, of the coefficients.
    value, expanded, k : (p,) arrays
        Rounded values, U and coverage factors that the certificate states.
    full_value : (p,) array
    covariance : (p, p) array
    covariance_units : tuple of tuple of str
    calibration : Calibration
        Calibration from the attached file, with a verified hash.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    value: Array
    expanded: Array
    k: Array
    full_value: Array
    covariance: Array
    covariance_units: tuple[tuple[str, ...], ...]
    calibration: Calibration


@dataclass(frozen=True, eq=False)
class StatedCertificate:
    """The number and the measurement results that a DCC states, as XML elements."""

    number: str
    measurements: tuple[Any, ...]


def read_dcc(document: bytes, source: str = "DCC") -> StatedCertificate:
    """Read a DCC that inercal wrote.

    Raises
    ------
    InputError
        If the document is not XML or not a DCC, or contains no results from inercal.
    """
    try:
        root = etree.fromstring(document, _parser())
        number = _text(root, ".//dcc:coreData/dcc:uniqueIdentifier")
        _quantity(root, _COEFFICIENTS)
    except (etree.XMLSyntaxError, AttributeError, ValueError) as error:
        raise InputError(
            f"{source} is not a DCC written by inercal: {error}", file=source
        ) from None
    return StatedCertificate(number, tuple(root.iterfind(".//dcc:measurementResult", _NAMES)))


def read_results(measurement: Any) -> StatedResults:
    """Read the results of one measurement of a DCC.

    Raises
    ------
    InputError
        If a number, the covariance or the attached calibration file is missing or damaged.
    """
    try:
        return _results(measurement)
    except (AttributeError, ValueError, KeyError) as error:
        raise InputError(f"the results are incomplete or damaged: {error}") from None


def _results(measurement: Any) -> StatedResults:
    rounded = _quantity(measurement, _COEFFICIENTS)
    full = _quantity(measurement, "inercal_covariance")
    columns = full.findall(".//si:column", _NAMES)
    cells = [column.findall("si:covariance", _NAMES) for column in columns]
    attached = _text(measurement, ".//dcc:file/dcc:dataBase64")
    content = base64.b64decode(attached).decode()
    found = StatedResults(
        tuple(_text(rounded, "si:labelXMLList").split()),
        tuple(_text(rounded, "si:unitXMLList").split()),
        _numbers(rounded, "si:valueXMLList"),
        _numbers(rounded, ".//si:uncertaintyXMLList"),
        _numbers(rounded, ".//si:coverageFactorXMLList"),
        _numbers(full, "si:valueXMLList"),
        np.array([[float(_text(cell, "si:value")) for cell in column] for column in cells]).T,
        tuple(zip(*(tuple(_text(c, "si:unit") for c in column) for column in cells), strict=True)),
        parse(content, "attached calibration file"),
    )
    p = len(found.names)
    shapes = {len(found.units), *(one.size for one in (found.value, found.expanded, found.k))}
    if shapes | {found.full_value.size} != {p} or found.covariance.shape != (p, p):
        raise ValueError("lists of different lengths")
    return found


def _quantity(measurement: Any, kind: str) -> Any:
    found = measurement.find(f".//dcc:quantity[@refType='{kind}']/si:realListXMLList", _NAMES)
    if found is None:
        raise ValueError(f"no result of type {kind}")
    return found


def _text(element: Any, path: str) -> str:
    return str(element.find(path, _NAMES).text)


def _numbers(element: Any, path: str) -> Array:
    return np.array([float(word) for word in _text(element, path).split()])


SIGNATURE_NAMESPACE = "http://www.w3.org/2000/09/xmldsig#"
_SIGNATURE_STUB = f"""<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema"
 targetNamespace="{SIGNATURE_NAMESPACE}"><xs:element name="Signature"><xs:complexType><xs:sequence>
 <xs:any processContents="skip" minOccurs="0" maxOccurs="unbounded"/></xs:sequence>
 <xs:anyAttribute processContents="skip"/></xs:complexType></xs:element></xs:schema>"""
_IMPORT = "{http://www.w3.org/2001/XMLSchema}import"


def schema_defects(document: bytes, schema: Path) -> tuple[str, ...]:
    """Return a line for each violation of the schema; empty for a valid document.

    Parameters
    ----------
    document : bytes
        The DCC as XML.
    schema : Path
        The file dcc.xsd; the schemas that it imports must be in the same folder.

    Raises
    ------
    InputError
        If the schema cannot be read, or a schema that it imports is not in its folder.
    """
    validator = _read_schema(schema)
    root = etree.fromstring(document, _parser())
    if validator.validate(root):
        return ()
    return tuple(f"line {one.line}: {one.message}" for one in validator.error_log)


def _parser() -> Any:
    return etree.XMLParser(resolve_entities=False, no_network=True)


def _read_schema(path: Path) -> Any:
    root = _read_xml(path)
    imported: dict[str, str] = {}
    for file in sorted(path.parent.glob("*.xsd")):
        if file != path:
            imported.setdefault(_read_xml(file).get("targetNamespace"), file.resolve().as_uri())
    parser = _parser()
    parser.resolvers.add(_Resolver())
    for one in root.iter(_IMPORT):
        namespace = one.get("namespace")
        if namespace == SIGNATURE_NAMESPACE:
            one.set("schemaLocation", _Resolver.signature)
        elif namespace in imported:
            one.set("schemaLocation", imported[namespace])
        else:
            raise InputError(
                f"--schema {path} imports {namespace}, but the schema for it is not in "
                f"{path.parent}; put it there",
                file=path,
                key="--schema",
            )
    try:
        return etree.XMLSchema(
            etree.fromstring(etree.tostring(root), parser, base_url=path.resolve().as_uri())
        )
    except etree.XMLSchemaParseError as error:
        raise InputError(f"--schema {path}: {error}", file=path, key="--schema") from None


def _read_xml(path: Path) -> Any:
    try:
        return etree.fromstring(path.read_bytes(), _parser())
    except (OSError, etree.XMLSyntaxError) as error:
        raise InputError(
            f"--schema {path} cannot be read as a schema: {error}; give the file dcc.xsd",
            file=path,
            key="--schema",
        ) from None


class _Resolver(etree.Resolver):
    """A resolver that replaces the signature schema by a stub; libxml2 reads all other files."""

    signature = "inercal:signature"

    def resolve(self, system_url: str, public_id: str, context: Any) -> Any:
        """Return the stub schema for the address of XML signatures."""
        if system_url == self.signature:
            return self.resolve_string(_SIGNATURE_STUB, context)
        return None
