"""``ocisac transmit``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ocisac_fast.cli.output import emit_facts, emit_json, quantity
from ocisac_fast.cli.outputs import INPUT, OUTPUT, read_input, writes
from ocisac_fast.cli.pictures import json_option
from ocisac_fast.cli.sent_files import SUFFIXES, Sent, sent_chips, sent_tones
from ocisac_fast.cli.units import FREQUENCIES, RATE, Quantity
from ocisac_fast.files import atomic_path
from ocisac_fast.packets.fsk import fsk_transmit
from ocisac_fast.packets.transmission import LINE_CODES, PacketFormat, transmit as transmit_payload


@click.command(short_help="Chips that carry a payload.")
@click.argument("file", required=False, metavar="[FILE]", type=INPUT)
@click.option("--text", help="The payload, instead of a file's bytes.")
@click.option("--line-code", type=click.Choice(LINE_CODES), default="manchester", show_default=True)
@click.option("--code-table", metavar="WORDS", help="Custom line code: 2, 4, 16 or 256 words, such as 01,10.")
@click.option("--block-bytes", type=int, help="Coded bytes of a block, 1 to 255  [default: 16, with --fsk 4]")
@click.option("--preamble", type=click.Choice(["standard", "lengthened"]), default="standard", show_default=True)
@click.option("--number", type=int, default=0, show_default=True, help="Number of the packet, 0 to 255.")
@click.option("--chip-rate", type=RATE, help="For the times in a .csv and a note in a .h.")
@click.option("--fsk", type=FREQUENCIES, help="Tones instead of chips, one per frame, such as 1kHz,1.2kHz (CM-FSK).")
@click.option("--frame-rate", type=RATE, help="With --fsk: for the times in a .csv and a note in a .h.")
@click.option(
    "-o", "--output", type=OUTPUT, help=".txt, .npy, .csv (chip or time, level) or .h (C, eight chips per byte)."
)
@writes
@json_option
def transmit(
    file: str | None,
    text: str | None,
    line_code: str,
    code_table: str | None,
    block_bytes: int | None,
    preamble: str,
    number: int,
    chip_rate: Quantity | None,
    fsk: tuple[Quantity, ...] | None,
    frame_rate: Quantity | None,
    output: str | None,
    as_json: bool,
) -> None:
    """Encode the bytes of FILE (- for standard input) as one cycle of chips, to be sent repeatedly; 1 is bright.

    Without -o the chips are printed. The format is in docs/reference/packets.md. With --fsk the output is one cycle of
    tones, printed as indices from 0.
    """
    if fsk is not None and (line_code != "manchester" or code_table is not None or chip_rate is not None):
        raise click.UsageError("--fsk: has no line code and no chip rate")
    if fsk is None and frame_rate is not None:
        raise click.UsageError("--frame-rate: only with --fsk")
    suffix, payload = _suffix(output), _payload(file, text)
    if fsk is not None:
        short = 4 if block_bytes is None else block_bytes
        symbols = fsk_transmit(payload, fsk, block_bytes=short, preamble=preamble, number=number)
        facts: dict[str, Any] = {
            "payload_bytes": len(payload),
            "number": number,
            "tones_hz": list(symbols.tones),
            "symbols": len(symbols.symbols),
            "block_bytes": short,
        }
        size = f"{len(symbols.symbols)} symbols of {len(symbols.tones)} tones"
        _write(sent_tones(symbols), facts, size, frame_rate, output, suffix, as_json)
        return
    format = PacketFormat(
        line_code=line_code if code_table is None else code_table.split(","),
        block_bytes=16 if block_bytes is None else block_bytes,
        preamble=preamble,
    )
    sent = transmit_payload(payload, format=format, number=number)
    facts = {
        "payload_bytes": len(sent.payload),
        "number": sent.number,
        "line_code": sent.format.line_code,
        "chips": len(sent.chips),
        "blocks": sent.blocks,
        "block_chips": sent.block_chips,
        "block_bytes": sent.format.block_bytes,
        "codewords": sent.codewords,
        "codeword_data": sent.codeword_data,
    }
    size = f"{sent.blocks} blocks of {sent.block_chips} chips"
    _write(sent_chips(sent), facts, size, chip_rate, output, suffix, as_json)


def _write(
    sent: Sent, facts: dict[str, Any], size: str, rate: float | None, output: str | None, suffix: str, as_json: bool
) -> None:
    if output is not None:
        with atomic_path(output) as temporary:
            temporary.write_bytes(sent.file(suffix, rate))
    if as_json:
        shown = {"levels": sent.text} if sent.name == "chips" else {"sequence": sent.array.tolist()}
        emit_json({"file": output, **facts, **({} if output is not None else shown)})
    elif output is None:
        click.echo(sent.text)
    else:
        duration = {} if rate is None else {"one cycle": quantity(len(sent.values) / rate, "s")}
        emit_facts("", {"file": output, "payload": f"{facts['payload_bytes']} bytes", "cycle": size, **duration})


def _suffix(output: str | None) -> str:
    suffix = ".txt" if output is None else Path(output).suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"--output: got {output}, allowed: a file that ends in {', '.join(SUFFIXES)}")
    return suffix


def _payload(file: str | None, text: str | None) -> bytes:
    if (file is None) == (text is None):
        raise click.UsageError("needs FILE or --text, and not both")
    if text is not None:
        return text.encode()
    return read_input(str(file))
