"""Numbers with units on the command line."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from ocisac_fast.core.checks import shown

if TYPE_CHECKING:
    ParameterType = click.ParamType[Any]
else:  # generic only for type checkers
    ParameterType = click.ParamType


@dataclasses.dataclass(eq=False)
class Parsed(ParameterType):
    """The value that ``parse`` makes of a word; a word that is not ``allowed`` is an error that says so."""

    name: str
    _parse: Callable[[str], Any]
    _allowed: str

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not isinstance(value, str):
            return value
        try:
            return self._parse(value)
        except (ValueError, ZeroDivisionError, OverflowError):
            self.fail(f"got {shown(value)}, allowed: {self._allowed}")


_PREFIXES = {"": 1.0, "p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9}
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_QUANTITY = re.compile(rf"\s*({_NUMBER})(?:/({_NUMBER}))?\s*([a-zA-Zµμ]*)\s*")


class Quantity(float):
    """A number in SI units; ``has_unit`` is True if the unit was written."""

    has_unit: bool = False

    @classmethod
    def parse(cls, text: str, unit: str) -> Quantity:
        """Parse ``9.2us``, ``1/8000s``, ``4.95kHz`` or a plain number.

        Raises:
            ValueError: not a number of this form.
        """
        match = _QUANTITY.fullmatch(text)
        if match is None:
            return cls(float(text))  # the caller checks inf
        number, divisor, written = match.groups()
        value = float(number) / float(divisor or 1.0)
        if not written:
            return cls(value)
        prefix = written[: -len(unit)]
        if not written.lower().endswith(unit.lower()) or prefix not in _PREFIXES:
            raise ValueError(f"unit {written!r}")
        factor = _PREFIXES[prefix]  # a fractional one divides: 622us is the number nearest to 622e-6
        quantity = cls(value * factor if factor >= 1.0 else value / round(1.0 / factor))
        quantity.has_unit = True
        return quantity


@dataclasses.dataclass(eq=False)
class QuantityType(ParameterType):
    """A number of a unit, of at most ``most``, or ``positive``; with ``automatic``, also ``"auto"``."""

    name: str
    example: str
    automatic: bool = False
    most: float = math.inf
    positive: bool = False

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, Quantity):
            return value
        if self.automatic and str(value).lower() == "auto":
            return "auto"
        try:
            quantity = Quantity.parse(str(value), self.name)
            if math.isnan(quantity):
                raise ValueError("not a number")
        except (ValueError, ZeroDivisionError, OverflowError):
            auto = " or auto" if self.automatic else ""
            self.fail(f"got {shown(value)}, allowed: a number with or without unit, such as {self.example}{auto}")
        if quantity > self.most:
            hint = "" if quantity.has_unit else f"; {value} without a unit is in {self.name}, {value}us may be meant"
            self.fail(f"got {float(quantity):g} {self.name}, allowed: at most {self.most:g} {self.name}{hint}")
        if self.positive and not 0.0 < quantity < math.inf:
            self.fail(f"got {float(quantity):g} {self.name}, allowed: a finite number above 0")
        return quantity


TIME = QuantityType("s", "9.2us")
ROW_TIME = QuantityType("s", "9.2us", most=1.0)  # longer: a forgotten unit
LENGTH = QuantityType("m", "0.3mm")
FREQUENCY = QuantityType("Hz", "4.95kHz")
RATE = QuantityType("Hz", "30Hz", positive=True)
FREQUENCY_OR_AUTO = QuantityType("Hz", "4.95kHz", automatic=True)


def share(text: str) -> float:
    """Parse a share: ``0.02``, ``2%`` or ``1/32``."""
    number, slash, divisor = text.rstrip("%").partition("/")
    return float(number) / (float(divisor) if slash else 1.0) / (100.0 if text.endswith("%") else 1.0)


SHARE = Parsed("SHARE", share, "a share such as 0.02, 2% or 1/50")
_MOST_VALUES = 10_000
_RANGE = f"LOW..HIGH:COUNT, such as 10us..11ms:50, 0 < LOW < HIGH, COUNT 2 to {_MOST_VALUES}"
_WIDE = 10.0  # ratio of the ends above which values are in equal ratios


def spread_over(low: float, high: float, count: int) -> list[float]:
    """``count`` values from ``low`` to ``high``, at equal distances; in equal ratios where the ends differ tenfold."""
    if not 0.0 < low < high or not 2 <= count <= _MOST_VALUES:
        raise ValueError(f"range: got {low:g}..{high:g}:{count}, allowed: {_RANGE}")
    return [float(one) for one in (np.geomspace if high > _WIDE * low else np.linspace)(low, high, count)]


@dataclasses.dataclass(eq=False)
class Several(ParameterType):
    """Values of one type, separated by commas; ``count``: how many, if not any number.

    Without ``count``, ``LOW..HIGH:COUNT`` stands for as many values between. With two, ``LOW..HIGH`` for both.
    """

    single: ParameterType
    name: str
    count: int | None = None

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value

        def one(text: str) -> Any:
            return self.single.convert(text.strip(), param, ctx)

        parts = str(value).replace("..", ",").split(",") if self.count == 2 else str(value).split(",")
        if self.count not in (None, len(parts)):
            self.fail(f"got {shown(value)}, allowed: {self.name}")
        return tuple(each for part in parts for each in self._values(part, one))

    def _values(self, part: str, one: Callable[[str], Any]) -> list[Any]:
        low, dots, rest = part.partition("..")
        if not dots:
            return [one(part)]
        high, _, count = rest.partition(":")
        try:
            return [Quantity(each) for each in spread_over(one(low), one(high), int(count))]
        except ValueError:
            self.fail(f"got {shown(part)}, allowed: {_RANGE}")


FREQUENCIES = Several(FREQUENCY, "Hz,Hz,...")
TIMES = Several(TIME, "TIME,...")
SHARES = Several(SHARE, "SHARE,...")
