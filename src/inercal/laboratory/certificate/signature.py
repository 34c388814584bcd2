"""Sign with the laboratory's key: PAdES for the PDF (B-B), XAdES for the DCC (enveloped).

The key is read from a PKCS#12 file for each certificate and is never stored. Signatures have no
time stamp (B-T), because a time stamp needs a service on the network.
"""

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from inercal.basics.errors import InputError
from inercal.basics.small_files import read_small_file
from inercal.laboratory.certificate.dcc_elements import etree, signature_library

_FIELD = "inercal_certificate"


@dataclass(frozen=True, eq=False)
class SigningKey:
    """A signing key with its certificate, and the certificates of the issuers.

    Parameters
    ----------
    key, certificate : objects of the package cryptography
    chain : tuple
        Certificates of the issuers.
    content : bytes
        The PKCS#12 file.
    passphrase : bytes
    """

    key: Any
    certificate: Any
    chain: tuple[Any, ...]
    content: bytes
    passphrase: bytes

    def __repr__(self) -> str:
        return f"<SigningKey of {self.certificate.subject.rfc4514_string()}>"


def read_signing_key(path: Path, passphrase: str) -> SigningKey:
    """Read a key from a PKCS#12 file.

    Raises
    ------
    InputError
        If the file cannot be read, the passphrase is wrong, or a key or certificate is missing.
    MissingExtra
        If the packages for signatures are not installed.
    """
    pkcs12 = signature_library("cryptography.hazmat.primitives.serialization.pkcs12")
    content = read_small_file(path, "PKCS#12 file")
    try:
        key, certificate, chain = pkcs12.load_key_and_certificates(content, passphrase.encode())
    except ValueError as error:
        raise InputError(
            f"--sign {path} is not a PKCS#12 file, or the passphrase is wrong: {error}",
            file=path,
            key="--sign",
        ) from None
    if key is None or certificate is None:
        raise InputError(
            f"--sign {path} does not contain a key together with its certificate",
            file=path,
            key="--sign",
        )
    return SigningKey(key, certificate, tuple(chain), content, passphrase.encode())


def sign_dcc(document: bytes, key: SigningKey) -> bytes:
    """Return the DCC with an XAdES signature as the last child of its root."""
    enveloped = signature_library("signxml").methods.enveloped
    signer = signature_library("signxml.xades").XAdESSigner(method=enveloped)
    chain = [key.certificate, *key.chain]
    signed = signer.sign(etree.fromstring(document), key=key.key, cert=chain)
    return bytes(etree.tostring(signed, xml_declaration=True, encoding="UTF-8")) + b"\n"


def sign_pdf(document: bytes, key: SigningKey) -> bytes:
    """Return the PDF with a PAdES signature, which is appended to the unchanged bytes.

    Raises
    ------
    InputError
        If the key cannot sign a PDF.
    """
    signers = signature_library("pyhanko.sign.signers")
    pades = signature_library("pyhanko.sign.fields").SigSeedSubFilter.PADES
    writer = signature_library("pyhanko.pdf_utils.incremental_writer").IncrementalPdfFileWriter
    signer = signers.SimpleSigner.load_pkcs12_data(key.content, (), key.passphrase)
    if signer is None:
        raise InputError("--sign: a key of this kind cannot sign a PDF; give an RSA or ECDSA key")
    metadata = signers.PdfSignatureMetadata(
        field_name=_FIELD, subfilter=pades, md_algorithm="sha256"
    )
    output = BytesIO()
    signers.sign_pdf(writer(BytesIO(document)), metadata, signer=signer, output=output)
    return output.getvalue()
