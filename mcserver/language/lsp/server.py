"""The language server over pygls: diagnostics, completion, hover, times, remedies, formatting, folding."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Any

from lsprotocol import types as lsp
from pygls.lsp.server import LanguageServer

from mcserver.errors import Diagnostic, McError
from mcserver.gcode.line_faults import TITLES
from mcserver.gcode.text.source import split_lines
from mcserver.language.fix import select_edits
from mcserver.language.format import format_program
from mcserver.language.lsp.drawing import COMMAND, Drawings, NotDrawn
from mcserver.language.lsp.knowledge import complete, hover
from mcserver.language.lsp.outline import folding_ranges
from mcserver.language.lsp.tokens import TOKEN_TYPES, tokens_of
from mcserver.machine.machine_file import Machine
from mcserver.service.approval_basis import server_version
from mcserver.simulation.program_checker import ProgramChecker

MAX_TIMED_LINES = 20_000  # longer programs get no times: a simulation would take too long
MAX_KEPT_TIMES = 8  # programs whose times are kept
_SEVERITY = {"error": lsp.DiagnosticSeverity.Error, "warning": lsp.DiagnosticSeverity.Warning}


def build_server(machine: Machine, source: str) -> LanguageServer:
    """Build the server for programs of one machine; `LanguageServer.start_io` serves an editor.

    Args:
        source: the name or path that the machine was loaded from, for drawings.
    """
    server = LanguageServer(
        "mcserver", server_version(), text_document_sync_kind=lsp.TextDocumentSyncKind.Incremental
    )
    documents = _Documents(server, machine)
    drawings = Drawings(source)
    _register(server, documents, drawings)
    _register_drawing(server, documents, drawings)
    return server


class _Documents:
    """The open programs: the newest text of each is checked, older ones are forgotten."""

    def __init__(self, server: LanguageServer, machine: Machine) -> None:
        self.server = server
        self.machine = machine
        self.checker = ProgramChecker(machine)
        self.found: dict[str, tuple[str, list[Diagnostic]]] = {}
        self._times: dict[str, asyncio.Task[dict[str, Any]]] = {}
        self._checking: dict[str, asyncio.Task[None]] = {}
        self._one_at_a_time = asyncio.Lock()

    def lines(self, uri: str) -> list[str]:
        """Return the lines of a program as the dialect reads them."""
        return split_lines(self.text(uri))

    def text(self, uri: str) -> str:
        """Return the text of a program."""
        return self.server.workspace.get_text_document(uri).source

    def refresh(self, uri: str) -> None:
        """Check a program anew, unless a check of it is waiting for its turn already."""
        if uri not in self._checking:
            self._checking[uri] = asyncio.create_task(self._check(uri))

    def forget(self, uri: str) -> None:
        """Drop what is known of a program that was closed."""
        self.found.pop(uri, None)
        task = self._checking.pop(uri, None)
        if task is not None:
            task.cancel()

    async def _check(self, uri: str) -> None:
        async with self._one_at_a_time:
            # a change from here on starts another check
            self._checking.pop(uri, None)
            text = self.text(uri)
            try:
                found = await self.checker.check("editor", text, None)
            except McError as error:
                found = [Diagnostic(error.code, error.message, hint=error.hint, severity="warning", line=1)]
        self.found[uri] = (text, found)
        lines = split_lines(text)
        self.server.text_document_publish_diagnostics(
            lsp.PublishDiagnosticsParams(uri=uri, diagnostics=[self.shown(each, lines) for each in found])
        )

    def shown(self, diagnostic: Diagnostic, lines: Sequence[str]) -> lsp.Diagnostic:
        """Convert a diagnostic."""
        number = max(0, diagnostic.line - 1)
        title = TITLES.get(diagnostic.code)
        parts = [f"{title}: {diagnostic.message}" if title else diagnostic.message, diagnostic.hint]
        last = diagnostic.end_column if diagnostic.end_column > 0 else 2
        return lsp.Diagnostic(
            range=self.range(lines, number, max(0, diagnostic.column - 1), last - 1),
            message="\n".join(part for part in parts if part),
            severity=_SEVERITY[diagnostic.severity],
            code=diagnostic.code,
            source="mcserver",
        )

    def range(self, lines: Sequence[str], number: int, start: int, end: int) -> lsp.Range:
        """Convert code points of a line, from 0, to the units that the editor counts in."""
        line = lines[number] if number < len(lines) else ""
        units = self.server.workspace.position_codec.client_num_units
        return lsp.Range(
            lsp.Position(number, units(line[:start])), lsp.Position(number, units(line[: max(start, end)]))
        )

    def point(self, uri: str, position: lsp.Position) -> tuple[str, int]:
        """Return the line at an editor's position and the code point within it."""
        lines = self.lines(uri)
        line = lines[position.line] if position.line < len(lines) else ""
        units = self.server.workspace.position_codec.client_num_units
        at = 0
        while at < len(line) and units(line[:at]) < position.character:
            at += 1
        return line, at

    async def times(self, uri: str) -> list[dict[str, Any]]:
        """Simulate a program and return its lines with times; none if it has faults or is too long."""
        text = self.text(uri)
        if text.count("\n") > MAX_TIMED_LINES:
            return []
        task = self._times.get(text)
        if task is None:
            while len(self._times) >= MAX_KEPT_TIMES:
                self._times.pop(next(iter(self._times))).cancel()
            task = self._times[text] = asyncio.create_task(self._simulate(text))
        report = await asyncio.shield(task)
        return list(report["lines"]) if report["ok"] else []

    async def _simulate(self, text: str) -> dict[str, Any]:
        async with self._one_at_a_time:
            try:
                return (await self.checker.simulate("editor", text))[0]
            except McError:
                return {"ok": False, "lines": []}


def _register(server: LanguageServer, documents: _Documents, drawings: Drawings) -> None:
    @server.feature(lsp.TEXT_DOCUMENT_DID_OPEN)
    async def opened(params: lsp.DidOpenTextDocumentParams) -> None:
        documents.refresh(params.text_document.uri)

    @server.feature(lsp.TEXT_DOCUMENT_DID_CHANGE)
    async def changed(params: lsp.DidChangeTextDocumentParams) -> None:
        documents.refresh(params.text_document.uri)

    @server.feature(lsp.TEXT_DOCUMENT_DID_CLOSE)
    async def closed(params: lsp.DidCloseTextDocumentParams) -> None:
        documents.forget(params.text_document.uri)

    @server.feature(lsp.SHUTDOWN)
    async def shut_down(_params: None) -> None:
        documents.checker.close()
        drawings.close()

    _register_questions(server, documents)
    _register_changes(server, documents)


def _register_drawing(server: LanguageServer, documents: _Documents, drawings: Drawings) -> None:
    @server.feature(lsp.TEXT_DOCUMENT_CODE_LENS)
    async def code_lens(params: lsp.CodeLensParams) -> list[lsp.CodeLens]:
        start = lsp.Position(0, 0)
        draw = lsp.Command("Draw the path", COMMAND, arguments=[params.text_document.uri])
        return [lsp.CodeLens(lsp.Range(start, start), draw)]

    @server.command(COMMAND)
    async def draw(uri: str) -> str | None:
        """Draw a program and show its page where the editor can; return the page's URI."""
        try:
            page = (await drawings.draw(uri, documents.text(uri))).as_uri()
        except (NotDrawn, OSError) as error:
            server.window_show_message(lsp.ShowMessageParams(lsp.MessageType.Warning, f"no drawing: {error}"))
            return None
        window = server.client_capabilities.window
        if window is not None and window.show_document is not None and window.show_document.support:
            server.window_show_document(lsp.ShowDocumentParams(page, external=True))
        else:
            server.window_show_message(lsp.ShowMessageParams(lsp.MessageType.Info, f"drawn: {page}"))
        return page


def _register_questions(server: LanguageServer, documents: _Documents) -> None:
    @server.feature(
        lsp.TEXT_DOCUMENT_COMPLETION, lsp.CompletionOptions(trigger_characters=["G", "M", "T", "[", " "])
    )
    async def completion(params: lsp.CompletionParams) -> lsp.CompletionList:
        line, at = documents.point(params.text_document.uri, params.position)
        number = params.position.line
        items = [
            lsp.CompletionItem(
                label=each.label,
                kind=lsp.CompletionItemKind.Keyword,
                detail=each.detail,
                documentation=lsp.MarkupContent(lsp.MarkupKind.Markdown, each.documentation),
                sort_text=f"{order:04d}",
                text_edit=lsp.TextEdit(
                    documents.range([""] * number + [line], number, each.start, at), each.label
                ),
            )
            for order, each in enumerate(complete(line, at, documents.machine))
        ]
        return lsp.CompletionList(is_incomplete=False, items=items)

    @server.feature(lsp.TEXT_DOCUMENT_HOVER)
    async def hovered(params: lsp.HoverParams) -> lsp.Hover | None:
        line, at = documents.point(params.text_document.uri, params.position)
        found = hover(line, at, documents.machine)
        if found is None:
            return None
        number = params.position.line
        return lsp.Hover(
            lsp.MarkupContent(lsp.MarkupKind.Markdown, found[0]),
            documents.range([""] * number + [line], number, found[1], found[2]),
        )

    @server.feature(lsp.TEXT_DOCUMENT_INLAY_HINT)
    async def inlay_hints(params: lsp.InlayHintParams) -> list[lsp.InlayHint]:
        uri = params.text_document.uri
        lines = documents.lines(uri)
        wanted = range(params.range.start.line, params.range.end.line + 1)
        return [
            _time_hint(entry, documents, lines)
            for entry in await documents.times(uri)
            if entry["line"] - 1 in wanted and entry["line"] <= len(lines)
        ]

    @server.feature(
        lsp.TEXT_DOCUMENT_SEMANTIC_TOKENS_FULL,
        lsp.SemanticTokensLegend(token_types=list(TOKEN_TYPES), token_modifiers=[]),
    )
    async def semantic_tokens(params: lsp.SemanticTokensParams) -> lsp.SemanticTokens:
        lines = documents.lines(params.text_document.uri)
        units, found, before, at = documents.server.workspace.position_codec.client_num_units, [], 0, 0
        for number, line in enumerate(lines):
            for token in tokens_of(line):
                if number != before:
                    at = 0
                start, end = units(line[: token.start]), units(line[: token.end])
                found += [number - before, start - at, end - start, TOKEN_TYPES.index(token.kind), 0]
                before, at = number, start
        return lsp.SemanticTokens(data=found)

    @server.feature(lsp.TEXT_DOCUMENT_FOLDING_RANGE)
    async def folding(params: lsp.FoldingRangeParams) -> list[lsp.FoldingRange]:
        return [
            lsp.FoldingRange(
                start_line=first,
                end_line=last,
                kind=lsp.FoldingRangeKind.Comment if comment else lsp.FoldingRangeKind.Region,
            )
            for first, last, comment in folding_ranges(documents.lines(params.text_document.uri))
        ]


def _time_hint(entry: dict[str, Any], documents: _Documents, lines: Sequence[str]) -> lsp.InlayHint:
    number = entry["line"] - 1
    took = entry["end_s"] - entry["start_s"]
    shown = [f"from {entry['start_s']:.3f} s to {entry['end_s']:.3f} s"]
    if entry["requested_s"] is not None:
        shown.append(f"requested {entry['requested_s']:.3f} s")
    if entry["bound_by"]:
        shown.append(f"bound by {entry['bound_by']}")
    return lsp.InlayHint(
        position=documents.range(lines, number, len(lines[number]), len(lines[number])).end,
        label=f"{took:.3f} s",
        tooltip=", ".join(shown),
        padding_left=True,
    )


def _register_changes(server: LanguageServer, documents: _Documents) -> None:
    @server.feature(
        lsp.TEXT_DOCUMENT_CODE_ACTION, lsp.CodeActionOptions(code_action_kinds=[lsp.CodeActionKind.QuickFix])
    )
    async def code_actions(params: lsp.CodeActionParams) -> list[lsp.CodeAction]:
        uri = params.text_document.uri
        text, found = documents.found.get(uri, ("", []))
        if text != documents.text(uri):
            return []
        lines = split_lines(text)
        usable = select_edits(found)
        chosen = [
            each for each in usable if params.range.start.line <= each.line - 1 <= params.range.end.line
        ]
        actions = [_action(f"{each.code}: {each.hint}", uri, [each], documents, lines) for each in chosen]
        if chosen and len(usable) > 1:
            actions.append(
                _action(f"Apply all {len(usable)} certain remedies", uri, usable, documents, lines)
            )
        return actions

    @server.feature(lsp.TEXT_DOCUMENT_FORMATTING)
    async def formatting(params: lsp.DocumentFormattingParams) -> list[lsp.TextEdit]:
        uri = params.text_document.uri
        before = documents.text(uri)
        after = format_program(before)
        if after == before:
            return []
        end = lsp.Position(before.count("\n") + 1, 0)
        return [lsp.TextEdit(lsp.Range(lsp.Position(0, 0), end), after)]


def _action(
    title: str, uri: str, remedies: Sequence[Diagnostic], documents: _Documents, lines: Sequence[str]
) -> lsp.CodeAction:
    edits = [
        lsp.TextEdit(
            documents.range(lines, each.line - 1, each.edit.column - 1, each.edit.end_column - 1),
            each.edit.text,
        )
        for each in remedies
        if each.edit is not None
    ]
    return lsp.CodeAction(
        title=title,
        kind=lsp.CodeActionKind.QuickFix,
        diagnostics=[documents.shown(each, lines) for each in remedies],
        edit=lsp.WorkspaceEdit(changes={uri: edits}),
        is_preferred=len(remedies) == 1,
    )
