"""``ocisac receive``."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Annotated, Any

import click

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cli.command import command
from ocisac_fast.cli.errors import SOME_FAILED, error_text, input_errors
from ocisac_fast.cli.output import Table, emit_json, emit_summary, facts_of, number, progress, quantity
from ocisac_fast.cli.outputs import INPUT, OUTPUT, PLOTS, draw
from ocisac_fast.cli.packet_stream import PacketOptions, PacketStream
from ocisac_fast.cli.pictures import PictureOptions, open_pictures, rows_and_columns, stack
from ocisac_fast.cli.sent_files import ErrorCount
from ocisac_fast.cli.text import one_line
from ocisac_fast.files.recording import Frame
from ocisac_fast.receiver import receive as receive_frames


@command
def receive(
    files: Annotated[tuple[str, ...], INPUT, {"metavar": "FILE...", "nargs": -1}],
    *,
    packet: PacketOptions,
    sent: Annotated[str | None, INPUT, "Bits that are sent over and over (.txt, .npy): count the errors."] = None,
    picture: PictureOptions,
    plot: Annotated[
        str | None, OUTPUT, f"Draw the combined column of the first frame with its chips ({PLOTS})."
    ] = None,
    as_json: bool,
) -> None:
    """Receive on-off keyed bits from FILE... (pictures, videos, .npy arrays, or -); 1 is bright.

    Columns, channel and chip rate are estimated. Chips cut by the edges of a frame are excluded. With --packets, frames
    are one stream in time order, exposures may be longer than a chip (then --chip-rate is needed), and completed
    payloads are printed; lights side by side or above each other are separate sources. With --fsk each frame shows one
    tone of a set (CM-FSK). An interrupt ends the reception; earlier results are printed. Of several files, those that
    cannot be read are named, and the exit code is 3.
    """
    rate = picture.check_frequency("--chip-rate", packet.chip_rate)
    errors = ErrorCount(sent)
    stream = PacketStream(packet, picture) if packet.asked else None
    header = [*(["file"] if len(files) > 1 else []), "frame", *_HEADER, *([] if stream is None else ["payload"])]
    table = None if as_json else Table(header, left=("flags", "bits", "payload"), spare=("rows per chip",))
    title = ""
    stopped: KeyboardInterrupt | None = None
    failed = False
    try:
        for file in files:
            try:
                for facts in _received(file, picture, plot, rate, stream):
                    named = ({"file": file} if len(files) > 1 else {}) | facts | errors.of(facts)
                    if table is None:
                        emit_json(named)
                        continue
                    axis = facts["scan_axis"] if stream is None else stream.scan_axis
                    title = f"scan axis {axis}" if picture.names(axis) else ""
                    table.add(_row(named, picture.in_hertz, stream is not None), title)
            except input_errors() as error:
                if len(files) == 1:
                    if table is not None:
                        table.flush(title)
                    raise
                failed = True
                click.echo(f"ocisac: {one_line(error_text(error))}", err=True)
            plot = None  # the first frame of the first file
    except KeyboardInterrupt as signal:  # earlier results are printed
        stopped = signal
    if table is not None:
        table.end(title)
    if stream is not None:
        emit_summary(stream.summary(), as_json)
    errors.report(as_json)
    if stopped is not None:
        raise stopped
    if failed:
        raise click.exceptions.Exit(SOME_FAILED)


_RUN = 8  # frames
_HEADER = ("source", "chips", "rows per chip", "chip rate", "SNR", "flags", "bits")


def _received(
    file: str, picture: PictureOptions, plot: str | None, rate: float | None, stream: PacketStream | None
) -> Iterator[dict[str, Any]]:
    """The JSON objects of a file, generated as its frames are read."""
    with open_pictures(file, picture) as pictures:
        announced, camera, count = pictures.frame_count, pictures.camera, 0
        # A frame of a live stream is answered at once.
        for run in _in_runs(progress(pictures.frames, "receiving", announced), 1 if announced is None else _RUN):
            if plot is not None and count == 0:
                first = stack(run[:1])
                draw(plot, "plot_received", first[0], camera, received=receive_frames(first, camera, chip_rate=rate)[0])
            if stream is not None:
                for k, frame in enumerate(run):
                    yield from stream.push(frame, camera, count + k)
            else:
                for result in receive_frames(stack(run), camera, chip_rate=rate):
                    yield picture.in_units(_facts(result, count, run[0].shape, camera))
            count += len(run)


def _in_runs(frames: Iterator[Frame], most: int) -> Iterator[list[Frame]]:
    """Up to ``most`` frames at a time: decoding displaces the interpreter and the receiver from the caches.

    An error or an interrupt is raised after the frames before it.
    """
    stopped: BaseException | None = None
    while stopped is None:
        run: list[Frame] = []
        try:
            run.extend(itertools.islice(frames, most))
        except BaseException as error:
            stopped = error
        if not run:
            break
        yield run
    if stopped is not None:
        raise stopped


def _facts(result: Any, first_frame: int, shape: tuple[int, ...], camera: Camera) -> dict[str, Any]:
    """The JSON object of a frame and source."""
    return {
        "frame": first_frame + int(result.frame),
        "source": int(result.source),
        "colour": int(result.colour) if len(result.colour_weights) > 1 else None,
        "rows": rows_and_columns(shape, camera)[0],
        **facts_of(result, "bits rows_per_chip chip_rate_hz snr_db flags"),
        "scan_axis": camera.scan_axis,
        "first_row": result.phase,
        "end_row": result.phase + len(result.bits) * result.rows_per_chip,
    }


def _row(facts: dict[str, Any], in_hertz: bool, packets: bool) -> list[str]:
    payload = f"packet {facts['packet']}: {one_line(facts['payload'])}" if "payload" in facts else ""
    if in_hertz:
        rate = quantity(facts.get("chip_rate_hz", facts.get("tone_hz")), "Hz")
    elif "tone_cycles_per_row" in facts:
        rate = number(facts["tone_cycles_per_row"], "cycles per row")
    else:
        rate = number(1.0 / facts["rows_per_chip"], "a row")
    return [
        *([facts["file"]] if "file" in facts else []),
        str(facts["frame"]),
        str(facts["source"]),
        str(len(facts["bits"])),
        quantity(facts.get("rows_per_chip"), "", 5),
        rate,
        number(facts["snr_db"], "dB", 3),
        ", ".join(facts["flags"]) or "none",
        facts["bits"] or "no bits",
        *([payload] if packets else []),
    ]
