"""Files that commands read and write: inputs never replaced, and other files only with ``--force``."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import click

from ocisac_fast.files.extras import matplotlib
from ocisac_fast.files.raw import read_whole, standard_input
from ocisac_fast.files.reading import name_of
from ocisac_fast.files.recording import FileError, naming
from ocisac_fast.files.remote import local_part
from ocisac_fast.files.writing import fixed_outputs

_STANDARD = "-"  # input or output
_HERE = os.path.dirname(__file__)
_SETTINGS: tuple[str, ...] = ("$MATPLOTLIBRC", "$MATPLOTLIBRC/matplotlibrc", "$MPLCONFIGDIR/matplotlibrc")
_SETTINGS += ("$XDG_CONFIG_HOME/matplotlib/matplotlibrc", "~/.config/matplotlib/matplotlibrc")  # of matplotlib


class _Named(click.Path):
    kind = "file"

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        if not os.fspath(value):
            raise click.UsageError(f"{label(param)}: got no name, allowed: a {self.kind}")
        return super().convert(value, param, ctx)


class InputFile(_Named):
    """A file that a command reads; checked where it is opened."""

    def files(self, path: str | os.PathLike[str]) -> Iterable[str | os.PathLike[str]]:
        """The files that a path stands for."""
        return (local_part(os.fspath(path)),)


class OutputFile(_Named):
    """A file that a command writes."""


class OutputFolder(_Named):
    """A folder that a command writes into."""

    kind = "folder"


PLOTS = "PNG, PDF or SVG"
INPUT, OUTPUT = InputFile(readable=False), OutputFile(dir_okay=False, readable=False)


def read_input(path: str | os.PathLike[str]) -> bytes:
    """All of a file that is no recording, or of standard input.

    Raises:
        FileError: more than 64 MiB.
    """
    with naming(name_of(path), None), contextlib.ExitStack() as opened:
        is_standard = os.fspath(path) == _STANDARD
        return read_whole(standard_input() if is_standard else opened.enter_context(open(path, "rb")))


def draw(path: str | None, plot: str, *given: Any, **options: Any) -> None:
    """Draw a plot of ``ocisac_fast.plots`` to a file; nothing is imported where none is asked for."""
    if path is not None:
        from ocisac_fast import plots

        import_matplotlib()
        getattr(plots, plot)(*given, path=path, **options)


def import_matplotlib() -> None:
    """Import it without reading a matplotlibrc of the working folder, which may be a stranger's, or a pipe.

    Raises:
        FileError: its settings or its list of fonts are a pipe or a device, which would be read without an end.
    """
    _require_end(os.path.expanduser(os.path.expandvars(path)) for path in _SETTINGS)
    is_there = os.path.lexists("matplotlibrc")
    with contextlib.chdir(_HERE) if is_there else contextlib.nullcontext():
        cache = matplotlib().get_cachedir()
    _require_end(Path(cache).glob("fontlist-*.json"))


def _require_end(paths: Iterable[str | Path]) -> None:
    for path in paths:
        if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
            raise FileError(f"{path}: a pipe or device, allowed: a file, or none")


@contextlib.contextmanager
def checked_outputs(force: bool) -> Iterator[None]:
    """Inside, the present command may write its outputs; those that exist only with ``force``.

    Its parameters of the type `OutputFile` are checked against each other, against those of the type `InputFile` and
    against what is there, and again where they are written.
    """
    context, every = click.get_current_context(), output_files()
    outputs = [(param, path) for param, path in every if os.path.isfile(path) or not os.path.exists(path)]
    inputs, folders = (list(given_paths(context, kind)) for kind in (InputFile, OutputFolder))
    for param, path in (*inputs, *outputs):
        if _is_standard_output(local_part(os.fspath(path))):
            raise click.UsageError(f"{label(param)}: got {path}, which is standard output too, allowed: another file")
    for param, path in inputs:
        assert isinstance(param.type, InputFile)
        require_not_written(param.type.files(path))
    for k, (param, path) in enumerate(outputs):
        refused = f"{label(param)}: got {path}, which"
        for other, written in (*folders, *outputs[:k]):
            if _is_same(path, written):
                raise click.UsageError(f"{refused} {label(other)} writes too, allowed: another file")
        if os.path.isfile(path) and not force:
            raise click.UsageError(f"{refused} exists, allowed: a new file, or --force")
    with fixed_outputs([path for _, path in every], replace=force):
        yield


def given_paths(context: click.Context, kind: type[click.Path]) -> Iterator[tuple[click.Parameter, Any]]:
    """Parameters of a type, with each of their paths: those of a command, and of one that it runs for many files."""
    for param in context.command.params:
        value = context.params.get(str(param.name))
        inner = getattr(value, "context", None)
        if isinstance(inner, click.Context):
            yield from given_paths(inner, kind)
        elif isinstance(param.type, kind) and value is not None:
            yield from ((param, path) for path in (value if isinstance(value, tuple) else (value,)))


def output_files() -> list[tuple[click.Parameter, Any]]:
    """Parameters of the present command that are written, with their paths."""
    every = given_paths(click.get_current_context(), OutputFile)
    return [(param, path) for param, path in every if path != _STANDARD]


def _is_same(path: str, other: str | os.PathLike[str]) -> bool:
    """True for one file by any two names or links; the other one may be standard input."""
    try:
        return os.path.samestat(os.stat(path), os.stat(0 if other == _STANDARD else other))
    except (OSError, ValueError):
        return other != _STANDARD and os.path.realpath(path) == os.path.realpath(other)


def require_not_written(read: Iterable[str | os.PathLike[str]]) -> None:
    """Refuse outputs of the present command that are files which it reads."""
    files = [(param, path) for param, path in output_files() if os.path.isfile(path)]
    for each in read if files else ():
        for param, path in files:
            if _is_same(path, each):
                raise click.UsageError(f"{label(param)}: got {path}, which is read, allowed: another file")


def _is_standard_output(path: str) -> bool:
    """True for the file that standard output was redirected to: as input it grows, as output it is replaced."""
    with contextlib.suppress(OSError, ValueError):
        there = os.stat(0 if path == _STANDARD else path)
        return stat.S_ISREG(there.st_mode) and os.path.samestat(there, os.fstat(1))
    return False


def label(param: click.Parameter) -> str:
    """The parameter as it is written: ``--plot``, or ``OUT``."""
    return param.human_readable_name if isinstance(param, click.Argument) else param.opts[-1]
