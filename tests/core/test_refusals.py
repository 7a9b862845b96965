"""Values without meaning are refused with one line: the argument, the value, and what is allowed (refused_values).

The messages are stored in refusals.txt; ``python tests/core/test_refusals.py`` writes them again.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from refused_values import REFUSED, Call
from test_bad_values import FUNCTIONS, call

STORED = Path(__file__).with_name("refusals.txt")
CASES = [
    (name, argument, number)
    for name, arguments in REFUSED.items()
    for argument, values in arguments.items()
    for number in range(len(values))
]


def message(name: str, argument: str, number: int) -> str:
    value = REFUSED[name][argument][number]
    asked = value if isinstance(value, Call) else Call({argument: value})
    with pytest.raises(ValueError, match=rf"(^|\W){argument}: ") as refused:
        asked.own() if asked.own else call(name, asked.changes)
    return str(refused.value)


def messages() -> Iterator[str]:
    for name, argument, number in CASES:
        yield f"{name} {argument} {number}: {message(name, argument, number)}"


@pytest.fixture(scope="module")
def stored() -> dict[str, str]:
    return dict(line.split(": ", 1) for line in STORED.read_text(encoding="utf-8").splitlines())


@pytest.mark.parametrize(("name", "argument", "number"), CASES)
def test_a_value_without_meaning_is_refused(stored: dict[str, str], name: str, argument: str, number: int) -> None:
    got = message(name, argument, number)
    assert re.fullmatch(r".+: got .+, allowed: .+", got)
    assert got == stored[f"{name} {argument} {number}"]


def test_every_stored_message_has_its_case(stored: dict[str, str]) -> None:
    assert list(stored) == [f"{name} {argument} {number}" for name, argument, number in CASES]
    assert set(REFUSED) <= set(FUNCTIONS)


if __name__ == "__main__":
    STORED.write_text("".join(f"{line}\n" for line in messages()), encoding="utf-8")
