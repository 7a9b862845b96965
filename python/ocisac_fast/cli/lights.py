"""Flickering lights on the command line."""

from __future__ import annotations

import itertools
from typing import Any

import click

from ocisac_fast.cli.units import ParameterType, Quantity, share, spread_over
from ocisac_fast.core.checks import shown
from ocisac_fast.exposure import FlickeringLight, mains_lights

_MAINS = {"mains": (50.0, 60.0), "mains50": (50.0,), "mains60": (60.0,)}
_VALUES = 5  # of a range without a count
_ALLOWED = "100Hz, 100Hz+-1%, 90Hz:square, 90Hz:0.1 (its duty), 90Hz..200Hz:5%..50%, mains"


class _Lights(ParameterType):
    """Lights; ``whole``: a range of frequencies is one light of any of them, and of duties the smallest.

    Otherwise a range is five values, or the number behind it: ``90Hz..200Hz:12:5%..50%:4``.
    """

    name = "LIGHT,..."

    def __init__(self, whole: bool) -> None:
        self._whole = whole

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        lights: list[FlickeringLight] = []
        for part in str(value).split(","):
            text = part.strip()
            try:
                lights += mains_lights(_MAINS[text]) if text in _MAINS else self._lights(text)
            except (ValueError, ZeroDivisionError, OverflowError) as error:
                reason = f" ({error})" if ": got" in str(error) else ""
                self.fail(f"got {shown(text)}{reason}, allowed: {_ALLOWED}")
        return tuple(lights)

    def _lights(self, text: str) -> list[FlickeringLight]:
        """Lights of one text: a frequency or a range, then a duty or a range, each with a count where one is given."""
        tone, *more = text.split(":")
        count = more.pop(0) if ".." in tone and more and more[0].isdecimal() else ""
        shape, duties = [*more, "", ""][:2]
        if len(more) > 2 or (duties and ".." not in shape):
            raise ValueError(text)
        shapes = [None if not shape else 0.5] if shape in ("", "square") else self._shares(shape, duties)
        return [
            FlickeringLight(frequency, uncertainty=uncertainty, duty=duty)
            for (frequency, uncertainty), duty in itertools.product(self._frequencies(tone, count), shapes)
        ]

    def _shares(self, text: str, count: str) -> list[float]:
        low, dots, high = text.partition("..")
        if not dots or (self._whole and not count):
            return [share(low)]
        return spread_over(share(low), share(high), int(count or _VALUES))

    def _frequencies(self, text: str, count: str) -> list[tuple[float, float]]:
        """Frequencies and uncertainties, Hz."""
        first, dots, last = text.partition("..")
        if not dots:
            number, _, spread = text.replace("±", "+-").partition("+-")
            frequency = float(Quantity.parse(number, "Hz"))
            scale = frequency / 100.0 if spread.endswith("%") else 1.0
            return [(frequency, float(Quantity.parse(spread.rstrip("%") or "0", "Hz")) * scale)]
        low, high = (float(Quantity.parse(end, "Hz")) for end in (first, last))
        if self._whole and not count:
            return [(0.5 * (low + high), 0.5 * (high - low))]
        return [(each, 0.0) for each in spread_over(low, high, int(count or _VALUES))]


LIGHTS = _Lights(whole=False)
LIGHTS_TO_AVOID = _Lights(whole=True)


def light_name(light: FlickeringLight) -> str:
    """The light in the syntax of the command line."""
    spread = f"+-{light.uncertainty:g}Hz" if light.uncertainty else ""
    return f"{light.frequency:g}Hz{spread}" + ("" if light.duty is None else f":{light.duty:g}")
