"""Convert values of a TOML text to sections (msgspec Structs), with every mistake and its path."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Iterator
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import msgspec

from mcserver.errors import ConfigurationError, Diagnostic
from mcserver.machine.toml_positions import Path, find_positions, position_of


class Mistakes:
    """Collects the mistakes of one machine file.

    Args:
        text: of the file, for lines and columns. source: its name.
    """

    def __init__(self, text: str, source: str) -> None:
        self._text = text
        self._source = source
        self._found: list[tuple[str, Path, str, str]] = []

    def add(self, path: Path, what: str, hint: str, code: str = "MC004") -> None:
        """Add a mistake; MC003: an unknown key or a wrong type, MC004: a wrong value."""
        self._found.append((code, path, what, hint))

    def raise_if_any(self) -> None:
        """Raise if there is any mistake.

        Raises:
            MachineFileRejected: with a diagnostic for each, in the order of the text.
        """
        if not self._found:
            return
        positions = find_positions(self._text)
        diagnostics = []
        for code, path, what, hint in self._found:
            place = position_of(positions, path)
            diagnostics.append(
                Diagnostic(
                    code=code,
                    message=f"{shown_path(path)}: {what}",
                    line=place.line if place else 0,
                    column=place.column if place else 0,
                    end_column=place.end_column if place else 0,
                    hint=hint,
                )
            )
        diagnostics.sort(key=lambda each: (each.line, each.column))
        raise MachineFileRejected(self._source, self._text, diagnostics)


class MachineFileRejected(ConfigurationError):
    """A machine file with mistakes: all in ``diagnostics``; code and hint are those of the first."""

    def __init__(self, source: str, text: str, diagnostics: Iterable[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        self.source = source
        self.lines = text.splitlines()
        shown = [f"{source}:{each.line}: {each.message}" for each in self.diagnostics]
        first = self.diagnostics[0]
        super().__init__(first.code, "\n".join(shown), first.hint)


def did_you_mean(written: str, known: Iterable[str], otherwise: str) -> str:
    """Return a hint that names the known value nearest to what was written, else ``otherwise``."""
    near = difflib.get_close_matches(written, list(known), n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}?" if near else otherwise


def shown_path(path: Path) -> str:
    """Return a path for people, such as ``axis[0].drive.kind``."""
    shown = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return shown.removeprefix(".") or "the file"


def read_section(value: object, kind: Any, path: Path, mistakes: Mistakes) -> Any:
    """Convert a value to the annotated type of its key; None if any part of it is wrong.

    Args:
        kind: a Struct, a union of Structs with one ``tag_field``, a list of these, or a type with msgspec's
            constraints, whose ``description`` is the hint.
    """
    if _optional(kind):
        kind = next(each for each in _alternatives(kind) if each is not type(None))
    if get_origin(kind) is list and _structs(get_args(kind)[0]):
        if not isinstance(value, list):
            mistakes.add(path, f"{_shown(value)} is not an array of tables", f"write [[{path[-1]}]]", "MC003")
            return None
        return [read_section(each, get_args(kind)[0], (*path, i), mistakes) for i, each in enumerate(value)]
    structs = _structs(kind)
    if not structs:
        return _read_leaf(value, kind, path, mistakes)
    if not isinstance(value, dict):
        mistakes.add(path, f"{_shown(value)} is not a table", f"write [{shown_path(path)}]", "MC003")
        return None
    return _read_table(value, structs, path, mistakes)


def _read_table(value: dict[str, Any], structs: tuple[Any, ...], path: Path, mistakes: Mistakes) -> Any:
    struct = structs[0]
    tag_field = struct.__struct_config__.tag_field
    if tag_field is not None:
        tags = {each.__struct_config__.tag: each for each in structs}
        tag = value.get(tag_field, struct.__struct_config__.tag)
        if tag not in tags:
            mistakes.add(
                (*path, tag_field),
                f"{_shown(tag)} is not one of {_listed(tags)}",
                _nearest(tag, tags),
                "MC003",
            )
            return None
        struct = tags[tag]
    known = read_keys(value, struct, path, mistakes, structs)
    faulty = any(each is None or (isinstance(each, list) and None in each) for each in known.values())
    return None if faulty else struct(**known)


def read_keys(
    value: dict[str, Any], struct: Any, path: Path, mistakes: Mistakes, kinds: tuple[Any, ...] = ()
) -> dict[str, Any]:
    """Convert the values of a table one by one.

    Args:
        struct: whose keys they are. kinds: the Structs of its union.

    Returns:
        By field name of the struct: the given value, or None if it is wrong or missing.
    """
    tag_field = struct.__struct_config__.tag_field
    agreed = getattr(struct, "agreed", ())  # fields without a key
    fields = {
        field.encode_name: field for field in msgspec.structs.fields(struct) if field.name not in agreed
    }
    for key in value:
        if key not in fields and key != tag_field:
            _refuse_key(key, struct, tuple(fields), kinds, path, mistakes)
    known: dict[str, Any] = {}
    for key, field in fields.items():
        if key in value:
            known[field.name] = read_section(value[key], field.type, (*path, key), mistakes)
        elif field.required:
            mistakes.add((*path, key), "is missing", f"add {key} = … here", "MC003")
            known[field.name] = None
    return known


def _refuse_key(
    key: str, struct: Any, known: tuple[str, ...], kinds: tuple[Any, ...], path: Path, mistakes: Mistakes
) -> None:
    owners = [each for each in kinds if key in each.__struct_encode_fields__]
    if owners and struct.other_kinds_keys_are_idle:
        return
    if owners:
        config = owners[0].__struct_config__
        own = " or ".join(f'"{each.__struct_config__.tag}"' for each in owners)
        mistakes.add(
            (*path, key), "does not belong to this kind", f"it belongs to {config.tag_field} = {own}"
        )
    else:
        mistakes.add((*path, key), "is no key here", _nearest(key, known), "MC003")


def _floats(value: object) -> Iterator[float]:
    """Yield the numbers in a value, including those in nested lists."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, list):
        for each in value:
            yield from _floats(each)


def _read_leaf(value: object, kind: Any, path: Path, mistakes: Mistakes) -> object:
    bare, hint = _unannotated(kind)
    for number in _floats(value):
        if not math.isfinite(number):
            hint = hint or "leave the key out where there is no limit"
            mistakes.add(path, f"{number} is not a finite number", hint)
            return None
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        reason = str(error).replace("`", "").replace("Expected", "expected", 1).replace(" - at $", " at ")
    choices = get_args(bare) if get_origin(bare) is Literal else ()
    if choices:
        mistakes.add(
            path, f"{_shown(value)} is not one of {_listed(choices)}", _nearest(value, choices), "MC003"
        )
        return None
    try:
        msgspec.convert(value, bare)
    except msgspec.ValidationError:
        mistakes.add(path, reason, hint or "compare it with the documentation", "MC003")
    else:
        why = "" if "regex" in reason else f": {reason}"
        mistakes.add(path, f"{_shown(value)} does not fit{why}", hint)
    return None


def _alternatives(kind: Any) -> tuple[Any, ...]:
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def _optional(kind: Any) -> bool:
    """Return whether the type is one type or None."""
    alternatives = _alternatives(kind)
    return len(alternatives) == 2 and type(None) in alternatives


def _structs(kind: Any) -> tuple[Any, ...]:
    alternatives = _alternatives(kind)
    fit = all(isinstance(each, type) and issubclass(each, msgspec.Struct) for each in alternatives)
    return alternatives if fit else ()


def _unannotated(kind: Any) -> tuple[Any, str]:
    """Return the type without its constraints, and its hint."""
    if get_origin(kind) is not Annotated:
        return kind, ""
    bare, *metas = get_args(kind)
    hints = [meta.description for meta in metas if isinstance(meta, msgspec.Meta) and meta.description]
    if get_origin(bare) in (list, tuple, dict):
        # constraints of a list's elements count too
        bare = get_origin(bare)
    return bare, hints[0] if hints else ""


def _shown(value: object) -> str:
    text = f'"{value}"' if isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}…"


def _listed(choices: Iterable[object]) -> str:
    return ", ".join(_shown(each) for each in choices)


def _nearest(written: object, known: Iterable[object]) -> str:
    names = [str(each) for each in known]
    return did_you_mean(str(written), names, f"known here: {', '.join(names)}")
