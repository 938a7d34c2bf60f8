"""The language server, asked by a headless Neovim."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.language.test_lsp import PROGRAM

NEOVIM = """
local client = vim.lsp.start_client({ name = 'mcserver', cmd = { PYTHON, '-m', 'mcserver', 'lsp' } })
vim.lsp.buf_attach_client(0, client)
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
    script = tmp_path / "ask.lua"
    script.write_text(NEOVIM.replace("PYTHON", f"[[{sys.executable}]]"))
    done = subprocess.run(
        ["nvim", "--headless", "-u", "NONE", "-n", str(program), "-c", f"luafile {script}"],
        capture_output=True,
        text=True,
        timeout=300,
        env={"PATH": "/usr/bin:/bin", "HOME": str(tmp_path), "XDG_STATE_HOME": str(tmp_path)},
        check=False,
    )
    found, code, line, labels = (done.stdout + done.stderr).strip().splitlines()[-1].split(" ")
    assert (found, code, line) == ("true", "MC101", "2")
    assert "G1010" in labels.split(",")
