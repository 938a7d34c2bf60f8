"""Binds the methods of the table to the functions that carry them out, by name."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from typing import Any

from mcserver.net.method_table import METHODS
from mcserver.net.method_table import Method as Described
from mcserver.net.rpc import Method


def bound_methods(handlers: Iterable[object], methods: Iterable[Described] = METHODS) -> dict[str, Method]:
    """Find each method's handler among the public functions of some objects.

    Args:
        handlers: their public functions take a client's id and a request, and are named as the methods.
        methods: those that have to be there.

    Raises:
        TypeError: a method without handler, with two, or a public function that is no method.
    """
    found: dict[str, Callable[[str, Any], Any]] = {}
    for each in handlers:
        for name, _ in inspect.getmembers(type(each), inspect.isfunction):
            if name.startswith("_"):
                continue
            if name in found:
                raise TypeError(f"the method {name} has two handlers")
            found[name] = getattr(each, name)
    described = {method.name: method for method in methods}
    if found.keys() != described.keys():
        raise TypeError(
            f"without handler: {sorted(described.keys() - found.keys())}, "
            f"no method of the table: {sorted(found.keys() - described.keys())}"
        )
    return {name: Method(method.request, found[name], method.changes) for name, method in described.items()}
