"""Receiver for optical camera communication and sensing (OC-ISAC).

``__init__.pyi`` lists the top-level names. Each is imported from its room on first access, which keeps
``import ocisac_fast`` fast, and lets the command line handle signals before anything is loaded.
"""

from __future__ import annotations

import functools
import importlib
import os


@functools.cache
def _rooms_by_name() -> dict[str, str]:
    """The room of each public name, from the import statements of the stub."""
    import ast

    with open(f"{os.path.splitext(__file__)[0]}.pyi", encoding="utf-8") as stub:
        imports = [node for node in ast.parse(stub.read()).body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


def __getattr__(name: str) -> object:
    value: object
    if name == "__version__":
        value = importlib.import_module("ocisac_fast._core").version()
    elif name == "__all__":
        value = sorted(_rooms_by_name())
    elif name in _rooms_by_name():
        value = getattr(importlib.import_module(_rooms_by_name()[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*_rooms_by_name(), "__version__"]
