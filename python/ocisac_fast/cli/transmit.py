"""``ocisac transmit``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np

from ocisac_fast.cli.fsk_files import SYMBOL_WRITERS, symbols_text
from ocisac_fast.cli.output import emit_facts, emit_json, quantity
from ocisac_fast.cli.outputs import writes
from ocisac_fast.cli.pictures import FILE_PATH, json_option
from ocisac_fast.cli.sent_files import c_header_bytes, csv_bytes, npy_bytes
from ocisac_fast.cli.units import FREQUENCIES, RATE, Quantity
from ocisac_fast.packets.fsk import fsk_transmit
from ocisac_fast.packets.transmission import LINE_CODES, PacketFormat, Transmission, transmit as transmit_payload

_Writer = Callable[[Any, float | None], bytes]


def _text(sent: Transmission, _: float | None) -> bytes:
    return "".join(map(str, sent.chips.tolist())).encode() + b"\n"


def _npy(sent: Transmission, _: float | None) -> bytes:
    return npy_bytes(sent.chips)


def _csv(sent: Transmission, chip_rate: float | None) -> bytes:
    return csv_bytes("chip", "level", sent.chips.tolist(), chip_rate)


def _c_header(sent: Transmission, chip_rate: float | None) -> bytes:
    """Chips packed eight per byte, the first one most significant."""
    packed = [f"0x{byte:02x}" for byte in np.packbits(sent.chips).tolist()]
    rate = [] if chip_rate is None else [f"#define OCISAC_CHIP_RATE_HZ {chip_rate!r}"]
    comment = [
        f"A packet of {len(sent.payload)} bytes: send the chips one after the other, over and over.",
        "Chip k: ocisac_chips[k >> 3] >> (7 - (k & 7)) & 1, 1 = bright.",
    ]
    return c_header_bytes("chips", packed, comment, [*rate, f"#define OCISAC_CHIP_COUNT {len(sent.chips)}UL"])


_WRITERS: dict[str, _Writer] = {
    ".txt": _text,
    ".npy": _npy,
    ".csv": _csv,
    ".h": _c_header,
}


@click.command(short_help="Chips that carry a payload.")
@click.argument("file", required=False, metavar="[FILE]", type=FILE_PATH)
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
    "-o", "--output", type=FILE_PATH, help=".txt, .npy, .csv (chip or time, level) or .h (C, eight chips per byte)."
)
@writes("output")
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
    if fsk is not None:
        if line_code != "manchester" or code_table is not None or chip_rate is not None:
            raise click.UsageError("--fsk: has no line code and no chip rate")
        short = 4 if block_bytes is None else block_bytes
        _transmit_tones(_payload(file, text), fsk, short, preamble, number, frame_rate, output, as_json)
        return
    if frame_rate is not None:
        raise click.UsageError("--frame-rate: only with --fsk")
    writer = _writer(output, _WRITERS)
    sent = transmit_payload(
        _payload(file, text),
        format=PacketFormat(
            line_code=line_code if code_table is None else code_table.split(","),
            block_bytes=16 if block_bytes is None else block_bytes,
            preamble=preamble,
        ),
        number=number,
    )
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
    if output is not None:
        Path(output).write_bytes(writer(sent, chip_rate))
    if as_json:
        levels = {} if output is not None else {"levels": _text(sent, None).decode().strip()}
        emit_json({"file": output, **facts, **levels})
    elif output is None:
        click.echo(_text(sent, None), nl=False)
    else:
        size = f"{sent.blocks} blocks of {sent.block_chips} chips"
        duration = {} if chip_rate is None else {"one cycle": quantity(len(sent.chips) / chip_rate, "s")}
        emit_facts("", {"file": output, "payload": f"{len(sent.payload)} bytes", "cycle": size, **duration})


def _transmit_tones(
    payload: bytes,
    tones: tuple[Quantity, ...],
    block_bytes: int,
    preamble: str,
    number: int,
    frame_rate: Quantity | None,
    output: str | None,
    as_json: bool,
) -> None:
    writer = _writer(output, SYMBOL_WRITERS)
    sent = fsk_transmit(payload, tones, block_bytes=block_bytes, preamble=preamble, number=number)
    facts = {
        "payload_bytes": len(sent.payload),
        "number": sent.number,
        "tones_hz": list(sent.tones),
        "symbols": len(sent.symbols),
        "block_bytes": sent.block_bytes,
    }
    if output is not None:
        Path(output).write_bytes(writer(sent, frame_rate))
    if as_json:
        emit_json({"file": output, **facts, **({} if output is not None else {"sequence": sent.symbols.tolist()})})
    elif output is None:
        click.echo(symbols_text(sent), nl=False)
    else:
        duration = {} if frame_rate is None else {"one cycle": quantity(len(sent.symbols) / frame_rate, "s")}
        size = f"{len(sent.symbols)} symbols of {len(sent.tones)} tones"
        emit_facts("", {"file": output, "payload": f"{len(sent.payload)} bytes", "cycle": size, **duration})


def _writer(output: str | None, writers: dict[str, _Writer]) -> _Writer:
    suffix = ".txt" if output is None else Path(output).suffix.lower()
    if suffix not in writers:
        raise ValueError(f"--output: got {output}, allowed: a file that ends in {', '.join(writers)}")
    return writers[suffix]


def _payload(file: str | None, text: str | None) -> bytes:
    if (file is None) == (text is None):
        raise click.UsageError("needs FILE or --text, and not both")
    if text is not None:
        return text.encode()
    return sys.stdin.buffer.read() if file == "-" else Path(str(file)).read_bytes()
