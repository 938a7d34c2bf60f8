"""Digest of a machine file and all files that it names, independent of their folders."""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import msgspec

from mcserver.machine.machine_file import Machine
from mcserver.machine.mesh_files import find_mesh

# keys whose values are paths: the files' contents count, not the paths
_FILES = ("urdf", "srdf", "file", "eds")


def canonical_bytes(value: object) -> bytes:
    """Return equal bytes for equal values of structs, mappings, sets, numbers and text."""
    plain = msgspec.to_builtins(value, str_keys=True, order="deterministic")
    return msgspec.msgpack.encode(plain)


def machine_digest(machine: Machine) -> str:
    """Return the SHA-256 of a machine, hexadecimal, with the contents of the files that it names, and of its
    links' meshes if bodies are checked.

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
    """Return the SHA-256 of a file; for a built-in one its name."""
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else file.name


def _meshes(urdf: Path) -> list[str]:
    if not urdf.is_file():
        return []
    try:
        named = ElementTree.parse(urdf).iter("mesh")
    except ElementTree.ParseError:
        # whoever loads it reports the fault
        return []
    found = [find_mesh(mesh.get("filename", ""), urdf, ()) for mesh in named]
    return [_content(each) for each in found if each is not None]
