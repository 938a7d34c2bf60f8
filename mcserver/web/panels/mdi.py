"""Manual data input: lines typed in, judged and run at once, with a history."""

from __future__ import annotations

import html

from mcclient import MotionError, ProgramRejected
from mcclient.broken_off import MANUAL_INPUT
from nicegui import events, ui

from mcserver.gcode.text.command_table import COMMANDS
from mcserver.web.actions import Actions
from mcserver.web.formatting import page_hint
from mcserver.web.open_programs import refuse_open
from mcserver.web.panels.card import card
from mcserver.web.translation import mark, t

HISTORY = 50
# The line goes with the key or the click that runs it, and its field is empty at once: what is typed while
# the line is on its way is the next one. That the field is empty goes first.
SUBMITTED = """() => {
  const field = document.querySelector("input.mc-line"), line = field.value;
  field.value = "";
  field.dispatchEvent(new Event("input", { bubbles: true }));
  setTimeout(() => emit(line), 0);
}"""
WHY = mark("a line typed now would move the axes when nobody expects it any more")


class MdiPanel:
    """A field for a line of G-code; Up and Down bring earlier ones back."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._history: list[str] = []
        self._place = 0
        codes = [command.name for command in COMMANDS]
        with card(t("Manual input")):
            with ui.row().classes("w-full items-center no-wrap"):
                self._field = (
                    ui.input(label=t("G-code"), placeholder="G01 X10 F600", autocomplete=codes)
                    .classes("grow font-mono")
                    .props(
                        "autocapitalize=off autocorrect=off spellcheck=false input-class=mc-line "
                        f'data-kept=line aria-label="{t("G-code line")}"'
                    )
                )
                run = ui.button(t("Run")).props("color=primary")
            self._answer = (
                ui.html("", sanitize=False).classes("w-full overflow-x-auto").props("aria-live=polite")
            )
        run.on("click", self._run, js_handler=SUBMITTED)
        self._field.on("keydown.enter", self._run, js_handler=SUBMITTED)
        self._field.on("keydown.up", lambda: self._recall(-1))
        self._field.on("keydown.down", lambda: self._recall(1))

    def _recall(self, step: int) -> None:
        if self._history:
            self._place = min(max(self._place + step, 0), len(self._history))
            self._field.set_value(self._history[self._place] if self._place < len(self._history) else "")

    async def _run(self, event: events.GenericEventArguments) -> None:
        line = str(event.args or "").strip()
        if not line:
            return
        if not self._actions.allowed("open"):
            # it stands there again, unless another one is being typed
            if not self._field.value:
                self._field.set_value(line)
            return
        self._history = [*self._history, line][-HISTORY:]
        self._place = len(self._history)
        self._show(f"&gt; {html.escape(line)}")
        try:
            await self._run_line(line)
        except ProgramRejected as error:
            first = error.diagnostics[0]
            width = max(1, first.end_column - first.column)
            caret = " " * (first.column - 1) + "^" * width
            self._show_refusal(line, f"{caret} {t(first.message)} [{first.code}]", first.hint)
        except MotionError as error:
            self._show_refusal(line, f"{t(error.message)} [{error.code}]", error.hint)
        else:
            self._show(f"{html.escape(line)}   {t('done')}")

    async def _run_line(self, line: str) -> None:
        link, user = self._actions.link, self._actions.visitor.name
        machine = link.connected()
        refuse_open(link, await machine.programs(ended=False), WHY)
        # what it sets is kept with this name
        async with machine.program(f"{MANUAL_INPUT} by {user}", at_pause=True) as program:
            self._actions.note(line)
            await program.send(line)

    def _show_refusal(self, line: str, message: str, hint: str) -> None:
        remedy = f"\n= {html.escape(page_hint(hint))}" if hint else ""
        self._show(f'{html.escape(line)}\n<span class="text-negative">{html.escape(message)}</span>{remedy}')

    def _show(self, content: str) -> None:
        self._answer.set_content(
            f'<pre class="mc-program" tabindex="0" aria-label="{t("Answer")}">{content}</pre>'
        )
