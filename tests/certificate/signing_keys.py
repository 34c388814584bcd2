"""Keys of a laboratory, for tests: self-signed, or with a chain; of 2048 bits."""

from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    pkcs12,
)

PASSPHRASE = "of the tests"


def write_key(folder: Path, name: str) -> None:
    """Write NAME.p12, a self-signed key with its certificate, and NAME.pem, the certificate."""
    key = _new_key()
    _write(folder, name, key, _certificate(name, key, name, key), ())


def write_chain(folder: Path, name: str) -> None:
    """Write NAME.p12, a key with its certificate and an intermediate one, and ROOT of both, PEM."""
    root, between, key = _new_key(), _new_key(), _new_key()
    of_root = _certificate("root", root, "root", root)
    of_between = _certificate("between", between, "root", root)
    _write(folder, name, key, _certificate(name, key, "between", between, ca=False), (of_between,))
    (folder / "root.pem").write_bytes(of_root.public_bytes(Encoding.PEM))


def _new_key() -> rsa.RSAPrivateKey:
    return rsa.generate_private_key(public_exponent=65537, key_size=2048)


def _name(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, f"Laboratory {name}")])


def _certificate(
    name: str, key: rsa.RSAPrivateKey, issuer: str, of: rsa.RSAPrivateKey, *, ca: bool = True
) -> x509.Certificate:
    usage = x509.KeyUsage(
        digital_signature=True, content_commitment=True, key_encipherment=False,
        data_encipherment=False, key_agreement=False, key_cert_sign=ca, crl_sign=False,
        encipher_only=False, decipher_only=False,
    )  # fmt: skip
    public, authority = key.public_key(), of.public_key()
    return (
        x509.CertificateBuilder()
        .subject_name(_name(name))
        .issuer_name(_name(issuer))
        .public_key(public)
        .serial_number(x509.random_serial_number())
        .not_valid_before(datetime(2020, 1, 1, tzinfo=UTC))
        .not_valid_after(datetime(2120, 1, 1, tzinfo=UTC))
        .add_extension(x509.BasicConstraints(ca=ca, path_length=None), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(authority), critical=False
        )
        .sign(of, hashes.SHA256())
    )


def _write(
    folder: Path,
    name: str,
    key: rsa.RSAPrivateKey,
    certificate: x509.Certificate,
    chain: tuple[x509.Certificate, ...],
) -> None:
    encryption = BestAvailableEncryption(PASSPHRASE.encode())
    content = pkcs12.serialize_key_and_certificates(
        name.encode(), key, certificate, chain or None, encryption
    )
    (folder / f"{name}.p12").write_bytes(content)
    (folder / f"{name}.pem").write_bytes(certificate.public_bytes(Encoding.PEM))
