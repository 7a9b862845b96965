"""``ocisac transmit``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import click

from ocisac_fast.cli.command import command
from ocisac_fast.cli.output import emit_facts, emit_json, quantity
from ocisac_fast.cli.outputs import INPUT, OUTPUT, read_input
from ocisac_fast.cli.packet_stream import BlockBytes, Preamble
from ocisac_fast.cli.sent_files import SUFFIXES, Sent, sent_chips, sent_tones
from ocisac_fast.cli.units import FREQUENCIES, RATE, Quantity
from ocisac_fast.files import atomic_path
from ocisac_fast.packets.fsk import fsk_transmit
from ocisac_fast.packets.transmission import LINE_CODES, PacketFormat, transmit as transmit_payload


@command
def transmit(
    file: Annotated[str | None, INPUT, {"metavar": "[FILE]"}] = None,
    *,
    text: Annotated[str | None, "The payload, instead of a file's bytes."] = None,
    line_code: Annotated[str, click.Choice(LINE_CODES), "Line code of packets."] = "manchester",
    code_table: Annotated[
        str | None, {"metavar": "WORDS"}, "Custom line code: 2, 4, 16 or 256 words, such as 01,10."
    ] = None,
    block_bytes: BlockBytes = None,
    preamble: Preamble = "standard",
    number: Annotated[int, "Number of the packet, 0 to 255."] = 0,
    chip_rate: Annotated[Quantity | None, RATE, "For the times in a .csv and a note in a .h."] = None,
    fsk: Annotated[
        tuple[Quantity, ...] | None,
        FREQUENCIES,
        "Tones instead of chips, one per frame, such as 1kHz,1.2kHz (CM-FSK).",
    ] = None,
    frame_rate: Annotated[Quantity | None, RATE, "With --fsk: for the times in a .csv and a note in a .h."] = None,
    output: Annotated[
        str | None,
        OUTPUT,
        {"names": ["-o", "--output"]},
        ".txt, .npy, .csv (chip or time, level) or .h (C, eight chips per byte).",
    ] = None,
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
        return text.encode(errors="surrogateescape")  # as it was given
    return read_input(str(file))
