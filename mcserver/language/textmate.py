"""Write the TextMate grammar of the dialect, for editors that colour by it.

``python -m mcserver.language.textmate editors/vscode/syntaxes/gcode.tmLanguage.json`` renews the file.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path

from mcserver.gcode.text.command_table import COMMANDS, Kind

_SCOPES = {
    Kind.MOVE: "keyword.control.motion.gcode",
    Kind.DIRECT: "keyword.control.motion.gcode",
    Kind.DWELL: "keyword.control.motion.gcode",
    Kind.AXIS: "support.function.axis.gcode",
    Kind.SETTING: "storage.modifier.modal.gcode",
    Kind.PROGRAM: "keyword.control.program.gcode",
}
_NUMBER = r"[ \t]*[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"


def textmate_grammar() -> str:
    """Write the grammar as JSON, with a line end."""
    codes = [
        {"name": scope, "match": _codes(spec.name for spec in COMMANDS if _SCOPES.get(spec.kind) == scope)}
        for scope in dict.fromkeys(_SCOPES.values())
    ]
    patterns = [
        {"name": "comment.line.semicolon.gcode", "match": ";.*$"},
        {"name": "comment.block.gcode", "match": r"\([^)]*\)?"},
        {"name": "comment.line.percentage.gcode", "match": r"^[ \t]*%.*$"},
        {"name": "constant.other.line-number.gcode", "match": rf"^[ \t]*[Nn]{_NUMBER}"},
        *codes,
        {"name": "invalid.illegal.code.gcode", "match": rf"[GgMm]{_NUMBER}"},
        _word(r"\[[ \t]*[0-9]{1,3}[ \t]*\]|[XYZABCUVWxyzabcuvw]", "variable.parameter.axis.gcode"),
        _word("[IJKRPijkrp]", "variable.parameter.gcode"),
        _word("[FTft]", "entity.name.tag.gcode"),
        {"name": "punctuation.separator.group.gcode", "match": ","},
    ]
    grammar = {"name": "G-code", "scopeName": "source.gcode", "patterns": patterns}
    return json.dumps(grammar, indent=2) + "\n"


def _codes(names: Iterable[str]) -> str:
    """Write a pattern for codes, with any leading zeros; longer numbers first."""
    numbers: dict[str, list[str]] = {}
    for name in names:
        numbers.setdefault(name[0], []).append(str(int(name[1:])))
    alternatives = [
        f"[{letter}{letter.lower()}][ \\t]*0*(?:{'|'.join(sorted(found, key=len, reverse=True))})"
        for letter, found in numbers.items()
    ]
    return f"(?:{'|'.join(alternatives)})(?![0-9.])"


def _word(names: str, scope: str) -> dict[str, object]:
    return {
        "match": f"({names})({_NUMBER})",
        "captures": {"1": {"name": scope}, "2": {"name": "constant.numeric.gcode"}},
    }


if __name__ == "__main__":
    for name in sys.argv[1:]:
        Path(name).write_text(textmate_grammar(), "utf-8")
