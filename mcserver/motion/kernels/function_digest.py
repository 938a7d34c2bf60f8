"""A digest of a kernel and of everything that its machine code depends on."""

from __future__ import annotations

import enum
import hashlib
import inspect
from collections.abc import Callable
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

# Modules of these packages may change with the kernels; those of others are named by their version.
_OWN = ("mcserver", "mckinematics")


def function_digest(function: Callable[..., Any]) -> str:
    """Digest a kernel's code, its constants and, recursively, all kernels that it calls.

    numba compiles all of them into the caller's machine code, so a change of any of them changes the digest;
    a change of a comment, a docstring or a line number does not.

    Returns:
        SHA-256 in hexadecimal.
    """
    digest = hashlib.sha256()
    seen: dict[int, int] = {}
    for part in _function(function, seen):
        digest.update(part.encode())
        digest.update(b"\0")
    return digest.hexdigest()


def _function(function: Any, seen: dict[int, int]) -> list[str]:
    # a dispatcher of numba has the function inside
    function = getattr(function, "py_func", function)
    if id(function) in seen:
        return [f"function {seen[id(function)]}"]
    seen[id(function)] = len(seen)
    parts = ["function", function.__qualname__]
    names: set[str] = set()
    parts += _code(function.__code__, names, function.__doc__)
    for default in function.__defaults__ or ():
        parts += _value(default, seen)
    for cell in function.__closure__ or ():
        parts += _value(cell.cell_contents, seen)
    scope = function.__globals__
    for name in sorted(names):
        if name in scope:
            parts.append(name)
            parts += _value(scope[name], seen)
    return parts


def _code(code: CodeType, names: set[str], docstring: str | None) -> list[str]:
    names.update(code.co_names)
    parts = [
        code.co_code.hex(),
        repr((code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)),
        repr((code.co_argcount, code.co_kwonlyargcount, code.co_flags)),
    ]
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            parts += _code(constant, names, None)
        elif constant is None or constant != docstring:
            parts.append(repr(constant))
    return parts


def _value(value: Any, seen: dict[int, int]) -> list[str]:
    """Describe the value of a global name, a default or a closure's variable, equally in every process."""
    if isinstance(value, FunctionType) or hasattr(value, "py_func"):
        return _function(value, seen)
    if isinstance(value, enum.Enum):
        return [type(value).__qualname__, value.name, repr(value.value)]
    if isinstance(value, np.ndarray):
        return [repr((value.dtype.str, value.shape)), hashlib.sha256(value.tobytes()).hexdigest()]
    if isinstance(value, tuple | list):
        parts = [type(value).__qualname__]
        for each in value:
            parts += _value(each, seen)
        return parts
    if value is None or isinstance(value, bool | int | float | complex | str | bytes | np.generic | np.dtype):
        return [repr(value)]
    if isinstance(value, ModuleType):
        own = value.__name__.split(".")[0] in _OWN and value.__file__
        return [value.__name__, _file(value.__file__ or "") if own else ""]
    if isinstance(value, type):
        fields = getattr(value, "_fields", ())
        members = [repr(each) for each in value] if issubclass(value, enum.Enum) else []
        return [value.__module__, value.__qualname__, *fields, *members]
    if isinstance(value, BuiltinFunctionType | np.ufunc):
        return [str(getattr(value, "__module__", "")), value.__name__]
    # another type: digest the file that defines it
    source = inspect.getsourcefile(type(value))
    return [type(value).__module__, type(value).__qualname__, _file(source) if source else ""]


def _file(path: str) -> str:
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError:
        return path
