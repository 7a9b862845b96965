"""The grammar of all public names: data first, camera second, everything else by keyword, few arguments, one unit.

Names are read from the rooms, so that new ones are tested without an entry here. Classes whose docstring lists
``Attributes:`` are results of the library; users make all others, and their constructors follow the grammar.
"""

from __future__ import annotations

import enum
import importlib
import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
ARCHITECTURE = ROOT / "docs" / "reference" / "architecture.md"
ROOMS = re.findall(r"^\| `(\w+)` \|", ARCHITECTURE.read_text(encoding="utf-8"), re.MULTILINE)

NAMELESS = ("device", "web", "rows", "columns", "smoke")  # without Python names
NAMED = [room for room in ROOMS if room not in NAMELESS]
GRAMMAR = [room for room in NAMED if room not in ("cli", "reference")]  # nor programs, nor twins

MAX_ARGUMENTS = 10  # tone_gain has 10, all in the table of names that others rely on
MAX_POSITIONAL = 3  # data, camera, and what the function is named after: a frequency, a channel, rows

# Optional arguments that are natural without their name: what the class is, or a frequency as in tone_gain.
NATURAL = {
    "Camera": {"exposure", "frame_time"},
    "mains_lights": {"frequencies"},
    "tone_columns": {"frequency"},
    "sense_region": {"frequency"},
    "ExposureMeasurement": {"lights", "motions"},
    "Ambient": {"intensity"},
    "PathLoss": {"exponent"},
    "Plain": {"level"},
    "Pose": {"position", "rotation"},
}
OLD = re.compile(r"(^|_)(least(?!_squares)|most)(_|$)")


def public(room: str) -> Iterator[tuple[str, Any]]:
    """Names and values of a room that are defined in it."""
    module = importlib.import_module(f"ocisac_fast.{room}")
    for name in getattr(module, "__all__", vars(module)):
        value = getattr(module, name)
        if not name.startswith("_") and getattr(value, "__module__", "").startswith(module.__name__):
            yield name, value


def is_result(value: Any) -> bool:
    """True for what users do not construct: results, flags, errors, protocols."""
    return inspect.isclass(value) and (
        "Attributes:" in (value.__doc__ or "")
        or issubclass(value, (enum.Enum, BaseException))
        or getattr(value, "_is_protocol", False)
    )


def callables() -> Iterator[Any]:
    """Functions, methods and the constructors of classes that users make, of all rooms but the twins'."""
    for room in GRAMMAR:
        for name, value in public(room):
            if inspect.isclass(value):
                for method, function in vars(value).items():
                    function = getattr(function, "__func__", function)
                    if inspect.isfunction(function) and not method.startswith("_"):
                        yield pytest.param(f"{name}.{method}", function, id=f"{room}.{name}.{method}")
            if callable(value) and not is_result(value):
                yield pytest.param(name, value, id=f"{room}.{name}")


def parameters(function: Callable[..., Any]) -> list[inspect.Parameter]:
    every = inspect.signature(function).parameters.values()
    return [one for one in every if one.name not in ("self", "cls")]


CALLABLES = list(callables())


@pytest.mark.parametrize(("name", "function"), CALLABLES)
def test_a_call_follows_the_grammar(name: str, function: Callable[..., Any]) -> None:
    every = parameters(function)
    names = [one.name for one in every]
    assert len(every) <= MAX_ARGUMENTS
    assert not [one for one in names if OLD.search(one)], "min_ and max_"
    assert not [one.name for one in every if one.kind in (one.VAR_POSITIONAL, one.VAR_KEYWORD)]
    assert "camera" not in names[2:], "the camera is second, after the data, or first"
    positional = [one for one in every if one.kind is not one.KEYWORD_ONLY]
    assert len(positional) <= MAX_POSITIONAL
    optional = {one.name for one in positional if one.default is not one.empty}
    assert optional <= NATURAL.get(name, set()), "optional arguments are given by keyword"


@pytest.mark.parametrize("room", NAMED)
def test_no_public_name_is_of_the_old_grammar(room: str) -> None:
    for name, value in public(room):
        fields = [] if not inspect.isclass(value) else [one for one in vars(value) if not one.startswith("_")]
        assert not [one for one in (name, *fields) if OLD.search(one)]


def entries(value: Any) -> dict[str, str]:
    """Names in the sections Args and Attributes of a docstring, and their text."""
    text = inspect.getdoc(value) or ""
    found = re.findall(r"^ {4}(\w[\w, ]*): (.*(?:\n {8}.*)*)", text, re.MULTILINE)
    return {name: entry for names, entry in found for name in names.split(", ")}


@pytest.mark.parametrize("room", GRAMMAR)
def test_an_exposure_is_in_seconds_unless_its_name_says_rows(room: str) -> None:
    for name, value in public(room):
        for parameter, text in entries(value).items():
            if parameter in ("exposure", "exposures"):
                assert re.search(r"\b(s|seconds)\b", text), f"{name}: {parameter}: {text}"
            if parameter == "exposure_rows":
                assert "rows" in text, f"{name}: {parameter}: {text}"


def option_classes() -> list[Any]:
    """Frozen classes that group options: every field has a default."""
    return [
        pytest.param(value, id=name)
        for room in GRAMMAR
        for name, value in public(room)
        if hasattr(value, "__dataclass_fields__")
        and not is_result(value)
        and parameters(value)
        and all(one.kind is one.KEYWORD_ONLY for one in parameters(value))
    ]


@pytest.mark.parametrize("kind", option_classes())
def test_classes_of_options_document_every_field(kind: Any) -> None:
    assert set(entries(kind)) >= {one.name for one in parameters(kind)}


def test_the_exceptions_exist() -> None:
    known = {one.values[0]: one.values[1] for one in CALLABLES}
    for name, natural in NATURAL.items():
        assert natural <= {one.name for one in parameters(known[name])}, name
