"""Optional libraries for files, imported when a file is read or written."""

from __future__ import annotations

import importlib
import os
from typing import Any, BinaryIO

from ocisac_fast.files.recording import FileError


def _library(module: str, name: str) -> Any:
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise FileError(f"needs {name}: pip install {name}") from error


def pillow() -> Any:
    """``PIL.Image``."""
    return _library("PIL.Image", "pillow")


def pyav() -> Any:
    """``av``."""
    return _library("av", "av")


def opened_video(file: BinaryIO, container: str | None = None) -> Any:
    """A container of FFmpeg, which gets bytes and never a name: it would read one as a URL, and open others itself."""
    return pyav().open(file, format=container, options={"protocol_whitelist": ""})


def fsspec() -> Any:
    """``fsspec``."""
    try:
        return _library("fsspec", "fsspec")
    except FileError:
        raise
    except Exception as error:  # of its configuration, which it reads as it is imported
        folder = os.environ.get("FSSPEC_CONFIG_DIR", "~/.config/fsspec")
        raise FileError(f"{folder}: fsspec's configuration cannot be read: {error}") from error


def pyarrow(module: str = "pyarrow") -> Any:
    """``pyarrow`` or a module of it."""
    return _library(module, "pyarrow")


def savemat() -> Any:
    """``scipy.io.savemat``."""
    return _library("scipy.io", "scipy").savemat
