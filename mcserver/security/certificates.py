"""A site's certificate authority and certificates, by the ``cryptography`` package (extra ``security``)."""

from __future__ import annotations

import datetime
import ipaddress

import msgspec

from mcserver.errors import ConfigurationError

try:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
except ImportError as error:
    raise ConfigurationError(
        "MC561", "certificates need the package cryptography", "pip install 'mcserver[security]'"
    ) from error

AUTHORITY_DAYS = 3650
# the longest that common TLS libraries accept of a server
IDENTITY_DAYS = 825
# clocks of machines differ
EARLIER = datetime.timedelta(hours=1)


class Credentials(msgspec.Struct, frozen=True):
    """A certificate and its private key, in PEM."""

    certificate: bytes
    key: bytes


def new_authority(name: str, now: datetime.datetime) -> Credentials:
    """A certificate authority that signs nothing but certificates of its site."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = _subject(name)
    certificate = (
        _builder(subject, subject, key.public_key(), now, AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(sign_certificates=True), critical=True)
        .sign(key, hashes.SHA256())
    )
    return _credentials(certificate, key)


def new_identity(
    authority: Credentials, name: str, now: datetime.datetime, *, hosts: tuple[str, ...] = ()
) -> Credentials:
    """A certificate with this common name.

    Args:
        hosts: names and addresses at which it may serve; empty: a client's certificate.
    """
    purposes = [ExtendedKeyUsageOID.CLIENT_AUTH] + ([ExtendedKeyUsageOID.SERVER_AUTH] if hosts else [])
    return _signed(authority, name, now, purposes, hosts)


def new_signer(authority: Credentials, name: str, now: datetime.datetime) -> Credentials:
    """A certificate that signs approvals of runs under this name, and opens no connection."""
    return _signed(authority, name, now, [ExtendedKeyUsageOID.CODE_SIGNING], ())


def _signed(
    authority: Credentials,
    name: str,
    now: datetime.datetime,
    purposes: list[x509.ObjectIdentifier],
    hosts: tuple[str, ...],
) -> Credentials:
    issuer = x509.load_pem_x509_certificate(authority.certificate)
    signer = serialization.load_pem_private_key(authority.key, None)
    assert isinstance(signer, ec.EllipticCurvePrivateKey), "made by new_authority"
    key = ec.generate_private_key(ec.SECP256R1())
    alternative = [_general_name(host) for host in hosts] or [x509.DNSName(name)]
    certificate = (
        _builder(_subject(name), issuer.subject, key.public_key(), now, IDENTITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(sign_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
        .add_extension(x509.SubjectAlternativeName(alternative), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key()), critical=False
        )
        .sign(signer, hashes.SHA256())
    )
    return _credentials(certificate, key)


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePublicKey,
    now: datetime.datetime,
    days: int,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - EARLIER)
        .not_valid_after(now + datetime.timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _subject(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _usage(*, sign_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not sign_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=sign_certificates,
        crl_sign=sign_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _credentials(certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> Credentials:
    return Credentials(
        certificate.public_bytes(serialization.Encoding.PEM),
        key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        ),
    )
