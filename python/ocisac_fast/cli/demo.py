"""``ocisac demo``."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import Annotated, Any

import click

from ocisac_fast import demo as testbed
from ocisac_fast.cli.command import command
from ocisac_fast.cli.output import emit_json, emit_table, facts_of, quantity
from ocisac_fast.cli.outputs import OutputFolder, import_matplotlib
from ocisac_fast.cli.text import printable


@command
def demo(
    *,
    directory: Annotated[
        Path, OutputFolder(file_okay=False, path_type=Path), "Folder of the recordings and the picture."
    ] = Path("demo"),
    as_json: bool,
) -> None:
    """Record the paper's testbed (simulated, as video), read it back, and compare gains with theory and bits."""
    picture = directory / "demo.png"
    force = click.get_current_context().params["force"]
    result = testbed.run(directory, force=force)
    import_matplotlib()
    testbed.draw(result, picture, force=force)
    if as_json:
        emit_json(
            {
                "settings": [_facts(measured) for measured in result.measurements],
                "bits": result.received.bits,
                "text": result.text,
                "picture": str(picture),
            }
        )
        return
    header = ["light", "frequency", "exposure", "theory", "gain", "± σ", "difference / σ"]
    emit_table("Gain of every setting of the testbed", header, [_row(measured) for measured in result.measurements])
    worst = max(abs(measured.gain - measured.setting.theory) for measured in result.measurements)
    click.echo(f"largest difference from theory: {worst:.1e}")
    chips = printable(str(directory / "chips.png"))
    click.echo(f"{len(result.received.bits)} chips received from {chips}: {result.received.bits}")
    click.echo(f"message: {result.text or 'not found'}")
    click.echo(f"picture: {printable(str(picture))}")
    _show_what_next(directory)


_TO_TRY = {
    "the text that the lamp sends": "receive lamp.mkv --packets --chip-rate 15kHz --row-time 22.2us",
    "how much of a lamp's flicker the exposure leaves": "gain video.mkv --frequency 500Hz --row-time 22.2us "
    "--exposure 1202us --waveform square",
    "a picture without the bands of its lamp": "clean banded.png clean.png --row-time 22.2us",
}


def _show_what_next(directory: Path) -> None:
    """Print where the command is, and three commands for the recordings of the demo."""
    program = Path(sys.argv[0]).absolute()
    activate = program.parent / "activate"
    click.echo(f"\nocisac is {printable(str(program))}")
    click.echo("Three things to try:\n")
    if shutil.which("ocisac") is None and activate.is_file():
        click.echo(f"  . {printable(os.path.relpath(activate))}")
    click.echo(f"  cd {printable(str(directory))}")
    for what, words in _TO_TRY.items():
        click.echo(f"\n  # {what}\n  ocisac {words}")


def _facts(measured: Any) -> dict[str, Any]:
    return facts_of(measured.setting, "kind frequency_hz exposure_s theory") | facts_of(measured, "gain gain_std")


def _row(measured: Any) -> list[str]:
    setting = measured.setting
    return [
        setting.kind,
        f"{setting.frequency:.0f} Hz",
        quantity(setting.exposure, "s"),
        f"{setting.theory:.5f}",
        f"{measured.gain:.5f}",
        f"{measured.gain_std:.5f}",
        f"{(measured.gain - setting.theory) / measured.gain_std:+.1f}",
    ]
