"""Pages of the reference that are generated: Python by room, command line, ``ocisac-rx``, tables of results."""

from __future__ import annotations

import importlib
import inspect
import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

from ocisac_fast.batch.fields import documentation

ROOT = Path(__file__).resolve().parents[2]
# Rooms without an interface for users, and those that the pages of the command line and of the tests describe.
_LEFT_OUT = {"device", "demo", "cli", "smoke"}


def write(folder: Path) -> None:
    """Write all generated pages into a folder; one that has not changed keeps its time and is not rebuilt."""
    rooms = [room for room in re.findall(r"^\| `(\w+)` \|", _architecture(), re.MULTILINE) if _is_public(room)]
    for room in rooms:
        _write(folder / "python" / f"{room}.md", "\n".join(_room_page(room)))
    _write(folder / "python" / "index.md", "\n".join(_index(rooms)))
    _write(folder / "columns.md", _COLUMNS + documentation())
    _write(folder / "command-line.md", _COMMAND_LINE)
    _write(folder / "ocisac-rx.md", _RECEIVER.format(help=_receiver_help()))


def public_names(room: str) -> list[str]:
    """Names of a room's package that are defined in it, in the order of its imports."""
    module = importlib.import_module(f"ocisac_fast.{room}")
    return [
        name
        for name in getattr(module, "__all__", vars(module))
        if not name.startswith("_") and getattr(getattr(module, name), "__module__", "").startswith(module.__name__)
    ]


def _architecture() -> str:
    return (ROOT / "docs" / "reference" / "architecture.md").read_text(encoding="utf-8")


def _is_public(room: str) -> bool:
    return room not in _LEFT_OUT and (ROOT / "python" / "ocisac_fast" / room / "__init__.py").is_file()


def _room_page(room: str) -> Iterator[str]:
    module = importlib.import_module(f"ocisac_fast.{room}")
    yield from (f"# {room}", "", f"`ocisac_fast.{room}`: {inspect.getdoc(module)}", "", "```{eval-rst}")
    yield from (f".. module:: ocisac_fast.{room}", "")
    for name in public_names(room):
        value = getattr(module, name)
        if inspect.isclass(value):
            yield from (f".. autoclass:: ocisac_fast.{room}.{name}", "   :members:")
            if not issubclass(value, (int, tuple, Exception)):  # of enumerations and tuples only their own members
                yield "   :inherited-members:"
        elif callable(value):
            yield f".. autofunction:: ocisac_fast.{room}.{name}"
        yield ""
    yield "```"


def _index(rooms: list[str]) -> Iterator[str]:
    yield from ("# Python, room by room", "", _PYTHON, "", "| room | |", "|---|---|")
    for room in rooms:
        text = (inspect.getdoc(importlib.import_module(f"ocisac_fast.{room}")) or "").splitlines()[0]
        yield f"| [{room}]({room}.md) | {text} |"
    yield from ("", "```{toctree}", ":hidden:", "", *rooms, "```", "")


def _receiver_help() -> str:
    program = os.environ.get("OCISAC_RX", str(ROOT / "build" / "make" / "cpp" / "apps" / "ocisac-rx"))
    return subprocess.run([program, "--help"], check=True, capture_output=True, text=True).stdout


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


_PYTHON = """\
Times are in seconds, frequencies in Hz, stored values in DN (steps of the camera's scale). Arrays are (rows,
columns) or (frames, rows, columns), with rows in time order. Bad values raise a `ValueError` that names the
argument, its value and what is allowed. Answers that are not reliable carry flags (`ocisac_fast.Flag`).

The names that are used most are at the top level too: `from ocisac_fast import Camera, tone_gain, receive`."""

_COMMAND_LINE = """\
# Command line

Times and frequencies take units: `22.2us`, `1/8000s`, `4.95kHz`. Every command takes `--json`: one JSON object a
line on standard output, and nothing else there ([its keys](columns.md)). Exit code: 0 done, also where `receive`,
`detect`, `sense` or `clean` say that they found nothing; 2 wrong input, also a recording without what `calibrate`
needs; 3 no gain (`gain`, `sense --region`), an older OUT that stays (`clean --force`), or some of several files
(`receive`) or recordings (`batch`) failed; 130 interrupted.

```{eval-rst}
.. click:: ocisac_fast.cli.application:ocisac
   :prog: ocisac
   :nested: full
```
"""

_RECEIVER = """\
# ocisac-rx: options

The text of `ocisac-rx --help`. [What it reads and writes](../reference/device.md) has the lines of its output.

```text
{help}```
"""

_COLUMNS = """\
# Keys of --json, columns of Parquet

The commands print these keys with `--json`, and `ocisac batch` writes them as columns, with the path of the
recording before them. Unit and meaning are in the metadata of each column too (`schema.field("gain").metadata`).
Without a row time, rates are per row (`frequency_cycles_per_row` in place of `frequency_hz`), times in rows
(`exposure_rows`), and `chip_rate_hz` is left out. Values that are not finite are null. `ocisac gain` prints one
object for all frames, with `frames` in place of `frame`;
`ocisac batch` writes a row for each frame.

Keys of the other commands:

| command | keys |
|---|---|
| `exposure` | `exposure_s`, `objective` (s), `method` |
| `exposure --avoid` | `exposure_s`, `modulation`, `holds`, `null_s`, `gain`, `objective`, `lights` |
| `flicker` | `frequency_hz`, `duty`, `exposure_s`, `modulation_index`, `detection_index` |
| | `mitigation_probability`, `missed` |
| `lamp` | `frequencies_hz`, `best_hz`, `modulation`, `holds`, `always_from_hz` |
| | `no_missed_pulse_from_hz`, `chip_rates_from_hz` |
| `transmit` | `file`, `payload_bytes`, `number`, `line_code`, `block_bytes`, `codewords`, `codeword_data` |
| | `chips`, `blocks`, `block_chips`; `levels` without `-o` |
| `simulate` | `file`, `frames`, `rows`, `columns`, `dtype`, `row_time_s`, `exposure_s`; of a scene `error_bound_dn` |
| `receive --sent` | also `errors`, `compared`, `missing`, `inserted`, `shift`, `inverted`, `chance` |
| `demo` | `settings` (`kind`, `frequency_hz`, `exposure_s`, `theory`, `gain`, `gain_std`), `bits`, `text`, `picture` |

"""
