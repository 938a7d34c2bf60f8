"""A digest of a machine file as it was read, its model of links included."""

from __future__ import annotations

import hashlib
from pathlib import Path

import msgspec

from mcserver.machine.machine_file import Machine


def canonical_bytes(value: object) -> bytes:
    """Return bytes that are the same for equal values of structs, mappings, sets, numbers and text."""
    plain = msgspec.to_builtins(value, str_keys=True, order="deterministic")
    return msgspec.msgpack.encode(plain)


def machine_digest(machine: Machine) -> str:
    """Return the SHA-256 of a machine, hexadecimal; of a URDF that is a file, its content counts.

    Raises:
        OSError: the URDF cannot be read.
    """
    digest = hashlib.sha256(canonical_bytes(machine))
    urdf = None if machine.urdf is None else Path(machine.urdf)
    if urdf is not None and urdf.is_file():
        digest.update(urdf.read_bytes())
    return digest.hexdigest()
