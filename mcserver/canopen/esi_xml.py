"""The XML of ESI files (EtherCAT Slave Information, ETG.2000), from whoever wrote it.

A document type is refused, and with it every entity of a file's own: none can be expanded or fetched.
"""

from __future__ import annotations

from xml.etree.ElementTree import Element, ParseError, TreeBuilder, XMLParser

from mcserver.canopen.eds_text import fault
from mcserver.errors import ConfigurationError

# A real one of a maker's whole series has some hundred thousand.
MAX_ELEMENTS = 1_000_000
_CHUNK = 64 * 1024
_MARKS = (b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff")


class _Refused(ValueError):
    """What an ESI file must not have."""


class _Builder(TreeBuilder):
    """A tree without name spaces and without a document type."""

    def __init__(self) -> None:
        super().__init__()
        self._count = 0

    def start(self, tag: str, attrs: dict[str, str], /) -> Element:
        self._count += 1
        if self._count > MAX_ELEMENTS:
            raise _Refused(f"has more than {MAX_ELEMENTS} elements")
        return super().start(tag.rpartition("}")[2], attrs)

    def end(self, tag: str, /) -> Element:
        return super().end(tag.rpartition("}")[2])

    def doctype(self, *_: object) -> None:
        raise _Refused("has a document type (<!DOCTYPE>), which could hide entities")


def is_xml(raw: bytes) -> bool:
    """Return whether a file's bytes begin as XML does, in UTF-8 or UTF-16; an EDS file begins with a
    section.
    """
    for mark in _MARKS:
        raw = raw.removeprefix(mark)
    return raw[:64].replace(b"\x00", b"").lstrip()[:1] == b"<"


def esi_root(raw: bytes, source: str) -> Element:
    """Return the root, ``EtherCATInfo``.

    Raises:
        ConfigurationError: MC008 it is no XML, another kind of it, or has what an ESI file must not have.
    """
    parser = XMLParser(target=_Builder())
    try:
        for at in range(0, len(raw), _CHUNK):
            parser.feed(raw[at : at + _CHUNK])
        root: Element = parser.close()
    except (_Refused, ParseError, LookupError, ValueError) as error:
        what = str(error) if isinstance(error, _Refused) else f"is no XML that can be read: {error}"
        raise _fault(source, what) from error
    if root.tag != "EtherCATInfo":
        raise _fault(source, f"is XML of another kind: <{root.tag[:40]}>, not <EtherCATInfo>")
    return root


def _fault(source: str, what: str) -> ConfigurationError:
    return fault(source, "", "", what, "give the drive's ESI file as the maker publishes it")
