"""How kernels are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

_Function = TypeVar("_Function", bound=Callable[..., Any])


def compiled(function: _Function) -> _Function:
    """Compiles at the first call, keeps the result in ``__pycache__``, and lets other threads run meanwhile.

    Divisions by zero give infinities as in numpy.
    """
    return cast(_Function, numba.njit(cache=True, nogil=True, error_model="numpy")(function))
