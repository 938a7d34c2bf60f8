"""A site's certificate authority and certificates, by the ``cryptography`` package (extra ``security``)."""

from __future__ import annotations

import datetime
import ipaddress

import msgspec

from mcserver.errors import ConfigurationError

try:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec, rsa
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
# of OPC UA's policies in common use, whose keys are RSA [bit]
RSA_SIZE = 3072
Key = ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey


class Credentials(msgspec.Struct, frozen=True):
    """A certificate and its private key, in PEM."""

    certificate: bytes
    key: bytes


def new_authority(name: str, now: datetime.datetime) -> Credentials:
    """Return a certificate authority that signs nothing but certificates of its site."""
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
    """Return a certificate with this common name.

    Args:
        hosts: names and addresses at which it may serve; empty: a client's certificate.
    """
    purposes = [ExtendedKeyUsageOID.CLIENT_AUTH] + ([ExtendedKeyUsageOID.SERVER_AUTH] if hosts else [])
    return _signed(authority, name, now, purposes, hosts)


def new_signer(authority: Credentials, name: str, now: datetime.datetime) -> Credentials:
    """Return a certificate that signs approvals of runs under this name, and opens no connection."""
    return _signed(authority, name, now, [ExtendedKeyUsageOID.CODE_SIGNING], ())


def new_application(
    authority: Credentials, name: str, now: datetime.datetime, hosts: tuple[str, ...]
) -> Credentials:
    """Return a certificate of an OPC UA application, server or client (OPC 10000-6, 6.2.2)."""
    key = rsa.generate_private_key(public_exponent=65537, key_size=RSA_SIZE)
    names = (x509.UniformResourceIdentifier(f"urn:mcserver:opcua:{name}"), *map(_general_name, hosts))
    purposes = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
    return _signed_for(key, authority, name, now, purposes, names)


def _signed(
    authority: Credentials,
    name: str,
    now: datetime.datetime,
    purposes: list[x509.ObjectIdentifier],
    hosts: tuple[str, ...],
) -> Credentials:
    names = tuple(_general_name(host) for host in hosts) or (x509.DNSName(name),)
    return _signed_for(ec.generate_private_key(ec.SECP256R1()), authority, name, now, purposes, names)


def _signed_for(
    key: Key,
    authority: Credentials,
    name: str,
    now: datetime.datetime,
    purposes: list[x509.ObjectIdentifier],
    names: tuple[x509.GeneralName, ...],
) -> Credentials:
    issuer = x509.load_pem_x509_certificate(authority.certificate)
    signer = serialization.load_pem_private_key(authority.key, None)
    assert isinstance(signer, ec.EllipticCurvePrivateKey), "made by new_authority"
    rsa_key = isinstance(key, rsa.RSAPrivateKey)
    certificate = (
        _builder(_subject(name), issuer.subject, key.public_key(), now, IDENTITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(sign_certificates=False, encipher=rsa_key), critical=True)
        .add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key()), critical=False
        )
        .sign(signer, hashes.SHA256())
    )
    return _credentials(certificate, key)


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePublicKey | rsa.RSAPublicKey,
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


def _usage(*, sign_certificates: bool, encipher: bool = False) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not sign_certificates,
        content_commitment=encipher,
        key_encipherment=encipher,
        data_encipherment=encipher,
        key_agreement=False,
        key_cert_sign=sign_certificates,
        crl_sign=sign_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _credentials(certificate: x509.Certificate, key: Key) -> Credentials:
    return Credentials(
        certificate.public_bytes(serialization.Encoding.PEM),
        key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        ),
    )
