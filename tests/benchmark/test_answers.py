"""Answers come from a folder or a command, bounded in size and time."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path

import pytest
from mcbenchmark.answers import MAX_OUTPUT, AnsweringCommand, program_in, read_answer
from mcbenchmark.cli import run
from mcbenchmark.tasks import shipped_tasks

from mcserver.errors import UsageFault


@pytest.mark.parametrize(
    ("answer", "program"),
    [
        ("G1010\nG01 X1\n", "G1010\nG01 X1\n"),
        ("Sure:\n```gcode\nG1010\n```\nDone.", "G1010\n"),
        ("```\nG1\n```\nNo, better:\n```nc\nG1010\n```\n", "G1010\n"),
        ("```\r\nG1010\r\n```\r\n", "G1010\n"),
        ("```\nG1010", "G1010"),
        ("~~~gcode\nG1010\n~~~\n", "G1010\n"),
        ("```\nG1010\n```\nIt prints:\n```\nok\n```\n", "G1010\n"),
        ("Here is the program:\n\nG1010\nG01 X1 (go on)\n\nIt moves X to 1.\n", "\nG1010\nG01 X1 (go on)\n"),
        ("G1010\nand then\nG01 X1", "G1010\nand then\nG01 X1"),
        ("GO1 X1\nG1010\n", "GO1 X1\nG1010\n"),
        ("(milling a pocket for you)\nG1010\n", "(milling a pocket for you)\nG1010\n"),
        ("I would rather not.", "I would rather not."),
    ],
)
def test_the_last_block_with_codes_or_what_stands_between_prose_is_the_program(
    answer: str, program: str
) -> None:
    assert program_in(answer) == program


def test_answers_are_found_by_number_and_by_name(tmp_path: Path) -> None:
    (tmp_path / "007.gcode").write_text("G7")
    assert read_answer(tmp_path, 7, "name").text == "G7"
    (tmp_path / "name.gcode").write_text("Gname")
    assert read_answer(tmp_path, 7, "name").text == "Gname"
    assert "there is no 008.gcode" in read_answer(tmp_path, 8, "other").missing
    (tmp_path / "009.gcode").mkdir()
    assert read_answer(tmp_path, 9, "folder").missing
    (tmp_path / "010.gcode").write_bytes(b"x" * (MAX_OUTPUT + 1))
    assert "more than" in read_answer(tmp_path, 10, "long").missing


def command(script: str, timeout_s: float = 60.0) -> AnsweringCommand:
    return AnsweringCommand(shlex.join([sys.executable, "-c", script]), timeout_s)


def test_a_command_reads_the_prompt_and_writes_the_program() -> None:
    assert command("print(input().upper())").ask("g1010\n").text == "G1010\n"


def test_no_shell_takes_part(tmp_path: Path) -> None:
    answer = AnsweringCommand(f"echo G1010; touch {tmp_path}/made $HOME `id`", 60.0).ask("")
    assert answer.text.startswith("G1010; touch")
    assert not (tmp_path / "made").exists()


def test_a_command_that_does_not_read_a_long_prompt_is_no_fault() -> None:
    assert command("print('G1010')").ask("x" * 1_000_000).text == "G1010\n"


def test_a_flood_of_output_is_no_answer() -> None:
    flood = "import sys\nwhile True: sys.stdout.write('G01 X1\\n' * 1000)"
    assert "more than" in command(flood).ask("").missing


@pytest.mark.parametrize(
    "script",
    [
        "import time; time.sleep(600)",
        "import os, time\nos.close(1)\ntime.sleep(600)",
        "import subprocess; subprocess.Popen(['sleep', '600']); print('G1010')",
    ],
)
def test_a_command_that_does_not_end_is_ended_with_all_that_it_started(script: str) -> None:
    assert "longer than" in command(script, timeout_s=0.5).ask("").missing


def test_a_command_that_fails_without_output_says_its_exit_code() -> None:
    assert "ended with 3" in command("raise SystemExit(3)").ask("").missing


@pytest.mark.parametrize("words", ["", "  ", "llm 'open"])
def test_a_command_without_words_is_refused(words: str) -> None:
    with pytest.raises(UsageFault, match="MC081"):
        AnsweringCommand(words, 1.0)


def test_a_command_that_does_not_exist_is_refused() -> None:
    with pytest.raises(UsageFault, match="MC081"):
        AnsweringCommand("/nonexistent/llm", 1.0).ask("")


def test_the_benchmark_judges_a_folder_and_keeps_its_answers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "001.gcode").write_text(shipped_tasks()[0].solution)
    (tmp_path / "square.gcode").write_text("Of course!\n```\nG1010\n```\n")
    arguments = [str(tmp_path), "--only", "lines", "--save", str(tmp_path / "kept")]
    assert run([*arguments, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["passed"], answer["tasks"], answer["categories"]["lines"]["passed"]) == (1, 5, 1)
    findings = {each["task"]: [one["check"] for one in each["findings"]] for each in answer["results"]}
    assert findings["line-at-a-speed"] == []
    assert findings["square"] == ["path"]
    assert findings["raster"] == ["answer"]
    assert (tmp_path / "kept" / "square.gcode").read_text() == "G1010\n"


def test_prompts_are_written_under_the_tasks_numbers(tmp_path: Path) -> None:
    assert run(["--prompts", str(tmp_path), "--only", "repair"]) == 0
    names = sorted(file.name for file in tmp_path.iterdir())
    assert names[0] == "057-repair-letters.txt"
    assert "GO1 X1O Y2O" in (tmp_path / names[0]).read_text()


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--baseline", "random", "--command", "cat"],
        ["--baseline", "random", "--only", "dancing"],
        ["/nonexistent"],
        ["--command", "/nonexistent/llm", "--only", "square"],
    ],
)
def test_what_cannot_be_meant_is_refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*arguments, "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["ok"] is False
