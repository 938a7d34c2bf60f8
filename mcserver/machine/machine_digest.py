"""A digest of a machine file as it was read, its model of links included."""

from __future__ import annotations

import hashlib
from pathlib import Path

import msgspec

from mcserver.machine.clearance_section import MeshBody
from mcserver.machine.machine_file import Machine


def canonical_bytes(value: object) -> bytes:
    """Return bytes that are the same for equal values of structs, mappings, sets, numbers and text."""
    plain = msgspec.to_builtins(value, str_keys=True, order="deterministic")
    return msgspec.msgpack.encode(plain)


def machine_digest(machine: Machine) -> str:
    """Return the SHA-256 of a machine, hexadecimal; of URDF, SRDF and mesh files their content counts.

    Raises:
        OSError: one of them cannot be read.
    """
    digest = hashlib.sha256(canonical_bytes(machine))
    for path in _files(machine):
        if path.is_file():
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _files(machine: Machine) -> list[Path]:
    """Return the files that the machine file names and that its motion is judged by."""
    named = [machine.urdf]
    if machine.clearance is not None:
        named.append(machine.clearance.srdf)
        named += [each.file for each in machine.clearance.bodies if isinstance(each, MeshBody)]
    return [Path(each) for each in named if each is not None]
