"""What the server and its Python client say with each code, read from their sources: so no code is without
a word.
"""

from __future__ import annotations

import ast
import functools
import re
from collections.abc import Iterable, Iterator
from importlib import resources
from importlib.resources.abc import Traversable

# Messages of one code that are told.
MOST_MESSAGES = 5
_CODE = re.compile(r"MC[0-9]{3}( / MC[0-9]{3})*\Z")
# codes whose messages the sources put together from parts
WORDED = {
    "MC004": ("a value of the machine file is out of its range, or values contradict each other", ""),
    "MC008": ("an EDS, DCF or ESI file of a drive cannot be understood", "get it from the maker"),
    "MC030": ("the homing of an axis in the machine file does not fit", "see homing"),
    "MC064": ("others would reach the page without login or TLS", "give --users, --certificate and --key"),
    "MC191": ("a twist or joint command of ROS 2 does not fit", "its finite numbers, frame and names"),
    "MC300": ("inverse kinematics failed", "see its message"),
    "MC301": (
        "the URDF or a tool of the machine file does not fit",
        "correct the file that the message names",
    ),
    "MC302": ("a point is out of the tool's reach", "move the path nearer"),
    "MC303": ("a joint would pass its limit on the way", "choose another pose or path"),
    "MC304": ("a path is singular: the chain loses a direction there", "keep off that point"),
    "MC305": ("no continuous joint path exists", "start from the other configuration, or use G00"),
    "MC320": ("two bodies come nearer to each other than the margin", "take another way"),
    "MC321": ("a body enters a zone, or leaves the one it stays in", "take another way"),
    "MC322": ("a body is too fast in a slow zone", "a lower F, and G01 instead of G00 there"),
    "MC330": (
        "an assertion does not hold in the simulated run",
        "change the program, or what is asked of it",
    ),
    "MC524": ("the disk under the journal is slow", "see `disk` of the status"),
    "MC525": ("a malformed message made a session of the server deaf; programs are held", "resume them"),
    "MC527": ("the journal was damaged, and the programs in it were set aside", "look at the machine first"),
    "MC528": ("another server of this name is on the network", "stop one of them"),
    "MC534": ("the server was started anew, and the client does not go on by itself", "continue_program"),
    "MC535": ("the connection was interrupted while a line was sent", "see the program's status"),
    "MC536": ("the client's program has ended on the server", "see the program's status"),
    "MC542": ("an address is not HOST:PORT", "give HOST:PORT"),
    "MC556": ("a drive sent an emergency message", "see the drive's manual for its code"),
    "MC558": ("a drive has started anew by itself", "look after its supply"),
    "MC563": ("a certificate of the server's Zenoh configuration ends soon", "renew it"),
    "MC564": ("the computer's clock was set", "times of later events are by the new one"),
    "MC603": ("a tool's life is used up; its next change waits for that", "have a new one ready"),
    "MC582": ("a recording cannot be written", "make room on the disk of the recordings"),
    "MC583": ("cycles are missing in a recording: the disk was too slow", "record to a faster disk"),
}


def messages_of(code: str) -> list[tuple[str, str]]:
    """Return messages and remedies of a code as the server words them, with ``…`` for values."""
    if code in WORDED:
        return [WORDED[code]]
    told = (each for text in _texts() if f'"{code}' in text for each in _messages_in(text))
    found = dict.fromkeys((message, hint) for one, message, hint in told if one == code and message)
    return list(found)[:MOST_MESSAGES]


@functools.cache
def _texts() -> tuple[str, ...]:
    """Return the text of every source."""
    packages = (resources.files("mcserver"), resources.files("mcclient"))
    return tuple(source.read_text("utf-8") for package in packages for source in _sources(package))


def _sources(folder: Traversable) -> Iterator[Traversable]:
    for each in sorted(folder.iterdir(), key=lambda one: one.name):
        if each.is_dir():
            yield from _sources(each)
        elif each.name.endswith(".py"):
            yield each


@functools.cache
def _messages_in(text: str) -> tuple[tuple[str, str, str], ...]:
    """Return codes with message and remedy of a source."""
    return tuple(each for node in ast.walk(ast.parse(text)) for each in _told_by(node))


def _told_by(node: ast.AST) -> Iterator[tuple[str, str, str]]:
    if isinstance(node, ast.Constant | ast.JoinedStr):
        # as logs have it
        code, _, message = _text(node).partition(": ")
        if _CODE.match(code):
            yield code, message.replace("%s", "…").replace("%d", "…"), ""
    elif isinstance(node, ast.Call):
        named = {each.arg: each.value for each in node.keywords}
        words = [each for each in (*node.args, *named.values()) if not isinstance(each, ast.Starred)]
        others = _worded(words)
        hint = _text(named["hint"]) if "hint" in named else "; ".join(others[1:2])
        for code in _codes(words):
            yield code, "; ".join(others[:1]), hint
    elif isinstance(node, ast.Tuple | ast.List):
        others = _worded(node.elts)
        for code in _codes(node.elts) if others else ():
            yield code, others[0], "; ".join(others[1:2])
    elif isinstance(node, ast.Dict):
        for key, value in zip(node.keys, node.values, strict=True):
            for code in _codes([key]):
                yield code, _text(value), ""


def _worded(nodes: Iterable[ast.expr]) -> list[str]:
    return [text for each in nodes if " " in (text := _text(each)) and not _CODE.match(text)]


def _codes(nodes: Iterable[ast.expr | None]) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.IfExp):
            yield from _codes([node.body, node.orelse])
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and _CODE.match(node.value):
            yield node.value


def _text(node: ast.expr) -> str:
    """Return the words of a text with values left open; empty for what is none."""
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=parts):
            return "".join(_text(part) or "…" for part in parts)
        case ast.BinOp(left=left, right=right):
            return f"{_text(left) or '…'}{_text(right) or '…'}" if _text(left) or _text(right) else ""
        case ast.Call(func=ast.Name(id="mark"), args=[text, *_]):
            # a text of the page's catalogues
            return _text(text)
        case ast.IfExp(body=body, orelse=other):
            return " / ".join(each for each in (_text(body), _text(other)) if each)
    return ""
