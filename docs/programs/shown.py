"""Commands and snippets of README and docs as printed: run in the order of the page, and compared with what it shows.

A page's blocks run in one folder, which begins as the demo leaves its own (README: as a clone with that folder in it):

* ``sh``: commands; ``# → words`` behind one: these words are in its output, in this order.
* ``python``: all blocks of a page share their variables; one with ``if __name__ == "__main__"`` is a program of its
  own.
* ``toml``, ``ini``, ``c`` with a file's name in a comment as the first line: that file.
* ``output`` after one of the first two: its output. ``…`` stands for anything, and numbers agree to 2 % or their last
  digit. ``python docs/programs/shown.py --write PAGE...`` puts the output of this machine there.

Programs that need a camera, a cluster, the network or root are those of docs/stand-ins, which comes first on the PATH.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
STAND_INS = ROOT / "docs" / "stand-ins"
_FENCE = re.compile(r"^(`{3,})(\w+)\n(.*?)^\1$", re.DOTALL | re.MULTILINE)
_FILE = re.compile(r"(?:#|//|/\*) ([\w@/.-]+\.[\w.]+)")
_NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
_TOLERANCE = 0.02
_SECONDS = 120


class ShownError(AssertionError):
    """What a page shows is not what happens."""


@dataclasses.dataclass
class Block:
    """A fenced block, and the output block that follows it.

    Attributes:
        line: of the page, from 1.
        output: text that the page shows; None: nothing.
        output_span: its place in the page.
    """

    language: str
    text: str
    line: int
    output: str | None = None
    output_span: tuple[int, int] = (0, 0)


def blocks_of(page: Path) -> list[Block]:
    """The blocks of a page in their order."""
    text = page.read_text(encoding="utf-8")
    blocks: list[Block] = []
    for match in _FENCE.finditer(text):
        _, language, inner = match.groups()
        if language == "output":
            blocks[-1].output, blocks[-1].output_span = inner, match.span(3)
        else:
            blocks.append(Block(language, inner, text.count("\n", 0, match.start()) + 2))
    return blocks


def commands_of(block: str) -> list[str]:
    """Commands of a block of sh; a line that ends with | or a backslash continues."""
    joined = re.sub(r"(\|)\n\s*|\\\n\s*", r"\1 ", block).strip()
    return [line for line in joined.splitlines() if line and not line.startswith("#")]


def words_of(text: str) -> list[str]:
    """Words and numbers, without the lines of tables; a number is separate from its unit."""
    return re.findall(rf"…|{_NUMBER.pattern}|[^\W\d_]+|[^\s\w─]", text)


def same(shown: str, got: str) -> bool:
    """Equal words, or numbers that agree to 2 % or to their last digit."""
    if shown == got:
        return True
    if not (_NUMBER.fullmatch(shown) and _NUMBER.fullmatch(got)):
        return False
    digits = len(shown.partition(".")[2].partition("e")[0]) if "e" not in shown else 0
    step = 10.0**-digits if "." in shown else 0.0
    return abs(float(shown) - float(got)) <= max(1.01 * step, _TOLERANCE * abs(float(got)))


def agrees(shown: list[str], got: list[str]) -> bool:
    """Whether the shown words are those of the output; … stands for any words."""
    parts: list[list[str]] = [[]]
    for word in shown:
        parts.append([]) if word == "…" else parts[-1].append(word)
    head, *middle, tail = [*parts, []] if len(parts) == 1 else parts
    at = _find(head, got[: len(head)], 0)
    for part in middle:
        at = -1 if at < 0 else _find(part, got, at)
    if at < 0:
        return False
    end = len(got) - len(tail)
    return end == at if len(parts) == 1 else end >= at and _find(tail, got, end) == len(got)


def _find(part: list[str], got: list[str], first: int) -> int:
    """Index behind the first place of ``part`` from ``first`` on; -1: there is none."""
    for begin in range(first, len(got) - len(part) + 1):
        if all(map(same, part, got[begin : begin + len(part)])):
            return begin + len(part)
    return -1


@dataclasses.dataclass
class Pages:
    """Runs pages: where programs and recordings are.

    Attributes:
        demo: folder that `ocisac demo` left.
        programs: folder of ``ocisac``, ``python`` and ``ocisac-rx``, put behind the stand-ins on the PATH.
    """

    demo: Path
    programs: Path

    def run(self, page: Path, folder: Path, write: bool = False) -> int:
        """Run the blocks of a page in a folder; the number of blocks that ran."""
        home = self._prepare(page, folder)
        variables: dict[str, object] = {"__name__": "page"}
        ran, outputs = 0, []
        for block in blocks_of(page):
            place = f"{page.relative_to(ROOT)}:{block.line}"
            name = _FILE.match(block.text)
            if block.language == "sh":
                output = self._run_commands(block, home, place)
            elif block.language == "python":
                shell = home / "demo" if page.name == "README.md" else home  # README's commands have gone there
                output = self._run_python(block, shell, place, variables)
            elif name and block.language in ("toml", "ini", "c"):
                (home / Path(name[1]).name).write_text(block.text, encoding="utf-8")
                continue
            else:
                continue
            ran += 1
            if block.output is not None:
                outputs.append((block.output_span, output))
                if not write and not agrees(words_of(block.output), words_of(output)):
                    raise ShownError(f"{place}: shows\n{block.output}\nprints\n{output}")
        if write:
            _replace(page, outputs)
        return ran

    def _prepare(self, page: Path, folder: Path) -> Path:
        """A folder with the recordings of the demo; for README a clone's, with that folder in it."""
        home = folder / page.stem
        recordings = home / "demo" if page.name == "README.md" else home
        recordings.mkdir(parents=True, exist_ok=True)
        for recording in self.demo.iterdir():
            if recording.suffix in (".mkv", ".png"):
                shutil.copy(recording, recordings)
        shutil.copytree(ROOT / "examples", home / "examples", dirs_exist_ok=True)
        (home / ".venv" / "bin").mkdir(parents=True, exist_ok=True)
        (home / ".venv" / "bin" / "activate").write_text("# the programs are on the PATH\n")
        return home

    def _environment(self) -> dict[str, str]:
        path = f"{STAND_INS}{os.pathsep}{self.programs}{os.pathsep}{os.environ['PATH']}"
        return {**os.environ, "PATH": path, "OCISAC_ROOT": str(ROOT), "COLUMNS": "160"}

    def _run_commands(self, block: Block, home: Path, place: str) -> str:
        commands = commands_of(block.text)
        with tempfile.TemporaryDirectory() as where:
            script = "\n".join(f'{{\n{each}\n}} >"{where}/{k}"' for k, each in enumerate(commands))
            done = subprocess.run(
                ["bash", "-e", "-o", "pipefail", "-c", script],
                cwd=home,
                env=self._environment(),
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                timeout=_SECONDS,
            )
            outputs = [
                path.read_text(encoding="utf-8") for path in sorted(Path(where).iterdir(), key=lambda p: int(p.name))
            ]
        if done.returncode != 0:
            raise ShownError(f"{place}: {commands[len(outputs) - 1]}\nexit code {done.returncode}\n{done.stderr}")
        for command, output in zip(commands, outputs, strict=True):
            _, arrow, shown = command.partition("# → ")
            if arrow and shown not in output and not agrees(["…", *words_of(shown), "…"], words_of(output)):
                raise ShownError(f"{place}: {command}\nprints\n{output}")
        return "".join(outputs)

    def _run_python(self, block: Block, home: Path, place: str, variables: dict[str, object]) -> str:
        if "__main__" in block.text:
            program = home / "program.py"
            program.write_text(block.text, encoding="utf-8")
            done = subprocess.run(
                [sys.executable, program.name],
                cwd=home,
                env={**self._environment(), "PYTHONPATH": str(STAND_INS)},
                capture_output=True,
                text=True,
                timeout=_SECONDS,
            )
            if done.returncode != 0:
                raise ShownError(f"{place}: {done.stderr}")
            return done.stdout
        printed, before = io.StringIO(), Path.cwd()
        sys.path.insert(0, str(STAND_INS))
        try:
            os.chdir(home)
            with contextlib.redirect_stdout(printed), warnings.catch_warnings():
                warnings.simplefilter("error")
                exec(compile(block.text, place, "exec"), variables)
        except Exception as error:
            raise ShownError(f"{place}: {type(error).__name__}: {error}") from error
        finally:
            os.chdir(before)
            sys.path.remove(str(STAND_INS))
        return printed.getvalue()


def _replace(page: Path, outputs: list[tuple[tuple[int, int], str]]) -> None:
    """Put outputs into the page, without blank lines at their ends and spaces at the ends of lines."""
    text = page.read_text(encoding="utf-8")
    for (begin, end), output in reversed(outputs):
        lines = [line.rstrip() for line in output.splitlines()]
        while lines and not lines[0]:
            lines.pop(0)
        while lines and not lines[-1]:
            lines.pop()
        text = text[:begin] + "".join(f"{line}\n" for line in lines) + text[end:]
    page.write_text(text, encoding="utf-8")


def program_folder(folder: Path) -> Path:
    """A folder with ``ocisac`` and ``python`` of this interpreter, and ``ocisac-rx`` of the build or of OCISAC_RX."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, words in (("ocisac", "-m ocisac_fast.cli"), ("python", "")):
        program = folder / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n')
        program.chmod(0o755)
    receiver = Path(os.environ.get("OCISAC_RX", ROOT / "build" / "make" / "cpp" / "apps" / "ocisac-rx"))
    if receiver.is_file() and not (folder / "ocisac-rx").exists():
        (folder / "ocisac-rx").symlink_to(receiver)
    return folder


def main() -> None:
    parser = argparse.ArgumentParser(description="Run the commands and snippets of pages.")
    parser.add_argument("pages", nargs="+", type=Path)
    parser.add_argument("--write", action="store_true", help="put the outputs into the pages")
    arguments = parser.parse_args()
    from ocisac_fast import demo

    with tempfile.TemporaryDirectory() as folder:
        demo.run(Path(folder) / "recordings")
        pages = Pages(Path(folder) / "recordings", program_folder(Path(folder) / "programs"))
        for page in arguments.pages:
            print(page, pages.run(page.resolve(), Path(folder) / "pages", arguments.write), "blocks")


if __name__ == "__main__":
    main()
