"""The on-disk cache of kernels' machine code.

numba's own cache checks the file of a function, not the functions that it calls (numba #1833), and two
processes that save two signatures of one function at once may swap them. Here a file's name is a digest of
everything that its content depends on, so it is never out of date.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import platform
from collections.abc import Callable
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core import sigutils

from mcserver.motion.kernels.cache_folder import read, write
from mcserver.motion.kernels.function_digest import function_digest
from mcserver.motion.kernels.kept_code import pack, unpack

log = logging.getLogger(__name__)

# Version of the format; it is part of the digest.
FORMAT = "4"
# Settings of numba that change the code that it makes.
_SETTINGS = ("OPT", "BOUNDSCHECK", "DEBUGINFO_DEFAULT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "ENABLE_AVX")


class KernelCache:
    """The cache of one kernel, for all of its signatures; has the interface of numba's caches."""

    cache_path = None

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @functools.cached_property
    def _digest(self) -> str:
        """Return the digest, computed at the first call, when all kernels that it calls are defined."""
        settings = [str(getattr(numba.config, each, None)) for each in _SETTINGS]
        versions = [platform.python_implementation(), platform.python_version(), numba.__version__]
        versions += [llvmlite.__version__, np.__version__]
        parts = [FORMAT, function_digest(self._function), *versions, *settings]
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()

    def _name(self, signature: Any, codegen: Any) -> str:
        arguments, returned = sigutils.normalize_signature(signature)
        # the processor and its features
        parts = [self._digest, repr(codegen.magic_tuple()), str(returned), *(str(each) for each in arguments)]
        digest = hashlib.sha256("\0".join(parts).encode()).hexdigest()
        return f"{self._function.__name__.strip('<>')}-{digest[:40]}"

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return the compile result for a signature; None: it has to be compiled."""
        content = read(self._name(signature, target.codegen()))
        if content is None:
            return None
        try:
            return unpack(content, target)
        except Exception as error:
            # whatever the error is, compiling still works
            log.debug("%s: kept machine code cannot be read: %s", self._function.__name__, error)
            return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Store a compile result, if numba can serialize it."""
        if result.library.has_dynamic_globals or any(not each.can_cache for each in result.lifted):
            return
        write(self._name(signature, result.codegen), pack(result))

    def enable(self) -> None:
        """Do nothing: the cache is always on."""

    def disable(self) -> None:
        """Do nothing: names are digests, so what is kept is right."""

    def flush(self) -> None:
        """Do nothing: names are digests, so what is kept is right."""
