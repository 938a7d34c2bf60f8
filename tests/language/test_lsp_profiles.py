"""The language server of a machine with a profile, by bytes on its standard input and output alone."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from typing import Any, BinaryIO

import pytest
from mcbenchmark.families import machine_file

from mcserver.language.lsp.tokens import TOKEN_TYPES, Token, tokens_of

URI = "file:///p.nc"
PROGRAM = "G90 G94 F600\nG54\nG81 X5 Z-3 R2 (🙂 hole)\n"


class RawClient:
    """Frames of the base protocol, and nothing of a library."""

    def __init__(self, stdin: BinaryIO, stdout: BinaryIO) -> None:
        self._stdin, self._stdout = stdin, stdout
        self._number = 0

    def notify(self, method: str, params: object) -> None:
        self._send({"method": method, "params": params})

    def ask(self, method: str, params: object) -> Any:
        self._number += 1
        self._send({"id": self._number, "method": method, "params": params})
        while True:
            message = self.read()
            if message.get("id") == self._number and "method" not in message:
                assert "error" not in message, message
                return message["result"]

    def diagnostics(self) -> list[dict[str, Any]]:
        while (message := self.read()).get("method") != "textDocument/publishDiagnostics":
            pass
        return list(message["params"]["diagnostics"])

    def read(self) -> dict[str, Any]:
        size = 0
        while line := self._stdout.readline().strip():
            name, _, value = line.partition(b":")
            if name.lower() == b"content-length":
                size = int(value)
        return dict(json.loads(self._stdout.read(size)))

    def _send(self, message: dict[str, Any]) -> None:
        body = json.dumps({"jsonrpc": "2.0", **message}).encode()
        self._stdin.write(f"Content-Length: {len(body)}\r\n\r\n".encode() + body)
        self._stdin.flush()


@pytest.fixture(scope="module")
def client() -> Iterator[RawClient]:
    words = [sys.executable, "-m", "mcserver", "lsp", "--machine", machine_file("mill")]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        made = RawClient(process.stdin, process.stdout)  # type: ignore[arg-type]
        offered = made.ask("initialize", {"processId": None, "rootUri": None, "capabilities": {}})
        assert offered["capabilities"]["textDocumentSync"]["change"] == 2
        assert offered["capabilities"]["semanticTokensProvider"]["legend"]["tokenTypes"] == list(TOKEN_TYPES)
        made.notify("initialized", {})
        document = {"uri": URI, "languageId": "gcode", "version": 1, "text": PROGRAM}
        made.notify("textDocument/didOpen", {"textDocument": document})
        yield made
        made.ask("shutdown", None)
        made.notify("exit", None)
        assert process.wait(60) == 0


def test_an_editor_of_a_mill_is_served_by_bytes(client: RawClient) -> None:
    at = {"textDocument": {"uri": URI}}
    assert [each["severity"] for each in client.diagnostics() if each["severity"] == 1] == []
    shown = client.ask("textDocument/hover", {**at, "position": {"line": 1, "character": 2}})
    assert "**G54** acts in the profile cnc" in shown["contents"]["value"]
    assert "D-62" in shown["contents"]["value"]
    offered = client.ask("textDocument/completion", {**at, "position": {"line": 2, "character": 2}})
    labels = {each["label"]: each for each in offered["items"]}
    assert {"G80", "G81", "G82", "G83", "G85", "G89"} <= set(labels)
    assert labels["G81"]["detail"] == "Canned cycles"
    # a part of a line is replaced
    change = {
        "range": {"start": {"line": 0, "character": 0}, "end": {"line": 0, "character": 3}},
        "text": "GO1",
    }
    client.notify(
        "textDocument/didChange", {"textDocument": {"uri": URI, "version": 2}, "contentChanges": [change]}
    )
    (fault,) = [each for each in client.diagnostics() if each["code"] == "MC101"]
    actions = client.ask(
        "textDocument/codeAction", {**at, "range": fault["range"], "context": {"diagnostics": [fault]}}
    )
    (edit,) = actions[0]["edit"]["changes"][URI]
    assert (actions[0]["kind"], edit["newText"]) == ("quickfix", "01")
    assert edit["range"]["start"] == {"line": 0, "character": 1}
    tokens = client.ask("textDocument/semanticTokens/full", at)["data"]
    assert len(tokens) % 5 == 0
    # the comment of line 3, in units of UTF-16: the face counts twice
    assert tokens[-5:][2:4] == [len("(🙂 hole)") + 1, TOKEN_TYPES.index("comment")]


@pytest.mark.parametrize(
    ("line", "kinds"),
    [
        ("G01 X-1.5", ["keyword", "parameter", "number"]),
        ("g10 [6]90 ; G1", ["keyword", "parameter", "number", "comment"]),
        ("O100 sub", ["function"]),
        ("#5=[#<_x>+1]", ["variable", "variable", "number"]),
        ("% title G1", ["comment"]),
        ("", []),
        ("(open", ["comment"]),
    ],
)
def test_tokens_are_codes_words_numbers_parameters_and_comments(line: str, kinds: list[str]) -> None:
    found = list(tokens_of(line))
    assert [each.kind for each in found] == kinds
    assert all(each.start < each.end <= len(line) for each in found)


def test_tokens_have_their_columns() -> None:
    assert list(tokens_of("G1 X5")) == [
        Token("keyword", 0, 2),
        Token("parameter", 3, 4),
        Token("number", 4, 5),
    ]
