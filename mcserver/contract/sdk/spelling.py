"""How a language writes types and values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from mcserver.contract.sdk.model import Field, ListOf, MapOf, Maybe, NamedType, Scalar, Type


@dataclass(frozen=True)
class Spelling:
    """Types and default values in a language; ``{}`` stands for what is inside.

    Attributes:
        scalars: by the name of a `Scalar`. boxed: those that are written otherwise inside of another type.
        named: a message or words. message: a message, where it is written otherwise than words.
        renamed: names that are others there.
        nothing, empty_list, empty_map, text, empty_text, number: values. flags: false and true.
        word: one of the words of a type, by that type's name.
    """

    scalars: Mapping[str, str]
    list_of: str
    map_of: str
    maybe: str
    boxed: Mapping[str, str] = field(default_factory=dict)
    named: str = "{}"
    message: str = ""
    renamed: Mapping[str, str] = field(default_factory=dict)
    nothing: str = "null"
    empty_list: str = ""
    empty_map: str = ""
    text: str = '"{}"'
    empty_text: str = '""'
    number: str = "{}"
    flags: tuple[str, str] = ("false", "true")
    word: Callable[[str, str], str] = "{}.{}".format

    def type(self, kind: Type, *, inside: bool = False) -> str:
        """Return a type as the language writes it."""
        match kind:
            case Scalar(name):
                return (inside and self.boxed.get(name)) or self.scalars[name]
            case NamedType(name, words):
                return ((not words and self.message) or self.named).format(self.name(name))
            case ListOf(inner):
                return self.list_of.format(self.type(inner, inside=True))
            case MapOf(inner):
                return self.map_of.format(self.type(inner, inside=True))
            case Maybe(inner):
                return self.maybe.format(self.type(inner, inside=True))

    def name(self, name: str) -> str:
        """Return a name of the wire as it is called in the language."""
        return self.renamed.get(name, name)

    def default(self, of: Field) -> str:
        """Return the value of a field that is left out."""
        match of.type, of.default:
            case Maybe(), _:
                return self.nothing
            case ListOf(), _:
                return self.empty_list
            case MapOf(), _:
                return self.empty_map
            case NamedType(name, words=True), str(word):
                return self.word(name, word)
            case _, bool(flag):
                return self.flags[flag]
            case _, str(text):
                return self.text.format(text) if text else self.empty_text
            case _, value:
                return self.number.format(value)
