"""A digest of a machine file as it was read, with all files that it names; of no folder that they are in."""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import msgspec

from mcserver.machine.machine_file import Machine
from mcserver.machine.mesh_files import find_mesh

# keys of a machine whose values are paths: of these files the content counts, and not where they are
_FILES = ("urdf", "srdf", "file", "eds")


def canonical_bytes(value: object) -> bytes:
    """Return bytes that are the same for equal values of structs, mappings, sets, numbers and text."""
    plain = msgspec.to_builtins(value, str_keys=True, order="deterministic")
    return msgspec.msgpack.encode(plain)


def machine_digest(machine: Machine) -> str:
    """Return the SHA-256 of a machine, hexadecimal; of the files that it names their content counts, and
    where bodies are judged that of its links' meshes.

    Raises:
        OSError: one of them cannot be read.
    """
    plain = msgspec.to_builtins(machine, str_keys=True, order="deterministic")
    meshes = [] if machine.clearance is None or machine.urdf is None else _meshes(Path(machine.urdf))
    return hashlib.sha256(canonical_bytes((_contents(plain), meshes))).hexdigest()


def _contents(plain: Any) -> Any:
    if isinstance(plain, dict):
        return {
            key: _content(Path(value)) if key in _FILES and isinstance(value, str) else _contents(value)
            for key, value in plain.items()
        }
    return [_contents(each) for each in plain] if isinstance(plain, list | tuple) else plain


def _content(file: Path) -> str:
    """Return the SHA-256 of a file; the name of one that is built in."""
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else file.name


def _meshes(urdf: Path) -> list[str]:
    if not urdf.is_file():
        return []
    try:
        named = ElementTree.parse(urdf).iter("mesh")
    except ElementTree.ParseError:
        # who loads it says so
        return []
    found = [find_mesh(mesh.get("filename", ""), urdf, ()) for mesh in named]
    return [_content(each) for each in found if each is not None]
