"""Frames to bits and payloads."""

from ocisac_fast.receiver.bit_errors import BitErrors as BitErrors, compare_bits as compare_bits
from ocisac_fast.receiver.blind import Received as Received, receive as receive
from ocisac_fast.receiver.fsk import FskFrame as FskFrame, FskReceiver as FskReceiver
from ocisac_fast.receiver.stream import (
    GainOptions as GainOptions,
    LightGain as LightGain,
    MultiReceiver as MultiReceiver,
    ReceivedFrame as ReceivedFrame,
    Receiver as Receiver,
    SourceFrame as SourceFrame,
)
