"""The reference is independent: it holds its own functions alone, and production code does not use it."""

import ast
import importlib
import inspect
import pathlib

import ocisac_fast
from ocisac_fast import reference

PACKAGE = pathlib.Path(ocisac_fast.__file__).parent


def imports_of(path: pathlib.Path) -> list[tuple[str, str]]:
    """(module, name) of every import; the name is empty for ``import module``."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            found += [(node.module or "", name.name) for name in node.names]
        elif isinstance(node, ast.Import):
            found += [(name.name, "") for name in node.names]
    return found


def test_the_reference_holds_only_what_it_defines() -> None:
    public = {name: value for name, value in vars(reference).items() if not name.startswith("_")}
    functions = {name: value for name, value in public.items() if not inspect.ismodule(value)}
    assert len(functions) > 25
    for name, value in functions.items():
        assert value.__module__.startswith("ocisac_fast.reference."), name
    for name, value in public.items():
        if name not in functions:
            assert value.__name__.startswith("ocisac_fast.reference."), name


def test_production_code_does_not_import_the_reference() -> None:
    for path in PACKAGE.rglob("*.py"):
        if path.parent != PACKAGE / "reference":
            for module, name in imports_of(path):
                assert not f"{module}.{name}".startswith("ocisac_fast.reference"), path


def test_the_reference_takes_only_types_and_constants_from_production_code() -> None:
    for path in (PACKAGE / "reference").glob("*.py"):
        for module, name in imports_of(path):
            if module.startswith("ocisac_fast") and not module.startswith("ocisac_fast.reference"):
                value = getattr(importlib.import_module(module), name)
                assert not inspect.isroutine(value), f"{path.name}: {module}.{name}"
                assert not inspect.ismodule(value), f"{path.name}: {module}.{name}"
