"""Read the results back from a DCC that inercal wrote."""

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.calibration import Calibration
from inercal.calibration.files import parse
from inercal.laboratory.certificate.dcc_elements import DCC_NAMESPACE, SI_NAMESPACE, etree

_NAMES = {"dcc": DCC_NAMESPACE, "si": SI_NAMESPACE}


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
    """The number and the results that a DCC states."""

    number: str
    results: tuple[StatedResults, ...]


def read_dcc(document: bytes, source: str = "DCC") -> StatedCertificate:
    """Read a DCC that inercal wrote.

    Raises
    ------
    InputError
        If the document is not XML or not a DCC, or does not contain the results that inercal
        writes.
    """
    parser = etree.XMLParser(resolve_entities=False, no_network=True)
    try:
        root = etree.fromstring(document, parser)
        number = _text(root, ".//dcc:coreData/dcc:uniqueIdentifier")
        results = tuple(_results(one) for one in root.iterfind(".//dcc:measurementResult", _NAMES))
    except InputError:
        raise
    except (etree.XMLSyntaxError, AttributeError, ValueError, KeyError) as error:
        raise InputError(
            f"{source} is not a DCC written by inercal: {error}", file=source
        ) from None
    return StatedCertificate(number, results)


def _results(measurement: Any) -> StatedResults:
    rounded = _quantity(measurement, "inercal_coefficients")
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
