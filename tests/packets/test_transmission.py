"""Line codes, packets and their way back: agreement with the reference, loss, corruption, test vectors, refusals."""

import pathlib
import shutil
import subprocess
import zlib

import numpy as np
import pytest
import reedsolo
from hypothesis import given, settings, strategies as st

import ocisac_fast as ocisac
from ocisac_fast import reference
from ocisac_fast.packets import PacketFormat, decode_line_code, encode_line_code
from ocisac_fast.reference.packets import _codeword

DOCUMENT = pathlib.Path(__file__).parents[2] / "docs" / "reference" / "packets.md"
TABLE = ("00110", "01010", "01100", "10010")
CODES = ("none", "manchester", "4b6b", "8b10b", TABLE)
CERTAIN = 20.0  # nats


def soft(chips, certainty=CERTAIN):
    return certainty * (2.0 * chips - 1.0)


def longest_run(chips):
    return np.diff(np.flatnonzero(np.diff(chips)), prepend=-1, append=len(chips) - 1).max()


@given(code=st.sampled_from(CODES), words=st.lists(st.integers(0, 255), max_size=40), noise=st.floats(0, 40))
@settings(max_examples=2 * settings.default.max_examples // 5)
def test_line_codes_agree_with_the_reference(code, words, noise):
    bits = np.unpackbits(np.array(words, np.uint8))
    chips = encode_line_code(bits, code)
    np.testing.assert_array_equal(chips, reference.encode_line_code(bits, code))
    if not words:
        return
    llr = soft(chips) + noise * np.random.default_rng(len(words)).standard_normal(len(chips))
    llr[np.abs(llr) < 5] = 0
    for got, expected in zip(decode_line_code(llr, code), reference.decode_line_code(llr, code), strict=True):
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12 * CERTAIN * 40)


@pytest.mark.parametrize(("code", "longest"), [("manchester", 2), ("4b6b", 4), ("8b10b", 5)])
def test_runs_stay_below_those_of_the_preamble_and_the_mean_is_half(code, longest):
    values = np.random.default_rng(1).integers(0, 256, 30_000, dtype=np.uint8)
    chips = encode_line_code(np.unpackbits(values), code)
    assert longest_run(chips) == longest
    assert abs(np.cumsum(2 * chips.astype(int) - 1)).max() <= 4


@given(
    payload=st.binary(min_size=1, max_size=60),
    code=st.sampled_from(CODES),
    block_bytes=st.integers(1, 255),
    preamble=st.sampled_from(["standard", "lengthened"]),
    number=st.integers(0, 255),
)
@settings(max_examples=2 * settings.default.max_examples // 25)
def test_transmit_agrees_with_the_reference(payload, code, block_bytes, preamble, number):
    packets = PacketFormat(line_code=code, block_bytes=block_bytes, preamble=preamble)
    longest = ocisac.longest_payload(format=packets)
    assert longest == reference.longest_payload(format=packets)
    sent = ocisac.transmit(payload[:longest], number=number, format=packets)
    expected = reference.transmit(payload[:longest], number=number, format=packets)
    np.testing.assert_array_equal(sent.chips, expected.chips)
    for name in ("payload", "number", "format", "codewords", "codeword_data", "blocks", "block_chips"):
        assert getattr(sent, name) == getattr(expected, name)
    assert sent.waveform(8e3) == ocisac.Chips(expected.chips, 8e3, repeat=True)


@pytest.mark.parametrize("data", [1, 17, 84, 170])
def test_the_code_is_that_of_an_independent_library(data):
    content = np.random.default_rng(data).integers(0, 256, data).tolist()
    assert _codeword(content) == list(reedsolo.RSCodec(255 - data).encode(content))


def test_vectors_of_the_document():
    rows = [line.split("|")[1:-1] for line in DOCUMENT.read_text().split("## Test vectors")[1].splitlines()[4:]]
    assert len(rows) == 6
    for payload, code, block_bytes, preamble, number, chips, checksum, first in (map(str.strip, row) for row in rows):
        content = bytes(range(256)) * 4 if "four times" in payload else bytes.fromhex(payload)
        line_code = code.split() if " " in code else code
        packets = PacketFormat(line_code=line_code, block_bytes=int(block_bytes), preamble=preamble)
        sent = ocisac.transmit(content, format=packets, number=int(number))
        text = "".join(map(str, sent.chips.tolist()))
        assert (len(text), f"{zlib.crc32(text.encode()):08x}") == (int(chips), checksum)
        assert text.startswith(first)


def test_the_command_writes_every_kind_of_file(tmp_path, run, facts):
    payload = tmp_path / "payload.bin"
    payload.write_bytes(b"OC-ISAC")
    sent = ocisac.transmit(b"OC-ISAC", format=PacketFormat(line_code="4b6b"), number=3)
    text = "".join(map(str, sent.chips.tolist()))
    options = ("transmit", payload, "--line-code", "4b6b", "--number", 3, "--chip-rate", "8kHz")
    assert run(*options) == (0, [text], [])
    for suffix in ("txt", "npy", "csv", "h"):
        assert facts(*options, "-o", tmp_path / f"chips.{suffix}")[0]["chips"] == len(text)
    assert (tmp_path / "chips.txt").read_text() == text + "\n"
    np.testing.assert_array_equal(np.load(tmp_path / "chips.npy"), sent.chips)
    times, levels = np.loadtxt(tmp_path / "chips.csv", delimiter=",", skiprows=1).T
    np.testing.assert_array_equal(levels, sent.chips)
    np.testing.assert_allclose(times, np.arange(len(text)) / 8000)
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    program = tmp_path / "chips.c"
    program.write_text(
        '#include <stdio.h>\n#include "chips.h"\nint main(void) { for (unsigned long k = 0; k < OCISAC_CHIP_COUNT; ++k)'
        ' putchar("01"[ocisac_chips[k >> 3] >> (7 - (k & 7)) & 1]); return OCISAC_CHIP_RATE_HZ != 8000.0; }\n'
    )
    subprocess.run([compiler, "-Wall", "-Werror", "-o", tmp_path / "chips", program], check=True)
    assert subprocess.run([tmp_path / "chips"], capture_output=True, check=True).stdout.decode() == text


def test_the_command_takes_text_and_tables_and_refuses_nonsense(run, facts):
    (found,) = facts("transmit", "--text", "hi", "--code-table", "01,10")
    assert found["levels"] == "".join(map(str, ocisac.transmit(b"hi").chips.tolist()))
    assert found["payload_bytes"] == 2
    for arguments, message in (
        (["--text", "hi", "-o", "a.wav"], "--output: got a.wav, allowed: a file that ends in .txt, .npy, .csv, .h"),
        ([], "needs FILE or --text, and not both"),
        (["--text", ""], "payload: got 0 bytes, allowed: 1 to 2715 bytes"),
        (["--text", "hi", "--chip-rate", "0"], "'--chip-rate': got 0 Hz, allowed: a finite number above 0"),
    ):
        code, _, (line,) = run("transmit", *arguments)
        assert code == 2
        assert message in line
