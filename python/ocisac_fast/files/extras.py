"""Optional libraries for files, imported when a file is read or written."""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

from ocisac_fast.files.recording import FileError

NO_THREAD = "this machine starts no further thread"
_MOST_BYTES = 1 << 30  # of a packet


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
        return called(pyav().open, _Read(file), format=container, options={"protocol_whitelist": ""})


class _Call(threading.local):
    """A thread's call of FFmpeg: bytes read, what reading raised, and exceptions that Python reports as ignored.

    PyAV ignores one that a signal's handler raises as a read or a seek begins, which FFmpeg takes for the film's end.
    """

    def __init__(self) -> None:
        self.count = 0
        self.error: BaseException | None = None
        self.reports: list[sys.UnraisableHookArgs] = []

    def stop(self) -> BaseException | None:
        ignored = (report.exc_value for report in self.reports if not isinstance(report.exc_value, Exception))
        return self.error or next(ignored, None)

    def is_endless(self) -> bool:
        """True if the call read more bytes than any packet has, and was given no more."""
        return self.count > _MOST_BYTES


call = _Call()


def called(function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
    """The result of a call of FFmpeg that may read; raises what its reads raised, whatever FFmpeg made of it."""
    call.count = 0
    hooks = sys.unraisablehook, sys.excepthook
    is_main = threading.current_thread() is threading.main_thread()  # which alone handles signals
    try:
        if is_main:  # functions in C, which no further signal breaks off; the second would print what the first keeps
            sys.unraisablehook, sys.excepthook = call.reports.append, "".format
        return function(*arguments, **options)
    finally:
        if is_main:
            sys.unraisablehook, sys.excepthook = hooks
        reports, stop = call.reports, call.stop()
        call.reports, call.error = [], None
        for report in reports:
            if isinstance(report.exc_value, Exception):
                hooks[0](report)
        if stop is not None:
            raise stop from None


def steps(items: Iterator[Any]) -> Iterator[Any]:
    """Packets or frames of FFmpeg, each by one call."""
    return iter(lambda: called(next, items, None), None)


class _Read:
    """A file as PyAV reads it."""

    def __init__(self, file: Any) -> None:
        self._file = file

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def read(self, size: int) -> bytes:
        try:
            data: bytes = b"" if call.stop() or call.is_endless() else self._file.read(size)  # FFmpeg reads on
            call.count += len(data)
            return data
        except BaseException as error:
            call.error = error
            return b""


@contextlib.contextmanager
def ffmpeg() -> Iterator[None]:
    """Within this, lacks of the machine, which are no fault of a file, are none of FFmpeg's errors.

    Raises:
        MemoryError, OSError: too little memory, too few threads.
    """
    try:
        yield
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
