"""The decorator that compiles kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from mcserver.motion.compiling import plain_kernels

_Function = TypeVar("_Function", bound=Callable[..., Any])


def compiled(function: _Function) -> _Function:
    """Compile at the first call, cache the machine code on disk, and release the interpreter's lock.

    Divisions by zero give infinities as in numpy. A kernel whose name begins with an underscore can be called
    from other kernels only: an entry from Python would take a quarter of the time to compile.
    `mcserver.motion.kernels.kernel_cache` says where and under which key the code is stored.
    """
    if plain_kernels():
        return function
    import numba

    from mcserver.motion.kernels.kernel_cache import KernelCache

    options: dict[str, Any] = {
        "nogil": True,
        "error_model": "numpy",
        "no_cfunc_wrapper": True,
        "no_cpython_wrapper": function.__name__.startswith("_"),
    }
    dispatcher: Any = numba.njit(**options)(function)
    # njit(cache=True) would set numba's own cache here
    dispatcher._cache = KernelCache(function)
    return cast(_Function, dispatcher)
