"""The command line ``ocisac``."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence


def open_standard_streams() -> None:
    """Open those that are closed, as daemons do: files would get their numbers, and be written to."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Exit code 0; 2 for invalid input; 3 if some of several files failed, there is no gain, or an older output stays;
    129, 130 or 143 if interrupted; 141 for a closed pipe.
    """
    # Read when NumPy is imported: its products are small here, and threads that wait for their share of one use time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    open_standard_streams()
    try:
        from ocisac_fast.cli.application import run

        return run(sys.argv[1:] if arguments is None else list(arguments))
    except KeyboardInterrupt:  # while modules are imported
        return 130
    except (ImportError, MemoryError) as error:
        if isinstance(error.__cause__, KeyboardInterrupt):  # of a module in C++
            return 130
        message = str(error.__cause__ or error) or "out of memory"
        if isinstance(error, ModuleNotFoundError):
            library = str(error.name).partition(".")[0]
            if library not in ("click", "rich"):
                raise
            message = f"the command line needs {library}: pip install {library}"
        print("ocisac:", " ".join(message.split()), file=sys.stderr)
        return 2
