"""Payloads as chips and back: line codes, packets, CM-FSK."""

from ocisac_fast.packets.fsk import (
    FskSymbol as FskSymbol,
    FskTransmission as FskTransmission,
    fsk_demodulate as fsk_demodulate,
    fsk_symbol_error_rate as fsk_symbol_error_rate,
    fsk_transmit as fsk_transmit,
)
from ocisac_fast.packets.goodput import Goodput as Goodput, possible_goodput as possible_goodput
from ocisac_fast.packets.merging import merge_receptions as merge_receptions
from ocisac_fast.packets.transmission import (
    LINE_CODES as LINE_CODES,
    PacketAssembler as PacketAssembler,
    PacketFormat as PacketFormat,
    Payload as Payload,
    Stretch as Stretch,
    Transmission as Transmission,
    decode_line_code as decode_line_code,
    encode_line_code as encode_line_code,
    longest_payload as longest_payload,
    transmit as transmit,
)
