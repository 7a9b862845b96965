"""Checks of the values of a scene, by name."""

from __future__ import annotations

import math
from typing import Any

from ocisac_fast.core.checks import one_of, shown


def number(
    name: str,
    value: Any,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    open_low: bool = False,
) -> float:
    """Return a finite number in [low, high], or above ``low`` if ``open_low``, else raise ValueError."""
    good = isinstance(value, (int, float)) or hasattr(value, "__float__")
    held = float(value) if good and not isinstance(value, (str, bool)) else math.nan
    if not math.isfinite(held) or held > high or held < low or (open_low and held == low):
        ends = [f"above {low:g}" if open_low else f"{low:g} or above"] if low > -math.inf else []
        ends += [f"up to {high:g}"] if high < math.inf else []
        raise ValueError(f"{name}: got {shown(value)}, allowed: a finite number{''.join(f', {end}' for end in ends)}")
    return held


def whole(name: str, value: Any, low: int, high: int) -> int:
    """Return a whole number in [low, high], else raise ValueError."""
    if isinstance(value, bool) or not hasattr(value, "__index__") or not low <= value <= high:
        raise ValueError(f"{name}: got {shown(value)}, allowed: a whole number from {low} to {high}")
    return int(value)


def numbers(name: str, values: Any, count: int) -> tuple[float, ...]:
    """Return ``count`` finite numbers, else raise ValueError."""
    try:
        held = tuple(values)
    except TypeError:
        held = ()
    if isinstance(values, str) or len(held) != count:
        raise ValueError(f"{name}: got {shown(values)}, allowed: {count} finite numbers")
    return tuple(number(name, value) for value in held)


def instance(name: str, value: object, kinds: type | tuple[type, ...]) -> None:
    """Raise ValueError unless the value has one of the given types."""
    if not isinstance(value, kinds):
        names = kinds.__name__ if isinstance(kinds, type) else one_of(kind.__name__ for kind in kinds)
        raise ValueError(f"{name}: got {shown(value)}, allowed: {names}")


def hold(target: object, **values: object) -> None:
    """Set attributes of a frozen object during its construction."""
    for name, value in values.items():
        object.__setattr__(target, name, value)
