"""Flickering lights on the command line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ocisac_fast.cli.units import ParameterType, Quantity, Several
from ocisac_fast.core.checks import shown

if TYPE_CHECKING:
    from ocisac_fast.exposure import FlickeringLight

_MAINS = {"mains": (50.0, 60.0), "mains50": (50.0,), "mains60": (60.0,)}


def _light(text: str) -> FlickeringLight:
    """Parse ``100Hz``, ``100Hz+-1%``, ``100Hz+-0.5Hz``, ``90Hz:square``, ``90Hz+-1%:0.1``."""
    from ocisac_fast.exposure import FlickeringLight

    tone, _, shape = text.partition(":")
    number, _, spread = tone.replace("±", "+-").partition("+-")
    frequency = Quantity.parse(number, "Hz")
    share = spread.endswith("%")
    uncertainty = Quantity.parse(spread.rstrip("%") or "0", "Hz") * (frequency / 100.0 if share else 1.0)
    duty = {"": None, "square": 0.5}[shape] if shape in ("", "square") else percentage(shape)
    return FlickeringLight(float(frequency), uncertainty=float(uncertainty), duty=duty)


def percentage(text: str) -> float:
    """Parse a share: ``0.02`` or ``2%``."""
    return float(text[:-1]) / 100.0 if text.endswith("%") else float(text)


class _Lights(ParameterType):
    name = "LIGHT,..."

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        from ocisac_fast.exposure import mains_lights

        lights: list[FlickeringLight] = []
        for part in str(value).split(","):
            text = part.strip()
            try:
                lights += mains_lights(_MAINS[text]) if text in _MAINS else [_light(text)]
            except (ValueError, ZeroDivisionError, OverflowError) as error:
                reason = f" ({error})" if ": got" in str(error) else ""
                self.fail(
                    f"got {shown(text)}{reason}, allowed: 100Hz, 100Hz+-1%, 90Hz:square, 90Hz:0.1 (its duty), mains"
                )
        return tuple(lights)


class _Share(ParameterType):
    name = "SHARE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, float):
            return value
        try:
            return percentage(str(value))
        except ValueError:
            self.fail(f"got {shown(value)}, allowed: a share such as 0.02 or 2%")


LIGHTS = _Lights()
SHARE = _Share()
SHARES = Several(SHARE, "SHARE,...")


def light_name(light: FlickeringLight) -> str:
    """The light in the syntax of the command line."""
    spread = f"+-{light.uncertainty:g}Hz" if light.uncertainty else ""
    return f"{light.frequency:g}Hz{spread}" + ("" if light.duty is None else f":{light.duty:g}")
