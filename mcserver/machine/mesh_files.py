"""Find the mesh files that a URDF names."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path


def mesh_names(text: str) -> list[str]:
    """Return the mesh names in a URDF's visuals, each once, in order."""
    robot = ElementTree.fromstring(text)
    named = [mesh.get("filename", "") for mesh in robot.iterfind("link/visual/geometry/mesh")]
    return [name for name in dict.fromkeys(named) if name]


def find_mesh(written: str, urdf: Path, roots: Sequence[Path]) -> Path | None:
    """Return the file of a URDF's ``mesh filename``; None if it is not found.

    ``package://name/rest`` is searched for in every folder above the URDF, then in ``roots``; a folder is the
    package if it has its name, or contains a folder of that name.
    """
    if written.startswith("file://"):
        written = written.removeprefix("file://")
    if not written.startswith("package://"):
        path = urdf.parent / written
        return path if path.is_file() else None
    name, _, rest = written.removeprefix("package://").partition("/")
    for folder in (*urdf.resolve().parents, *roots):
        packages = [folder / name] + ([folder] if folder.name == name else [])
        for package in packages:
            if (package / rest).is_file():
                return package / rest
    return None
