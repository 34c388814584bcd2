"""Write the digital calibration certificate (DCC 3.2.1 of PTB, with D-SI 2.1.0) as XML.

Each measurement result contains two results: the rounded coefficients with U, as the certificate
states them, and the unrounded coefficients with their covariance. The ellipsoid of the covariance
contains all true values at once with the same probability as U. Its coverage factor is k² =
χ²_n(p), or n F_p(n, ν). The unit of a covariance is the product of two units. Numbers are in SI
units.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

import base64
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from math import isfinite, sqrt
from typing import Any

from scipy.special import chdtri, fdtri

from inercal.basics.units.expression import read_unit
from inercal.calibration.files import calibration_object
from inercal.calibration.specification import LimitResult
from inercal.estimation.uncertainty import COVERAGE_PROBABILITY
from inercal.laboratory.certificate import dcc_administration
from inercal.laboratory.certificate.content import Certificate, Texts
from inercal.laboratory.certificate.dcc_elements import (
    DCC_NAMESPACE,
    content,
    dcc,
    list_label,
    si,
    to_bytes,
)
from inercal.laboratory.certificate.facts import (
    condition_facts,
    method_facts,
    results_title,
    rule_lines,
)
from inercal.laboratory.certificate.results import ResultSet

_WORDS = {
    "length": r"\metre",
    "time": r"\second",
    "angle": r"\radian",
    "temperature": r"\kelvin",
    "flux_density": r"\tesla",
}


def dsi_unit(*units: str) -> str:
    r"""Return the product of SI units in the notation of D-SI.

    Parameters
    ----------
    *units : str
        SI units in the notation of inercal.

    Examples
    --------
    >>> dsi_unit("(rad/s)/(m/s²)"), dsi_unit("1"), dsi_unit("m/s²", "m/s²")
    ('\\metre\\tothe{-1}\\second\\radian', '\\one', '\\metre\\tothe{2}\\second\\tothe{-4}')
    """
    powers: Counter[str] = Counter()
    for unit in units:
        for name, power in read_unit(unit).dimension:
            powers[name] += round(power)
    words = [
        word + ("" if powers[name] == 1 else rf"\tothe{{{powers[name]}}}")
        for name, word in _WORDS.items()
        if powers[name]
    ]
    return "".join(words) or r"\one"


SCHEMA_VERSION = "3.2.1"
_SCHEMA_LOCATION = f"{DCC_NAMESPACE} https://ptb.de/dcc/v{SCHEMA_VERSION}/dcc.xsd"
_CONFORMITY = {
    "pass": "pass",
    "conditional pass": "conditionalPass",
    "conditional fail": "conditionalFail",
    "fail": "fail",
}


def write_dcc(certificate: Certificate) -> bytes:
    """Return the DCC as UTF-8 XML; identical certificates give identical bytes."""
    root = dcc(
        "digitalCalibrationCertificate",
        dcc_administration.administrative_data(certificate),
        dcc(
            "measurementResults",
            *(_measurement_result(certificate, one) for one in certificate.results),
        ),
        schemaVersion=SCHEMA_VERSION,
    )
    root.set("{http://www.w3.org/2001/XMLSchema-instance}schemaLocation", _SCHEMA_LOCATION)
    return to_bytes(root)


def calibration_bytes(results: ResultSet) -> bytes:
    """Return the bytes of the attached file with the calibration of these results."""
    return (
        json.dumps(calibration_object(results.calibration), indent=1, ensure_ascii=False).encode()
        + b"\n"
    )


def _measurement_result(certificate: Certificate, results: ResultSet) -> Any:
    texts, calibration = certificate.texts, results.calibration
    last = results is certificate.results[-1]
    return dcc(
        "measurementResult",
        content("name", texts, results_title(texts, results)),
        dcc("usedMethods", _used_method(certificate)),
        dcc(
            "usedSoftware",
            dcc(
                "software",
                content("name", texts, "inercal"),
                dcc("release", calibration.provenance.get("inercal") or version("inercal")),
            ),
        ),
        _equipment(certificate),
        _influence_conditions(certificate, results),
        dcc("results", _rounded_result(texts, results), _full_result(texts, results)),
        _conformity(certificate) if last else None,
    )


def _used_method(certificate: Certificate) -> Any:
    texts = certificate.texts
    facts = method_facts(certificate)
    return dcc(
        "usedMethod",
        content("name", texts, certificate.calibration.method or "–"),
        content("description", texts, *(f"{name}: {text}" for name, text in facts)),
        dcc("reference", certificate.job.procedure or certificate.laboratory.procedure),
    )


def _equipment(certificate: Certificate) -> Any:
    texts, instruments = certificate.texts, certificate.laboratory.instrument
    if not instruments:
        return None
    listed: list[Any] = []
    for one in instruments:
        known = [("serial_number", one.serial_number, "manufacturer")]
        known.append(("certificate", one.certificate, "other"))
        identifications = [
            dcc(
                "identification",
                dcc("issuer", issuer),
                dcc("value", value),
                content("name", texts, texts.text(key)),
            )
            for key, value, issuer in known
            if value
        ]
        facts = [("calibrated_by", one.calibrated_by), ("due", one.due and one.due.isoformat())]
        words = [f"{texts.text(key)}: {text}" for key, text in facts if text]
        listed.append(
            dcc(
                "measuringEquipment",
                content("name", texts, one.name),
                content("description", texts, *words) if words else None,
                dcc("identifications", *identifications) if identifications else None,
                refType="basic_normalUsed",
            )
        )
    return dcc("measuringEquipments", *listed)


def _influence_conditions(certificate: Certificate, results: ResultSet) -> Any:
    texts = certificate.texts
    conditions = [
        dcc(
            "influenceCondition",
            content("name", texts, name),
            dcc("status", results.status) if results.status else None,
            dcc("data", content("text", texts, text)),
        )
        for name, text in condition_facts(certificate, results.calibration)
    ]
    return dcc("influenceConditions", *conditions) if conditions else None


def _result(
    kind: str,
    results: ResultSet,
    description: Sequence[Any],
    values: Iterable[float],
    uncertainty: Any,
) -> Any:
    """Return a result with the values of all coefficients; `description` includes its name."""
    rows = results.rows
    numbers = si(
        "realListXMLList",
        si("labelXMLList", " ".join(list_label(row.name) for row in rows)),
        si("valueXMLList", _numbers(values)),
        si("unitXMLList", " ".join(dsi_unit(row.si_unit) for row in rows)),
        uncertainty,
    )
    data = dcc("data", dcc("quantity", numbers, refType=kind))
    return dcc("result", *description, data, refType=kind)


def _rounded_result(texts: Texts, results: ResultSet) -> Any:
    rows = results.rows
    uncertainty = si(
        "expandedUncXMLList",
        si("uncertaintyXMLList", _numbers(row.expanded_si for row in rows)),
        si("coverageFactorXMLList", " ".join([f"{results.k:.2f}"] * len(rows))),
        si("coverageProbabilityXMLList", " ".join([str(COVERAGE_PROBABILITY)] * len(rows))),
    )
    described = "; ".join(
        f"{row.name}: {texts.word('meaning', row.meaning)}, {row.value} ± {row.expanded} {row.unit}"
        for row in rows
    )
    description = (
        content("name", texts, texts.text("results")),
        content("description", texts, described),
    )
    values = (row.value_si for row in rows)
    return _result("inercal_coefficients", results, description, values, uncertainty)


def _full_result(texts: Texts, results: ResultSet) -> Any:
    calibration = results.calibration
    units = [row.si_unit for row in results.rows]
    columns = [
        si(
            "column",
            *(
                si("covariance", si("value", repr(value)), si("unit", dsi_unit(first, second)))
                for first, value in zip(units, column, strict=True)
            ),
        )
        for second, column in zip(units, results.covariance.T.tolist(), strict=True)
    ]
    ellipsoid = si(
        "ellipsoidalRegionXMLList",
        si("covarianceMatrix", *columns),
        si("coverageFactor", f"{_ellipsoid_factor(results):.4f}"),
        si("coverageProbability", str(COVERAGE_PROBABILITY)),
    )
    file_name = f"{calibration.sensor.name}.calibration.json"
    attached = dcc(
        "file",
        dcc("fileName", "-".join(file_name.split())),
        dcc("mimeType", "application/json"),
        dcc("dataBase64", base64.b64encode(calibration_bytes(results)).decode()),
    )
    description = (
        content("name", texts, texts.text("coefficients_full")),
        content("description", texts, texts.text("attached"), more=(attached,)),
    )
    values = calibration.values.tolist()
    return _result("inercal_covariance", results, description, values, ellipsoid)


def _ellipsoid_factor(results: ResultSet) -> float:
    """Return the coverage factor k of the ellipsoid of all coefficients."""
    n, dof, p = len(results.rows), results.dof, COVERAGE_PROBABILITY
    return sqrt(float(n * fdtri(n, dof, p) if isfinite(dof) else chdtri(n, 1 - p)))


def _conformity(certificate: Certificate) -> Any:
    conformity = certificate.conformity
    if conformity is None:
        return None
    sensor = certificate.calibration.sensor
    units = {row.name: row.si_unit for row in certificate.results[-1].rows}
    entries = [
        _limit_entry(certificate.texts, one, dsi_unit(units[one.name])) for one in conformity.limits
    ]
    overall = dcc(
        "metaData",
        content("name", certificate.texts, sensor.name),
        dcc("norm", "JCGM 106:2012"),
        dcc("norm", "ILAC-G8:09/2019"),
        content("declaration", certificate.texts, *rule_lines(certificate)),
        dcc("conformity", _CONFORMITY[conformity.result]),
        refType="basic_conformity",
    )
    return dcc("measurementMetaData", overall, *entries)


def _limit_entry(texts: Texts, one: LimitResult, unit: str) -> Any:
    limits = [
        dcc("quantity", si("real", si("label", name), si("value", repr(value)), si("unit", unit)))
        for name, value in (("lower", one.lower), ("upper", one.upper))
        if isfinite(value)
    ]
    return dcc(
        "metaData",
        content("name", texts, one.name),
        dcc("conformity", _CONFORMITY[one.result]),
        dcc("data", *limits),
        refType="basic_conformity",
    )


def _numbers(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)
