"""The language server, asked by a headless Neovim with the settings that the guide has for it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.language.test_lsp import PROGRAM

GUIDE = Path(__file__).parents[2] / "docs" / "language.md"
COMMAND = "'mcserver', 'lsp', '--machine', 'cell-1.toml'"

NEOVIM = """
local found = vim.wait(90000, function() return #vim.diagnostic.get(0) > 0 end, 50)
local first = vim.diagnostic.get(0)[1]
local answers = vim.lsp.buf_request_sync(0, 'textDocument/completion',
  { textDocument = vim.lsp.util.make_text_document_params(), position = { line = 3, character = 3 } }, 30000)
local labels = {}
for _, answer in pairs(answers or {}) do
  for _, item in ipairs(answer.result.items) do table.insert(labels, item.label) end
end
local said = { tostring(found), first.code, first.lnum, table.concat(labels, ',') }
io.stdout:write(table.concat(said, ' '), '\\n')
vim.cmd('qa!')
"""


@pytest.mark.skipif(shutil.which("nvim") is None, reason="Neovim is not installed (Debian: neovim)")
def test_a_headless_neovim_shows_a_diagnostic_and_a_completion(tmp_path: Path) -> None:
    program = tmp_path / "p.gcode"
    program.write_text(PROGRAM + "G10\n")
    settings = tmp_path / "nvim" / "init.lua"
    settings.parent.mkdir()
    _, after = GUIDE.read_text("utf-8").split("### Neovim", 1)
    snippet = after.split("```lua\n", 1)[1].split("```", 1)[0]
    assert COMMAND in snippet
    settings.write_text(snippet.replace(COMMAND, f"[[{sys.executable}]], '-m', 'mcserver', 'lsp'"))
    script = tmp_path / "ask.lua"
    script.write_text(NEOVIM)
    folders = dict.fromkeys(("HOME", "XDG_CONFIG_HOME", "XDG_STATE_HOME", "XDG_DATA_HOME"), str(tmp_path))
    done = subprocess.run(
        ["nvim", "--headless", "-n", str(program), "-c", f"luafile {script}"],
        capture_output=True,
        text=True,
        timeout=300,
        env={"PATH": "/usr/bin:/bin", **folders},
        check=False,
    )
    found, code, line, labels = (done.stdout + done.stderr).strip().splitlines()[-1].split(" ")
    assert (found, code, line) == ("true", "MC101", "2")
    assert "G1010" in labels.split(",")
