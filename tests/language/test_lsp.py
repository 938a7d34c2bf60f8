"""The language server, asked by the client of pygls."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_asyncio
from lsprotocol import types as lsp
from pygls.lsp.client import LanguageClient

PROGRAM = "G94 F6000\nG01 X100 ; 🙂\nGO1 X1\n"
# one server for all tests: each start of it takes two seconds of a core
pytestmark = pytest.mark.asyncio(loop_scope="module")


class Editor(LanguageClient):
    """A client with one file open, that keeps the diagnostics it is sent.

    Attributes:
        uri: of the file, another one in each test. said: messages to whoever edits.
    """

    def __init__(self) -> None:
        super().__init__("tests", "1")
        self.uri = ""
        self.said: asyncio.Queue[str] = asyncio.Queue()
        self.published: asyncio.Queue[lsp.PublishDiagnosticsParams] = asyncio.Queue()

        @self.feature(lsp.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        def take(params: lsp.PublishDiagnosticsParams) -> None:
            self.published.put_nowait(params)

        @self.feature(lsp.WINDOW_SHOW_MESSAGE)
        def show(params: lsp.ShowMessageParams) -> None:
            self.said.put_nowait(params.message)

    def open(self, text: str) -> None:
        self.text_document_did_open(
            lsp.DidOpenTextDocumentParams(lsp.TextDocumentItem(self.uri, "gcode", 1, text))
        )

    def change(self, text: str, version: int) -> None:
        self.text_document_did_change(
            lsp.DidChangeTextDocumentParams(
                lsp.VersionedTextDocumentIdentifier(version, self.uri),
                [lsp.TextDocumentContentChangeWholeDocument(text)],
            )
        )

    async def diagnostics(self) -> list[lsp.Diagnostic]:
        """The next ones of the file that is open, not late ones of another."""
        async with asyncio.timeout(250):
            while (published := await self.published.get()).uri != self.uri:
                pass
        return list(published.diagnostics)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def client() -> AsyncIterator[Editor]:
    client = Editor()
    await client.start_io(sys.executable, "-m", "mcserver", "lsp")
    await client.initialize_async(lsp.InitializeParams(capabilities=lsp.ClientCapabilities()))
    client.initialized(lsp.InitializedParams())
    yield client
    await client.shutdown_async(None)
    client.exit(None)
    await client.stop()


@pytest.fixture
def editor(client: Editor, tmp_path: Path) -> Editor:
    client.uri = (tmp_path / "p.gcode").as_uri()
    return client


def here(line: int, character: int) -> lsp.Position:
    return lsp.Position(line, character)


async def drawn(editor: Editor) -> str | None:
    page = await editor.workspace_execute_command_async(
        lsp.ExecuteCommandParams("mcserver.draw", [editor.uri])
    )
    assert page is None or isinstance(page, str)
    return page


@pytest.mark.timeout(300)
async def test_the_lens_draws_the_text_of_the_editor_and_says_why_it_cannot(editor: Editor) -> None:
    editor.open("G1010\nG94 F6000\nG01 X12.5\n")
    lenses = await editor.text_document_code_lens_async(
        lsp.CodeLensParams(lsp.TextDocumentIdentifier(editor.uri))
    )
    assert lenses is not None
    assert lenses[0].command is not None
    assert lenses[0].command.command == "mcserver.draw"
    assert list(lenses[0].command.arguments or ()) == [editor.uri]
    page = await drawn(editor)
    assert page is not None
    assert (await editor.said.get()).startswith("drawn: file:///")
    assert "G01 X12.5" in Path(page.removeprefix("file://")).read_text("utf-8")
    editor.change("GO1 X1\n", 2)
    assert await drawn(editor) is None
    assert "MC101" in await editor.said.get()
    assert not Path(page.removeprefix("file://")).exists()


async def test_faults_come_with_columns_and_remedies_and_go_when_the_text_is_right(editor: Editor) -> None:
    editor.open(PROGRAM)
    (fault,) = await editor.diagnostics()
    assert fault.code == "MC101"
    assert (fault.range.start.line, fault.range.start.character, fault.range.end.character) == (2, 0, 3)
    actions = await editor.text_document_code_action_async(
        lsp.CodeActionParams(lsp.TextDocumentIdentifier(editor.uri), fault.range, lsp.CodeActionContext([]))
    )
    assert actions is not None
    (action,) = actions
    assert isinstance(action, lsp.CodeAction)
    assert action.edit is not None
    assert action.edit.changes is not None
    (edit,) = action.edit.changes[editor.uri]
    assert (edit.range.start.character, edit.range.end.character, edit.new_text) == (1, 3, "01")
    editor.change(PROGRAM.replace("GO1", "G01"), 2)
    assert await editor.diagnostics() == []


async def test_completion_hover_folding_and_formatting(editor: Editor) -> None:
    editor.open("; one\n; two\ng1 x5 f600\nG10")
    document = lsp.TextDocumentIdentifier(editor.uri)
    offered = await editor.text_document_completion_async(lsp.CompletionParams(document, here(3, 3)))
    assert isinstance(offered, lsp.CompletionList)
    assert "G1010" in [item.label for item in offered.items]
    shown = await editor.text_document_hover_async(lsp.HoverParams(document, here(2, 1)))
    assert shown is not None
    assert isinstance(shown.contents, lsp.MarkupContent)
    assert "D-21" in shown.contents.value
    folds = await editor.text_document_folding_range_async(lsp.FoldingRangeParams(document))
    assert folds is not None
    assert [(fold.start_line, fold.end_line) for fold in folds] == [(0, 1), (0, 3)]
    edits = await editor.text_document_formatting_async(
        lsp.DocumentFormattingParams(document, lsp.FormattingOptions(4, True))
    )
    assert edits is not None
    assert edits[0].new_text == "; one\n; two\nG01 X5 F600\nG10\n"


# the first simulation of a fresh clone compiles the planner
@pytest.mark.timeout(400)
async def test_inlay_hints_give_each_lines_time_behind_its_last_character(editor: Editor) -> None:
    editor.open("G1010\nG93 F60\nG01 X100 ; 🙂\n")
    hints = await editor.text_document_inlay_hint_async(
        lsp.InlayHintParams(lsp.TextDocumentIdentifier(editor.uri), lsp.Range(here(0, 0), here(3, 0)))
    )
    assert hints is not None
    moves = [hint for hint in hints if hint.position.line == 2]
    assert [hint.label for hint in moves] == ["1.000 s"]
    # the emoji counts as two units of UTF-16
    assert moves[0].position.character == len("G01 X100 ; ") + 2
    assert "requested 1.000 s" in str(moves[0].tooltip)
