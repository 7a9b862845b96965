"""One receiver for all frames of all files of ``ocisac receive``, and its output."""

from __future__ import annotations

import base64
import dataclasses
import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import click

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cli.output import decibels, facts_of, flag_names, quantity
from ocisac_fast.cli.pictures import REGION, PictureOptions, rows_and_columns
from ocisac_fast.cli.units import FREQUENCIES, FREQUENCY, Quantity
from ocisac_fast.core.regions import Region
from ocisac_fast.files.recording import Frame
from ocisac_fast.packets.goodput import possible_goodput, require_in_frame_time
from ocisac_fast.packets.transmission import LINE_CODES, PacketFormat, transmit

BlockBytes = Annotated[int | None, "Coded bytes of a packet's block, 1 to 255  [default: 16, with --fsk 4]"]
Preamble = Annotated[Literal["standard", "lengthened"], "Of packets; lengthened: for exposures above 8 chips."]


@dataclasses.dataclass(frozen=True, kw_only=True)
class PacketOptions:
    """Options of `ocisac receive` for chips and packets."""

    chip_rate: Annotated[Quantity | None, FREQUENCY, "Chips per second; default: estimated in every frame."] = None
    line_code: Annotated[str | None, click.Choice(LINE_CODES), "Line code of packets  [default: manchester]"] = None
    packets: Annotated[bool, "Receive packets of `ocisac transmit`; implied by a --line-code but none."] = False
    block_bytes: BlockBytes = None
    preamble: Preamble = "standard"
    sources: Annotated[int, click.IntRange(1, 64), "Max. number of lights with packets."] = 8
    source_region: Annotated[
        tuple[Region, ...], REGION, {"multiple": True}, "Region of a light with packets; repeatable."
    ] = ()
    fsk: Annotated[tuple[Quantity, ...] | None, FREQUENCIES, "Tones of CM-FSK, one per frame, such as 1kHz,1.2kHz."] = (
        None
    )
    gain: Annotated[bool, "Measure the gain of each light's tone too."] = False
    frequency: Annotated[Quantity | None, FREQUENCY, "Frequency of the tone; default: estimated at detection."] = None

    @property
    def asked(self) -> bool:
        """True if packets are to be received."""
        return self.packets or self.line_code not in (None, "none") or bool(self.fsk)

    @property
    def format(self) -> PacketFormat:
        """Format of the sender's packets."""
        size = self.block_bytes if self.block_bytes is not None else 4 if self.fsk else 16
        return PacketFormat(line_code=self.line_code or "manchester", block_bytes=size, preamble=self.preamble)


class PacketStream:
    """Converts frames to JSON objects, one per frame and source."""

    def __init__(self, options: PacketOptions, picture: PictureOptions) -> None:
        self._options = options
        self._picture = picture
        self._asked_rate = picture.check_frequency("--chip-rate", options.chip_rate)
        self._tones = tuple(picture.check_frequency("--fsk", tone) or 0.0 for tone in options.fsk or ())
        self._frequency = picture.check_frequency("--frequency", options.frequency)
        self._format = options.format
        self._receiver: Any = None
        self._camera: Camera | None = None
        self._rows = self._frames = self._payloads = self._payload_bytes = self._with_data = self._blocks = 0
        self._share = 0.0
        self._chip_rate = math.nan

    def push(self, frame: Frame, camera: Camera, number: int) -> Iterator[dict[str, Any]]:
        """The objects of the next frame; ``number``: in the file."""
        if self._camera is None:
            self._camera = camera
            self._receiver = self._make(self._camera)
            rows = rows_and_columns(frame.shape, camera)[0]
            try:
                require_in_frame_time(rows, camera)
            except ValueError as error:
                raise ValueError(f"--frame-rate, --row-time: {error}") from None
        self._frames += 1
        self._rows = rows_and_columns(frame.shape, self._camera)[0]
        if self._tones:
            result = self._receiver.push(frame)
            self._count(result)
            self._with_data += result.outcome == "received"
            yield self._picture.in_units(self._tone_facts(result, number))
            return
        lights = self._receiver.push(frame)
        self._with_data += any(light.received.outcome == "received" for light in lights)
        for result in lights:
            self._count(result.received)
            if math.isfinite(result.received.chip_rate):
                self._chip_rate = result.received.chip_rate
            yield self._picture.in_units(self._chip_facts(result, number))

    @property
    def scan_axis(self) -> str:
        """Read-out axis of the camera; y before the first frame."""
        return "y" if self._camera is None else self._camera.scan_axis

    def summary(self) -> str:
        """Number of payloads, and the goodput with its bounds by the gap between frames and by the code."""
        if not self._payloads:
            return f"no payload in {self._frames} frame{'s' * (self._frames > 1)}: {self._reason()}"
        count = f"{self._payloads} payload{'s' if self._payloads > 1 else ''} in {self._frames} frames"
        camera = self._camera
        if camera is None or camera.frame_time is None:
            return count
        seconds = self._frames * camera.frame_time
        count += f", {quantity(8.0 * self._payload_bytes / seconds, 'bit/s', 4)}"
        if self._tones or not math.isfinite(self._chip_rate):
            return count
        possible = possible_goodput(
            max(self._payload_bytes // self._payloads, 1),
            camera,
            chip_rate=self._chip_rate,
            rows=self._rows,
            format=self._format,
        )
        through = quantity(possible.gap, "bit/s", 4)
        return f"{count}; a light's chips through the gap: {through}, as packets: {quantity(possible.code, 'bit/s', 4)}"

    def _reason(self) -> str:
        """Why no payload was received; as in ocisac-rx."""
        if not self._with_data:
            return "no light with chips was found; --row-time, --exposure and --chip-rate may be wrong or missing"
        blocks = (
            f"headers of {self._blocks} blocks, {100.0 * min(self._share, 1.0):.0f} % of the bytes that a payload needs"
        )
        senders = "--line-code, --block-bytes, --preamble, --chip-rate or --row-time may differ from the sender's"
        found = blocks if self._blocks else f"but no header of a packet; {senders}"
        return f"chips in {self._with_data} of them, {found}{self._hint()}"

    def _hint(self) -> str:
        """Hint that a frame shows less than one block."""
        if self._camera is None or self._tones or not math.isfinite(self._chip_rate):
            return ""
        sent = transmit(b"-", format=self._format)
        shown = int(self._rows * self._camera.row_period * self._chip_rate)
        if sent.block_chips <= shown:
            return ""
        return (
            f"; a block of {self._format.block_bytes} bytes is {sent.block_chips} chips, a frame shows {shown}: "
            "smaller blocks show more headers"
        )

    def _make(self, camera: Camera) -> Any:
        options = self._options
        if self._tones:
            from ocisac_fast.receiver import FskReceiver

            size = self._format.block_bytes
            return FskReceiver(camera, self._tones, block_bytes=size, preamble=options.preamble)
        from ocisac_fast.receiver import GainOptions, MultiReceiver

        waveform: Literal["square", "tone"] = "square" if self._picture.waveform == "square" else "tone"
        gain = GainOptions(frequency=self._frequency, waveform=waveform, duty=self._picture.duty)
        return MultiReceiver(
            camera,
            chip_rate=self._asked_rate,
            format=self._format,
            regions=[self._picture.in_region(region) for region in options.source_region],
            max_sources=options.sources,
            gain=gain if options.gain else None,
        )

    def _count(self, received: Any) -> None:
        if received.stretch is not None:
            self._share = max(self._share, received.stretch.share)
            self._blocks += received.stretch.blocks
        if received.payload is not None:
            self._payloads += 1
            self._payload_bytes += len(received.payload.data)

    def _chip_facts(self, light: Any, number: int) -> dict[str, Any]:
        """Keys as in ocisac-rx."""
        received = light.received
        facts = {
            "frame": number,
            "source": light.source,
            "rows": self._rows,
            "region": list(self._picture.in_picture(light.region)),
            **facts_of(received, "bits rows_per_chip chip_rate_hz snr_db exposure_s error_rate outcome"),
        }
        facts |= {**_packet_facts(received), "flags": flag_names(received.flags)}
        if light.gain is not None:
            facts |= facts_of(light.gain, "frequency_hz frequency_std_hz gain gain_std")
            facts |= {f"gain_{key}": value for key, value in facts_of(light.gain, "snr_db flags").items()}
        if light.suggestion is not None:
            facts["suggested_exposure_s"] = light.suggestion.exposure
        return facts

    def _tone_facts(self, result: Any, number: int) -> dict[str, Any]:
        seen = result.symbol if result.outcome == "received" else None
        facts = {
            "frame": number,
            "source": 0,
            "rows": self._rows,
            "bits": "" if seen is None else "".join("1" if llr > 0.0 else "0" for llr in seen.llr),
            "symbol": None if seen is None else seen.symbol,
            "tone_hz": None if seen is None else self._tones[seen.symbol],
            "snr_db": math.nan if seen is None else decibels(seen.snr),
            "error_rate": math.nan if seen is None else seen.error_rate,
            "outcome": result.outcome,
        }
        return {**facts, **_packet_facts(result), "flags": flag_names(result.flags)}


def _packet_facts(received: Any) -> dict[str, Any]:
    """Missing frames, the packet's result for this frame, and the completed payload."""
    facts: dict[str, Any] = {"frames_missing": received.missing}
    if received.stretch is not None:
        names = ("outcome", "blocks", "bytes", "cut", "doubtful", "share", "inverted", "lack")
        facts |= {f"packet_{name}": getattr(received.stretch, name) for name in names}
    if received.payload is not None:
        payload = received.payload.data
        facts |= {"packet": received.payload.number, "payload": payload.decode(errors="replace")}
        facts["payload_base64"] = base64.b64encode(payload).decode()
    return facts
