"""Errors of input as text, and exit codes."""

from __future__ import annotations

import errno
import sys

import click

SOME_FAILED = 3


def input_errors() -> tuple[type[Exception], ...]:
    """Errors that input provokes, also by its size, with warnings under ``-W error``."""
    arrow = sys.modules.get("pyarrow")  # whose own errors are none of these
    errors = (click.ClickException, OSError, ValueError, ArithmeticError, MemoryError, Warning)
    return errors if arrow is None else (*errors, arrow.ArrowException)


def error_text(error: Exception) -> str:
    """The message of an error that input provokes; of the system's errors with the file's name."""
    if isinstance(error, MemoryError):
        return f"out of memory: {error}".removesuffix(": ")
    if isinstance(error, click.ClickException):
        return error.format_message()
    if isinstance(error, OSError):
        working = "working folder: " if error.errno == errno.ENOENT else ""  # of getcwd(), where it was removed
        name = working if error.filename is None else f"{error.filename}: "
        return name + (error.strerror or str(error))
    return str(error).removesuffix(" or None")  # an option is left out
