"""What is measured in every recording: a command of ``ocisac`` with its options."""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import click

from ocisac_fast.batch.fields import FIELDS
from ocisac_fast.batch.recordings import content_hash, present_state, require_file
from ocisac_fast.cli.command import taken
from ocisac_fast.cli.output import collected_objects, plain
from ocisac_fast.cli.outputs import InputFile, OutputFile, given_paths, label
from ocisac_fast.cli.pictures import PictureOptions, open_pictures
from ocisac_fast.core.checks import shown
from ocisac_fast.files import LightResponse, RecordingStream
from ocisac_fast.files.reading import STANDARD_INPUT
from ocisac_fast.files.remote import absolute, is_remote

IN_STRETCHES = ("gain", "detect")  # each frame has an answer of its own
# Beside outputs: what is of a single call, and following from frame to frame, which stretches interrupt.
_NOT_FOR_MANY = ("as_json", "sent", "pulses", "force", "search_every")


@dataclass(frozen=True)
class Task:
    """What is measured in every recording.

    Args:
        command: ``"gain"``, ``"receive"``, ``"detect"``, ``"sense"``, ``"calibrate"`` or ``"clean"``.
        options: those of the command line with ``_`` for ``-``: ``{"frequency": "500Hz", "row_time": 22.2e-6}``; True
            for a flag, a list for an option that is repeated. Paths of files become absolute.

    Raises:
        ValueError: no such command, or an option or a value that it does not have.
        OSError: a file among the options, which all recordings share, cannot be read.
    """

    command: str
    options: Mapping[str, Any]
    _states: dict[str, str] = field(init=False, repr=False, default_factory=dict)  # of those files, by option

    def __post_init__(self) -> None:
        if self.command not in FIELDS:
            raise ValueError(f"command: got {shown(self.command)}, allowed: {', '.join(FIELDS)}")
        try:
            arguments, picture = self.arguments()
            picture.camera(RecordingStream(iter(()), "array", LightResponse()))
            for name in () if self.command == "calibrate" else ("frequency", "chip_rate"):
                picture.check_frequency(f"--{name.replace('_', '-')}", arguments.get(name))
            inputs = {
                str(option.name): _opened(option, path, picture)
                for option, path in given_paths(self.context, InputFile)
            }
        except click.ClickException as error:
            raise ValueError(error.format_message()) from error
        object.__setattr__(self, "options", {**self.options, **inputs})
        self._states.update({name: _state(path) for name, path in inputs.items()})

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
        known = _for_many(command)
        for option in command.params:
            if option.name in values and option.name not in known:
                raise ValueError(
                    f"{words[0]}: got {option.opts[0]}, allowed: its other options (batch's stand before it)"
                )
        return cls(words[0], values)

    def arguments(self) -> tuple[dict[str, Any], PictureOptions]:
        """The command's arguments, converted, and apart from them the common options."""
        arguments = dict(self.context.params)
        return arguments, taken(PictureOptions, arguments)

    @property
    def context(self) -> click.Context:
        """The command with its options, without those of a single call."""
        return _without_recording(self.command, tuple(self._words()))

    @property
    def picture(self) -> PictureOptions:
        """The common options."""
        return self.arguments()[1]

    @property
    def inputs(self) -> list[str]:
        """Files that are read beside each recording."""
        return [self.options[name] for name in self._states]

    def require_inputs(self) -> None:
        """Raise ValueError where one of ``inputs`` is not as it was when this was made."""
        for name, state in self._states.items():
            if _state(self.options[name]) != state:
                raise ValueError(
                    f"--{name}: got {self.options[name]}, which changed meanwhile, allowed: the same for all recordings"
                )

    def run(self, path: str, *, cleaned: str | None = None) -> None:
        """Run the command with ``--json``; an exit code of its own, such as without a light, has its rows."""
        with (
            contextlib.suppress(click.exceptions.Exit),
            _context(self.command, tuple(self._words()), path, cleaned) as context,
        ):
            context.command.invoke(context)

    def facts(self) -> dict[str, Any]:
        """The command and all its options, also those not given, as JSON, and states of files among them."""
        options = {name: plain(value) for name, value in sorted(self.context.params.items())}
        states = {f"{name}_state": state for name, state in self._states.items()}
        return {"command": self.command, "options": {**options, **states}}

    def _words(self) -> Iterator[str]:
        known = _for_many(_command(self.command))
        for name, value in self.options.items():
            if name not in known:
                raise ValueError(f"{self.command}: got option {name!r}, allowed: {', '.join(known)}")
            option = known[name]
            if option.is_flag:
                yield from [option.opts[0]] if value else []
                continue
            for each in _several(value) if option.multiple else [value]:
                yield from (option.opts[0], _text(each))


def _for_many(command: click.Command) -> dict[str, click.Option]:
    """Options that all recordings may share, by name."""
    every = (param for param in command.params if isinstance(param, click.Option))
    return {str(one.name): one for one in every if not (one.name in _NOT_FOR_MANY or isinstance(one.type, OutputFile))}


def _opened(option: click.Parameter, path: str, picture: PictureOptions) -> str:
    """The absolute path of a recording that is read beside each other one; opened once, before any is measured."""
    if path == STANDARD_INPUT:
        raise click.UsageError(f"{label(option)}: got -, allowed: a file, which is read for each recording")
    whole = path if is_remote(path) else absolute(path)
    require_file(whole)
    with collected_objects(), open_pictures(whole, picture, axis_of_light=False):
        return whole


def _state(path: str) -> str:
    return present_state(path) or str(content_hash(path))


@lru_cache(maxsize=8)  # of one task, which a worker parses once
def _without_recording(command: str, words: tuple[str, ...]) -> click.Context:
    context = _context(command, words, "recording", None)
    known = _for_many(context.command)
    context.params = {name: value for name, value in context.params.items() if name in known}
    return context


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
