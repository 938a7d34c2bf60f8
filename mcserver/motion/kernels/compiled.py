"""How kernels are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from mcserver.motion.compiling import plain_kernels

_Function = TypeVar("_Function", bound=Callable[..., Any])


def compiled(function: _Function) -> _Function:
    """Compile at the first call, keep the machine code on disk, and let other threads run meanwhile.

    Divisions by zero give infinities as in numpy. A kernel whose name begins with an underscore can be called
    from other kernels only: it has no entry from Python, which takes a quarter of the time to compile.
    Where and under which key the code is kept: `mcserver.motion.kernels.kernel_cache`.
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
    # what njit(cache=True) sets, with numba's own cache
    dispatcher._cache = KernelCache(function)
    return cast(_Function, dispatcher)
