"""Optional libraries for files, imported when a file is read or written."""

from __future__ import annotations

import contextlib
import importlib
import os
from collections.abc import Iterator
from typing import Any

from ocisac_fast.files.recording import FileError

NO_THREAD = "this machine starts no further thread"


def _library(module: str, name: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        if isinstance(error.__cause__, KeyboardInterrupt):
            raise error.__cause__ from None
        if isinstance(error, ModuleNotFoundError):
            raise FileError(f"needs {name}: pip install {name}") from error
        raise FileError(f"{name} cannot be loaded: {error}") from error


def pillow() -> Any:
    """``PIL.Image``."""
    return _library("PIL.Image", "pillow")


def pyav() -> Any:
    """``av``."""
    return _library("av", "av")


def opened_video(file: Any, container: str | None = None) -> Any:
    """A container of FFmpeg, which gets bytes and never a name: it would read one as a URL, and open others itself."""
    with ffmpeg():
        return pyav().open(_Read(file), format=container, options={"protocol_whitelist": ""})


class _Interrupted(Exception):
    pass


class _Read:
    """A file as PyAV reads it, which hands on exceptions, but drops what is none, such as KeyboardInterrupt."""

    def __init__(self, file: Any) -> None:
        self._file = file
        self._interrupted = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def read(self, size: int) -> bytes:
        try:
            return b"" if self._interrupted else self._file.read(size)
        except Exception:
            raise
        except BaseException as stop:
            self._interrupted = True  # FFmpeg reads on before PyAV raises
            raise _Interrupted from stop


@contextlib.contextmanager
def ffmpeg() -> Iterator[None]:
    """Within this, interrupts and lacks of the machine, which are no fault of a file, are none of FFmpeg's errors.

    Raises:
        MemoryError, OSError: too little memory, too few threads.
    """
    try:
        yield
    except _Interrupted as interrupted:
        raise interrupted.__cause__ from None  # type: ignore[misc]
    except pyav().MemoryError as error:
        raise MemoryError from error
    except pyav().BlockingIOError as error:
        raise OSError(error.errno, NO_THREAD) from error


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


def matplotlib(module: str = "matplotlib") -> Any:
    """``matplotlib`` or a module of it."""
    return _library(module, "matplotlib")


def savemat() -> Any:
    """``scipy.io.savemat``."""
    return _library("scipy.io", "scipy").savemat
