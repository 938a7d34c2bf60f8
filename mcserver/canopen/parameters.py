"""A drive's parameters as its EDS names them: listed, searched, found by name or number, values from text."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from typing import cast

from canopen.objectdictionary import ODVariable

from mcserver.canopen.canopen_errors import object_text
from mcserver.canopen.dictionary import DeviceDictionary
from mcserver.canopen.settings import AXIS_OFFSET
from mcserver.canopen.values import Value, encode_value, type_name
from mcserver.canopen.views import ParameterInfo, SdoType
from mcserver.errors import UsageFault

_NUMBER = re.compile(r"(?:0x)?([0-9a-f]{4})h?(?:[:.](?:0x)?([0-9a-f]{1,2})h?)?", re.I)
MOST_NEAR = 5


class Parameter(ParameterInfo, frozen=True):
    """One object of a drive."""

    @property
    def place(self) -> tuple[int, int]:
        return self.index, self.subindex

    @property
    def readable(self) -> bool:
        return self.access != "wo"

    @property
    def writable(self) -> bool:
        return self.access in ("wo", "rw", "rwr", "rww")

    @property
    def title(self) -> str:
        """For messages: ``6065h:00 Following error window``."""
        return f"{object_text(*self.place)} {self.name}"


def parameters_of(dictionary: DeviceDictionary, node_axis: int = 0) -> list[Parameter]:
    """Every object of one axis of a node, by number: the node's own, and of 6000h … 9FFFh the axis's 800h.

    Args:
        dictionary: of the EDS. node_axis: which axis of the node.
    """
    own = range(0x6000 + AXIS_OFFSET * node_axis, 0x6000 + AXIS_OFFSET * (node_axis + 1))
    return [
        parameter_of(each)
        for each in dictionary.variables
        if each.index >= 0x1000 and (each.index in own or not 0x6000 <= each.index < 0xA000)
    ]


def parameter_of(variable: ODVariable) -> Parameter:
    """Return an object of an EDS as a parameter."""
    return Parameter(
        variable.index,
        variable.subindex,
        " ".join(variable.qualname.split()),
        cast(SdoType, type_name(variable.data_type)),
        variable.access_type,
        variable.min,
        variable.max,
    )


def search(parameters: Sequence[Parameter], words: Sequence[str]) -> list[Parameter]:
    """Return the parameters whose number, name, type or access contain every word, in any case."""
    wanted = [word.lower() for word in words]
    return [
        each
        for each in parameters
        if all(word in f"{each.title} {each.type} {each.access}".lower() for word in wanted)
    ]


def find(parameters: Sequence[Parameter], dictionary: DeviceDictionary, text: str) -> Parameter:
    """The one parameter that a text names: 6065, 6091h:01, 0x6091:1, or its name; a part of one is none.

    Raises:
        UsageFault: MC559 nothing or several are named so; the nearest names stand in the remedy.
        ConfigurationError: MC008 the EDS has the object in a form that cannot be read.
    """
    plain = " ".join(text.split()).lower()
    # names first: "feed" is a number too
    found = [each for each in parameters if each.name.lower() == plain]
    found = found or [each for each in parameters if each.name.rpartition(".")[2].lower() == plain]
    near = found or search(parameters, plain.split())
    number = _NUMBER.fullmatch(plain)
    if number is not None and not found:
        place = int(number[1], 16), int(number[2] or "0", 16)
        if place in dictionary.unreadable:
            raise dictionary.unreadable[place]
        found = [each for each in parameters if each.place == place]
        near = near or [each for each in parameters if each.index == place[0]]
    if len(found) == 1:
        return found[0]
    names = {each.name.lower(): each for each in parameters}
    near = near or [names[name] for name in difflib.get_close_matches(plain, names, MOST_NEAR)]
    shown = ", ".join(each.title for each in near[:MOST_NEAR])
    more = f", and {len(near) - MOST_NEAR} more" if len(near) > MOST_NEAR else ""
    what = "more than one parameter is" if found else "no parameter of this drive is"
    raise UsageFault(
        "MC559",
        f"{what} named {text!r}",
        f"there is {shown}{more}" if shown else "`mcserver drives search AXIS WORDS` looks for one",
    )


def encode(parameter: Parameter, value: Value) -> bytes:
    """Return the bytes of a value that may be written, by the EDS's type, access and limits.

    Raises:
        UsageFault: MC559 it is not to be written, or the value is none of its type or outside its limits.
    """
    if not parameter.writable:
        raise UsageFault(
            "MC559", f"{parameter.title} is {parameter.access}", "only rw and wo parameters are written"
        )
    try:
        raw = encode_value(parameter.type, value)
    except (ValueError, OverflowError) as error:
        raise UsageFault(
            "MC559", f"{parameter.title}: {value!r} is no {parameter.type}: {error}", "give another value"
        ) from error
    if not raw:
        raise UsageFault("MC559", f"{parameter.title}: an empty value cannot be written", "give a value")
    # an EDS that gives both limits as 0 gives none
    if (parameter.low, parameter.high) != (0, 0) and not parameter.type.startswith(("bool", "f")):
        number = int.from_bytes(raw, "little", signed=parameter.type.startswith("i"))
        below = parameter.low is not None and number < parameter.low
        if below or (parameter.high is not None and number > parameter.high):
            raise UsageFault(
                "MC559",
                f"{parameter.title}: {number} is outside {_limits(parameter)} of the EDS",
                "give a value within; where the EDS is wrong, correct it there",
            )
    return raw


def _limits(parameter: Parameter) -> str:
    low, high = ("…" if limit is None else str(limit) for limit in (parameter.low, parameter.high))
    return f"{low} to {high}"
