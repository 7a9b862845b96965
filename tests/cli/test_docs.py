"""README.md and docs/: commands of the README run, all commands parse, all Python blocks fit the library."""

from __future__ import annotations

import ast
import importlib
import inspect
import os
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("PIL.Image")
pytest.importorskip("av")
pytest.importorskip("matplotlib")
pytest.importorskip("click")
pytest.importorskip("rich")

import click

from ocisac_fast.cli import main
from ocisac_fast.cli.application import ocisac

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
README = PAGES[0].read_text(encoding="utf-8")


def fenced(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def command_lines(block: str) -> list[str]:
    """Commands of a block of sh; a line that ends with | or \\ continues."""
    return re.sub(r"(\|)\n\s*|\\\n\s*", r"\1 ", block).strip().splitlines()


def pipeline(line: str) -> list[list[str]]:
    """Words of each program of a pipeline, without comments."""
    words: list[list[str]] = [[]]
    lexer = shlex.shlex(line, posix=True, punctuation_chars="|")
    lexer.whitespace_split = True
    for word in lexer:
        words.append([]) if word == "|" else words[-1].append(word)
    return [program for program in words if program]


# The README runs


def simulate(output: str, *options: object) -> None:
    camera = ("--row-time", "22.2us", "--exposure", "1202us", "--noise", "1", "--dark-level", "16")
    assert main(["simulate", *camera, *map(str, options), "-o", output]) == 0


def recordings(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The recordings that the README presupposes."""
    square = ("--waveform", "square", "--frequency", "500")
    simulate(str(folder / "recording.mkv"), *square, "--frames", 2, "--columns", 5)
    simulate(str(folder / "video.mkv"), *square, "--frames", 3, "--rows", 1080, "--columns", 200)
    for name, duty in (("a.mkv", 0.05), ("b.mkv", 0.1)):
        pulses = ("--waveform", "square", "--frequency", 30.1, "--duty", duty, "--columns", 8, "--rows", 1080)
        simulate(str(folder / name), *pulses, "--exposure", "200us", "--frames", 330)
    capsys.readouterr()
    assert main(["transmit", "--text", "Hello", "--block-bytes", "8"]) == 0
    chips = ("--waveform", "chips", "--bits", capsys.readouterr().out.strip(), "--chip-rate", "12kHz")
    simulate(str(folder / "lamp.mkv"), *chips, "--exposure", "100us", "--columns", 16, "--frames", 60)


def test_the_readme_runs(tmp_path, monkeypatch, capsys):
    """Every Python block and every command, in order, in one folder with the recordings that the README presupposes.

    Left out are pipelines with a program that is not installed, such as a camera's; of make the target must exist.
    """
    recordings(tmp_path, capsys)
    monkeypatch.chdir(tmp_path)
    for code in fenced(README, "python"):
        exec(compile(code, "README.md", "exec"), {})
    assert capsys.readouterr().out.count("\n") >= 4
    programs = tmp_path / "programs"
    programs.mkdir()
    (programs / "ocisac").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ocisac_fast.cli "$@"\n')
    (programs / "ocisac").chmod(0o755)
    if "OCISAC_RX" in os.environ:
        (programs / "ocisac-rx").symlink_to(os.environ["OCISAC_RX"])
    path = f"{programs}{os.pathsep}{os.environ['PATH']}"
    ran = 0
    for line in [line for block in fenced(README, "sh") for line in command_lines(block)]:
        names = [words[0] for words in pipeline(line)]
        if names == ["make"]:
            line, folder = line.replace("make", "make --dry-run", 1), ROOT
        else:
            folder = tmp_path
        if any(shutil.which(name, path=path) is None for name in names):
            assert "ocisac" not in names
            continue
        done = subprocess.run(
            ["sh", "-c", line],
            cwd=folder,
            env={**os.environ, "PATH": path},
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert done.returncode == 0, f"{line}\n{done.stderr}"
        assert not done.stderr or "ocisac" not in names or "Traceback" not in done.stderr, done.stderr
        ran += 1
    assert ran >= 15


# Commands of all pages parse


def shown_commands(page: Path) -> Iterator[list[str]]:
    """Words of each ``ocisac`` command of a page: in blocks, in indented lines, in the text."""
    text = page.read_text(encoding="utf-8")
    blocks = [line for block in fenced(text, "sh") for line in command_lines(block)]
    text = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    indented = re.findall(r"^ {4}(ocisac .*)$", text, re.MULTILINE)
    inline = [" ".join(code.split()) for code in re.findall(r"`(ocisac\s[^`]+)`", text)]
    for line in [*blocks, *indented, *inline]:
        yield from (words[1:] for words in pipeline(line) if words[0] == "ocisac")


COMMANDS = [
    pytest.param(words, id=f"{page.name}: {' '.join(words)}") for page in PAGES for words in shown_commands(page)
]


@pytest.mark.parametrize("words", COMMANDS)
def test_a_shown_command_parses(words):
    """The command exists, takes these options, and their values; … stands for more."""
    context = click.Context(ocisac)
    name, command, rest = ocisac.resolve_command(context, words)
    inner = click.Context(command, info_name=name, parent=context)
    values, left, order = command.make_parser(inner).parse_args([word.rstrip("…").rstrip(",") or "1" for word in rest])
    assert not left
    for parameter in order:
        if isinstance(parameter, click.Option) and not isinstance(parameter.type, click.Path):
            value = values[parameter.name]
            if value is not None and "flag_needs_value" not in str(value):
                parameter.type_cast_value(inner, value)


def test_commands_are_shown():
    assert len(COMMANDS) > 30


# Python blocks of all pages fit the library


def python_blocks(page: Path) -> Iterator[str]:
    """Fenced blocks, and indented ones that import the library."""
    text = page.read_text(encoding="utf-8")
    yield from fenced(text, "python")
    text = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    for block in re.findall(r"(?:^(?: {4}.*)?\n)+", text, re.MULTILINE):
        code = textwrap.dedent(block).strip("\n")
        if re.search(r"^\s*(from|import) ocisac_fast", code, re.MULTILINE):
            yield code


BLOCKS = [
    pytest.param(code, id=f"{page.name}: {code.splitlines()[0]}") for page in PAGES for code in python_blocks(page)
]


@pytest.mark.parametrize("code", BLOCKS)
def test_a_python_block_fits_the_library(code):
    """It compiles, its imports exist, and calls of imported names take the arguments shown."""
    tree = ast.parse(code)
    known = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("ocisac_fast"):
            module = importlib.import_module(str(node.module))
            known |= {alias.asname or alias.name: getattr(module, alias.name) for alias in node.names}
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in known:
            named = {word.arg: None for word in node.keywords if word.arg}
            inspect.signature(known[node.func.id]).bind(*[None] * len(node.args), **named)


def test_python_blocks_are_shown():
    assert len(BLOCKS) >= 5
