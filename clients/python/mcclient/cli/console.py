"""``mcctl console``: a conversation with a machine, at a terminal or from a pipe."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Iterable
from pathlib import Path

import typer
from prompt_toolkit import PromptSession
from prompt_toolkit.completion import CompleteEvent, Completer, Completion
from prompt_toolkit.document import Document
from prompt_toolkit.history import FileHistory, History, InMemoryHistory
from prompt_toolkit.patch_stdout import patch_stdout

from mcclient.cli.codes import CODES, COMMANDS
from mcclient.cli.options import (
    AxesOption,
    JsonOption,
    Target,
    parse_axes,
)
from mcclient.cli.output import errors_shown, exit_code_of, narration, results, say, write_json
from mcclient.cli.signals import on_signals
from mcclient.cli.talk import Talk
from mcclient.cli.terminal import TerminalConsole
from mcclient.errors import MotionError
from mcclient.lines import from_thread


class CodeCompleter(Completer):
    """The dialect's codes, and the console's own commands at the beginning of a line."""

    def get_completions(self, document: Document, _event: CompleteEvent) -> Iterable[Completion]:
        """Called by the prompt on Tab."""
        before = document.text_before_cursor
        word = before.split(" ")[-1]
        table = COMMANDS if before.startswith(":") else CODES
        if not word:
            return
        for name, meaning in table.items():
            if name.lower().startswith(word.lower()):
                yield Completion(name, start_position=-len(word), display_meta=meaning)


def console(target: Target, axes: AxesOption = None, json: JsonOption = False) -> None:
    """Type G-code, line by line, in one program; :help lists the console's own commands.

    From a pipe each line is waited for, and the exit code is that of the last error.
    """

    async def work() -> MotionError | None:
        chosen = parse_axes(axes)
        async with target.open() as one:
            if sys.stdin.isatty() and results().is_terminal:
                talk = Talk(one, _console_above_prompt, axes=chosen)
                await _at_terminal(talk, one.name)
            else:
                talk = Talk(one, results if not json else narration, axes=chosen)
                await _from_pipe(talk)
            return talk.failure

    with errors_shown(json):
        failure = asyncio.run(work())
    code = exit_code_of(failure) if failure is not None and not sys.stdin.isatty() else 0
    if json:
        write_json({"ok": failure is None, "exit_code": code})
    raise typer.Exit(code)


def _console_above_prompt() -> TerminalConsole:
    # made anew each time: while the prompt is shown, standard output is replaced by one that writes above it
    return TerminalConsole(file=sys.stdout, force_terminal=True, soft_wrap=True)


async def _from_pipe(talk: Talk) -> None:
    async for text in from_thread(sys.stdin):
        if not await talk.enter(text.rstrip("\r\n"), wait=True):
            break
    await talk.finish()


async def _at_terminal(talk: Talk, name: str) -> None:
    session: PromptSession[str] = PromptSession(
        history=_history(), completer=CodeCompleter(), complete_while_typing=False
    )
    say(f"{name}: one program, its modal state lasts from line to line; :help, :quit", "dim")
    with patch_stdout(raw=True):
        while True:
            try:
                text = await session.prompt_async(f"{name} {talk.number}> ")
            except KeyboardInterrupt:
                if talk.moving:
                    await talk.hold()
                continue
            except EOFError:
                break
            if not await talk.enter(text, wait=False):
                break
    await _leave(talk)


async def _leave(talk: Talk) -> None:
    """Waits for the motion's end; Ctrl-C stops it."""
    if talk.held:
        say("the program is held: mcctl resume goes on, Ctrl-C aborts it", "yellow")
    elif talk.moving:
        say("waiting for the motion's end; Ctrl-C aborts it")
    finishing = asyncio.create_task(talk.finish())
    loop = asyncio.get_running_loop()

    def abort() -> None:
        aborting.append(loop.create_task(talk.abort()))

    aborting: list[asyncio.Task[None]] = []
    unheard = on_signals((signal.SIGINT,), abort)
    try:
        await finishing
        await asyncio.gather(*aborting, return_exceptions=True)
    finally:
        unheard()


def _history() -> History:
    """In the user's state folder (XDG); in memory where that cannot be written."""
    base = os.environ.get("XDG_STATE_HOME")
    folder = (Path(base) if base else Path.home() / ".local" / "state") / "mcctl"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        history = folder / "history"
        history.touch(mode=0o600)
    except OSError:
        return InMemoryHistory()
    return FileHistory(str(history))
