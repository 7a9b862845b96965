"""Options that `ocisac receive`, ocisac-rx, its man page and the GStreamer element share: no name, sentence, range or
default differs."""

from __future__ import annotations

import re
from pathlib import Path

import click
import pytest

from ocisac_fast.cli.receive import receive
from ocisac_fast.packets.transmission import LINE_CODES, PacketFormat
from ocisac_fast.receiver import GainOptions

CPP = Path(__file__).parents[2] / "cpp"
SETTINGS = (CPP / "apps" / "settings.cpp").read_text(encoding="utf-8")
MANUAL = (CPP / "apps" / "ocisac-rx.1").read_text(encoding="utf-8").replace("\\-", "-")
ELEMENT = "".join((CPP / "gstreamer" / name).read_text(encoding="utf-8") for name in ("ocisacrx.c", "shared.c"))
PROGRAM = set(re.findall(r'(?:add_option|add_flag|set_config)\("--([\w-]+)"', SETTINGS))
PROPERTIES = set(re.findall(r'"([a-z]+(?:-[a-z]+)*)",\s*(?:NULL, )?"[^"]*[ ,][^"]*"', ELEMENT))
COMMAND = {name.removeprefix("--"): one for one in receive.params for name in one.opts if name.startswith("--")}

SHARED = {"chip-rate", "line-code", "block-bytes", "frame-rate", "sources", "frequency", "row-time", "exposure"}
SHARED |= {"scan-axis", "region", "waveform", "duty", "tone-curve", "dark-level", "white-level"}


def test_names_are_the_same_everywhere() -> None:
    assert COMMAND.keys() & PROGRAM == SHARED
    assert PROGRAM - {"version"} <= set(re.findall(r"--([a-z-]+)", MANUAL))
    assert SHARED <= PROPERTIES
    assert {"gamma", "post-messages"} >= PROPERTIES - PROGRAM


@pytest.mark.parametrize("name", sorted(SHARED))
def test_sentences_begin_the_same_everywhere(name: str) -> None:
    """The rest depends on the program: where an unknown value comes from, and how it is written."""
    found = re.search(rf'"{name}",\s*(?:NULL, )?"([^",;]*)', ELEMENT)
    assert found
    sentence = re.escape(found[1])
    assert re.search(rf'"--{name}", [^"]*"{sentence}\b', SETTINGS)
    assert re.search(rf"--{name}\b.*\n{sentence}\b", MANUAL)
    if name != "region":  # the command reads no other pixels, in which it searches lights
        assert re.match(rf"{sentence}\b", vars(COMMAND[name])["help"])


def range_of(name: str) -> list[float]:
    """Lowest, highest and default value of the element's property."""
    found = re.search(rf'"{name}", (?:NULL, )?"[^"]*",\s*([^)]*?)(?:, flags)?\)', ELEMENT)
    assert found
    return [float(number) for number in re.findall(r"-?[\d.]+", found[1])]


def test_ranges_and_defaults_are_the_same_everywhere() -> None:
    sources = COMMAND["sources"]
    assert isinstance(sources.type, click.IntRange)
    assert range_of("sources") == [sources.type.min, sources.type.max, sources.default]
    assert range_of("block-bytes") == [1, 255, PacketFormat().block_bytes]
    with pytest.raises(ValueError, match="block_bytes: got 256, allowed: 1 to 255"):
        PacketFormat(block_bytes=256)
    assert re.search(r'"duty", "[^"]*", 1, 0\.5}', ELEMENT)
    assert COMMAND["duty"].default == GainOptions().duty == 0.5
    assert re.search(r"OCISAC_MANCHESTER\);", ELEMENT)
    assert PacketFormat().line_code == "manchester"


@pytest.mark.parametrize("name", ["line-code", "waveform", "scan-axis"])
def test_choices_are_the_same_everywhere(name: str) -> None:
    """The command may find the axis by itself."""
    kind = COMMAND[name].type
    assert isinstance(kind, click.Choice)
    choices = [str(choice) for choice in kind.choices if choice != "auto"]
    option = SETTINGS[SETTINGS.index(f'"--{name}"') :]
    assert set(choices) == set(re.findall(r'"([\w-]+)"', option[option.index("->transform") :].partition(";")[0]))
    values = re.findall(r'\{OCISAC_\w+, "[^"]*", "([\w-]+)"\}', ELEMENT)
    assert set(choices) <= set(values)


def test_line_codes_are_those_of_the_command() -> None:
    assert tuple(COMMAND["line-code"].type.choices) == tuple(LINE_CODES)
