"""When the certificates of a Zenoh configuration end, and who is told in time."""

from __future__ import annotations

import asyncio
import base64
import binascii
import datetime
import json
import re
import ssl
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import zenoh

WARNED_BEFORE = datetime.timedelta(days=30)
LOOK_AGAIN_S = 24 * 3600.0
CODE = "MC563"
REMEDY = "renew it before: docs/security.md, Renewing certificates"
_CERTIFICATES = ("connect_certificate", "listen_certificate", "root_ca_certificate")
_WRITTEN = re.compile(r"""\b\w+_certificate_base64["']?\s*:\s*["']([A-Za-z0-9+/=\s]+)["']""")
_WRITTEN_AUTHORITY = re.compile(r"""\broot_ca_certificate_base64["']?\s*:\s*["']([A-Za-z0-9+/=\s]+)["']""")
_SEQUENCE, _VERSION, _UTC_TIME = 0x30, 0xA0, 0x17


class Ending(NamedTuple):
    """A certificate of a file, and when it ends (UTC)."""

    file: Path
    ends: datetime.datetime

    def is_near(self, now: datetime.datetime) -> bool:
        """Return whether it ends within `WARNED_BEFORE`, or has ended."""
        return self.ends - now < WARNED_BEFORE

    def said(self, now: datetime.datetime) -> str:
        """When, for people."""
        ended = "has ended" if self.ends <= now else f"ends in {(self.ends - now).days} days"
        return f"the certificate in {self.file} {ended}: {self.ends:%Y-%m-%d %H:%M} UTC"


def first_ending(file: Path) -> Ending | None:
    """Return which certificate of a Zenoh configuration ends first; None: it has none that can be read.

    What is wrong with a configuration is said where it is used.
    """
    try:
        ends = [_end_of(pem) for pem in _certificates(file)]
    except (OSError, ValueError, LookupError, zenoh.ZError):
        return None
    return Ending(file, min(ends)) if ends else None


def authority_of(file: Path | None) -> bytes | None:
    """Return the site's certificate of a Zenoh configuration (PEM); None: it has none that can be read."""
    if file is None:
        return None
    try:
        written = _WRITTEN_AUTHORITY.search(file.read_text("utf-8"))
        if written is not None:
            return base64.b64decode(written[1])
        tls = json.loads(zenoh.Config.from_file(file).get_json("transport/link/tls")) or {}
        path = tls.get("root_ca_certificate")
        return Path(path).read_bytes() if path else None
    except (OSError, ValueError, LookupError, zenoh.ZError):
        return None


async def warn_of_expiry(
    file: Path,
    warn: Callable[[str], None],
    now: Callable[[], datetime.datetime],
    sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
) -> None:
    """Say each day, from 30 days before on, that a certificate of a configuration ends."""
    while True:
        ending = await asyncio.to_thread(first_ending, file)
        if ending is not None and ending.is_near(now()):
            warn(f"{ending.said(now())}; {REMEDY}")
        await sleep(LOOK_AGAIN_S)


def _certificates(file: Path) -> Iterator[str]:
    # Zenoh takes what is written into the file itself for a secret, and gives it to nobody
    for found in _WRITTEN.finditer(file.read_text("utf-8")):
        yield base64.b64decode(found[1]).decode("ascii")
    tls = json.loads(zenoh.Config.from_file(file).get_json("transport/link/tls")) or {}
    for name in _CERTIFICATES:
        if path := tls.get(name):
            yield Path(path).read_text("ascii")


def _end_of(pem: str) -> datetime.datetime:
    """When a certificate ends: RFC 5280, 4.1; the package ``cryptography`` need not be there.

    Raises:
        ValueError: it is none.
    """
    try:
        der = ssl.PEM_cert_to_DER_cert(pem)
    except binascii.Error as error:
        raise ValueError(str(error)) from error
    _, content, _ = _element(der, 0)
    _, at, _ = _element(der, content)
    tag, _, _ = _element(der, at)
    # version (which may be left out), serial number, algorithm, issuer; then the validity
    for _ in range(4 if tag == _VERSION else 3):
        _, _, at = _element(der, at)
    tag, begins, _ = _element(der, at)
    if tag != _SEQUENCE:
        raise ValueError("no certificate")
    _, _, at = _element(der, begins)
    tag, start, end = _element(der, at)
    form = "%y%m%d%H%M%SZ" if tag == _UTC_TIME else "%Y%m%d%H%M%SZ"
    return datetime.datetime.strptime(der[start:end].decode("ascii"), form).replace(tzinfo=datetime.UTC)


def _element(der: bytes, at: int) -> tuple[int, int, int]:
    """Tag of an element of DER, where its content begins, and where it ends."""
    tag, size, start = der[at], der[at + 1], at + 2
    if size & 0x80:
        count = size & 0x7F
        size, start = int.from_bytes(der[start : start + count], "big"), start + count
    return tag, start, start + size
