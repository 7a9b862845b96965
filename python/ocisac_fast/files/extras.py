"""Optional libraries for files, imported when a file is read or written."""

from __future__ import annotations

import importlib
from typing import Any

from ocisac_fast.files.recording import FileError


def _library(module: str, name: str, extra: str = "files") -> Any:
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise FileError(f"needs {name}: pip install 'ocisac-fast[{extra}]'") from error


def pillow() -> Any:
    """``PIL.Image``."""
    return _library("PIL.Image", "Pillow")


def pyav() -> Any:
    """``av``."""
    return _library("av", "PyAV")


def fsspec() -> Any:
    """``fsspec``."""
    return _library("fsspec", "fsspec", "cli")


def pyarrow(module: str = "pyarrow") -> Any:
    """``pyarrow`` or a module of it."""
    return _library(module, "pyarrow", "cli")
