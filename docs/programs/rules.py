"""Thresholds of the core that decide, with what set each: rows of docs/measured/rules.md.

``python docs/programs/rules.py --write`` in a clone with its history writes the tables from the constants of the rooms
in which decisions are made. The last column, the case that fails without a rule, is kept for rules that are left.
"""

from __future__ import annotations

import argparse
import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

TOP = Path(__file__).resolve().parents[2]
PAGE = TOP / "docs" / "measured" / "rules.md"
ROOMS = ("tones", "columns", "rows", "chips", "packets", "receiver", "lights", "cleaning")
_DECLARED = re.compile(
    r"^[ \t]*(?:inline )?(?:static )?constexpr (?:const )?[\w:<>, ]*?\b(k[A-Z]\w*)\s*(?:=|\{)([^;]*);"
    r"[ \t]*(?://[ \t]*(.*))?$",
    re.MULTILINE,
)
_FURTHER = re.compile(r",\s*(k[A-Z]\w*)\s*=")
_HEAD = "| rule | value | meaning | set by | fails without it |\n|---|---|---|---|---|\n"
ROW = re.compile(r"^\| `(\w+)`, (\S+) \| `(.*?)` \| (.*?) \| (.*?) \| (.*?) \|$", re.MULTILINE)


@dataclass(frozen=True)
class Rule:
    """A named threshold; ``file`` without its folders, ``meaning`` the comment beside it."""

    room: str
    file: str
    name: str
    value: str
    meaning: str


def rules() -> Iterator[Rule]:
    """All rules of the rooms, by room and file."""
    for room in ROOMS:
        places = [TOP / "cpp" / "src" / room, TOP / "cpp" / "include" / "ocisac" / room]
        for path in sorted(file for place in places for file in place.glob("*.[ch]pp")):
            if "kernels" in path.name:  # widths of vectors and blocks decide no answer
                continue
            text = path.read_text(encoding="utf-8")
            for found in _DECLARED.finditer(text):
                first, value, comment = found.groups()
                names = [first, *_FURTHER.findall(value)]
                values = _FURTHER.split(value)[::2]
                for name, each in zip(names, values, strict=True):
                    yield Rule(room, path.name, name, _inline(each), _inline(comment or _above(text, found.start())))


def _above(text: str, start: int) -> str:
    """The comment in the lines before a declaration."""
    lines: list[str] = []
    for line in reversed(text[:start].splitlines()):
        if not line.strip().startswith("//"):
            break
        lines.insert(0, line.strip().lstrip("/ "))
    return " ".join(lines)


def _inline(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def origins() -> dict[tuple[str, str], str]:
    """The subject of the commit that first declared each name with its value."""
    log = ["git", "log", "--reverse", "--no-merges", "--format=%x00%s", "-p", "-U0", "--", "cpp"]
    first: dict[tuple[str, str], str] = {}
    subject = ""
    for line in subprocess.run(log, cwd=TOP, capture_output=True, text=True, check=True).stdout.splitlines():
        if line.startswith("\0"):
            subject = line[1:]
        elif line.startswith("+"):
            for name, value in re.findall(r"\b(\w+)\s*[={]\s*([^;,/]*)", line):
                first.setdefault((_as_constant(name), value.strip()), subject)
    return first


def _as_constant(name: str) -> str:
    """``kMinGain`` for ``min_gain``, as constants of some rooms were named once."""
    return name if re.match("k[A-Z]", name) else "k" + "".join(part[:1].upper() + part[1:] for part in name.split("_"))


def kept(page: str) -> dict[tuple[str, str], str]:
    """The last column of the page by (name, file)."""
    return {(row[1], row[2]): row[6] for row in ROW.finditer(page)}


def table(of_room: list[Rule], first: dict[tuple[str, str], str], cases: dict[tuple[str, str], str]) -> str:
    """The rows of a room."""
    rows = []
    for rule in of_room:
        origin, case = _short(first.get((rule.name, rule.value), "")), cases.get((rule.name, rule.file), "")
        rows.append(f"| `{rule.name}`, {rule.file} | `{rule.value}` | {rule.meaning} | {origin} | {case} |")
    return _HEAD + "\n".join(rows) + "\n"


def _short(subject: str) -> str:
    """A subject up to 100 characters, cut at a word."""
    text = _inline(subject).replace("`", "")
    return text if len(text) <= 100 else text[:100].rsplit(" ", 1)[0] + " …"


def main() -> None:
    parser = argparse.ArgumentParser(description="Write the rules of the core into their page.")
    parser.add_argument("--write", action="store_true", help="replace the tables of docs/measured/rules.md")
    asked = parser.parse_args()
    page = PAGE.read_text(encoding="utf-8")
    every, first, cases = list(rules()), origins(), kept(page)
    text = page.split("\n## ", 1)[0].rstrip() + "\n"
    for room in ROOMS:
        of_room = [rule for rule in every if rule.room == room]
        text += f"\n## {room}\n\n{len(of_room)} rules.\n\n" + table(of_room, first, cases)
    if asked.write:
        PAGE.write_text(text, encoding="utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
