"""Values of the client's types with the fields that matter to a test; the others are empty."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

import mcclient.types

T = TypeVar("T")
EMPTY = {"str": "", "int": 0, "float": 0.0, "bool": False, "bytes": b""}


def wire_value(kind: type[T], *values: Any, **fields: Any) -> T:
    """Return a message; ``values`` are its first fields."""
    described = dataclasses.fields(kind)  # type: ignore[arg-type]
    given = {**{field.name: value for field, value in zip(described, values, strict=False)}, **fields}
    for field in described:
        left_out = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if field.name not in given and left_out:
            given[field.name] = _empty(str(field.type))
    return kind(**given)


def _empty(annotation: str) -> Any:
    if annotation.startswith("tuple["):
        return ()
    if annotation.startswith("dict["):
        return {}
    if annotation in EMPTY:
        return EMPTY[annotation]
    kind = getattr(mcclient.types, annotation)
    return wire_value(kind) if dataclasses.is_dataclass(kind) else next(iter(kind))
