"""Preload of the worker processes that ``cluster`` starts on this machine."""

from __future__ import annotations

import signal


def dask_setup(_: object) -> None:
    """Ignore Ctrl-C, which a terminal sends to all processes: the client ends the workers in order."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
