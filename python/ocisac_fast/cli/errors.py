"""Errors that input provokes, and exit codes."""

from __future__ import annotations

import click

SOME_FAILED = 3
INPUT_ERRORS = (click.ClickException, OSError, ValueError, ArithmeticError, Warning)  # the last: under `-W error`


def error_text(error: Exception) -> str:
    """The message of an error that input provokes; of the system's errors with the file's name."""
    if isinstance(error, click.ClickException):
        return error.format_message()
    if isinstance(error, OSError):
        name = f"{error.filename}: " if error.filename is not None else ""
        return name + (error.strerror or str(error))
    return str(error).removesuffix(" or None")  # an option is left out
