"""How kernels are compiled."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

_Function = TypeVar("_Function", bound=Callable[..., Any])


def compiles() -> bool:
    """Whether kernels are compiled at all: ``NUMBA_DISABLE_JIT=1`` runs them as plain Python."""
    return not numba.config.DISABLE_JIT  # type: ignore[attr-defined]


def compiled(function: _Function) -> _Function:
    """Compiles at the first call, keeps the result on disk, and lets other threads run meanwhile.

    Divisions by zero give infinities as in numpy. The result is kept in ``__pycache__``, ``$NUMBA_CACHE_DIR``
    or in the user's cache folder; where none of them can be written, each start compiles anew.
    """
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    with contextlib.suppress(RuntimeError):
        # raised here, and not at the call, where there is no place for the cache
        return cast(_Function, numba.njit(cache=True, **options)(function))
    return cast(_Function, numba.njit(**options)(function))
