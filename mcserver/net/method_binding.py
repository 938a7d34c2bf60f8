"""Bind the methods of the table to their handlers, by name."""

from __future__ import annotations

import inspect
from collections.abc import Iterable

from mcserver.net.method_table import METHODS, Method
from mcserver.net.rpc import Handler


def bound_handlers(objects: Iterable[object], methods: Iterable[Method] = METHODS) -> dict[str, Handler]:
    """Find each method's handler among the public functions of some objects; in the order of the table.

    Args:
        objects: whose public functions have names of methods, and take a client's id and a request.
        methods: all need a handler.

    Raises:
        TypeError: a method has no handler, or two, or a public function is not a method.
    """
    found: dict[str, Handler] = {}
    for each in objects:
        for name, _ in inspect.getmembers(type(each), inspect.isfunction):
            if name.startswith("_"):
                continue
            if name in found:
                raise TypeError(f"the method {name} has two handlers")
            found[name] = getattr(each, name)
    named = {method.name for method in methods}
    if found.keys() != named:
        raise TypeError(
            f"without handler: {sorted(named - found.keys())}, "
            f"no method of the table: {sorted(found.keys() - named)}"
        )
    return {method.name: found[method.name] for method in methods}
