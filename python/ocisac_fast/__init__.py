"""Receiver for optical camera communication and sensing (OC-ISAC).

``__init__.pyi`` lists the top-level names. Each is imported from its room on first access, which keeps
``import ocisac_fast`` fast.
"""

from __future__ import annotations

import ast
import importlib
from pathlib import Path
from typing import Any

from ocisac_fast._core import version as _version

__version__ = _version()


def _rooms_by_name() -> dict[str, str]:
    """The room of each public name, from the import statements of the stub."""
    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


_ROOM_OF = _rooms_by_name()
__all__ = sorted(_ROOM_OF)


def __getattr__(name: str) -> Any:
    if name not in _ROOM_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_ROOM_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
