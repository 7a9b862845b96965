"""The map of the code holds: each room knows only rooms before it, nothing goes in a circle, no room takes over."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "python" / "ocisac_fast"
INCLUDE = ROOT / "cpp" / "include"
ARCHITECTURE = ROOT / "docs" / "reference" / "architecture.md"
ROOMS = re.findall(r"^\| `(\w+)` \|", ARCHITECTURE.read_text(encoding="utf-8"), re.MULTILINE)
PUBLIC_HEADERS = (ROOT / "cpp" / "public_headers.txt").read_text().split()

Arrows = dict[str, set[str]]  # what a module needs, by name


def includes(path: Path) -> list[str]:
    return re.findall(r'^#include "([^"]+)"', path.read_text(encoding="utf-8"), re.MULTILINE)


def cpp_files() -> Iterator[Path]:
    for folder in (INCLUDE / "ocisac", ROOT / "cpp" / "src"):
        yield from sorted(path for path in folder.rglob("*.?pp"))


def cpp_arrows() -> Arrows:
    """Arrows between files, named room/file: a header and its source may know others of their room in turn."""
    arrows: Arrows = {}
    for path in cpp_files():
        top = INCLUDE / "ocisac" if path.is_relative_to(INCLUDE) else ROOT / "cpp" / "src"
        needed = {i.removeprefix("ocisac/") for i in includes(path)} - {"ocisac.h"}
        arrows[path.relative_to(top).as_posix()] = needed
    return arrows


def binding_arrows() -> Arrows:
    """Bindings know the rooms of the core and each other; bindings.hpp and module.cpp serve all of them."""
    arrows: Arrows = {}
    for path in sorted((ROOT / "python" / "bindings").glob("*.?pp")):
        if path.stem not in ("bindings", "module"):
            needed = {i.removeprefix("ocisac/") if "/" in i else f"{Path(i).stem}/" for i in includes(path)}
            arrows.setdefault(f"{path.stem}/", set()).update(needed - {"bindings/", f"{path.stem}/"})
    return arrows


def python_module(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return "/".join(part for part in parts if part != "__init__") or "ocisac_fast"


def imported(path: Path) -> set[str]:
    """Modules of the package that a module imports, wherever the statement stands: lazy imports count as well."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        found |= {name.removeprefix("ocisac_fast.") for name in names if name.startswith("ocisac_fast.")}
    return found


def python_arrows() -> Arrows:
    modules = {python_module(path): path for path in sorted(PACKAGE.rglob("*.py"))}

    def module_of(name: str) -> str | None:
        parts = name.split(".")
        return next((m for n in range(len(parts), 0, -1) if (m := "/".join(parts[:n])) in modules), None)

    return {
        name: {module for i in imported(path) if (module := module_of(i)) not in (None, name)}
        for name, path in modules.items()
    }


ARROWS = {"C++": cpp_arrows(), "bindings": binding_arrows(), "Python": python_arrows()}


def room(module: str) -> str:
    return module.partition("/")[0]


def circle(arrows: Arrows) -> list[str]:
    try:
        TopologicalSorter(arrows).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


@pytest.mark.parametrize("language", ARROWS)
def test_every_module_has_its_room(language):
    rooms = {room(module) for module in ARROWS[language]} - {"ocisac_fast"}
    assert rooms <= set(ROOMS)


@pytest.mark.parametrize("language", ARROWS)
def test_a_room_knows_only_rooms_before_it(language):
    order = {name: place for place, name in enumerate([*ROOMS, "ocisac_fast"])}
    against = {
        f"{module} → {other}"
        for module, needed in ARROWS[language].items()
        for other in needed
        if order.get(room(other), -1) > order[room(module)]
    }
    assert not against


@pytest.mark.parametrize("language", ARROWS)
def test_nothing_goes_round_in_a_circle(language):
    assert not circle(ARROWS[language])


def test_arrows_and_circles_are_seen():
    assert "light/waveforms" in ARROWS["Python"]["scene/signals"]
    assert "core/require.hpp" in ARROWS["C++"]["camera/camera.cpp"]
    assert "packets/" in ARROWS["bindings"]["receiver/"]
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"a"}})


@pytest.mark.parametrize(("folder", "suffix"), [(ROOT / "cpp" / "src", "?pp"), (PACKAGE, "py")], ids=["C++", "Python"])
def test_no_room_holds_more_than_a_quarter(folder, suffix):
    lines: dict[str, int] = {}
    for path in folder.rglob(f"*.{suffix}"):
        name = room(str(path.relative_to(folder)))
        lines[name] = lines.get(name, 0) + len(path.read_text(encoding="utf-8").splitlines())
    total = sum(lines.values())
    assert {name: count for name, count in lines.items() if count > total / 4} == {}


def test_public_headers_are_what_bindings_and_programs_include():
    users = [*(ROOT / "python" / "bindings").glob("*.?pp"), *(ROOT / "cpp" / "apps").glob("*.?pp")]
    included = {i for path in users for i in includes(path) if i.startswith("ocisac/")}
    assert sorted(included | {"ocisac/ocisac.h"}) == PUBLIC_HEADERS


def test_installed_headers_are_what_public_headers_reach():
    reached: set[str] = set()
    pending = list(PUBLIC_HEADERS)
    while pending:
        header = pending.pop()
        if header not in reached:
            reached.add(header)
            pending += includes(INCLUDE / header)
    installed = {str(path.relative_to(INCLUDE)) for path in INCLUDE.rglob("*.h*")}
    assert installed == reached


def types_for_all(source: str) -> Iterator[str]:
    """Names of the types that a C++ source defines at the top of namespaces that have names."""
    scopes: list[str] = []
    token = (
        r'//[^\n]*|"(?:\\.|[^"\\\n])*"|\bnamespace\b[^{;=]*\{|'
        r"(?<![<,] )\b(?:struct|class) (\w+)(?!::)\b[^;{()<>]*\{|[{}]"
    )
    for match in re.finditer(token, source):
        text = match[0]
        if match[1] and all(scope.startswith("namespace ") and "kernels" not in scope for scope in scopes):
            yield match[1]
        if text.startswith("namespace"):
            scopes.append("namespace " + " ".join(text[:-1].split()[1:]) if text[9:-1].strip() else "unnamed")
        elif text.endswith("{"):
            scopes.append("block")
        elif text == "}":
            scopes.pop()


def test_a_type_has_one_definition():
    """Two types of one name break C++'s rule of one definition: an inline function of the one runs for the other."""
    assert list(types_for_all("namespace a {\nstruct B { struct C { }; };\nnamespace {\nclass D { };\n}\n}")) == ["B"]
    where: dict[str, set[str]] = {}
    for path in cpp_files():
        for name in types_for_all(path.read_text(encoding="utf-8")):
            where.setdefault(name, set()).add(path.name)
    assert {name: sorted(files) for name, files in where.items() if len(files) > 1} == {}
