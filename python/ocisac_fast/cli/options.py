"""Options that belong together: a class whose fields are options of the command line."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, TypeVar

import click

_Options = TypeVar("_Options")


def option(*names: str, **about: Any) -> Any:
    """A field of a dataclass that is an option, with the arguments of ``click.option``; without a command None."""
    return dataclasses.field(default=None, metadata={"option": click.option(*names, **about)})


def taken(kind: type[_Options], arguments: dict[str, Any]) -> _Options:
    """Remove the options of a class from a command's arguments."""
    fields: Any = dataclasses.fields(kind)  # type: ignore[arg-type]
    return kind(**{field.name: arguments.pop(field.name) for field in fields if field.name in arguments})


def options_of(kind: type[Any], name: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Add the options of a class to a command, and pass them to its function as one argument."""

    def added(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def wrapped(**arguments: Any) -> Any:
            return function(**{name: taken(kind, arguments)}, **arguments)

        for field in reversed(dataclasses.fields(kind)):
            wrapped = field.metadata.get("option", lambda same: same)(wrapped)
        return wrapped

    return added
