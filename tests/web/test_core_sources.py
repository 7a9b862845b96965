"""The core stays buildable for browsers: ``make web`` takes minutes, this takes none of them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_algorithms_that_libcxx_13_lacks_are_there() -> None:
    """Every algorithm of ranges that the core uses is in web/wasm/standard_library.hpp."""
    header = ROOT / "web" / "wasm" / "standard_library.hpp"
    if not header.is_file():
        pytest.skip("no repository here")
    sources = [path for folder in ("src", "include") for path in sorted((ROOT / "cpp" / folder).rglob("*.[ch]pp"))]
    used = {name for path in sources for name in re.findall(r"std::ranges::(\w+)", path.read_text(encoding="utf-8"))}
    text = header.read_text(encoding="utf-8")
    there = set(re.findall(r"constexpr \w+ (\w+)\(|OCISAC_\w+\((\w+)\)", text))
    names = {name for pair in there for name in pair if name}
    assert used - names == {"greater", "less"}  # function objects, which it has
