"""An approval as a signed file: what an operator would see of a run, signed under the site's authority.

The file is one JSON object: ``approval``, whose bytes are signed as written, ``signature`` (ECDSA over
SHA-256, base64) and ``certificate`` of the signer (X.509, PEM). Signing and verifying need the package
``cryptography`` (extra ``security``).
"""

from __future__ import annotations

import base64
import binascii
import datetime
from typing import TYPE_CHECKING

import msgspec

from mcserver.errors import Refused
from mcserver.planning.start_state import StartState
from mcserver.service.arming import Extent, ToolExtent

if TYPE_CHECKING:
    from cryptography import x509

MAX_CERTIFICATE = 256 * 1024  # characters of a file
_REMEDY = "certify the run anew: mcserver certify"


class Approval(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Certified properties of a run.

    Attributes:
        sha256: of the text. axes: that it may move. start: further inputs of its simulation.
        machine: digest of the machine file. version: of the server. digest: of the approval: all of these.
        setpoints: SHA-256 of every setpoint of its simulation.
        duration_s, extents, tools, effects, clearance_mm: what an operator sees of it; None: no bodies.
        override: greatest feed override, 1 as programmed. until: expiry [s since 1970, UTC].
    """

    sha256: str
    axes: tuple[int, ...]
    start: StartState
    machine: str
    version: str
    digest: str
    setpoints: str
    duration_s: float
    extents: tuple[Extent, ...]
    tools: tuple[ToolExtent, ...]
    effects: tuple[str, ...]
    clearance_mm: float | None
    override: float
    until: float


class CertifiedRun(msgspec.Struct, frozen=True):
    """A verified approval, and the name of its signer."""

    approval: Approval
    signer: str


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    approval: msgspec.Raw
    signature: str
    certificate: str


def sign(approval: Approval, certificate: bytes, key: bytes) -> bytes:
    """Write the file of an approval, signed by a key with a certificate of the site's authority.

    Args:
        certificate, key: of the signer (PEM), as `mcserver.security.certificates.new_signer` makes them.
    """
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    signer = serialization.load_pem_private_key(key, None)
    assert isinstance(signer, ec.EllipticCurvePrivateKey), "made by new_signer"
    signed = msgspec.json.encode(approval)
    signature = base64.b64encode(signer.sign(signed, ec.ECDSA(hashes.SHA256()))).decode()
    return msgspec.json.encode(_File(msgspec.Raw(signed), signature, certificate.decode())) + b"\n"


def verified(file: str, authority: bytes | None, now: datetime.datetime) -> CertifiedRun:
    """Verify a file, and return the approval.

    Args:
        authority: the site's certificate (PEM), from the server's Zenoh configuration; None: it has none.

    Raises:
        Refused: MC578 not an approval, changed, expired, or not signed by a signer of this site.
    """
    if authority is None:
        raise Refused(
            "MC578",
            "this server knows no site whose signatures it could trust",
            "start it with --zenoh-config of the site: docs/security.md",
        )
    try:
        from cryptography import x509
    except ImportError as error:
        raise Refused(
            "MC578", "certificates need the package cryptography", "pip install 'mcserver[security]'"
        ) from error
    try:
        content = msgspec.json.decode(file, type=_File)
        certificate = x509.load_pem_x509_certificate(content.certificate.encode())
        site = x509.load_pem_x509_certificate(authority)
        signature = base64.b64decode(content.signature, validate=True)
    except (msgspec.DecodeError, ValueError, binascii.Error) as error:
        raise _refused("it is no certificate of a run") from error
    _check_signer(certificate, site, now)
    _check_signature(certificate, signature, bytes(content.approval))
    try:
        approval = msgspec.json.decode(content.approval, type=Approval)
    except msgspec.DecodeError as error:
        raise _refused(f"another version has made it: {error}") from error
    if now.timestamp() >= approval.until:
        ended = datetime.datetime.fromtimestamp(approval.until, datetime.UTC)
        raise _refused(f"it expired at {ended:%Y-%m-%d %H:%M:%S} UTC")
    return CertifiedRun(approval, _name_of(certificate))


def _check_signer(certificate: x509.Certificate, site: x509.Certificate, now: datetime.datetime) -> None:
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.x509.oid import ExtendedKeyUsageOID

    try:
        certificate.verify_directly_issued_by(site)
    except (ValueError, TypeError, InvalidSignature) as error:
        raise _refused("its signer is not of this site") from error
    try:
        purposes = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    except x509.ExtensionNotFound:
        purposes = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CLIENT_AUTH])
    # certificates of people and machines are for connections, and cannot sign approvals
    if ExtendedKeyUsageOID.CODE_SIGNING not in purposes:
        raise _refused(f"{_name_of(certificate)} may not sign approvals")
    for each in (certificate, site):
        if not each.not_valid_before_utc <= now <= each.not_valid_after_utc:
            raise _refused(f"the key of {_name_of(each)} has expired, or is not valid yet")


def _check_signature(certificate: x509.Certificate, signature: bytes, signed: bytes) -> None:
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec

    key = certificate.public_key()
    if not isinstance(key, ec.EllipticCurvePublicKey):
        raise _refused("its signer's key is of another kind")
    try:
        key.verify(signature, signed, ec.ECDSA(hashes.SHA256()))
    except InvalidSignature as error:
        raise _refused("it was changed since it was signed") from error


def _name_of(certificate: x509.Certificate) -> str:
    from cryptography.x509.oid import NameOID

    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(names[0].value)[:64] if names else "nobody"


def _refused(why: str) -> Refused:
    return Refused("MC578", f"the certificate does not count: {why}", _REMEDY)
