"""The group of commands, imported on demand, and the conversion of errors to one line and an exit code."""

from __future__ import annotations

import _thread
import contextlib
import difflib
import functools
import importlib
import os
import signal
import sys
import time
import warnings
from collections.abc import Callable
from typing import Any

import click
from click.shell_completion import CompletionItem, shell_complete

from ocisac_fast import __version__
from ocisac_fast.cli.errors import error_text, input_errors
from ocisac_fast.cli.text import one_line, write_any_text
from ocisac_fast.core.checks import shown

_COMMANDS = {
    "calibrate": "Row time of a camera, from a light of known frequency.",
    "gain": "Gain of a tone in a recording, and its theoretical value.",
    "exposure": "Best exposure time for communication and sensing, or without bands of lights.",
    "flicker": "Flicker indices of IEEE P2020 for lamps and exposures.",
    "lamp": "Frequencies, duties and chip rates of a lamp for given exposures.",
    "locate": "Position of the camera from lights at known places.",
    "receive": "Bits of the lights in a recording.",
    "transmit": "Chips that carry a payload.",
    "detect": "Modulated lights in a recording.",
    "sense": "Moving textures and lights in a recording: gain, motion, speed.",
    "clean": "The picture without the light's bands, or the bands alone.",
    "batch": "One command for many recordings, on all processors or a cluster.",
    "simulate": "Simulate a recording of a modulated light.",
    "info": "Versions, build and processor features.",
    "demo": "The paper's testbed from recording to result, with a picture.",
}
# Commands that run other commands live in a room after this one.
_ROOM_OF = {"batch": "ocisac_fast.batch.command"}


_PAUSE = 0.01  # s
_COMPLETION = "_OCISAC_COMPLETE"  # variable of click's scripts: bash_source, bash_complete, zsh_source, ...


class _LazyGroup(click.Group):
    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0].lower() not in _COMMANDS and not ctx.resilient_parsing:
            near = difflib.get_close_matches(args[0].lower(), _COMMANDS, 1)
            allowed = near[0] if near else ", ".join(_COMMANDS)
            raise click.UsageError(f"command: got {shown(args[0])}, allowed: {allowed}")
        return super().resolve_command(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        module = _ROOM_OF.get(cmd_name, f"ocisac_fast.cli.{cmd_name}")
        command = getattr(importlib.import_module(module), cmd_name)
        assert isinstance(command, click.Command)
        command.short_help = _COMMANDS[cmd_name]
        return command

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Commands with their descriptions, without an import of their modules, and options."""
        begun = [name for name in _COMMANDS if name.startswith(incomplete.lower())]
        options = click.Command.shell_complete(self, ctx, incomplete)
        return [CompletionItem(name, help=_COMMANDS[name]) for name in begun] + options

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))


@click.group(
    cls=_LazyGroup,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "token_normalize_func": str.lower},
)
@click.version_option(__version__, message="ocisac %(version)s", help="Show the version.")
@click.pass_context
def ocisac(ctx: click.Context) -> None:
    """Receiver for optical camera communication and sensing with a rolling shutter.

    Times and frequencies take units: 9.2us, 1/8000s, 4.95kHz; plain numbers are seconds and Hz.
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


def run(arguments: list[str], command: click.Command = ocisac) -> int:
    """Run a command; errors are one line on standard error. The exit code is that of ``ocisac_fast.cli.main``."""
    warnings.showwarning = _warn
    write_any_text()
    before, hook = {}, sys.unraisablehook
    sys.unraisablehook = functools.partial(_interrupt_again, hook)
    with contextlib.suppress(ValueError):  # not the main thread: no signal handlers
        for number in (signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) == signal.SIG_DFL:  # not under nohup
                before[number] = signal.signal(number, _stop)
    try:
        return _run(arguments, command)
    finally:
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)


class _Terminated(KeyboardInterrupt):
    """SIGTERM or SIGHUP as an interrupt: incomplete files are removed during unwinding."""


def _stop(number: int, _: Any) -> None:
    raise _Terminated(number)


def _interrupt_again(usual: Callable[[Any], object], ignored: Any) -> None:
    """Send a signal again whose exception Python ignores in the function that each import calls at its end."""
    error = ignored.exc_value
    if not (isinstance(error, KeyboardInterrupt) and "_get_module_lock" in getattr(ignored.object, "__qualname__", "")):
        usual(ignored)
        return
    number = int(error.args[0]) if error.args else signal.SIGINT
    _thread.start_new_thread(_send, (number,))  # after this function, in which it would be ignored too


def _send(number: int) -> None:
    time.sleep(_PAUSE)
    os.kill(os.getpid(), number)


def _run(arguments: list[str], command: click.Command) -> int:
    try:
        try:
            if instruction := os.environ.get(_COMPLETION):
                try:
                    return shell_complete(command, {}, str(command.name), _COMPLETION, instruction)
                except KeyError as missing:
                    lack = f"{missing.args[0]}: not set, allowed: {_COMPLETION} by a shell's script alone"
                    raise click.ClickException(lack) from None
            with command.make_context(command.name, list(arguments)) as context:
                command.invoke(context)
        finally:
            sys.stdout.flush()
        return 0
    except click.exceptions.Exit as done:
        return done.exit_code
    except _Terminated as stopped:
        return 128 + int(stopped.args[0])
    except (KeyboardInterrupt, click.Abort):
        return 130
    except BrokenPipeError:
        return 141
    except input_errors() as error:
        return _fail(command, _as_written(error_text(error), arguments, command))


# Arguments of Python that options have under another name.
_OPTION_OF = {"f_comm": "comm", "f_sense": "sense", "min_gain": "keep", "exposure_spread": "spread"}


def _as_written(message: str, arguments: list[str], command: click.Command) -> str:
    """A message about an argument of Python, ``f_comm: got``, as one about the option that gave it, ``--comm: got``."""
    name, colon, rest = message.partition(": got ")
    if isinstance(command, click.Group) and arguments:
        command = command.get_command(click.Context(command), arguments[0].lower()) or command
    for param in command.params:
        if colon and isinstance(param, click.Option) and param.name == _OPTION_OF.get(name, name):
            return f"{param.opts[-1]}{colon}{rest}"
    return message


def _fail(command: click.Command, message: str) -> int:
    print(f"{command.name}:", one_line(message), file=sys.stderr)
    return 2


def _warn(message: Warning | str, *_: Any, **__: Any) -> None:
    print("ocisac: warning:", one_line(str(message)), file=sys.stderr)
