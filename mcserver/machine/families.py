"""Kinds of drives: simulated, ideal, and one for each folder of `mcserver.drives` with a drive.py."""

from __future__ import annotations

import importlib
import pkgutil
from importlib.util import find_spec
from typing import TYPE_CHECKING, Union

from mcserver.machine.drive import CanDrive, Drive, IdealDrive


def family_drives() -> tuple[type[CanDrive], ...]:
    """Return ``DRIVE`` of each family, sorted by folder name."""
    package = find_spec("mcserver.drives")
    folders = () if package is None else package.submodule_search_locations or ()
    names = [f"mcserver.drives.{each.name}.drive" for each in pkgutil.iter_modules(folders) if each.ispkg]
    return tuple(importlib.import_module(name).DRIVE for name in sorted(names) if find_spec(name) is not None)


# type of ``[axis.drive]`` for msgspec: one of the kinds, by ``kind``
if TYPE_CHECKING:
    AnyDrive = Drive
else:
    AnyDrive = Union[(Drive, IdealDrive, *family_drives())]
