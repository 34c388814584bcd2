"""Verify a certificate: its numbers, its signatures, and its entry in the register."""

import asyncio
import base64
import hashlib
import logging
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.errors import InercalError, InputError
from inercal.basics.small_files import read_small_file
from inercal.basics.units import format_value_and_uncertainty
from inercal.laboratory.certificate.dcc_elements import etree, list_label, signature_library
from inercal.laboratory.certificate.dcc_reading import (
    SIGNATURE_NAMESPACE,
    StatedCertificate,
    read_dcc,
    read_results,
    schema_defects,
)
from inercal.laboratory.store import Register

_LARGEST = 64 << 20  # largest size of a certificate in bytes
_PDF_HEAD = b"%PDF-"


@dataclass(frozen=True)
class Check:
    """One check of a certificate.

    Parameters
    ----------
    name : str
    passed : bool or None
        Whether the check passed; None if it could not be made.
    text : str
        Result of the check.
    vouches : bool
        Whether a passed check proves who issued the file.
    """

    name: str
    passed: bool | None
    text: str
    vouches: bool = False


@dataclass(frozen=True)
class Verification:
    """The results of all checks of a certificate.

    Parameters
    ----------
    number : str
    checks : tuple of Check
    """

    number: str
    checks: tuple[Check, ...]

    @property
    def authentic(self) -> bool:
        """Whether no check failed, and a trusted signature or the register proves who issued it."""
        vouched = any(one.vouches for one in self.checks)
        return vouched and all(one.passed is not False for one in self.checks)


def verify(
    path: Path,
    *,
    trust: Path | None = None,
    schema: Path | None = None,
    register: Register | None = None,
) -> Verification:
    """Verify a certificate, given as a PDF or a DCC.

    Parameters
    ----------
    path : Path
    trust : Path, optional
        PEM file with trusted certificates; the chain of a signature must lead to one of them.
    schema : Path, optional
        The file dcc.xsd.
    register : Register, optional

    Raises
    ------
    InputError
        If the file is neither a PDF nor a DCC from inercal.
    MissingExtra
        If the packages for signatures are not installed.
    """
    content = read_small_file(path, "certificate", _LARGEST)
    trusted = None if trust is None else read_small_file(trust, "PEM file")
    checks: list[Check] = []
    document = content
    is_pdf = content.startswith(_PDF_HEAD)
    if is_pdf:
        with _readable(path):
            document = _attached_dcc(content, path)
            checks.append(_pdf_signature(content, trusted))
    stated = read_dcc(document, str(path))
    of_dcc = _dcc_signature(document, trusted)
    # A DCC with a valid signature could also be attached to forged pages.
    checks.append(replace(of_dcc, vouches=False) if is_pdf else of_dcc)
    checks += [_agreement(one, k) for k, one in enumerate(stated.measurements, start=1)]
    if schema is not None:
        defects = schema_defects(document, schema)
        checks.append(Check("schema", not defects, defects[0] if defects else "valid"))
    if register is not None:
        checks.append(_registered(content, stated, register))
    return Verification(stated.number, tuple(checks))


@contextmanager
def _readable(path: Path) -> Generator[None]:
    """Convert any error of the PDF reader to a one-line error that says the file is damaged."""
    try:
        yield
    except InercalError:
        raise
    except Exception as error:  # damaged bytes cause many types of errors
        raise InputError(
            f"this PDF has no attached DCC, or it is damaged: {error}; get the file again"
        ).located(path) from None


def _attached_dcc(content: bytes, path: Path) -> bytes:
    reader = signature_library("pyhanko.pdf_utils.reader").PdfFileReader
    names = reader(BytesIO(content), strict=False).root["/Names"]["/EmbeddedFiles"]
    listed = list(_name_tree(names))
    found = [file["/EF"]["/F"].data for name, file in listed if name.endswith(".xml")]
    if len(found) != 1:
        raise InputError(
            f"this PDF has {len(found)} attached DCCs, but a certificate has exactly one"
        ).located(path)
    return bytes(found[0])


def _name_tree(node: Any) -> Any:
    """Yield the name and file specification of each entry in a name tree."""
    if "/Names" in node:
        entries = list(node["/Names"])
        for name, file in zip(entries[::2], entries[1::2], strict=True):
            yield str(name), file.get_object()
    for child in node.get("/Kids", ()):
        yield from _name_tree(child.get_object())


def _pdf_signature(content: bytes, trusted: bytes | None) -> Check:
    name = "signature of the PDF"
    reader = signature_library("pyhanko.pdf_utils.reader").PdfFileReader
    validation = signature_library("pyhanko.sign.validation")
    context = signature_library("pyhanko_certvalidator").ValidationContext
    signatures = reader(BytesIO(content), strict=False).embedded_signatures
    if not signatures:
        return Check(name, None, "not signed")
    embedded = signatures[-1]
    roots = _certificates(trusted) if trusted else [embedded.signer_cert]
    logging.getLogger("pyhanko").setLevel(logging.CRITICAL)  # the check below says the same
    try:
        status = validation.validate_pdf_signature(embedded, context(trust_roots=roots))
    except validation.SignatureValidationError as error:
        return Check(name, False, str(error))
    covers_all = str(status.coverage).endswith("ENTIRE_FILE")
    subject = str(embedded.signer_cert.subject.human_friendly)
    if not (status.intact and status.valid and covers_all):
        return Check(name, False, f"the file was changed after {subject} signed it")
    return _trust_check(name, subject, trusted, bool(status.trusted))


def _trust_check(name: str, subject: str, trusted: bytes | None, leads: bool) -> Check:
    if trusted is None:
        who = f"signed by {subject}, who was not checked"
        return Check(name, True, f"intact, {who}; name the certificates you trust with --trust")
    if not leads:
        reason = f"the certificate of {subject} does not lead to the one you trust"
        return Check(name, False, f"intact, but {reason}")
    return Check(name, True, f"intact, signed by {subject}, trusted", vouches=True)


def _certificates(pem: bytes) -> list[Any]:
    """Return the certificates in a PEM file in the form that pyHanko needs."""
    load = signature_library("asn1crypto.x509").Certificate.load
    der = signature_library("cryptography.hazmat.primitives.serialization").Encoding.DER
    return [load(one.public_bytes(der)) for one in _load_pem(pem)]


def _load_pem(pem: bytes) -> list[Any]:
    try:
        return list(signature_library("cryptography.x509").load_pem_x509_certificates(pem))
    except ValueError as error:
        raise InputError(
            f"--trust: the file contains no certificate in PEM format: {error}", key="--trust"
        ) from None


def _dcc_signature(document: bytes, trusted: bytes | None) -> Check:
    name = "signature of the DCC"
    refusals = signature_library("signxml.exceptions")
    verifier = signature_library("signxml.xades").XAdESVerifier()
    root = etree.fromstring(document, etree.XMLParser(resolve_entities=False, no_network=True))
    found = root.find(f"{{{SIGNATURE_NAMESPACE}}}Signature")
    if found is None:
        return Check(name, None, "not signed")
    texts = [
        str(one.text) for one in found.iterfind(f".//{{{SIGNATURE_NAMESPACE}}}X509Certificate")
    ]
    try:
        x509 = signature_library("cryptography.x509")
        der, *chain = map(base64.b64decode, texts or [""])
        own = x509.load_der_x509_certificate(der)
        signed = verifier.verify(document, x509_cert=own)[0].signed_xml
    except (refusals.InvalidSignature, refusals.InvalidInput, etree.LxmlError, ValueError) as error:
        return Check(name, False, f"the DCC was changed after it was signed: {error}")
    if signed is None or signed.tag != root.tag:
        return Check(name, False, "the signature covers only a part of the DCC")
    subject = str(own.subject.rfc4514_string())
    leads = trusted is not None and _leads_to(der, chain, trusted)
    return _trust_check(name, subject, trusted, leads)


def _leads_to(own: bytes, chain: Sequence[bytes], trusted: bytes) -> bool:
    """Return whether the chain of a certificate (DER) leads to a trusted certificate (PEM)."""
    load = signature_library("asn1crypto.x509").Certificate.load
    library = signature_library("pyhanko_certvalidator")
    refusals = signature_library("pyhanko_certvalidator.errors")
    context = library.ValidationContext(trust_roots=_certificates(trusted))
    path = library.CertificateValidator(
        load(own), [load(one) for one in chain], validation_context=context
    )
    try:
        asyncio.run(path.async_validate_path())
    except (refusals.PathError, refusals.ValidationError):
        return False
    return True


def _agreement(measurement: Any, number: int) -> Check:
    """Check that the rounded numbers, the covariance and the attached calibration file agree."""
    name = f"results {number}"
    try:
        stated = read_results(measurement)
    except InputError as error:
        return Check(name, False, str(error))
    calibration = stated.calibration
    names = tuple(map(list_label, calibration.sensor.coefficients))
    if stated.names != names or not np.array_equal(stated.full_value, calibration.values):
        return Check(
            name, False, "the coefficients differ from those in the attached calibration file"
        )
    std = np.sqrt(np.diag(stated.covariance))
    if np.any(std < calibration.std * (1 - 1e-9)):
        return Check(name, False, "the covariance is smaller than in the attached calibration file")
    # A capability of the laboratory increases standard deviations and preserves the correlations.
    scale = np.divide(std, calibration.std, out=np.ones_like(std), where=calibration.std > 0)
    off = stated.covariance - calibration.covariance * np.outer(scale, scale)
    np.fill_diagonal(off, 0.0)
    if np.any(np.abs(off) > 1e-9 * np.outer(std, std)):
        return Check(
            name, False, "the covariance differs from that in the attached calibration file"
        )
    for k, coefficient in enumerate(calibration.sensor.coefficients):
        si = calibration.sensor.coefficient(coefficient).si
        full = stated.k[k] * std[k] / si
        shown = format_value_and_uncertainty(float(stated.full_value[k]) / si, float(full))
        both = float(stated.value[k]) / si, float(stated.expanded[k]) / si
        for text, each in zip(shown, both, strict=True):
            # The certificate states k with two decimals, which may change the last digit of U.
            if abs(float(text) - each) > max(1e-9 * abs(each), 0.051 * both[1]):
                wrong = f"the value or U stated for {coefficient} is not the rounded result"
                return Check(name, False, wrong)
    larger = [one for one, by in zip(names, scale, strict=True) if by > 1 + 1e-9]
    more = f"; U of {', '.join(larger)} is larger than in this file, which only a stated capability"
    more = f"{more} of the laboratory explains" * bool(larger)
    return Check(name, True, f"rounded results, covariance and calibration file agree{more}")


def _registered(content: bytes, stated: StatedCertificate, register: Register) -> Check:
    name = "register"
    try:
        entry = register.certificate(stated.number)
    except InputError as error:
        return Check(name, False, str(error))
    if hashlib.sha256(content).hexdigest() not in (entry.pdf_sha256, entry.dcc_sha256):
        return Check(name, False, f"the file differs from {stated.number} as it was issued")
    changes = register.successors(stated.number)
    replaced = [number for number, change in changes if change == "substituted"]
    if replaced:
        return Check(name, False, f"replaced by {replaced[-1]}")
    amended = [number for number, change in changes if change == "amended"]
    more = f"; amended by {', '.join(amended)}" if amended else ""
    return Check(name, True, f"issued on {entry.issued} by {entry.by}{more}", vouches=True)
