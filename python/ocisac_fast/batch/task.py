"""What is measured in every recording: a command of ``ocisac`` with its options."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import click

from ocisac_fast.batch.fields import FIELDS
from ocisac_fast.cli.command import taken
from ocisac_fast.cli.output import plain
from ocisac_fast.cli.pictures import PictureOptions
from ocisac_fast.core.checks import shown
from ocisac_fast.files import LightResponse, RecordingStream

IN_STRETCHES = ("gain", "detect")  # each frame has an answer of its own
# Output and input of a single call, and following from frame to frame, which stretches interrupt.
_NOT_FOR_MANY = ("plot", "as_json", "csv", "table", "sent", "per_column", "marks", "pulses", "force", "search_every")


@dataclass(frozen=True)
class Task:
    """What is measured in every recording.

    Args:
        command: ``"gain"``, ``"receive"``, ``"detect"``, ``"sense"``, ``"calibrate"`` or ``"clean"``.
        options: those of the command line with ``_`` for ``-``: ``{"frequency": "500Hz", "row_time": 22.2e-6}``; True
            for a flag, a list for an option that is repeated.

    Raises:
        ValueError: no such command, or an option or a value that it does not have.
    """

    command: str
    options: Mapping[str, Any]

    def __post_init__(self) -> None:
        if self.command not in FIELDS:
            raise ValueError(f"command: got {shown(self.command)}, allowed: {', '.join(FIELDS)}")
        try:
            arguments, picture = self.arguments()
            picture.camera(RecordingStream(iter(()), "array", LightResponse()))
            for name in () if self.command == "calibrate" else ("frequency", "chip_rate"):
                picture.check_frequency(f"--{name.replace('_', '-')}", arguments.get(name))
        except click.ClickException as error:
            raise ValueError(error.format_message()) from error

    @classmethod
    def from_words(cls, words: Sequence[str]) -> Task:
        """The task of a command line: ``["gain", "--frequency", "500Hz"]``."""
        if not words or words[0] not in FIELDS:
            raise ValueError(f"COMMAND: got {words[0] if words else 'none'}, allowed: {', '.join(FIELDS)}")
        command = _command(words[0])
        values, left, _ = command.make_parser(click.Context(command, info_name=words[0])).parse_args(list(words[1:]))
        if values.pop("help", False):
            context = click.Context(command, info_name=words[0])
            click.echo(command.get_help(context))
            context.exit()
        names = {argument.name for argument in command.params if isinstance(argument, click.Argument)}
        given = [value for name in names for value in _several(values.pop(name, None))]
        if given or left:
            raise ValueError(f"{words[0]}: got {[*given, *left][0]}, allowed: options (recordings stand before it)")
        for option in command.params:
            if option.name in _NOT_FOR_MANY and option.name in values:
                raise ValueError(
                    f"{words[0]}: got {option.opts[0]}, allowed: its other options (batch's stand before it)"
                )
        return cls(words[0], values)

    def arguments(self) -> tuple[dict[str, Any], PictureOptions]:
        """The command's arguments, converted, and apart from them the common options."""
        arguments = dict(_arguments(self.command, tuple(self._words())))
        return arguments, taken(PictureOptions, arguments)

    @property
    def picture(self) -> PictureOptions:
        """The common options."""
        return self.arguments()[1]

    def run(self, path: str, *, cleaned: str | None = None) -> None:
        """Run the command with ``--json``."""
        with _context(self.command, tuple(self._words()), path, cleaned) as context:
            context.command.invoke(context)

    def facts(self) -> dict[str, Any]:
        """The command and all its options, also those not given, as JSON."""
        arguments = _arguments(self.command, tuple(self._words()))
        options = {name: plain(value) for name, value in sorted(arguments.items()) if name not in _NOT_FOR_MANY}
        return {"command": self.command, "options": options}

    def _words(self) -> Iterator[str]:
        command = _command(self.command)
        known = {str(param.name): param for param in command.params if isinstance(param, click.Option)}
        allowed = [name for name in known if name not in _NOT_FOR_MANY]
        for name, value in self.options.items():
            if name not in allowed:
                raise ValueError(f"{self.command}: got option {name!r}, allowed: {', '.join(allowed)}")
            option = known[name]
            if option.is_flag:
                yield from [option.opts[0]] if value else []
                continue
            for each in _several(value) if option.multiple else [value]:
                yield from (option.opts[0], _text(each))


@lru_cache(maxsize=8)  # of one task, which a worker parses once
def _arguments(command: str, words: tuple[str, ...]) -> Mapping[str, Any]:
    params = _context(command, words, "recording", None).params
    return {name: value for name, value in params.items() if name not in ("file", "files", "source", "target")}


def _context(command: str, words: Sequence[str], path: str, cleaned: str | None) -> click.Context:
    targets = [cleaned or "cleaned.mkv"] if command == "clean" else []
    return _command(command).make_context(command, [*words, "--json", "--", path, *targets])


def _command(name: str) -> click.Command:
    command = getattr(importlib.import_module(f"ocisac_fast.cli.{name}"), name)
    assert isinstance(command, click.Command)
    return command


def _several(value: Any) -> Sequence[Any]:
    """A list of a word, of a list, or of what click's parser puts in place of a missing argument."""
    if isinstance(value, str):
        return (value,)
    return value if isinstance(value, (list, tuple)) else ()


def _text(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return ",".join(_text(each) for each in value)
    return str(value)
