"""Line codes and packets from their definitions, one bit at a time; CM-FSK by least squares."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.packets.transmission import PacketFormat, Transmission

_WORDS_4B6B = [f"{word:06b}" for word in (14, 13, 19, 22, 21, 35, 38, 37, 25, 26, 28, 49, 50, 41, 42, 44)]
# Widmer and Franaszek's table: abcdei by the lower five bits, fghj by the upper three, at running disparity -1; words
# with * are inverted at +1.
_TABLE = (
    "100111* 011101* 101101* 110001 110101* 101001 011001 111000* 111001* 100101 010101 110100 001101 101100 011100 "
    "010111* 011011* 100011 010011 110010 001011 101010 011010 111010* 110011* 100110 010110 110110* 001110 101110* "
    "011110* 101011* 1011* 1001 0101 1100* 1101* 1010 0110 1110*"
)
_SIX, _FOUR = _TABLE.split(" ")[:32], _TABLE.split(" ")[32:]
_INVERTED = str.maketrans("01", "10")
_PREAMBLE = "01111110000001"
_MASK = 0x5AA5


def _at_disparity(entry: str, disparity: int) -> str:
    word = entry.rstrip("*")
    return word.translate(_INVERTED) if entry != word and disparity > 0 else word


def _encode_8b10b(values: Sequence[int]) -> str:
    chips, disparity = "", -1
    for value in values:
        low, high = value & 31, value >> 5
        six = _at_disparity(_SIX[low], disparity)
        disparity = disparity if six.count("1") == 3 else -disparity
        four = _at_disparity(_FOUR[high], disparity)
        if high == 7 and low in ((11, 13, 14) if disparity > 0 else (17, 18, 20)):
            four = "1000" if disparity > 0 else "0111"
        disparity = disparity if four.count("1") == 2 else -disparity
        chips += six + four
    return chips


def _words(line_code: str | Sequence[str]) -> list[str]:
    named = {"none": ["0", "1"], "manchester": ["01", "10"], "4b6b": _WORDS_4B6B}
    return named[line_code] if isinstance(line_code, str) else list(line_code)


def _encode(bits: str, line_code: str | Sequence[str]) -> str:
    if line_code == "8b10b":
        return _encode_8b10b([int(bits[k : k + 8], 2) for k in range(0, len(bits), 8)])
    words = _words(line_code)
    length = len(words).bit_length() - 1
    return "".join(words[int(bits[k : k + length], 2)] for k in range(0, len(bits), length))


def encode_line_code(bits: npt.ArrayLike, line_code: str | Sequence[str]) -> npt.NDArray[np.uint8]:
    """Encode word by word from the table."""
    text = "".join(str(int(bit)) for bit in np.asarray(bits))
    return np.array([int(chip) for chip in _encode(text, line_code)], np.uint8)


def decode_line_code(
    llr: npt.ArrayLike, line_code: str | Sequence[str]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Likelihood of every word of the code; for each bit, the best word with a 1 minus the best with a 0."""
    if line_code == "8b10b":
        # The next word after disparity +1 has its other form.
        unbalanced = next(value for value in range(256) if _encode_8b10b([value]).count("1") != 5)
        forms = [[_encode_8b10b([value]), _encode_8b10b([unbalanced, value])[10:]] for value in range(256)]
    else:
        forms = [[word] for word in _words(line_code)]
    table = np.array([[[int(chip) for chip in word] for word in form] for form in forms], float)
    chips = np.asarray(llr, float).reshape(-1, table.shape[2])
    scores = np.einsum("vfc,wc->wvf", table, chips).max(axis=2)
    count = len(forms).bit_length() - 1
    ones = np.arange(len(forms))[:, np.newaxis] >> np.arange(count)[::-1] & 1
    bits = [scores[:, ones[:, k] == 1].max(1) - scores[:, ones[:, k] == 0].max(1) for k in range(count)]
    known = {tuple(word) for form in table.astype(int).tolist() for word in form}
    hard = [tuple(word) in known for word in (chips > 0).astype(int).tolist()]
    return np.stack(bits, axis=1).ravel(), (chips != 0).all(axis=1) & ~np.array(hard, bool)


def _product(a: int, b: int) -> int:
    """Product in GF(256) modulo x^8 + x^4 + x^3 + x^2 + 1, by shift and add."""
    result = 0
    for bit in range(8):
        if b >> bit & 1:
            result ^= a << bit
    for bit in range(14, 7, -1):
        if result >> bit & 1:
            result ^= 0x11D << (bit - 8)
    return result


def _codeword(data: Sequence[int]) -> list[int]:
    """Data and the remainder of its division by the product of x - alpha^j, j = 0 ... 254 - len(data)."""
    generator, root = [1], 1
    for _ in range(255 - len(data)):
        shifted, scaled = [*generator, 0], [0, *(_product(value, root) for value in generator)]
        generator = [a ^ b for a, b in zip(shifted, scaled, strict=True)]
        root = _product(root, 2)
    rest = [*data, *[0] * (255 - len(data))]
    for k in range(len(data)):
        factor = rest[k]
        for j, value in enumerate(generator):
            rest[k + j] ^= _product(factor, value)
    return [*data, *rest[len(data) :]]


def _header(block: int, number: int, length: int) -> int:
    digits = f"{length:04o}"
    fields = f"{block:08b}{number & 1}{int(digits[block % 4]):03b}"
    rest = [int(bit) for bit in fields + "0000"]
    for k in range(12):
        if rest[k]:
            for j, bit in enumerate((1, 0, 0, 1, 1)):
                rest[k + j] ^= bit
    return int(fields + "".join(map(str, rest[12:])), 2) ^ _MASK


def _pn9(bits: int) -> list[int]:
    sequence = [1] * 9
    while len(sequence) < bits:
        sequence.append(sequence[-5] ^ sequence[-9])
    return sequence[:bits]


def longest_payload(*, format: PacketFormat | None = None) -> int:
    """Bounded by 256 blocks per cycle, 170 bytes of data per codeword and four octal digits of length."""
    return min(4095, 170 * (256 * (format or PacketFormat()).block_bytes // 255) - 5)


def transmit(payload: bytes | npt.ArrayLike, *, format: PacketFormat | None = None, number: int = 0) -> Transmission:
    """Encode the format of docs/reference/packets.md step by step."""
    format = format or PacketFormat()
    block_bytes = format.block_bytes
    content = bytes(payload) if isinstance(payload, bytes) else np.asarray(payload, np.uint8).tobytes()
    data = bytes([number]) + content
    data += zlib.crc32(data).to_bytes(4, "big")
    codewords = min(-(-len(data) // 85), 256 * block_bytes // 255)
    size = -(-len(data) // codewords)
    data = data.ljust(codewords * size, b"\0")
    words = [_codeword(data[word::codewords]) for word in range(codewords)]
    blocks = max(-(-255 * codewords // block_bytes), 4)
    white = _pn9(8 * blocks * block_bytes)
    marks = {"standard": [0], "lengthened": [0, 1, 0]}[format.preamble]
    start = "".join(str(int(chip) ^ inverted) for inverted in marks for chip in _PREAMBLE)
    chips = ""
    for block in range(blocks):
        bits = f"{_header(block, number, len(content)):016b}"
        for position in range(block * block_bytes, (block + 1) * block_bytes):
            coded = position % (255 * codewords)
            symbol = coded // codewords
            value = words[(coded + symbol) % codewords][symbol]
            mask = int("".join(map(str, white[8 * position : 8 * position + 8])), 2)
            bits += f"{value ^ mask:08b}"
        chips += start + _encode(bits, format.line_code)
    levels = np.array([int(chip) for chip in chips], np.uint8)
    return Transmission(levels, content, number, format, codewords, size, blocks, len(levels) // blocks)


def fsk_demodulate(
    column: npt.ArrayLike, camera: Camera, tones: Sequence[float], *, amplitude: float | None = None
) -> tuple[int, npt.NDArray[np.float64]]:
    """Index of the most likely tone and ln p(rows | tone), maximum 0.

    Mean, slope, cosine and sine are fitted for each tone; r² is the energy explained beyond mean and slope. The noise
    is the residual of the strongest tone, without the search for other light. I0 is computed from its integral.
    """
    rows = np.asarray(column, dtype=float)
    count = len(rows)
    n = np.arange(count)
    plain = np.stack([np.ones(count), n - n.mean()], axis=1)
    left = rows - plain @ np.linalg.lstsq(plain, rows, rcond=None)[0]
    lengths = []
    for tone in tones:
        turn = 2 * np.pi * ((tone * camera.row_period * n) % 1.0)
        model = np.column_stack([plain, np.cos(turn), np.sin(turn)])
        fit = model @ np.linalg.lstsq(model, rows, rcond=None)[0]
        lengths.append(math.sqrt(max(float(left @ left) - float(((rows - fit) ** 2).sum()), 0.0)))
    strongest = int(np.argmax(lengths))
    variance = (float(left @ left) - lengths[strongest] ** 2) / (count - 4)
    exposure = camera.exposure or 0.0
    gains = [max(abs(float(np.sinc(tone * exposure))), 1e-3) for tone in tones]
    if amplitude is None:
        energy = max(lengths[strongest] ** 2 - 2 * variance, 0.0)
        amplitude = math.sqrt(energy / (count / 2)) / gains[strongest]
    turn = (np.arange(4096) + 0.5) * np.pi / 4096
    likelihoods = []
    for length, gain in zip(lengths, gains, strict=True):
        expected = amplitude * gain * math.sqrt(count / 2)
        x = expected * length / variance
        log_i0 = x + math.log(float(np.mean(np.exp(x * (np.cos(turn) - 1)))))
        likelihoods.append(log_i0 - expected**2 / (2 * variance))
    array = np.array(likelihoods)
    return int(np.argmax(array)), array - array.max()


def fsk_symbol_error_rate(tones: int, snr: float) -> float:
    """Binomial sum, term by term; loses precision beyond 32 tones."""
    others = range(1, tones)
    signs = [(-1.0) ** (k + 1) * math.comb(tones - 1, k) / (k + 1) for k in others]
    return math.fsum(sign * math.exp(-k / (k + 1) * snr) for sign, k in zip(signs, others, strict=True))
