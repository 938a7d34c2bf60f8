"""Serialize the machine code of a compiled kernel, and load it again in another process.

numba's own loading imports its whole library of typed functions, BLAS with scipy, and parses the intermediate
code of each kernel, which only a compiler needs: four fifths of the time of reading the cache. Here loading a
kernel reads its object code only; the rest is read when another kernel that calls it is compiled.
"""

from __future__ import annotations

import io
import pickle
from functools import partial
from typing import Any

import llvmlite.binding as llvm
from numba.core.compiler import CompileResult
from numba.core.environment import Environment, _rebuild_env, lookup_environment
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps


def pack(result: Any) -> bytes:
    """Return a compile result as bytes."""
    (name, _, (code, bitcode)), *rest = result._reduce()
    module = llvm.parse_bitcode(bitcode)
    symbols = [
        each.name
        for group in (module.functions, module.global_variables)
        for each in group
        if not each.is_declaration
    ]
    return bytes(dumps((name, code, bitcode, symbols, rest)))


def unpack(content: bytes, target: Any) -> Any:
    """Return the compile result from `pack`'s bytes, with its code in the ``target`` context's engine.

    Raises:
        Exception: of any kind, where the bytes are something else.
    """
    # numba's runtime for memory and references; only compiling needs the rest of the target
    rtsys.initialize(target)
    name, code, bitcode, symbols, rest = _Unpickler(io.BytesIO(content)).load()
    library = target.codegen().create_library(name)
    library.enable_object_caching()
    library._set_compiled_object(code)
    library._finalize_final_module()
    library._codegen._engine._defined_symbols.update(symbols)
    library._get_module_for_linking = partial(_module_for_linking, library, bitcode)
    description, environment, signature, objectmode, lifted, annotation, reload_init, referenced = rest
    for each in reload_init:
        each()
    entry = target.get_executable(library, description, environment)
    for each in referenced:
        library.codegen.set_env(each.env_name, each)
    # numba lists its fields at run time, where type checkers do not see them
    make: Any = CompileResult
    return make(
        target_context=target,
        typing_context=target.typing_context,
        library=library,
        environment=environment,
        entry_point=entry,
        fndesc=description,
        type_annotation=annotation,
        signature=signature,
        objectmode=objectmode,
        lifted=lifted,
        typing_error=None,
        call_helper=None,
        metadata=None,
        reload_init=reload_init,
        referenced_envs=referenced,
    )


def _module_for_linking(library: Any, bitcode: bytes) -> Any:
    """Return a kernel's intermediate code, for compiling a kernel that calls it."""
    if library._shared_module is None:
        library._shared_module = llvm.parse_bitcode(bitcode)
    return library._shared_module


def _environment(module: str, constants: list[Any], name: str) -> Any:
    """Return the constants that a function's machine code reads.

    numba would import the function's module for its globals, which machine code never reads; importing those
    of numba's own library takes longer than loading all kernels.
    """
    if not module.startswith("numba."):
        return _rebuild_env(module, constants, name)
    environment = lookup_environment(name)
    if environment is None:
        environment = Environment({"__name__": module})
        environment.consts[:] = constants
        environment.env_name = name
        Environment._memo[name] = environment
    return environment


class _Unpickler(pickle.Unpickler):
    """Unpickle a compile result without importing the modules of numba's library."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == (_rebuild_env.__module__, _rebuild_env.__name__):
            return _environment
        return super().find_class(module, name)
