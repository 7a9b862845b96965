"""A study as a program, with the errors and exit codes of the command line."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import click

from ocisac_fast.cli import application


def run(command: click.Command, arguments: Sequence[str] | None = None) -> int:
    """The exit code: 0, 2 for invalid input, 130 if interrupted, 141 for a closed pipe."""
    return application.run(list(sys.argv[1:] if arguments is None else arguments), command)
