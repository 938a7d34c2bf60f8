"""A start in the middle of a program: what is certain, where the axes are, the way, and the question."""

from __future__ import annotations

import html
from collections.abc import Callable
from functools import partial

from mcclient import MotionError
from mcclient.broken_off import broken_off
from mcclient.switches import switches_said
from mcclient.types import Continuation, ProgramStatus
from nicegui import ui

from mcserver.errors import McError
from mcserver.web.actions import Actions, show_error, show_refusal
from mcserver.web.dialogs import NamedDialog, answer_to
from mcserver.web.formatting import axis_name, page_hint, position_text, program_excerpt
from mcserver.web.jobs import Middle, Switches
from mcserver.web.machine_words import program_name
from mcserver.web.translation import language, t


async def ask_run_from(
    actions: Actions,
    name: str,
    text: str,
    from_line: int,
    switches: Switches,
    run: Callable[[Middle], bool],
) -> None:
    """Show how a program would begin at a line, and ask.

    Args:
        run: begins it; whether it was.
    """
    lines = text.split("\n")
    if not 1 <= from_line <= len(lines):
        show_refusal(
            t("{name} has no line {line}", name=name, line=from_line),
            t("it has {count} lines", count=len(lines)),
        )
        return
    try:
        shown = await actions.link.connected().continuation(
            before=lines[: from_line - 1], **switches._asdict()
        )
    except MotionError as error:
        show_error(error)
        return
    first = max(1, from_line - 3)
    excerpt = program_excerpt(lines, from_line, {}) if len(lines) > 1 else html.escape(lines[first - 1])
    await _ask(
        t("Run {name} from line {line}?", name=name, line=from_line),
        t("Run from line {line}", line=from_line),
        shown,
        excerpt,
        Middle(),
        run,
    )


async def ask_to_go_on(
    actions: Actions, program: ProgramStatus, go_on: Callable[[Continuation, Middle], bool]
) -> None:
    """Show how a program would go on, and ask.

    Args:
        go_on: begins it; whether it was.
    """
    try:
        shown = await actions.link.connected().continuation(program.program)
    except MotionError as error:
        show_error(error)
        return
    name = program_name(shown.name or shown.program)
    rows = [
        f'<span class="{"now" if number == shown.line else "mark"}">'
        f"{html.escape(f'{number:>6}  {text[:200]}')}</span>"
        for number, text in enumerate(shown.lines, shown.first)
    ]
    text = f'<pre class="mc-program" tabindex="0" aria-label="{t("Program text")}">{"".join(rows)}</pre>'
    known = "" if shown.whole else " " + t("The text is known through line {line}.", line=shown.accepted)
    certain = f"<p>{certain_text(shown.done)}{known}</p>"
    title = t("Go on with {name} at line {line}?", name=name, line=shown.line)
    verb = t("Go on at line {line}", line=shown.line)
    await _ask(title, verb, shown, certain + text, Middle(shown.program), partial(go_on, shown))


async def _ask(
    title: str,
    verb: str,
    shown: Continuation,
    text: str,
    middle: Middle,
    begin: Callable[[Middle], bool],
) -> None:
    """Ask with a button for each answer that there is, and begin as it says."""
    asked = {need.confirm for need in shown.needs}
    with NamedDialog(title) as dialog, ui.card().classes("mc-ask mc-way"):
        ui.label(title).classes("font-bold break-words")
        ui.html(text + continuation_html(shown), sanitize=False).classes("w-full overflow-x-auto")
        with ui.element("div").classes("mc-buttons"):
            for label, answer in answers_to(asked, verb, middle):
                ui.button(label, on_click=_submit(dialog, answer)).props("color=positive no-caps")
            ui.button(t("Cancel"), on_click=lambda: dialog.submit(None)).props("flat autofocus")

    async def act(answer: Middle) -> bool:
        return begin(answer)

    await answer_to(dialog, act)


def _submit(dialog: ui.dialog, answer: Middle) -> Callable[[], None]:
    return lambda: dialog.submit(answer)


def certain_text(done: int) -> str:
    """Return what is certain of a program that was broken off behind its line ``done``."""
    return t("Lines through {done} are certain; line {next} may have begun.", done=done, next=done + 1)


def answers_to(asked: set[str], verb: str, middle: Middle) -> list[tuple[str, Middle]]:
    """Return the buttons of the question; none where something stands in the way that nobody can confirm.

    Args:
        asked: fields that have to be confirmed; an empty one: what no confirmation lets pass.
    """
    if "" in asked:
        return []
    way = "way" in asked
    taken = t("Take this way: {verb}", verb=_inside_sentence(verb)) if way else verb
    if "outputs" not in asked:
        return [(taken, middle._replace(way=way))]
    then = _inside_sentence(taken)
    return [
        (t("Switch them on: {verb}", verb=then), middle._replace(way=way, outputs="set")),
        (t("Leave them: {verb}", verb=then), middle._replace(way=way, outputs="leave")),
    ]


def _inside_sentence(verb: str) -> str:
    """Return the words of a button as they stand behind others; nouns of German keep their capitals."""
    return verb if language() == "de" else verb[0].lower() + verb[1:]


def continuation_html(shown: Continuation) -> str:
    """Return where the axes are and are expected, the way between, and what has to be answered, as HTML."""
    found = [f"<p>{t('In force there:')} {html.escape(' '.join(shown.modal))}</p>"] if shown.modal else []
    found += [f"<p>{t(each)}</p>" for each in switches_said(shown.block_delete, shown.optional_stop)]
    rows = "".join(
        f"<tr><td>{axis_name(each.axis)}</td><td class=n>{position_text(each.now)}</td>"
        f"<td class=n>{t('not known') if each.there is None else position_text(each.there)}</td>"
        f"<td>{t('elsewhere') if each.away else ''}</td></tr>"
        for each in shown.axes
        if each.energized
    )
    if rows:
        head = (
            f"<tr><th>{t('Axis')}</th><th class=n>{t('is at')}</th>"
            f"<th class=n>{t('line starts at')}</th><th></th></tr>"
        )
        found.append(f'<table class="mc-positions"><thead>{head}</thead><tbody>{rows}</tbody></table>')
    energize = ", ".join(axis_name(axis) for axis in shown.energize)
    steps = ([t("energize {axes}", axes=energize)] if energize else []) + [t(each.text) for each in shown.way]
    if steps:
        ways = "".join(f"<li>{html.escape(step)}</li>" for step in steps)
        found.append(f'<p><b>{t("The way:")}</b></p><ol class="mc-steps">{ways}</ol>')
    if shown.axes and not any(each.targets for each in shown.way):
        found.append(f"<p>{t('The axes are where the program has them before this line.')}</p>")
    for need in shown.needs:
        hint = f"<br>= {html.escape(page_hint(need.hint))}" if need.hint else ""
        kind = "mc-faults" if not need.confirm else "mc-warnings"
        found.append(f'<div class="{kind}">{html.escape(t(need.message))} [{need.code}]{hint}</div>')
    return "".join(found)


class RecoveryPanel:
    """A card while the newest program was broken off: what is certain, and the button to go on.

    Attributes:
        program: that was broken off; None: none was.
    """

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self.program: ProgramStatus | None = None
        self._card = ui.card().classes("mc-card").props(f'role=region aria-label="{t("Broken off")}"')
        with self._card:
            self._said = ui.label("").classes("w-full font-bold break-words")
            self._certain = ui.label("").classes("w-full")
            self._button = ui.button(t("Continue …"), on_click=self._go_on).props("color=positive no-caps")
            self._button.set_enabled(actions.visitor.may("continue_program"))
        self._card.set_visibility(False)

    async def update(self) -> None:
        """Ask for the newest program, and show it where it was broken off."""
        machine = self._actions.link.machine
        if machine is None:
            return
        try:
            programs = await machine.programs(limit=10)
        except MotionError:
            return
        self._show(broken_off(programs, lines_left=True))

    def _show(self, program: ProgramStatus | None) -> None:
        self._card.set_visibility(program is not None)
        shown, self.program = self.program, program
        if program is None or program == shown:
            return
        name = program_name(program.name or program.program)
        self._said.set_text(
            t("{name} was {state} at line {line}", name=name, state=t(program.state), line=program.done + 1)
        )
        self._certain.set_text(certain_text(program.done))
        self._button.set_text(t("Continue at line {line}…", line=program.done + 1))

    async def _go_on(self) -> None:
        program = self.program
        if program is None or not self._actions.allowed("continue_program"):
            return
        await ask_to_go_on(self._actions, program, self._begin)

    def _begin(self, shown: Continuation, middle: Middle) -> bool:
        # control may have been taken away while the dialog was open
        if not self._actions.allowed("continue_program"):
            return False
        try:
            self._actions.link.jobs.go_on(shown, self._actions.visitor.name, middle)
        except (MotionError, McError) as error:
            show_error(error)
            return False
        return True
