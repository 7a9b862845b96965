"""Files that commands write: never over an input, and over other files only with ``--force``."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterator
from typing import Any

import click

_INPUTS = ("file", "files", "source", "scene", "unlit")


def writes(*names: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Add ``--force`` to a command whose parameters ``names``, and tables, are files that it writes."""

    def decorated(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def wrapped(*, force: bool, **arguments: Any) -> Any:
            for name in (*names, "csv", "table"):
                if arguments[name] is not None:
                    _check(name, arguments[name], list(_inputs(arguments)), force)
            return function(**arguments)

        return click.option("--force", is_flag=True, help="Replace files that exist.")(wrapped)

    return decorated


def _inputs(arguments: dict[str, Any]) -> Iterator[str]:
    for name in _INPUTS:
        value = arguments.get(name)
        yield from value if isinstance(value, tuple) else () if value is None else (value,)


def _check(name: str, path: str, inputs: list[str], force: bool) -> None:
    if not os.path.isfile(path):  # devices and pipes are written to
        return
    if any(os.path.isfile(one) and os.path.samefile(one, path) for one in inputs):
        raise click.UsageError(f"{_label(name)}: got {path}, which is read, allowed: another file")
    if not force:
        raise click.UsageError(f"{_label(name)}: got {path}, which exists, allowed: a new file, or --force")


def _label(name: str) -> str:
    """The parameter as it is written: ``--plot``, or ``OUT``."""
    command = click.get_current_context().command
    param = next(param for param in command.params if param.name == name)
    return str(param.metavar) if isinstance(param, click.Argument) else param.opts[-1]
