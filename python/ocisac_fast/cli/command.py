"""Commands from functions: each parameter is stated once, with its type, its sentence and its default.

``Annotated[float, "Bright share of a square wave."]`` is an option, ``Annotated[str, INPUT]`` before the ``*`` an
argument. Beside the type of Python stand a type of click where it tells more, a sentence, and a dictionary of what else
click is to know. Options that belong together are fields of a class, which the function takes as one argument.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import os
import types
import typing
from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal, TypeVar

import click

from ocisac_fast.cli.output import table_of_objects
from ocisac_fast.cli.outputs import OUTPUT, checked_outputs
from ocisac_fast.core.checks import one_of
from ocisac_fast.files.extras import pyarrow, savemat

_Options = TypeVar("_Options")


def command(function: Callable[..., None], kind: type[click.Command] = click.Command) -> click.Command:
    """A command with the parameters of a function, whose docstring is its help.

    It has ``--force`` for its outputs and ``--json``, and ``--table FILE`` for the same objects as rows; all of these
    give the function ``as_json``.
    """
    hints = typing.get_type_hints(function)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if dataclasses.is_dataclass(hint)}

    @functools.wraps(function)
    def called(**arguments: Any) -> None:
        asked = taken(_Output, arguments)
        paths = [path for path in (asked.csv, asked.table) if path is not None]
        own = {name: taken(group, arguments) for name, group in groups.items()}
        with checked_outputs(asked.force), table_of_objects(paths, asked.as_json):
            function(as_json=asked.as_json or bool(paths), **own, **arguments)

    params = [*_parameters_of(function), *_parameters_of(_Output)]
    name, text = function.__name__, inspect.getdoc(function)
    return kind(name, callback=called, params=params, help=text)


def taken(kind: type[_Options], arguments: dict[str, Any]) -> _Options:
    """Remove the options of a class from a command's arguments."""
    fields: Any = dataclasses.fields(kind)  # type: ignore[arg-type]
    return kind(**{field.name: arguments.pop(field.name) for field in fields if field.name in arguments})


def _table_path(ctx: click.Context, param: click.Parameter, path: str | None) -> str | None:
    """The path of a table, of a kind that can be written: its library is there before any work is done."""
    libraries = {".parquet": pyarrow, ".mat": savemat}
    allowed = [".csv"] if param.name == "csv" else [".csv", *libraries]
    suffix = os.path.splitext(str(path))[1].lower()
    if path not in (None, "-") and suffix not in allowed:
        option = "" if param.name != "csv" else " (--table writes .parquet and .mat)"
        raise click.UsageError(f"--{param.name}: got {path}, allowed: a name that ends with {one_of(allowed)}{option}")
    if suffix in libraries:
        libraries[suffix]()
    return path


_TABLE: dict[str, Any] = {"metavar": "FILE", "callback": _table_path}


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Output:
    """Options of all commands; ``csv`` is ``table`` with .csv alone."""

    force: Annotated[bool, "Replace files that exist."] = False
    as_json: Annotated[bool, {"names": ["--json"]}, "Print one JSON object per line, nothing else."] = False
    csv: Annotated[str | None, OUTPUT, _TABLE, {"hidden": True}] = None
    table: Annotated[str | None, OUTPUT, _TABLE, "Write it as .csv, .parquet or .mat; -: print CSV."] = None


def _parameters_of(made: Callable[..., Any]) -> Iterator[click.Parameter]:
    hints = typing.get_type_hints(made, include_extras=True)
    for parameter in inspect.signature(made).parameters.values():
        hint = hints[parameter.name]
        if dataclasses.is_dataclass(hint):
            yield from _parameters_of(hint)  # type: ignore[arg-type]
        elif typing.get_origin(hint) is Annotated:
            yield _parameter(parameter, *typing.get_args(hint))


def _parameter(parameter: inspect.Parameter, kind: Any, *about: Any) -> click.Parameter:
    given = _usual(kind)
    for each in about:
        given |= {"help": each} if isinstance(each, str) else each if isinstance(each, dict) else {"type": each}
    is_required, default = parameter.default is parameter.empty, parameter.default
    if parameter.kind is not parameter.KEYWORD_ONLY:
        return click.Argument([parameter.name], required=is_required, **given)
    if not is_required and default not in (None, ()):
        given["default"] = default
    given = {"required": is_required and "default" not in given, "show_default": "default" in given, **given}
    return click.Option([*given.pop("names", [f"--{parameter.name.replace('_', '-')}"]), parameter.name], **given)


def _usual(kind: Any) -> dict[str, Any]:
    """Convert a type of Python to arguments of click; ``| None`` is an option that may be left out."""
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        kind, *_ = (one for one in typing.get_args(kind) if one is not type(None))
    if typing.get_origin(kind) is Literal:
        return {"type": click.Choice(typing.get_args(kind))}
    if kind is bool:
        return {"is_flag": True}
    return {"type": kind} if kind in (int, float, str) else {}
