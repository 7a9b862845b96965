"""README.md and docs/: every command and every snippet runs as printed, inline commands parse, the gallery is short."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest
import shown

from ocisac_fast import demo
from ocisac_fast.cli.application import ocisac

ROOT = Path(__file__).parents[2]

PAGES = [
    ROOT / "README.md",
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if not {"generated", "gallery"} & set(page.parts)),
]
WITH_BLOCKS = [page for page in PAGES if {"sh", "python"} & {block.language for block in shown.blocks_of(page)}]


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Pages run on the recordings of one demo."""
    folder = tmp_path_factory.mktemp("demo")
    demo.run(folder)
    return shown.Pages(folder, shown.program_folder(tmp_path_factory.mktemp("programs")))


# Blocks run


@pytest.mark.parametrize("page", WITH_BLOCKS, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_runs_as_printed(page, pages, tmp_path, request):
    text = "".join(block.text for block in shown.blocks_of(page))
    if "dask worker" in text:
        request.getfixturevalue("process_semaphores")
    if "ocisac-rx" in text and not (pages.programs / "ocisac-rx").exists():
        pytest.skip("ocisac-rx is not built, and OCISAC_RX names none")
    assert pages.run(page, tmp_path) > 0


def test_blocks_of_commands_are_not_hidden():
    """Commands stand in blocks that run: ``sh``, not ``text`` or ``bash``, and not indented."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        outside = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
        hidden = [b.text for b in shown.blocks_of(page) if b.language not in ("sh", "python", "ini", "c")]
        hidden += re.findall(r"^ {4}.*$", outside, re.MULTILINE)
        lines = [line.strip() for block in hidden for line in block.splitlines()]
        assert not [line for line in lines if line.startswith(("ocisac", "make "))], page


def test_most_pages_for_users_have_blocks():
    for folder in ("start", "howto"):
        without = [page for page in (ROOT / "docs" / folder).glob("*.md") if page not in WITH_BLOCKS]
        assert [page.name for page in without] in ([], ["completion.md"])


# What a page shows is what is compared


@pytest.mark.parametrize(
    ("said", "got", "agree"),
    [
        ("gain 0.5032 ± 1.7e-05", "gain 0.50324 ± 1.71e-05", True),
        ("gain 0.5032", "gain 0.5232", False),
        ("2 m/s", "2 m/s more", False),
        ("… 2 m/s …", "speed 2 m/s more", True),
        ("… 2 m/s …", "speed 3 m/s more", False),
        ("a … c", "a b c", True),
        ("a … c", "a b c d", False),
        ("3 frames", "4 frames", False),
        ("", "", True),
        ("", "word", False),
    ],
)
def test_outputs_agree_to_the_digits_shown(said, got, agree):
    assert shown.agrees(shown.words_of(said), shown.words_of(got)) is agree


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("```sh\nocisac info    # → nonsense\n```\n", "nonsense"),
        ("```sh\nocisac nonsense\n```\n", "exit code 2"),
        ("```python\nraise ValueError('nonsense')\n```\n", "nonsense"),
        ("```python\nprint(1)\n```\n\n```output\n2\n```\n", "shows"),
    ],
)
def test_a_page_that_is_wrong_is_refused(text, reason, pages, tmp_path, monkeypatch):
    monkeypatch.setattr(shown, "ROOT", tmp_path)
    (tmp_path / "examples").mkdir()
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    with pytest.raises(shown.ShownError, match=reason):
        pages.run(page, tmp_path / "run")


# Commands in the text parse


def inline_commands(page: Path) -> list[list[str]]:
    """Words of each ``ocisac`` command in the text of a page."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    return [shlex.split(code)[1:] for code in re.findall(r"`(ocisac\s[^`]+)`", text)]


COMMANDS = [
    pytest.param(words, id=f"{page.name}: {' '.join(words)}") for page in PAGES for words in inline_commands(page)
]


@pytest.mark.parametrize("words", COMMANDS)
def test_a_command_in_the_text_parses(words):
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


def test_commands_are_in_the_text():
    assert len(COMMANDS) > 10


# The gallery


def test_the_programs_of_the_gallery_are_short():
    """10 to 30 lines of code after the description; `make docs` runs them."""
    programs = sorted((ROOT / "examples" / "gallery").glob("*.py"))
    assert len(programs) >= 10
    for program in programs:
        code = program.read_text(encoding="utf-8").split('"""')[2]
        assert 10 <= sum(bool(line.strip()) for line in code.splitlines()) <= 30, program
